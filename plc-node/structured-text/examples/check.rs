//! Checks files of Structured Text, in the order in which they are declared: prints the first mistake.
#![expect(clippy::disallowed_methods, reason = "an example reads its files itself")]

use std::process::ExitCode;

use structured_text::{Program, Source};

fn main() -> ExitCode {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let mut texts = Vec::new();
    for file in &files {
        match std::fs::read_to_string(file) {
            Ok(text) => texts.push(text),
            Err(error) => {
                eprintln!("{file}: {error}");
                return ExitCode::FAILURE;
            }
        }
    }
    let sources: Vec<_> = files.iter().zip(&texts).map(|(file, text)| Source { file, text }).collect();
    match Program::compile(&sources) {
        Ok(_) => ExitCode::SUCCESS,
        Err(mistake) => {
            eprintln!("{mistake}");
            ExitCode::FAILURE
        }
    }
}
