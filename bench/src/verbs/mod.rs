//! The bench's verbs, a module each with its options.

#[cfg(all(feature = "real", target_os = "linux"))]
pub mod doctor;
pub mod gate;
pub mod history;
pub mod install;
pub mod measure;
pub mod new;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod overhead;
pub mod report;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod scale;
pub mod study;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod timing;
