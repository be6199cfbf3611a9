//! Lists the EtherNet/IP devices that a broadcast reaches.
//!
//! ```console
//! $ cargo run -p ethernet-ip-proto --example list_identity -- eth0
//! ```
//!
//! The interface needs an IP address.

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Duration;

use ethernet_ip::{Search, SearchConfig};
use machine::Instant;
use machine::search::SearchEnded;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

struct UntilEnd;

impl Owner<Search> for UntilEnd {
    fn wake(&mut self, _: Instant, _: &mut Search, _: &Statistics) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(&mut self, _: Instant, _: &mut Search, _: SearchEnded) -> ControlFlow<()> {
        ControlFlow::Break(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let interface = std::env::args().nth(1).ok_or("usage: list_identity INTERFACE")?;
    let interface = Interface::open(&interface)?;
    let own = interface.address().zip(interface.mask());
    let (address, mask) = own.ok_or("the interface has no IPv4 address")?;
    // By a port that the kernel chooses: those of the standard may be taken.
    let config = SearchConfig::from_address(0, address, mask, Duration::from_secs(1));
    let mut driver = Driver::new(Search::new(config, clock::now()), interface, Notifier::new()?)?;
    driver.run(&mut UntilEnd)?;
    let devices = driver.machine().answers().devices();
    println!("{} devices", devices.len());
    for device in devices {
        let name = String::from_utf8_lossy(&device.product_name);
        println!("{:<16} {name:<32} {}", device.address.to_string(), device.identity);
    }
    Ok(())
}
