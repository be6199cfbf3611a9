//! What all pages share: one self-contained file with its style and its figures.

pub(crate) mod chart;
pub(crate) mod document;
pub(crate) mod figure;
