//! What all pages share: one self-contained file, its style, its figures.

pub(crate) mod chart;
pub(crate) mod document;
pub(crate) mod figure;
