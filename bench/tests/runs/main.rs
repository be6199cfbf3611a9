//! The verbs of the bench and its runs in virtual time: a file for each, in one program, since every program links the
//! whole bench again. What needs a network or a browser, or counts the allocations of its process, stands beside this
//! folder.

#![expect(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

mod failure;
mod program;
mod study_calls;

mod altered_image;
mod altered_run;
mod applications;
mod arguments;
mod broken_files;
mod calibrate;
mod captures;
mod causes;
mod cells;
mod columns;
mod command_line;
mod corrupted;
mod device_file;
mod drives;
mod explore;
mod exported_code;
mod exported_fields;
mod foreign_devices;
mod from_capture;
mod gate;
mod import_samples;
mod kept_files;
mod key_reference;
mod list_lengths;
mod report;
mod studies;
mod study_cells;
mod study_engine;
mod study_report;
mod sweep;
mod verb_exports;
mod virtual_run;
