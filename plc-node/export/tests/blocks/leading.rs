//! The exported code as the program of a PLC node: runs that the PLC ends, and lost connections.

use machine::{Duration, Instant, InterfaceId, Machine, Multihomed as _};
use planning::setup_and_application;
use plc_node::{AnyProgram, ExecutionType, ExportedCode, PlcConfig, PlcEvent, PlcNode};
use protocol::image::{IMAGE_LEN, Order};
use protocol::one_station::OneStation;
use robot_node::{Program as RobotProgram, RobotConfig, RobotNode};

use crate::bed::{ETHERNET, Wire};

/// A PLC that executes the exported code, and a robot.
struct Plant {
    plc: PlcNode<OneStation<Wire>, AnyProgram>,
    robot: RobotNode<Wire>,
    now: Instant,
    is_cut: bool,
}

impl Plant {
    fn new() -> Self {
        let (setup, application) = setup_and_application("A", None).unwrap();
        let plan = application.plan(&setup).unwrap();
        let config = || PlcConfig { scan_cost: Duration::ZERO, ..PlcConfig::of_plan(&setup, &plan) };
        let text = plc_export::structured_text(&config().exported(true)).unwrap();
        let code = ExportedCode::compile(&text).unwrap();
        let robot = RobotConfig::from_setup(&setup).unwrap();
        let robot = robot.in_cell_of(&application.application, &plan.wire_to_start(&setup)).unwrap();
        let now = Instant::from_millis(1);
        let wire = || Wire::new(Order::BigEndian);
        let programs = RobotProgram::stored(&plan, &setup);
        Self {
            plc: PlcNode::of_code(config(), Some(code), OneStation::new(wire()), now).unwrap(),
            robot: RobotNode::new(robot, programs, wire(), 7, now + Duration::from_micros(700)),
            now,
            is_cut: false,
        }
    }

    /// Runs one scan and the robot's cycles up to the next one; returns the PLC's events.
    fn scan(&mut self) -> Vec<PlcEvent> {
        let image = self.robot.bus().output;
        let frame: &[u8] = if self.is_cut { &[] } else { &image };
        self.plc.handle_frame(self.now, InterfaceId::FIRST, ETHERNET, frame);
        self.plc.handle_timeout(self.now);
        let mut events = Vec::new();
        while let Some(report) = self.plc.poll_event() {
            events.push(report.event);
        }
        let command = self.plc.buses()[0].bus.output;
        let frame: &[u8] = if self.is_cut { &[] } else { &command };
        Machine::handle_frame(&mut self.robot, self.now, ETHERNET, frame);
        let end = self.now + Duration::from_millis(1);
        while let Some(due) = Machine::poll_timeout(&self.robot).filter(|due| *due < end) {
            Machine::handle_timeout(&mut self.robot, due);
            while Machine::poll_event(&mut self.robot).is_some() {}
        }
        self.now = end;
        events
    }

    /// Scans until such an event comes.
    fn until(&mut self, is_wanted: impl Fn(&PlcEvent) -> bool) -> PlcEvent {
        for _ in 0..60_000 {
            if let Some(event) = self.scan().into_iter().find(|event| is_wanted(event)) {
                return event;
            }
        }
        panic!("the event does not come")
    }

    fn until_ready(&mut self) {
        // It may have become ready in the scan of the last event.
        if !self.plc.is_ready() {
            self.until(|event| matches!(event, PlcEvent::Ready));
        }
    }

    fn start(&mut self, execution_type: ExecutionType) {
        self.plc.start(self.now, execution_type).unwrap();
    }
}

#[test]
fn a_run_that_the_plc_aborts_ends_in_the_exported_code_too_and_the_next_one_passes() {
    let mut plant = Plant::new();
    plant.until_ready();
    for execution_type in ExecutionType::ALL {
        plant.start(execution_type);
        (0..800).for_each(|_| drop(plant.scan()));
        plant.plc.abort(plant.now);
        plant.until_ready();
        assert!(plant.plc.buses()[0].bus.output != [0; IMAGE_LEN]);
        plant.start(execution_type);
        plant.until(|event| matches!(event, PlcEvent::Finished(_)));
        plant.until_ready();
    }
}

#[test]
fn a_lost_connection_fails_the_run_of_exported_code_and_it_gets_ready_again() {
    let mut plant = Plant::new();
    plant.until_ready();
    plant.start(ExecutionType::Cm);
    (0..1_000).for_each(|_| drop(plant.scan()));
    plant.is_cut = true;
    plant.until(|event| matches!(event, PlcEvent::Failed(_)));
    (0..500).for_each(|_| assert!(!plant.scan().contains(&PlcEvent::Ready)));
    plant.is_cut = false;
    plant.until_ready();
    plant.start(ExecutionType::Sm);
    plant.until(|event| matches!(event, PlcEvent::Finished(_)));
}
