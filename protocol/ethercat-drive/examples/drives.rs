//! Six emulated drives on one cable. The program runs until it is killed.
//!
//! ```console
//! $ sudo cargo run -p ethercat-drive --example drives -- eth0
//! ```

use std::error::Error;
use std::ops::ControlFlow;

use ethercat_drive::{DriveConfig, DriveEvent, Drives};
use machine::{Duration, Instant};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

/// Prints what happens. A node would not print on its cyclic thread.
struct DriveWatch;

impl Owner<Drives> for DriveWatch {
    fn wake(&mut self, _: Instant, _: &mut Drives, _: &Statistics) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(&mut self, _: Instant, _: &mut Drives, event: DriveEvent) -> ControlFlow<()> {
        match event {
            DriveEvent::Power { drive, state, error } => println!("drive {drive}: {state:?}, {error}"),
            DriveEvent::Device { drive, event } => println!("drive {drive}: {event:?}"),
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let interface = std::env::args().nth(1).ok_or("usage: drives INTERFACE")?;
    let configs = [1, 2, 3, 4, 5, 6].map(|serial_number| DriveConfig::new(serial_number, 1e6));
    let drives = Drives::new(&configs, Duration::from_millis(1), clock::now());
    let mut driver = Driver::new(drives, Interface::open(&interface)?, Notifier::new()?)?;
    println!("{} drives wait for a controller at {interface}", configs.len());
    Ok(driver.run(&mut DriveWatch)?)
}
