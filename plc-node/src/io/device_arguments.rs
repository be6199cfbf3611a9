//! The devices of the command line: each `--device` with the options after it.

use std::net::Ipv4Addr;
use std::path::PathBuf;

use machine::Duration;
use node::device_options::ChoiceOptions;
use node::grouped_arguments::{Grouped, Groups};

/// A device, and what is said of it.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct DeviceArguments {
    /// The file: a GSDML (PROFINET), an EDS (EtherNet/IP) or an ESI (EtherCAT).
    ///
    /// Repeat it to drive several devices of one bus; --name, --at, --script and what is chosen from the file belong to the
    /// --device in front of them.
    #[arg(long, value_name = "FILE")]
    pub(super) device: PathBuf,
    /// The name of the device in --set, --read, --write and in the output; without it, what --at names.
    #[arg(long, value_name = "NAME")]
    pub(super) name: Option<String>,
    /// The device: its station name on PROFINET, its address on EtherNet/IP, its position on EtherCAT, from 1.
    ///
    /// Without it, the only one with the file's identity.
    #[arg(long, value_name = "NAME|ADDRESS|POSITION")]
    pub(super) at: Option<String>,
    /// PROFINET: the IP address that the device gets; without it, the one that it has.
    #[arg(long, value_name = "ADDRESS")]
    pub(super) address: Option<Ipv4Addr>,
    #[command(flatten)]
    pub(super) choice: ChoiceOptions,
    /// Outputs over time, a TOML file.
    #[arg(long, value_name = "FILE.toml")]
    pub(super) script: Option<PathBuf>,
    /// EtherNet/IP: the packet interval (RPI) of the outputs, in place of --interval.
    #[arg(long, value_name = "TIME", value_parser = node::duration_argument)]
    pub(super) rpi_out: Option<Duration>,
    /// EtherNet/IP: the packet interval (RPI) of the inputs, in place of --interval.
    #[arg(long, value_name = "TIME", value_parser = node::duration_argument)]
    pub(super) rpi_in: Option<Duration>,
}

impl Grouped for DeviceArguments {
    const FIRST: &'static str = "device";
    const WRITTEN: &'static str = "--device";
}

/// All devices of the command line.
pub(super) type AllDevices = Groups<DeviceArguments>;

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct TestCommandLine {
        #[command(flatten)]
        devices: AllDevices,
        #[arg(long)]
        run: bool,
    }

    fn parsed(line: &str) -> Result<Vec<DeviceArguments>, String> {
        let words = std::iter::once("io").chain(line.split_whitespace());
        TestCommandLine::try_parse_from(words).map(|line| line.devices.0).map_err(|error| error.to_string())
    }

    #[test]
    fn options_belong_to_the_device_in_front_of_them() {
        let devices = parsed(
            "--device a.xml --at valves --module 1=M --module 2.1=N --run --device b.xml --at=drive --name d --pdo 0x1A00,0x1A01",
        )
        .unwrap();
        let [a, b] = devices.as_slice() else { panic!("{devices:?}") };
        assert_eq!((a.at.as_deref(), a.name.as_deref()), (Some("valves"), None));
        assert_eq!((b.at.as_deref(), b.name.as_deref()), (Some("drive"), Some("d")));
        let (a, b) = (a.choice.to_choice().unwrap(), b.choice.to_choice().unwrap());
        assert_eq!((a.modules.len(), a.pdos, b.modules.len()), (2, None, 0));
        assert_eq!(b.pdos, Some(vec![0x1A00, 0x1A01]));
    }

    #[test]
    fn with_one_device_the_order_does_not_matter() {
        let devices = parsed("--at 192.168.0.2 --rpi-out 5ms --device a.eds").unwrap();
        assert_eq!(devices[0].at.as_deref(), Some("192.168.0.2"));
        assert_eq!(devices[0].rpi_out, Some(Duration::from_millis(5)));
    }

    #[test]
    fn options_that_are_of_no_device_or_twice_of_one_are_refused() {
        let said = parsed("--at 1 --device a.xml --device b.xml").unwrap_err();
        assert!(said.contains("--at in front of the first of several --device: put it after"), "{said}");
        let said = parsed("--device a.xml --device b.xml --at 1 --at 2").unwrap_err();
        assert!(said.contains("'--at <NAME|ADDRESS|POSITION>' cannot be used multiple times"), "{said}");
        assert!(parsed("").unwrap_err().contains("--device <FILE>"));
        assert!(parsed("--device a.eds --rpi-out soon").is_err());
    }
}
