//! Both programs and the robot, scan by scan, without a bus.

use machine::{
    Duration, Instant, InterfaceId, Machine, Multihomed as _, Port, PortRequest, Source, Transmit,
};
use planning::setup_and_application;
use plc_export::Maker;
use plc_node::{ExecutionType, PlcConfig, PlcEvent, PlcNode};
use protocol::fieldbus::{Counters, Down, DownCause, Fieldbus, LinkEvent};
use protocol::image::{IMAGE_LEN, Image, Order};
use protocol::one_station::OneStation;
use robot_node::{Program as RobotProgram, RobotConfig, RobotNode};
use structured_text::{Instance, Program, Variable};

use crate::read_back::{code_of, program_of};

/// Most steps of a scan: the first one builds the table of the check.
const BUDGET: u64 = 100_000;

pub(crate) const ETHERNET: Source = Source { port: Port::Ethernet, peer: None };

/// A bus whose images a test moves by hand.
#[derive(Debug)]
pub(crate) struct Wire {
    order: Order,
    input: Option<Image>,
    pub(crate) output: Image,
    event: Option<LinkEvent>,
    received: u64,
}

impl Wire {
    pub(crate) fn new(order: Order) -> Self {
        Self { order, input: None, output: [0; IMAGE_LEN], event: None, received: 0 }
    }
}

impl Machine for Wire {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    /// Takes an image; an empty frame is a lost connection.
    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        let image: Option<Image> = frame.try_into().ok();
        if image.is_some() != self.input.is_some() {
            self.event = Some(match image {
                Some(_) => LinkEvent::Up,
                None => LinkEvent::Down(Down { cause: DownCause::Watchdog, code: 0, text: "" }),
            });
        }
        self.received += 1;
        self.input = image;
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn poll_transmit(&mut self, _now: Instant, _buf: &mut [u8]) -> Option<Transmit> {
        None
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.event.take()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

impl Fieldbus for Wire {
    fn byte_order(&self) -> Order {
        self.order
    }

    fn set_output(&mut self, image: &Image) {
        self.output = *image;
    }

    fn input(&self) -> Option<Image> {
        self.input
    }

    fn disconnect(&mut self, _now: Instant) {}

    fn counters(&self) -> Counters {
        Counters { sent: 0, skipped: 0, received: self.received, lost: 0, late: 0, malformed: 0, foreign: 0 }
    }
}

/// The exported code with its variables.
pub(crate) struct Exported {
    program: Program,
    pub(crate) core: Instance,
    inputs: [Variable; 6],
    command: Variable,
    outputs: [Variable; 4],
    samples: Variable,
}

impl Exported {
    pub(crate) fn new(text: &str, order: Order) -> Self {
        Self::of(program_of(&code_of(text, Maker::St), Maker::St), order)
    }

    fn of(program: Program, order: Order) -> Self {
        let variable = |name: &str| program.variable("SB_Core", name).unwrap();
        let inputs = ["feedback_bytes", "now_us", "start", "execution_type", "repetitions", "bus_big_endian"]
            .map(variable);
        let outputs = ["ready", "done", "error", "error_id"].map(variable);
        let (command, samples) = (variable("command_bytes"), variable("sample_us"));
        let mut core = program.instance("SB_Core").unwrap();
        core.set(inputs[5], 0, i64::from(order == Order::BigEndian));
        Self { program, core, inputs, command, outputs, samples }
    }

    /// Sets the inputs of a user's program.
    pub(crate) fn start(&mut self, on: bool, execution_type: i64, repetitions: i64) {
        self.core.set(self.inputs[2], 0, i64::from(on));
        self.core.set(self.inputs[3], 0, execution_type);
        self.core.set(self.inputs[4], 0, repetitions);
    }

    pub(crate) fn scan(&mut self, now_us: u32, feedback: &Image) -> Image {
        for (index, byte) in (0..).zip(feedback) {
            self.core.set(self.inputs[0], index, i64::from(*byte));
        }
        self.core.set(self.inputs[1], 0, i64::from(now_us));
        self.core.scan(&self.program, BUDGET).unwrap_or_else(|trap| panic!("{trap}"));
        let mut command = [0; IMAGE_LEN];
        for (index, byte) in (0..).zip(&mut command) {
            *byte = u8::try_from(self.core.get(self.command, index)).unwrap();
        }
        command
    }

    pub(crate) fn is_ready(&self) -> bool {
        self.core.get(self.outputs[0], 0) == 1
    }

    pub(crate) fn is_done(&self) -> bool {
        self.core.get(self.outputs[1], 0) == 1
    }

    /// Returns the error's ID; 0 without one.
    pub(crate) fn error(&self) -> i64 {
        self.core.get(self.outputs[2], 0) * self.core.get(self.outputs[3], 0)
    }

    /// Takes an error back, as the next start does.
    pub(crate) fn clear_error(&mut self) {
        self.core.set(self.outputs[2], 0, 0);
    }

    pub(crate) fn sample_us(&self, index: u32) -> i64 {
        self.core.get(self.samples, index)
    }
}

/// What happens to the robot's image on its way in a scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Way {
    Intact,
    Lost,
    /// This bit flips.
    Altered(usize),
    /// There is no connection.
    Cut,
    /// The image of so many scans before.
    Old(usize),
}

/// Both programs and the robot.
pub(crate) struct Bed {
    pub(crate) plc: PlcNode<OneStation<Wire>>,
    pub(crate) exported: Exported,
    pub(crate) robot: RobotNode<Wire>,
    pub(crate) now: Instant,
    /// Feedback as of the last scans.
    history: Vec<Image>,
    feedback: Image,
    /// Repetitions that the PLC still starts.
    pub(crate) remaining: u32,
    pub(crate) execution_type: ExecutionType,
    /// Execution times of the PLC's own program, in ns.
    pub(crate) samples: Vec<u64>,
    pub(crate) failures: Vec<String>,
    pub(crate) images: usize,
}

impl Bed {
    pub(crate) fn new(setup: &str, application: &str, order: Order) -> Self {
        Self::with_edited(setup, application, order, |text| text)
    }

