//! An adapter that sends its outputs back as its inputs.
//!
//! ```console
//! $ cargo run -p ethernet-ip-proto --example adapter -- eth0
//! ```
//!
//! The interface needs an IP address. The adapter runs until it is killed.

mod echo;

use std::error::Error;
use std::net::Ipv4Addr;
use std::ops::ControlFlow;

use echo::{INPUTS, OUTPUTS};
use ethernet_ip::{Adapter, AdapterConfig};
use machine::{Instant, LinkEvent};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

struct Echo;

impl Owner<Adapter> for Echo {
    /// Copies the outputs to the inputs. The driver calls it after it has done everything that was due.
    fn wake(&mut self, _: Instant, adapter: &mut Adapter, _: &Statistics) -> ControlFlow<()> {
        let outputs = adapter.consumed(OUTPUTS).and_then(|data| <[u8; 8]>::try_from(data).ok());
        if let Some(Err(error)) = outputs.map(|data| adapter.set_produced(INPUTS, &data)) {
            eprintln!("{error}");
        }
        ControlFlow::Continue(())
    }

    /// Prints that a scanner owns the outputs, or is gone.
    fn event(&mut self, _: Instant, _: &mut Adapter, event: LinkEvent) -> ControlFlow<()> {
        match event {
            LinkEvent::Down(down) => println!("down: {down}"),
            event => println!("{event:?}"),
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let interface = std::env::args().nth(1).ok_or("usage: adapter INTERFACE")?;
    let interface = Interface::open(&interface)?;
    let address = interface.address().ok_or("the interface has no IPv4 address")?;
    let adapter = Adapter::new(AdapterConfig {
        description: &echo::DEVICE,
        serial_number: 1,
        address,
        mask: interface.mask().unwrap_or([255, 255, 255, 0].into()),
        gateway: Ipv4Addr::UNSPECIFIED,
        mac: interface.mac().0,
        // Frames of a connection from before a restart are not taken for those of a new one.
        first_id: clock::now().as_nanos() as u32,
        originators: machine::Allowed::default(),
    });
    let mut driver = Driver::new(adapter, interface, Notifier::new()?)?;
    println!("{address} waits for a scanner");
    Ok(driver.run(&mut Echo)?)
}
