//! `plc-node describe`: lists what a device file offers.

mod eds;
mod esi;
mod gsdml;

use std::fmt::{self, Write as _};
use std::path::PathBuf;

use device_files::{DeviceCatalogue, DeviceFile, SCHEMA_VERSION};
use node::Outcome;
use node::device_options::read_device_file;
use node::errln;
use node::output::to_stdout;

use crate::printable::{FileText, printable};

/// A device file.
#[derive(clap::Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DescribeCommand {
    /// The file: a GSDML (PROFINET), an EDS (EtherNet/IP) or an ESI (EtherCAT).
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Print everything that the file says as JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  plc-node describe GSDML-V2.35-Maker-Device-20230101.xml
  plc-node describe device.eds --json | jq '.device.connections[].name'

A file is a catalogue: it lists access points, modules, connections or revisions to choose from.";

impl DescribeCommand {
    /// Prints the catalogue to standard output and the warnings to standard error.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let name = self.file.display().to_string();
        let device = read_device_file(&self.file)?;
        device
            .warnings()
            .iter()
            .for_each(|warning| errln!("warning: {name}:{}", printable(warning.to_string().as_bytes())));
        let text = if self.json {
            let file = self.file.file_name().map_or(name.clone(), |name| name.to_string_lossy().into_owned());
            let catalogue = DeviceCatalogue { schema_version: SCHEMA_VERSION, file, device };
            serde_json::to_string_pretty(&catalogue)? + "\n"
        } else {
            listing(&device)
        };
        to_stdout(format_args!("{text}"))?;
        Ok(Outcome::Done)
    }
}

/// Lists what a file offers.
fn listing(device: &DeviceFile) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = match device {
        DeviceFile::Gsdml(gsdml) => gsdml::list(&mut text, gsdml),
        DeviceFile::Eds(eds) => eds::list(&mut text, eds),
        DeviceFile::Esi(esi) => esi::list(&mut text, esi),
    };
    text
}

/// Bytes as hexadecimal digits; long ones end with their number.
struct Digits<'a>(&'a [u8]);

impl fmt::Display for Digits<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MOST: usize = 32;
        let shown = self.0.get(..MOST).unwrap_or(self.0);
        shown.iter().try_for_each(|byte| write!(formatter, "{byte:02x}"))?;
        if shown.len() < self.0.len() { write!(formatter, "... ({} bytes)", self.0.len()) } else { Ok(()) }
    }
}

/// Writes one line.
fn line(text: &mut String, indent: usize, words: fmt::Arguments<'_>) -> fmt::Result {
    let start = text.len();
    write!(text, "{:indent$}{words}", "")?;
    let end = text.trim_end_matches([' ', '\t']).len().max(start);
    text.truncate(end);
    text.write_char('\n')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_of_our_files_is_listed_with_what_can_be_chosen() {
        let expected: [&[&str]; 3] = [
            &[
                "EDS 1.0: skillbench, skillbench robot",
                "connection 1: Exclusive Owner; exclusive owner",
                "  class 1; cyclic, change of state, application; path 20 04 24 97 2C 96 2C 64",
                "  O->T: 256 bytes Assem150; fixed; 32-bit header; point to point; RPI 500 to 10000000 us, proposed 1000 us",
                "  configuration: 0 bytes Assem151",
                "assembly 100: Feedback, 256 bytes, path 20 04 24 64 30 03",
                "capacity MaxIOMcastProducers: 1",
                "port 1: TCP EtherNet/IP",
            ],
            &[
                "GSDML 2.4: skillbench, skillbench",
                "access point ID_AccessPoint: 0x00000001 skillbench robot, order number skillbench-robot",
                "  station name skillbench-robot; slots 0..1; shortest interval 0.25 ms",
                "  subslot 32768: 0x00008000 Interface",
                "  slot fixed 1: module ID_Module1 Skill process image",
                "  subslot 1: ID_Submodule1_1: 0x00000101 Skill process image; 256 bytes in, 256 bytes out",
                "    in 0: Unsigned16, 2 bytes: status",
            ],
            &[
                "ESI: skillbench, vendor 0xFFFFFFFF; 1 devices, 0 modules",
                "device skillbench-robot: product 0x00000001, revision 0x00010000: skillbench robot",
                "  SM2 Outputs: 0x1100, 256 bytes, control 0x64",
                "  RxPDO 0x1600 Command: 2048 bits, SM2, fixed, mandatory",
                "    0x7000:01 control 1: UINT, 16 bits",
                "  CoE: SDO information, complete access",
            ],
        ];
        for ((name, text), lines) in devices::files().into_iter().zip(expected) {
            let device = device_files::read(&name, text.into()).unwrap();
            let listing = listing(&device);
            for line in lines {
                assert!(listing.lines().any(|listed| listed == *line), "{line} is missing in\n{listing}");
            }
        }
    }

    #[test]
    fn words_of_a_file_stay_in_their_line_and_reach_no_terminal_control() {
        assert_eq!(FileText("a\n\x1b[2J  b\u{202E}").to_string(), "a \u{FFFD}[2J b\u{FFFD}");
        assert_eq!(Digits(&[7; 40]).to_string(), format!("{}... (40 bytes)", "07".repeat(32)));
    }
}
