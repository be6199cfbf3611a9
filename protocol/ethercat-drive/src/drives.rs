//! Emulated drives on one cable, as one machine.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use ethercat_subdevice::{DeviceConfig, DeviceId, Event, PdoConfiguration, Segment};
use machine::{Cycle, Duration, Instant, Machine, PortRequest, Source, Transmit};

use crate::description::{
    DEFAULT_DECELERATION, DEFAULT_TORQUE, DEFAULT_WINDOW, DEFAULT_WINDOW_TIME, DRIVE, INTERPOLATION_PERIOD,
    MAX_TORQUE, QUICK_STOP_DECELERATION, WINDOW, WINDOW_TIME,
};
use crate::drive::{Drive, Parameters};
use crate::error_code::ErrorCode;
use crate::objects::{outputs, parameters, period, set_inputs, show_period};
use crate::state::State;

/// Largest number of missed cycles that are run after a stall of the host.
const CATCH_UP: u64 = 1_000;

/// Time in which an unloaded motor reaches its highest speed at rated torque, in s, unless a configuration says otherwise.
const RUN_UP_S: f64 = 0.01;

/// A drive on the cable.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct DriveConfig {
    /// Its serial number.
    pub serial_number: u32,
    /// Where its motor stands at power-on, in increments.
    pub position: i32,
    /// Highest speed of its motor in increments/s.
    pub max_speed: f64,
    /// Acceleration of its motor at rated torque, in increments/s².
    pub acceleration: f64,
    /// Largest following error in increments. It is the first value of an object that the controller can write by SDO, as are
    /// all settings after it.
    pub window: u32,
    /// Time in ms for which the following error may be larger.
    pub window_time: u16,
    /// Largest torque in ‰ of the rated torque. It limits every acceleration of the motor.
    pub max_torque: u16,
    /// Deceleration of a quick stop and of a fault in increments/s².
    pub deceleration: u32,
}

impl DriveConfig {
    /// Returns a drive at 0 with the settings that its [description](DRIVE) has.
    #[must_use]
    pub const fn new(serial_number: u32, max_speed: f64) -> Self {
        Self {
            serial_number,
            position: 0,
            max_speed,
            acceleration: max_speed / RUN_UP_S,
            window: DEFAULT_WINDOW,
            window_time: DEFAULT_WINDOW_TIME,
            max_torque: DEFAULT_TORQUE,
            deceleration: DEFAULT_DECELERATION,
        }
    }
}

/// What happened at a drive. Drives are numbered from 0 in their order on the cable.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DriveEvent {
    /// Its power state machine changed.
    Power {
        /// Which drive.
        drive: usize,
        /// The state that it is in.
        state: State,
        /// The error that it reports.
        error: ErrorCode,
    },
    /// An event of the SubDevice.
    Device {
        /// Which drive.
        drive: usize,
        /// The event.
        event: Event,
    },
}

/// Drives on one cable.
#[derive(Debug)]
pub struct Drives {
    segment: Segment,
    drives: Vec<Drive>,
    /// The drives' own cycle.
    cycle: Cycle,
    events: VecDeque<DriveEvent>,
}

impl Drives {
    /// Creates drives in their order on the cable. Their controller gives a new target each `period`, unless it sets another
    /// one by object 0x60C2, and they run in a cycle of half of it, from `start` on.
    #[must_use]
    pub fn new(configs: &[DriveConfig], period: Duration, start: Instant) -> Self {
        let mut segment = Segment::new();
        for config in configs {
            let DriveConfig { serial_number, window, window_time, max_torque, deceleration, .. } = *config;
            let id = segment.add(&DeviceConfig {
                serial_number,
                pdo_configuration: PdoConfiguration::Mappable,
                ..DeviceConfig::new(&DRIVE)
            });
            show_period(&mut segment, id, period);
            // Each drive has these objects, with four or two bytes.
            for (index, value) in [(WINDOW, window), (QUICK_STOP_DECELERATION, deceleration)] {
                let _ = segment.set_object(id, index, 0, &value.to_le_bytes());
            }
            for (index, value) in [(WINDOW_TIME, window_time), (MAX_TORQUE, max_torque)] {
                let _ = segment.set_object(id, index, 0, &value.to_le_bytes());
            }
        }
        let drive =
            |config: &DriveConfig| Drive::new(config.position, config.max_speed, config.acceleration, period);
        let cycle = Cycle::new(start, (period / 2).max(Duration::from_micros(50)));
        Self { segment, drives: configs.iter().map(drive).collect(), cycle, events: VecDeque::new() }
    }

    /// Returns a drive.
    #[must_use]
    pub fn drive(&self, drive: usize) -> Option<&Drive> {
        self.drives.get(drive)
    }

    /// Returns a drive, to block its shaft or to cause a fault.
    pub fn drive_mut(&mut self, drive: usize) -> Option<&mut Drive> {
        self.drives.get_mut(drive)
    }

    /// Stops a drive as an input of its own does. Returns `None` if there is no such drive.
    pub fn stop(&mut self, drive: usize) -> Option<()> {
        let Parameters { quick_stop, .. } = parameters(&self.segment, DeviceId(drive));
        self.drives.get_mut(drive).map(|drive| drive.stop(quick_stop))
    }

    /// Returns the SubDevices, to cut a cable or to switch one off.
    pub const fn segment_mut(&mut self) -> &mut Segment {
        &mut self.segment
    }

    /// Runs each drive for a cycle.
    fn run(&mut self) {
        let period = self.cycle.period();
        for (index, drive) in self.drives.iter_mut().enumerate() {
            let id = DeviceId(index);
            let outputs = outputs(&self.segment, id, drive);
            let before = drive.state();
            drive.cycle(period, outputs.as_ref(), &parameters(&self.segment, id));
            if drive.state() != before {
                let (state, error) = (drive.state(), drive.inputs().error);
                self.events.push_back(DriveEvent::Power { drive: index, state, error });
            }
            set_inputs(&mut self.segment, id, drive);
        }
    }

    /// Takes over a setting that a drive does not read in each of its cycles.
    fn note(&mut self, id: DeviceId, event: Event) {
        if let Event::ObjectWritten { index: INTERPOLATION_PERIOD, .. } = event
            && let Some(drive) = self.drives.get_mut(id.0)
            && let Some(period) = period(&self.segment, id)
        {
            drive.set_period(period);
        }
    }
}

impl Machine for Drives {
    type Event = DriveEvent;

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.segment.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.segment.handle_timeout(now);
        if let Some(tick) = self.cycle.tick(now) {
            for _ in 0..=tick.skipped.min(CATCH_UP) {
                self.run();
            }
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.segment.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<DriveEvent> {
        if let Some(event) = self.events.pop_front() {
            return Some(event);
        }
        let (id, event) = self.segment.poll_event()?;
        self.note(id, event);
        Some(DriveEvent::Device { drive: id.0, event })
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.segment.poll_timeout(), Some(self.cycle.next()))
    }
}