    /// Creates a bed whose exported code somebody edited.
    pub(crate) fn with_edited(
        setup: &str,
        application: &str,
        order: Order,
        edit: impl Fn(String) -> String,
    ) -> Self {
        Self::with(setup, application, order, |text| Exported::new(&edit(text), order))
    }

    /// Creates a bed with the code of a maker, read back from its files.
    pub(crate) fn of_maker(setup: &str, application: &str, order: Order, maker: Maker) -> Self {
        Self::with(setup, application, order, |text| {
            Exported::of(program_of(&code_of(&text, maker), maker), order)
        })
    }

    fn with(setup: &str, application: &str, order: Order, of_text: impl Fn(String) -> Exported) -> Self {
        let (setup, application) = setup_and_application(setup, Some(application)).unwrap();
        let plan = application.plan(&setup).unwrap();
        let config = || PlcConfig { scan_cost: Duration::ZERO, ..PlcConfig::of_plan(&setup, &plan) };
        let to_start = plan.wire_to_start(&setup);
        let text = plc_export::structured_text(&config().exported(true)).unwrap();
        let robot =
            RobotConfig::from_setup(&setup).unwrap().in_cell_of(&application.application, &to_start).unwrap();
        let programs = RobotProgram::stored(&plan, &setup);
        let start = Instant::from_millis(1);
        Self {
            plc: PlcNode::new(config(), OneStation::new(Wire::new(order)), start),
            exported: of_text(text),
            robot: RobotNode::new(robot, programs, Wire::new(order), 7, start + Duration::from_micros(700)),
            now: start,
            history: Vec::new(),
            feedback: [0; IMAGE_LEN],
            remaining: 0,
            execution_type: ExecutionType::Rc,
            samples: Vec::new(),
            failures: Vec::new(),
            images: 0,
        }
    }

