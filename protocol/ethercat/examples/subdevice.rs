//! Two SubDevices that send their outputs back as their inputs: one with mailbox and clock, one with process data alone.
//!
//! ```console
//! $ sudo cargo run -p ethercat-subdevice --example subdevice -- eth0
//! ```
//!
//! Any MainDevice at the other end of the cable finds them. They run until they are killed.

use std::error::Error;
use std::ops::ControlFlow;

use ethercat_subdevice::description::{
    Access, CLOCK_MODES, DataType, Description, Entry, Mailbox, Object, ObjectCode, Pdo, PdoEntry,
};
use ethercat_subdevice::{DeviceConfig, DeviceId, Event, Segment};
use machine::Instant;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics};

const fn entry(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 1, bits: 64, data_type: DataType::Unsigned64, name: "Number" }
}

/// Eight bytes each way, without mailbox.
static SIMPLE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 1,
    revision: 1,
    order_code: "SIMPLE",
    name: "Eight bytes each way",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[entry(0x7000)] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[entry(0x6000)] }],
    mailbox: None,
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// The same, with a mailbox, a gain and a text to read and to write, a file, and a clock.
static ECHO: Description = Description {
    product_code: 2,
    order_code: "ECHO",
    name: "Eight bytes each way, with a mailbox",
    mailbox: Some(Mailbox { len: 256, file_capacity: 0x1_0000 }),
    objects: &[
        Object {
            index: 0x8000,
            name: "Gain",
            code: ObjectCode::Variable,
            entries: &[Entry {
                subindex: 0,
                name: "Gain",
                data_type: DataType::Unsigned16,
                access: Access::ReadWrite,
                capacity: 2,
                default: &[1, 0],
            }],
        },
        Object {
            index: 0x8001,
            name: "Text",
            code: ObjectCode::Variable,
            entries: &[Entry {
                subindex: 0,
                name: "Text",
                data_type: DataType::VisibleString,
                access: Access::ReadWrite,
                capacity: 2000,
                default: b"nothing yet",
            }],
        },
    ],
    clock_modes: &CLOCK_MODES,
    numbers_names: true,
    ..SIMPLE
};

struct Echo;

impl Owner<Segment> for Echo {
    /// Copies the outputs to the inputs. The driver calls it after it has done everything that was due.
    fn wake(&mut self, _: Instant, segment: &mut Segment, _: &Statistics) -> ControlFlow<()> {
        for id in (0..segment.len()).map(DeviceId) {
            let outputs = segment.outputs(id).and_then(|data| <[u8; 8]>::try_from(data).ok());
            if let Some(Err(error)) = outputs.map(|data| segment.set_inputs(id, &data)) {
                eprintln!("{error}");
            }
        }
        ControlFlow::Continue(())
    }

    fn event(&mut self, _: Instant, _: &mut Segment, (device, event): (DeviceId, Event)) -> ControlFlow<()> {
        match event {
            Event::StateChanged { state, code } => println!("device {}: {state}, {code}", device.0),
            event => println!("device {}: {event:?}", device.0),
        }
        ControlFlow::Continue(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let interface = std::env::args().nth(1).ok_or("usage: subdevice INTERFACE")?;
    let mut segment = Segment::new();
    segment.add(&DeviceConfig { serial_number: 1, ..DeviceConfig::new(&ECHO) });
    segment.add(&DeviceConfig { serial_number: 2, ..DeviceConfig::new(&SIMPLE) });
    let mut driver = Driver::new(segment, Interface::open(&interface)?, Notifier::new()?)?;
    println!("2 devices wait for a MainDevice at {interface}");
    Ok(driver.run(&mut Echo)?)
}
