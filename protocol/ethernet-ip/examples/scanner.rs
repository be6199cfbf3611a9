//! A scanner that counts up in its outputs until the adapter of the example `adapter` has sent 1000 numbers back.
//!
//! ```console
//! $ cargo run -p ethernet-ip-proto --example scanner -- eth0 192.168.64.2
//! ```
//!
//! The interface needs an IP address; the second argument is the adapter's.

mod echo;

use std::error::Error;
use std::ops::ControlFlow;

use ethernet_ip::{ConnectionConfig, ConnectionId, Scanner, ScannerConfig};
use machine::{DownCause, Instant, LinkEvent};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

struct Counting {
    connection: ConnectionId,
    sent: u64,
}

impl Owner<Scanner> for Counting {
    /// Sends the next number once the last one came back. The driver calls it after it has done everything that was due.
    fn wake(&mut self, now: Instant, scanner: &mut Scanner, _: &Statistics) -> ControlFlow<()> {
        let Some(connection) = scanner.connection_mut(self.connection) else { return ControlFlow::Break(()) };
        if connection.input() == Some(&self.sent.to_le_bytes()[..]) {
            self.sent += 1;
            if self.sent == 1_000 {
                println!("1000 numbers came back");
                connection.disconnect(now);
            }
        }
        let set = connection.set_output(&self.sent.to_le_bytes());
        if set.is_err() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(
        &mut self,
        _: Instant,
        scanner: &mut Scanner,
        (id, event): (ConnectionId, LinkEvent),
    ) -> ControlFlow<()> {
        match event {
            LinkEvent::Down(down) if down.cause == DownCause::ClosedHere => return ControlFlow::Break(()),
            LinkEvent::Down(down) => match scanner.connection(id).and_then(|connection| connection.refusal())
            {
                Some(refusal) => println!("down: {refusal}"),
                None => println!("down: {down}"),
            },
            event => println!("{event:?}"),
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [interface, target] = &arguments[..] else { return Err("usage: scanner INTERFACE ADAPTER".into()) };
    let now = clock::now();
    let config = ScannerConfig { vendor: 0xFFFF, serial_number: 1, first_id: now.as_nanos() as u32 };
    let mut scanner = Scanner::new(config);
    let wanted = ConnectionConfig::exclusive_owner(target.parse()?, &echo::DEVICE, 1_000);
    let connection = scanner.connect(wanted, now)?;
    let mut driver = Driver::new(scanner, Interface::open(interface)?, Notifier::new()?)?;
    Ok(driver.run(&mut Counting { connection, sent: 1 })?)
}
