//! An IO-Device that sends its outputs back as its inputs.
//!
//! ```console
//! $ sudo cargo run -p profinet-proto --example device -- eth0 echo
//! ```
//!
//! The second argument is its station name; the controller gives it its IP address. It runs until it is killed.

mod echo;

use std::error::Error;
use std::ops::ControlFlow;

use echo::{LEN, PLACE};
use machine::{Instant, LinkEvent};
use profinet::{Device, DeviceConfig};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

struct Echo {
    interface: Interface,
}

impl Owner<Device> for Echo {
    /// Copies the outputs to the inputs. The driver calls it after it has done everything that was due.
    fn wake(&mut self, _: Instant, device: &mut Device, _: &Statistics) -> ControlFlow<()> {
        let (slot, subslot) = PLACE;
        let outputs = device.output(slot, subslot).and_then(|data| <[u8; LEN as usize]>::try_from(data).ok());
        if let Some(Err(error)) = outputs.map(|data| device.set_input(slot, subslot, &data)) {
            eprintln!("{error}");
        }
        ControlFlow::Continue(())
    }

    /// Handles an event: the controller connected, left, or gave the device its address.
    fn event(&mut self, now: Instant, device: &mut Device, event: LinkEvent) -> ControlFlow<()> {
        match event {
            LinkEvent::Up => println!("up"),
            LinkEvent::Down(down) => println!("down: {down}"),
            LinkEvent::SetAddress { address, mask, .. } => {
                println!("address {address}");
                let set = self.interface.set_address(address, mask);
                device.address_set(now, set.is_ok());
            }
            // It was created without permanent storage, and refuses what would need some.
            LinkEvent::Store => device.stored(now, false),
            LinkEvent::Foreign(request) => println!("{request}"),
            LinkEvent::Owner(owner) => println!("{owner}"),
            LinkEvent::Conflict(conflict) => println!("{conflict}"),
            // Only a controller reports this of its device.
            LinkEvent::Health => {}
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [interface, name] = &arguments[..] else { return Err("usage: device INTERFACE NAME".into()) };
    let interface = Interface::open(interface)?;
    let config = DeviceConfig {
        mac: interface.mac(),
        station_name: name.clone().into_bytes(),
        permanent: None,
        address: interface.address(),
        mask: interface.mask().unwrap_or([255, 255, 255, 0].into()),
        description: echo::DEVICE,
        controllers: machine::Allowed::default(),
    };
    let device = Device::new(config, clock::now());
    let mut driver = Driver::new(device, interface.clone(), Notifier::new()?)?;
    println!("{name} waits for a controller");
    Ok(driver.run(&mut Echo { interface })?)
}
