//! The crate `pnio` as IO-Device: slot 1 brings 256 bytes to the controller, slot 3 takes 256 from it.

use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use interop_peers::{IMAGE, Order, StubRobot};
use pnio::api::{IoDevice, StartOptions};
use pnio::config::{DeviceConfig, Slot};
use pnio::data::FieldType;
use pnio::device::RtOptions;

const INPUTS: Slot = Slot(1);
const OUTPUTS: Slot = Slot(3);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(interface), Some(station), Some(address)) = (args.next(), args.next(), args.next()) else {
        return Err("usage: pnio-robot INTERFACE STATION ADDRESS".into());
    };
    let device = DeviceConfig::builder(&station)
        .identity(0x0A0B, 0x0C0D)
        .input(INPUTS, &[FieldType::Word; IMAGE / 2])
        .output(OUTPUTS, &[FieldType::Word; IMAGE / 2])
        .build()?;
    let options = StartOptions {
        iface: interface.clone(),
        ip: address.parse::<Ipv4Addr>()?.octets(),
        rt: Some(RtOptions { iface: interface, cpu_pin: None, rt_priority: None, lock_memory: false }),
        app_cpus: None,
        im_store: None,
    };
    let device = IoDevice::start(device, options)?;
    println!("listening");
    let image = device.image();
    let mut robot = StubRobot::new(Order::Big);
    let mut connected = false;
    loop {
        if device.ready() != connected {
            connected = !connected;
            println!("{}", if connected { "connected" } else { "released" });
        }
        if connected {
            let mut command = [0; IMAGE];
            let fresh = image.read_outputs(OUTPUTS.0, 1, |bytes, validity| {
                command.copy_from_slice(bytes);
                validity.provider_run
            });
            if fresh.unwrap_or(false) {
                let feedback = robot.cycle(&command, Instant::now());
                // Between two connections there is no image to write to.
                let _ = image.write_inputs(INPUTS.0, 1, &feedback);
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}
