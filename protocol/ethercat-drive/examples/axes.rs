//! The controller of the example `drives`: it switches six drives on, moves them for some seconds at 1 ms, and stops them.
//!
//! ```console
//! $ sudo cargo run -p ethercat-drive --example axes -- eth0 30
//! ```
//!
//! A MainDevice is a machine within a machine here: each exchange of process data is a cycle of the axes.

use std::error::Error;
use std::ops::ControlFlow;

use ethercat_drive::{Axes, DRIVE, INPUT_LEN, OUTPUT_LEN, Wanted};
use ethercat_maindevice::{Config, ExpectedDevice, GroupMainDevice};
use machine::ethernet::Mac;
use machine::{Counters, Duration, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock, scheduling};

const AXES: usize = 6;
const CYCLE: Duration = Duration::from_millis(1);

/// Increments in a cycle.
const SPEEDS: [i32; AXES] = [1, -20, 300, -400, 500, 600];

struct DriveController {
    main: GroupMainDevice,
    axes: Axes,
    targets: [i32; AXES],
    inputs: [u8; AXES * INPUT_LEN],
    exchanges: u64,
    cycles: u64,
    worst_following_error: u32,
}

impl DriveController {
    fn new(mac: Mac, start: Instant) -> Self {
        let drive = ExpectedDevice {
            vendor: DRIVE.vendor_id,
            product: DRIVE.product_code,
            revision: Some(DRIVE.revision),
            output_bytes: OUTPUT_LEN,
            input_bytes: INPUT_LEN,
        };
        let config = Config { mac, devices: vec![drive; AXES], cycle: CYCLE, watchdog: CYCLE * 500 };
        Self {
            main: GroupMainDevice::new(config, start),
            axes: Axes::new(AXES),
            targets: [0; AXES],
            inputs: [0; AXES * INPUT_LEN],
            exchanges: 0,
            cycles: 0,
            worst_following_error: 0,
        }
    }

    /// Runs the axes if process data were exchanged since the last time.
    fn cycle(&mut self) {
        let received = self.main.counters().received;
        let is_new = received != std::mem::replace(&mut self.exchanges, received);
        let Some(inputs) = self.main.inputs().filter(|inputs| is_new && inputs.len() == self.inputs.len())
        else {
            return;
        };
        self.inputs.copy_from_slice(inputs);
        let are_on = self.axes.are_on();
        for ((axis, target), speed) in self.axes.axes().iter().zip(&mut self.targets).zip(SPEEDS) {
            if are_on {
                *target += speed;
                self.worst_following_error =
                    self.worst_following_error.max(axis.following_error().unsigned_abs());
            } else {
                *target = axis.position();
            }
        }
        self.cycles += u64::from(are_on);
        self.axes.cycle(&self.inputs, &self.targets, self.main.outputs_mut());
    }
}

impl Machine for DriveController {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.main.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.main.handle_frame(now, from, frame);
        self.cycle();
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.main.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.main.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.main.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.main.poll_timeout()
    }
}

/// Switches the axes on once the bus is up, and ends some seconds later, or when an axis stops by itself.
struct Run {
    length: Duration,
    end: Option<Instant>,
    /// The counters once all drives were on.
    before: Option<Counters>,
}

impl Owner<DriveController> for Run {
    fn wake(&mut self, now: Instant, controller: &mut DriveController, _: &Statistics) -> ControlFlow<()> {
        if let Some(error) = controller.axes.error() {
            println!("{error}");
            return ControlFlow::Break(());
        }
        if controller.axes.are_on() && self.before.is_none() {
            (self.before, self.end) = (Some(controller.main.counters()), Some(now + self.length));
        }
        if self.end.is_some_and(|end| end <= now) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    fn event(&mut self, _: Instant, controller: &mut DriveController, event: LinkEvent) -> ControlFlow<()> {
        println!("{event:?}");
        if event == LinkEvent::Up {
            controller.axes.want(Wanted::On);
        }
        ControlFlow::Continue(())
    }

    fn deadline(&self) -> Option<Instant> {
        self.end
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let interface = arguments.next().ok_or("usage: axes INTERFACE [SECONDS]")?;
    let seconds = arguments.next().map_or(Ok(30), |seconds| seconds.parse())?;
    if let Some(refused) = scheduling::make_real_time().refused() {
        println!("warning: {refused}");
    }
    let interface = Interface::open(&interface)?;
    let controller = DriveController::new(interface.mac(), clock::now());
    let mut driver = Driver::new(controller, interface, Notifier::new()?)?;
    let mut run = Run { length: Duration::from_secs(seconds), end: None, before: None };
    driver.run(&mut run)?;
    let controller = driver.machine();
    let before = run.before.unwrap_or_default();
    let counters = controller.main.counters();
    println!(
        "{} cycles with all drives on, {} without the full working counter, {} skipped by this host",
        controller.cycles,
        counters.lost - before.lost,
        counters.skipped - before.skipped
    );
    println!("worst following error: {} increments", controller.worst_following_error);
    Ok(())
}
