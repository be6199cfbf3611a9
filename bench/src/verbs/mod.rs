//! The bench's verbs, a module each with its options.

pub mod buses;
pub mod calibrate;
mod directory;
pub mod doctor;
mod each_bus;
mod event_loop;
pub mod explore;
pub mod gate;
pub mod history;
pub mod install;
mod jobs;
pub mod judge;
pub mod long;
pub mod measure;
pub mod new;
mod outputs;
pub mod overhead;
pub mod report;
pub mod sensitivity;
mod setup_option;
pub mod soak;
mod study;
pub mod sweep;
pub mod timing;
