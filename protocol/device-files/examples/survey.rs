//! Reads every file that is named, and prints a line with the outcome of each.

#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "the example reads files and measures"
)]

use std::process::ExitCode;
use std::time::Instant;

use device_files::DeviceFile;

fn main() -> ExitCode {
    for path in std::env::args().skip(1) {
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) => {
                eprintln!("{path}: {error}");
                return ExitCode::FAILURE;
            }
        };
        let start = Instant::now();
        let read = device_files::read(&path, bytes);
        let millis = start.elapsed().as_millis();
        let outcome = match &read {
            Ok(file) => format!("{}; {} warnings", summary(file), file.warnings().len()),
            Err(error) => format!("refused: {}", error.finding),
        };
        println!("{path}\t{millis} ms\t{outcome}");
    }
    ExitCode::SUCCESS
}

/// Counts what a file offers.
fn summary(file: &DeviceFile) -> String {
    match file {
        DeviceFile::Gsdml(file) => format!(
            "GSDML {}: {} access points, {} modules, {} submodules",
            file.schema_version,
            file.access_points.len(),
            file.modules.len(),
            file.submodules.len()
        ),
        DeviceFile::Eds(file) => format!(
            "EDS: {} parameters, {} assemblies, {} connections",
            file.parameters.len(),
            file.assemblies.len(),
            file.connections.len()
        ),
        DeviceFile::Esi(file) => {
            let objects = file.devices.iter().filter_map(|device| device.dictionary.as_ref());
            let objects: usize = objects.map(|dictionary| dictionary.objects.len()).sum();
            format!("ESI: {} devices, {} modules, {objects} objects", file.devices.len(), file.modules.len())
        }
    }
}
