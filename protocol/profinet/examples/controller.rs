//! An IO-Controller that counts up in its outputs until the device of the example `device` has sent 1000 numbers back.
//!
//! ```console
//! $ sudo cargo run -p profinet-proto --example controller -- eth0 192.168.64.1 echo 192.168.64.2 rt1
//! ```
//!
//! The arguments: its interface and IP address, the device's station name and the address that it is to have, and how
//! cyclic frames travel, `rt1` (EtherType 0x8892) or `udp`.

mod echo;

use std::error::Error;
use std::net::Ipv4Addr;
use std::ops::ControlFlow;
use std::time::{Duration, UNIX_EPOCH};

use echo::PLACE;
use machine::{DownCause, Instant, LinkEvent};
use profinet::description::Description;
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

struct Counting {
    ar: ArId,
    sent: u64,
}

impl Owner<Controller> for Counting {
    /// Sends the next number once the last one came back. The driver calls it after it has done everything that was due.
    fn wake(&mut self, now: Instant, controller: &mut Controller, _: &Statistics) -> ControlFlow<()> {
        let (slot, subslot) = PLACE;
        let Some(ar) = controller.ar_mut(self.ar) else { return ControlFlow::Break(()) };
        if ar.input(slot, subslot) == Some(&self.sent.to_be_bytes()[..]) {
            self.sent += 1;
            if self.sent == 1_000 {
                println!("1000 numbers came back");
                ar.disconnect(now);
            }
        }
        let set = ar.set_output(slot, subslot, &self.sent.to_be_bytes());
        if set.is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, _: Instant, _: &mut Controller, event: (ArId, LinkEvent)) -> ControlFlow<()> {
        match event {
            (_, LinkEvent::Down(down)) if down.cause == DownCause::ClosedHere => {
                return ControlFlow::Break(());
            }
            (_, LinkEvent::Down(down)) => println!("down: {down}"),
            (_, event) => println!("{event:?}"),
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [interface, address, name, device_address, transport] = &arguments[..] else {
        return Err("usage: controller INTERFACE ADDRESS DEVICE DEVICE_ADDRESS rt1|udp".into());
    };
    let interface = Interface::open(interface)?;
    let (address, mask): (Ipv4Addr, Ipv4Addr) = (address.parse()?, [255, 255, 255, 0].into());
    interface.set_address(address, mask)?;
    let mut controller = Controller::new(ControllerConfig {
        mac: interface.mac(),
        station_name: "controller".into(),
        address,
        mask,
        description: Description { modules: &[], station_type: "controller", ..echo::DEVICE },
        seed: UNIX_EPOCH.elapsed()?.as_secs(),
    })?;
    let device = ArConfig {
        station_name: name.clone(),
        mac: None,
        address: device_address.parse()?,
        description: echo::DEVICE,
        parameters: Vec::new(),
        transport: if transport == "udp" { Transport::Udp } else { Transport::Rt1 },
        cycle: Duration::from_millis(1),
        watchdog_cycles: 200,
    };
    let ar = controller.connect(device, clock::now())?;
    let mut driver = Driver::new(controller, interface, Notifier::new()?)?;
    Ok(driver.run(&mut Counting { ar, sent: 1 })?)
}
