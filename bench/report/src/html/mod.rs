//! What all pages share: one self-contained file with its style and its figures.

pub mod chart;
pub mod document;
pub mod figure;
