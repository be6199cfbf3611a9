//! Lists the PROFINET stations on a cable.
//!
//! ```console
//! $ sudo cargo run -p profinet-proto --example identify -- eth0
//! ```

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Duration;

use machine::Instant;
use machine::search::SearchEnded;
use profinet::{Search, SearchConfig};
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
    let interface = std::env::args().nth(1).ok_or("usage: identify INTERFACE")?;
    let interface = Interface::open(&interface)?;
    let start = clock::now();
    // Each search has transaction numbers of its own.
    let first_xid = start.as_nanos() as u32;
    let config = SearchConfig { mac: interface.mac(), first_xid, length: Duration::from_secs(1) };
    let mut driver = Driver::new(Search::new(config, start), interface, Notifier::new()?)?;
    driver.run(&mut UntilEnd)?;
    let stations = driver.machine().answers().devices();
    println!("{} stations", stations.len());
    for station in stations {
        let name = String::from_utf8_lossy(&station.name);
        let kind = String::from_utf8_lossy(&station.type_of_station);
        let address = station.ip.map(|ip| ip.address.to_string()).unwrap_or_default();
        println!("{}  {name:<24} {kind:<26} {address}", station.mac);
    }
    Ok(())
}
