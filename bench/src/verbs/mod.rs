//! The bench's verbs, a module each with its options.

pub mod doctor;
pub mod gate;
pub mod history;
pub mod install;
pub mod measure;
pub mod new;
pub mod overhead;
pub mod report;
pub mod timing;
