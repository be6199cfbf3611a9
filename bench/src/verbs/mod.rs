//! The bench's verbs, a module each with its options.

#[cfg(all(feature = "real", target_os = "linux"))]
pub mod doctor;
pub mod from_capture;
pub mod gate;
pub mod history;
pub mod import_samples;
pub mod install;
pub mod measure;
mod measured_elsewhere;
pub mod new;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod overhead;
pub mod report;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod scale;
pub mod study;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod timing;