    /// Asks both programs for repetitions.
    pub(crate) fn start(&mut self, execution_type: ExecutionType, repetitions: u32) {
        let code = match execution_type {
            ExecutionType::Rc => 1,
            ExecutionType::Sm => 2,
            ExecutionType::Cm => 3,
        };
        self.exported.start(true, code, i64::from(repetitions));
        (self.execution_type, self.remaining) = (execution_type, repetitions);
    }

    /// Runs one scan of both, and the robot's cycles up to the next one.
    pub(crate) fn scan(&mut self, way: Way) {
        let fresh = self.robot.bus().output;
        self.history.push(fresh);
        let before = self.feedback;
        self.feedback = match way {
            Way::Intact => fresh,
            Way::Lost => before,
            Way::Cut => [0; IMAGE_LEN],
            Way::Old(scans) => {
                *self.history.get(self.history.len().saturating_sub(scans + 1)).unwrap_or(&fresh)
            }
            Way::Altered(bit) => {
                let mut altered = fresh;
                altered[bit / 8 % IMAGE_LEN] ^= 1 << (bit % 8);
                altered
            }
        };
        if self.history.len() > 5_000 {
            self.history.drain(..1_000);
        }
        if self.remaining > 0 && self.plc.is_ready() {
            self.plc.start(self.now, self.execution_type).unwrap();
        }
        let frame: &[u8] = if way == Way::Cut { &[] } else { &self.feedback };
        if self.feedback != before {
            self.images += 1;
            self.plc.handle_frame(self.now, InterfaceId::FIRST, ETHERNET, frame);
        }
        self.plc.handle_timeout(self.now);
        while let Some(report) = self.plc.poll_event() {
            match report.event {
                PlcEvent::Finished(execution) => {
                    self.samples.push(execution.execution_time_ns);
                    self.remaining -= 1;
                }
                PlcEvent::Failed(failure) => {
                    self.failures.push(format!("{failure:?}"));
                    self.remaining = 0;
                }
                _ => {}
            }
        }
        let now_us = u32::try_from(self.now.as_nanos() / 1_000).unwrap();
        let command = self.exported.scan(now_us, &self.feedback);
        let expected = self.plc.buses()[0].bus.output;
        if command != expected {
            let order = Order::BigEndian;
            let differing: Vec<_> = (0..IMAGE_LEN).filter(|at| command[*at] != expected[*at]).collect();
            panic!(
                "scan at {now_us} us, {way:?}: bytes {differing:?}\nexported {:?}\nblocks   {:?}\nfeedback {:?}",
                &command[..36],
                &expected[..36],
                order.parse_feedback(&self.feedback)
            );
        }
        Machine::handle_frame(&mut self.robot, self.now, ETHERNET, &command);
        let end = self.now + Duration::from_millis(1);
        while let Some(due) = Machine::poll_timeout(&self.robot).filter(|due| *due < end) {
            Machine::handle_timeout(&mut self.robot, due);
            while Machine::poll_event(&mut self.robot).is_some() {}
        }
        self.now = end;
    }

    /// Scans until the exported code is done, at most so many times.
    pub(crate) fn until_done(&mut self, most: u32) -> u32 {
        for scan in 0..most {
            self.scan(Way::Intact);
            if self.exported.is_done() || self.exported.error() != 0 {
                return scan;
            }
        }
        panic!("not done in {most} scans")
    }

    /// Scans until both programs are ready.
    pub(crate) fn until_ready(&mut self, most: u32) {
        self.exported.start(false, 0, 0);
        for _ in 0..most {
            self.scan(Way::Intact);
            if self.exported.is_ready() && self.plc.is_ready() {
                return;
            }
        }
        panic!("not ready in {most} scans")
    }
}

/// Returns the application of setup A.
pub(crate) fn exported_a() -> plc_export::ExportedApplication {
    exported("A", None)
}

/// Returns an application of a setup, or the one of the setup.
pub(crate) fn exported(setup: &str, application: Option<&str>) -> plc_export::ExportedApplication {
    let (setup, application) = setup_and_application(setup, application).unwrap();
    let plan = application.plan(&setup).unwrap();
    PlcConfig::of_plan(&setup, &plan).exported(true)
}
