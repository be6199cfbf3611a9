//! Several machines of one process as one machine, each at an interface of its own.

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use crate::ethernet::Mac;
use crate::{
    Deadlines, Duration, Instant, InterfaceId, Machine, Multihomed, Numbers, Port, PortRequest, Source,
    StreamChange, StreamId, StreamRequest, Transmit, Turns,
};

/// Machines as one: that with the number N, from 0, is at the interface N. Events have the number of their machine.
///
/// A machine is asked for something only after it has changed, so that none of the calls walks over all of them.
#[derive(Debug)]
pub struct Machines<M> {
    machines: Vec<M>,
    deadlines: Deadlines,
    /// Deadlines are met at multiples of this time, in ns.
    grid_ns: u64,
    /// Machines whose deadline is over.
    due: Numbers,
    /// Machines that may have frames.
    sending: Turns,
    /// Machines that may have requests for TCP connections.
    connecting: Turns,
    /// Machines that may have events.
    reporting: Turns,
}

impl<M: Machine> Machines<M> {
    /// Most machines: interfaces are numbered by a byte, and one number stays free.
    pub const MOST: usize = u8::MAX as usize;

    /// Takes machines in the order of their interfaces, at most [`MOST`](Self::MOST); those after them are dropped.
    #[must_use]
    pub fn new(mut machines: Vec<M>) -> Self {
        machines.truncate(Self::MOST);
        let count = machines.len();
        let [mut sending, mut connecting, mut reporting] = [const { Turns::new() }; 3];
        for turns in [&mut sending, &mut connecting, &mut reporting] {
            turns.reserve(count);
        }
        let mut due = Numbers::new();
        due.reserve(count);
        let mut own =
            Self { machines, deadlines: Deadlines::new(), grid_ns: 1, due, sending, connecting, reporting };
        for number in 0..count {
            own.change(number, |_| ());
        }
        own
    }

    /// Meets deadlines at multiples of this time only, those of all machines together and each by so much too late: to wake up
    /// for each of many machines costs more than their work.
    #[must_use]
    pub fn on_grid(mut self, grid: Duration) -> Self {
        self.grid_ns = u64::try_from(grid.as_nanos()).unwrap_or(u64::MAX).max(1);
        self
    }

    /// Returns the machines in their order.
    #[must_use]
    pub fn as_slice(&self) -> &[M] {
        &self.machines
    }

    /// Changes a machine. Returns `None` for a number beyond the last one.
    pub fn change<T>(&mut self, number: usize, change: impl FnOnce(&mut M) -> T) -> Option<T> {
        let changed = change(self.machines.get_mut(number)?);
        self.ask(u16::try_from(number).ok()?);
        Some(changed)
    }

    /// Returns the next frame that one of the machines has for this poll, which takes the place of
    /// [`Machine::poll_transmit`], with the number of that machine.
    pub fn poll_frame<T>(&mut self, poll: impl FnMut(&mut M) -> Option<T>) -> Option<(usize, T)> {
        let found = next(&mut self.machines, &mut self.sending, poll);
        self.ask_again(found)
    }

    /// Has a machine asked for all that it may have now.
    fn ask(&mut self, number: u16) {
        let Some(machine) = self.machines.get(usize::from(number)) else { return };
        self.deadlines.set(number, Machine::poll_timeout(machine));
        self.sending.push(number);
        self.connecting.push(number);
        self.reporting.push(number);
    }

    /// Has a machine that gave something asked again, since that may have changed it.
    fn ask_again<T>(&mut self, found: Option<(u16, T)>) -> Option<(usize, T)> {
        let (number, given) = found?;
        self.ask(number);
        Some((number.into(), given))
    }

    fn get(&self, on: InterfaceId) -> Option<&M> {
        self.machines.get(usize::from(on.0))
    }
}

/// Returns the first thing that one of the machines in the queue has. Who has nothing leaves the queue.
fn next<M, T>(
    machines: &mut [M],
    turns: &mut Turns,
    mut poll: impl FnMut(&mut M) -> Option<T>,
) -> Option<(u16, T)> {
    while let Some(number) = turns.first() {
        if let Some(given) = machines.get_mut(usize::from(number)).and_then(&mut poll) {
            return Some((number, given));
        }
        turns.pop();
    }
    None
}

/// Returns the interface of a machine. There are no more machines than interfaces.
fn interface(number: usize) -> InterfaceId {
    InterfaceId(u8::try_from(number).unwrap_or(u8::MAX))
}

impl<M: Machine> Multihomed for Machines<M> {
    type Event = (usize, M::Event);

    fn interfaces(&self) -> u8 {
        u8::try_from(self.machines.len()).unwrap_or(u8::MAX)
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.change(on.0.into(), |machine| Machine::handle_frame(machine, now, from, frame));
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.change(on.0.into(), |machine| Machine::handle_broadcast(machine, now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        self.change(on.0.into(), |machine| Machine::handle_stream(machine, now, stream, change));
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac) {
        self.change(on.0.into(), |machine| Machine::handle_wrong_neighbour(machine, now, address, found));
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        self.get(on).map_or(&[], Machine::ports)
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        Machine::listen_port(self.get(on)?)
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        let found = next(&mut self.machines, &mut self.connecting, Machine::poll_stream);
        self.ask_again(found).map(|(number, request)| (interface(number), request))
    }

    fn dscp(&self, on: InterfaceId, port: Port) -> u8 {
        self.get(on).map_or(0, |machine| Machine::dscp(machine, port))
    }

    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        Machine::group(self.get(on)?, port, index)
    }

    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        Machine::neighbour(self.get(on)?, address)
    }

