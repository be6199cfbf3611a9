//! The crate `ciplink` as EtherNet/IP adapter, with the assemblies that our scanner looks for.

use std::time::{Duration, Instant};

use ciplink::adapter::{Adapter, AdapterConfig, AdapterIdentity, Assembly, Event};
use interop_peers::{IMAGE, Order, StubRobot};

const PRODUCED: u32 = 100;
const CONSUMED: u32 = 150;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let adapter = Adapter::start(AdapterConfig {
        identity: AdapterIdentity {
            vendor_id: 0xFFFF,
            product_name: "ciplink robot".into(),
            ..AdapterIdentity::default()
        },
        assemblies: vec![
            Assembly::input(PRODUCED, IMAGE),
            Assembly::output(CONSUMED, IMAGE),
            Assembly::config(151, 0),
        ],
        input_only_heartbeat: 152,
        listen_only_heartbeat: 153,
        rpi_min: Duration::from_millis(1),
        ..AdapterConfig::default()
    })?;
    println!("listening");
    let mut robot = StubRobot::new(Order::Little);
    loop {
        match adapter.next_event(Some(Duration::from_millis(1))) {
            Some(Event::Opened(info)) => println!("opened: {info:?}"),
            Some(Event::Closed(_)) => println!("closed"),
            Some(Event::TimedOut(_)) => println!("timed out"),
            _ => {}
        }
        let output = adapter.output(CONSUMED)?;
        if let (true, Ok(command)) = (output.run, output.data.try_into()) {
            adapter.set_input(PRODUCED, &robot.cycle(&command, Instant::now()))?;
        }
    }
}
