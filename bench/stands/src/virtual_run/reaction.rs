//! Reaction time of a bus: from the PLC's scan that writes a number to the scan that reads it back from the robot, which
//! copies it in its own cycle. There is no program and no skill, so that the cycles and the cable alone count.

use std::time::Duration;

use anyhow::bail;
use machine::{Cycle, Instant, LinkEvent, Machine, Source, StreamChange, StreamId, Transmit};
use protocol::fieldbus::{ControllerBus, Fieldbus, StationId};
use protocol::image::{IMAGE_LEN, Image};
use setup::Setup;
use virtual_time::{Event, Impairment, Pair, PairConfig, Side};

use super::new_nodes::{addresses, new_buses};
use super::phases::Phases;

/// Longest wait for the connection and for a reaction, in virtual time.
const PATIENCE: Duration = Duration::from_secs(10);

/// Measures `count` reactions with the clocks and phases of this seed.
///
/// # Errors
///
/// The setup gives no bus, the nodes do not connect, or a number does not come back.
pub fn reactions(setup: &Setup, seed: u64, count: usize) -> anyhow::Result<Vec<Duration>> {
    let mut phases = Phases::of_one(setup, seed);
    let bus = &setup.bus;
    let (plc, robot) = new_buses(bus, seed, &mut phases)?;
    let cycle = |phases: &mut Phases, side, cycle_us: u32| {
        Cycle::new(phases.first_at(side, cycle_us), Duration::from_micros(cycle_us.into()))
    };
    let scan = cycle(&mut phases, Side::A, setup.plc.scan_cycle_us.value);
    let robot_cycle = cycle(&mut phases, Side::B, setup.robot.cycle_us.value);
    let delay = Duration::from_micros(bus.cable_delay_us.value.into());
    let config = PairConfig {
        seed,
        clocks: phases.clocks(),
        links: [Impairment { delay, ..Impairment::default() }; 2],
        addresses: addresses(bus),
    };
    // Each question finds the robot at another point of its cycle.
    let pauses = robot_cycle.period().as_nanos().div_ceil(scan.period().as_nanos().max(1));
    let pauses = u32::try_from(pauses).unwrap_or(u32::MAX).max(1);
    let task = Asker { pauses, ..Asker::default() };
    let asker = Periodic { bus: plc, cycle: scan, task };
    let mut pair = Pair::new(asker, Periodic { bus: robot, cycle: robot_cycle, task: Copier }, config);
    let mut done = 0;
    let mut until = pair.now() + PATIENCE;
    while pair.a().task.reactions.len() < count {
        match pair.next_event((pair.now() + Duration::from_millis(10)).min(until)) {
            Some(Event::B(LinkEvent::SetAddress { address, .. })) => {
                pair.set_address(Side::B, Some(address));
                pair.command_b(|copier, now| copier.bus.address_set(now, true));
            }
            Some(Event::A((_, LinkEvent::Down(down)))) => bail!("no connection to the robot: {down}"),
            _ if pair.now() >= until => bail!("a number did not come back from the robot"),
            _ => {}
        }
        if pair.a().task.reactions.len() > done {
            (done, until) = (pair.a().task.reactions.len(), pair.now() + PATIENCE);
        }
    }
    let reactions = &pair.a().task.reactions;
    Ok(reactions.get(..count).unwrap_or(reactions).to_vec())
}

/// What a node does in its cycle.
trait ReactionTask<B> {
    fn run(&mut self, now: Instant, bus: &mut B);
}

/// Writes a number, waits until it comes back, pauses for some scans, and writes the next one.
#[derive(Debug, Default)]
struct Asker {
    number: u32,
    asked_at: Option<Instant>,
    /// Scans until the next number.
    pause: u32,
    /// Different pauses, each a scan longer than the one before.
    pauses: u32,
    reactions: Vec<Duration>,
}

impl<B: ControllerBus> ReactionTask<B> for Asker {
    fn run(&mut self, now: Instant, bus: &mut B) {
        let Some(input) = bus.input(StationId::FIRST) else { return };
        if let Some(asked_at) = self.asked_at {
            if !input.starts_with(&self.number.to_be_bytes()) {
                return;
            }
            self.reactions.push(now.since(asked_at));
            self.asked_at = None;
            self.pause = self.number % self.pauses;
        }
        if let Some(pause) = self.pause.checked_sub(1) {
            self.pause = pause;
            return;
        }
        self.number += 1;
        self.asked_at = Some(now);
        let mut image: Image = [0; IMAGE_LEN];
        image.iter_mut().zip(self.number.to_be_bytes()).for_each(|(place, byte)| *place = byte);
        bus.set_output(StationId::FIRST, &image);
    }
}

/// Sends back what came.
#[derive(Debug)]
struct Copier;

impl<B: Fieldbus> ReactionTask<B> for Copier {
    fn run(&mut self, _now: Instant, bus: &mut B) {
        if let Some(image) = bus.input() {
            bus.set_output(&image);
        }
    }
}

/// A bus endpoint with a cyclic task.
struct Periodic<B, T> {
    bus: B,
    cycle: Cycle,
    task: T,
}

impl<B: Machine, T: ReactionTask<B>> Machine for Periodic<B, T> {
    type Event = B::Event;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
        }
        if self.cycle.tick(now).is_some() {
            self.task.run(now, &mut self.bus);
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<B::Event> {
        self.bus.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.bus.poll_timeout().map_or(self.cycle.next(), |bus| bus.min(self.cycle.next())))
    }
}