    fn handle_timeout(&mut self, now: Instant) {
        while let Some(number) = self.deadlines.take_due(now) {
            self.due.insert(number);
        }
        while let Some(number) = self.due.take_first() {
            self.change(number.into(), |machine| Machine::handle_timeout(machine, now));
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        self.poll_frame(|machine| Machine::poll_transmit(machine, now, buf))
            .map(|(number, transmit)| (interface(number), transmit))
    }

    fn poll_event(&mut self) -> Option<(usize, M::Event)> {
        let found = next(&mut self.machines, &mut self.reporting, Machine::poll_event);
        self.ask_again(found)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let due = self.deadlines.first()?.as_nanos();
        Some(Instant::from_nanos(due.checked_next_multiple_of(self.grid_ns).unwrap_or(due)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends a frame so many ms after each that it gets, and reports it.
    #[derive(Debug)]
    struct Talker {
        due: Option<Instant>,
        frames: u8,
        events: u8,
        polls: u32,
    }

    impl Machine for Talker {
        type Event = u8;

        fn handle_frame(&mut self, now: Instant, _: Source, frame: &[u8]) {
            self.due = Some(now + Duration::from_millis(frame.first().copied().unwrap_or_default().into()));
        }

        fn ports(&self) -> &[PortRequest] {
            &[]
        }

        fn handle_timeout(&mut self, now: Instant) {
            if self.due.take_if(|due| *due <= now).is_some() {
                self.frames += 1;
            }
        }

        fn poll_transmit(&mut self, _: Instant, _: &mut [u8]) -> Option<Transmit> {
            self.polls += 1;
            self.frames = self.frames.checked_sub(1)?;
            self.events += 1;
            Some(Transmit { port: Port::Ethernet, to: None, len: 0 })
        }

        fn poll_event(&mut self) -> Option<u8> {
            self.events = self.events.checked_sub(1)?;
            Some(self.events)
        }

        fn poll_timeout(&self) -> Option<Instant> {
            self.due
        }
    }

    fn at(millis: u64) -> Instant {
        Instant::ZERO + Duration::from_millis(millis)
    }

    fn talkers(count: usize) -> Machines<Talker> {
        Machines::new((0..count).map(|_| Talker { due: None, frames: 0, events: 0, polls: 0 }).collect())
    }

    /// Returns the interfaces of all frames, and the numbers of all events.
    fn drain(machines: &mut Machines<Talker>, now: Instant) -> (Vec<u8>, Vec<usize>) {
        let (mut sent, mut reported) = (Vec::new(), Vec::new());
        while let Some((on, _)) = machines.poll_transmit(now, &mut []) {
            sent.push(on.0);
        }
        while let Some((number, _)) = machines.poll_event() {
            reported.push(number);
        }
        (sent, reported)
    }

    fn tell(machines: &mut Machines<Talker>, on: u8, after: u8) {
        let from = Source { port: Port::Ethernet, peer: None };
        machines.handle_frame(at(0), InterfaceId(on), from, &[after]);
    }

    #[test]
    fn each_machine_sends_at_its_own_interface_when_it_is_due() {
        let mut machines = talkers(3);
        tell(&mut machines, 2, 5);
        tell(&mut machines, 0, 5);
        tell(&mut machines, 1, 9);
        assert_eq!(machines.poll_timeout(), Some(at(5)));
        machines.handle_timeout(at(5));
        assert_eq!(drain(&mut machines, at(5)), (vec![0, 2], vec![0, 2]));
        assert_eq!(machines.poll_timeout(), Some(at(9)));
        machines.handle_timeout(at(9));
        assert_eq!(drain(&mut machines, at(9)), (vec![1], vec![1]));
        assert_eq!(machines.poll_timeout(), None);
    }

    #[test]
    fn deadlines_on_a_grid_are_met_together() {
        let mut machines = talkers(3).on_grid(Duration::from_millis(4));
        for (on, after) in [(0, 5), (1, 8), (2, 9)] {
            tell(&mut machines, on, after);
        }
        assert_eq!(machines.poll_timeout(), Some(at(8)));
        machines.handle_timeout(at(8));
        assert_eq!(drain(&mut machines, at(8)), (vec![0, 1], vec![0, 1]));
        assert_eq!(machines.poll_timeout(), Some(at(12)));
    }

    #[test]
    fn a_frame_for_an_interface_without_a_machine_changes_nothing() {
        let mut machines = talkers(2);
        tell(&mut machines, 2, 0);
        machines.handle_timeout(at(1));
        assert_eq!(drain(&mut machines, at(1)), (vec![], vec![]));
        assert_eq!(machines.interfaces(), 2);
    }

    #[test]
    fn a_machine_that_did_not_change_is_not_asked_again() {
        let mut machines = talkers(100);
        drain(&mut machines, at(0));
        tell(&mut machines, 7, 0);
        machines.handle_timeout(at(0));
        drain(&mut machines, at(0));
        let polls: Vec<u32> = machines.as_slice().iter().map(|talker| talker.polls).collect();
        // Once at the start; machine 7 again for its frame, and once more for the next one.
        assert!(polls.iter().enumerate().all(|(number, polls)| *polls == if number == 7 { 3 } else { 1 }));
    }
}
