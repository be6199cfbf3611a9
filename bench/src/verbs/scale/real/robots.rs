//! Processes of robots: several robot nodes as one machine, each on an interface of its own.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Read as _};
use std::net::Ipv4Addr;
use std::ops::ControlFlow;
use std::process::{Child, Command, ExitCode, Stdio};

use anyhow::{Context as _, anyhow, bail};
use clap::ValueEnum as _;
use machine::ethernet::Mac;
use machine::{
    Instant, InterfaceId, LinkEvent, Machine, Multihomed, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};
use protocol::fieldbus::Fieldbus as _;
use protocol_linux::{CyclicThread, Driver, Interface, NoticeSender, Notifier, Task, clock};
use report::{errln, outln};
use robot_node::bus::RobotBus;
use robot_node::{Program, RobotEvent, RobotNode};

use super::super::plant::{ScalePlant, ScaledBus, address};
use super::network::{ScaleNetwork, robot_interface};
use super::run_on;

/// First argument that makes this program a process of robots; no option of the bench begins like that.
const ROLE: &str = "__scale-robots";

/// Line by which the process says that its robots run.
const READY: &str = "ready";

/// Seed of the robots' connection numbers.
const SEED: u64 = 1;

type Robot = RobotNode<RobotBus>;

/// A process that runs robots until its standard input ends.
#[derive(Debug)]
pub(super) struct RobotProcess(Child);

impl RobotProcess {
    /// Starts a process of `count` robots from number `first` on, and waits until they run.
    pub(super) fn spawn(
        network: &ScaleNetwork,
        bus: ScaledBus,
        first: u8,
        count: u8,
        core: usize,
    ) -> anyhow::Result<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args([ROLE, bus.key()]).args([first.to_string(), count.to_string(), core.to_string()]);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        network.robots.confine(&mut command)?;
        let mut own = Self(command.spawn().context("cannot start the robots")?);
        let mut line = String::new();
        if let Some(output) = own.0.stdout.take() {
            BufReader::new(output).read_line(&mut line)?;
        }
        if line.trim() != READY {
            bail!("the robots did not start; their error is above");
        }
        Ok(own)
    }

    /// Returns an error if the process has ended.
    pub(super) fn check(&mut self) -> anyhow::Result<()> {
        match self.0.try_wait()? {
            None => Ok(()),
            Some(status) => bail!("a process of robots ended meanwhile: {status}"),
        }
    }
}

impl Drop for RobotProcess {
    fn drop(&mut self) {
        // Its standard input ends, and with it the process.
        drop(self.0.stdin.take());
        let _ = self.0.wait();
    }
}

/// Runs robots if this process was started for that. Call it first in `main`.
#[must_use]
pub fn run_as_robots() -> Option<ExitCode> {
    let mut arguments = std::env::args_os().skip(1);
    if arguments.next()?.to_str()? != ROLE {
        return None;
    }
    Some(match serve(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            errln!("error: {error:#}");
            ExitCode::FAILURE
        }
    })
}

/// Runs the robots of the command line until the standard input ends.
fn serve(arguments: impl Iterator<Item = OsString>) -> anyhow::Result<()> {
    let arguments: Vec<_> = arguments.filter_map(|argument| argument.into_string().ok()).collect();
    let [bus, first, count, core] = &arguments[..] else { bail!("a bus and three numbers are needed") };
    let bus = ScaledBus::from_str(bus, false).map_err(|reason| anyhow!(reason))?;
    let (first, count): (u8, u8) = (first.parse()?, count.parse()?);
    run_on(core.parse()?)?;
    let plant = ScalePlant::on(bus)?;
    let numbers = first..first.saturating_add(count);
    let in_line = bus == ScaledBus::Ethercat;
    let open = |number: u8| Interface::open(&robot_interface(number));
    let interfaces = numbers.clone().take(if in_line { 1 } else { count.into() }).map(open);
    let interfaces = interfaces.collect::<Result<Vec<_>, _>>()?;
    let macs = interfaces.iter().map(Interface::mac).cycle();
    let robots = numbers.clone().zip(macs).map(|(number, mac)| robot(&plant, number, mac));
    let machine = Robots::new(robots.collect(), in_line);
    let (waker, reader) = (Notifier::new()?, Notifier::new()?);
    let driver = Driver::new(machine, interfaces, waker.clone())?;
    let task = ServePlc { addresses: numbers.map(address).collect() };
    let mut thread = CyclicThread::start(driver, task, waker, reader)?;
    outln!("{READY}");
    // The bench ends the process by closing it.
    let _ = std::io::stdin().read(&mut [0])?;
    thread.send(())?;
    let finished = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    Ok(finished.result?)
}

fn robot(plant: &ScalePlant, number: u8, mac: Mac) -> Robot {
    let station = plant.station(number);
    let seed = SEED + u64::from(number);
    let bus = robot_node::bus::open(&station.setup.bus, mac, Some(address(number)), seed, clock::now);
    let store = Program::of_sections(&station.planned.motions, &station.programs);
    RobotNode::new(station.planned.robot, store, bus, seed, clock::now())
}

/// Robot nodes as one machine with an interface for each, or in line at one interface.
#[derive(Debug)]
struct Robots {
    robots: Vec<Robot>,
    in_line: bool,
    /// When each has something to do.
    deadlines: Vec<Option<Instant>>,
    /// Robots that may have something to send or to report, the next one last.
    pending: Vec<u8>,
}

impl Robots {
    fn new(mut robots: Vec<Robot>, in_line: bool) -> Self {
        let before_the_last = robots.len().saturating_sub(1);
        for robot in robots.iter_mut().take(before_the_last) {
            if let RobotBus::Ethercat(sub_device) = robot.bus_mut() {
                sub_device.lead_on();
            }
        }
        let deadlines = robots.iter().map(Machine::poll_timeout).collect();
        let pending = Vec::with_capacity(robots.len());
        Self { robots, in_line, deadlines, pending }
    }

    fn get(&self, InterfaceId(number): InterfaceId) -> Option<&Robot> {
        self.robots.get(usize::from(number))
    }

    /// Changes a robot, and looks at what it has to do then.
    fn change(&mut self, number: u8, change: impl FnOnce(&mut Robot)) {
        let Some(robot) = self.robots.get_mut(usize::from(number)) else { return };
        change(robot);
        if let Some(deadline) = self.deadlines.get_mut(usize::from(number)) {
            *deadline = Machine::poll_timeout(robot);
        }
        if !self.pending.contains(&number) {
            self.pending.push(number);
        }
    }

    /// Gives each robot in line what the one before it sends, and returns what the last one sends.
    fn pass_along(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let mut sent = None;
        for number in 0..u8::try_from(self.robots.len()).unwrap_or(u8::MAX) {
            if let Some(Transmit { port, len, .. }) = sent.take() {
                let frame = buf.get(..len).unwrap_or_default();
                self.change(number, |robot| {
                    Machine::handle_frame(robot, now, Source { port, peer: None }, frame);
                });
            }
            self.change(number, |robot| sent = Machine::poll_transmit(robot, now, buf));
        }
        sent
    }

    /// Returns what the next robot has of something. A robot that has nothing is not asked again until it changes.
    fn next<T>(&mut self, mut poll: impl FnMut(&mut Robot) -> Option<T>) -> Option<(u8, T)> {
        self.pending
            .iter()
            .rev()
            .find_map(|number| Some((*number, poll(self.robots.get_mut(usize::from(*number))?)?)))
    }
}

impl Multihomed for Robots {
    type Event = (u8, RobotEvent);

    fn interfaces(&self) -> u8 {
        if self.in_line { 1 } else { u8::try_from(self.robots.len()).unwrap_or(u8::MAX) }
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.change(on.0, |robot| Machine::handle_frame(robot, now, from, frame));
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.change(on.0, |robot| Machine::handle_broadcast(robot, now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        self.change(on.0, |robot| Machine::handle_stream(robot, now, stream, change));
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac) {
        self.change(on.0, |robot| Machine::handle_wrong_neighbour(robot, now, address, found));
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        self.get(on).map_or(&[], Machine::ports)
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        Machine::listen_port(self.get(on)?)
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        self.next(Machine::poll_stream).map(|(number, request)| (InterfaceId(number), request))
    }

    fn dscp(&self, on: InterfaceId, port: Port) -> u8 {
        self.get(on).map_or(0, |robot| Machine::dscp(robot, port))
    }

    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        Machine::group(self.get(on)?, port, index)
    }

    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        Machine::neighbour(self.get(on)?, address)
    }

    fn handle_timeout(&mut self, now: Instant) {
        for number in 0..u8::try_from(self.robots.len()).unwrap_or(u8::MAX) {
            if self.deadlines.get(usize::from(number)).copied().flatten().is_some_and(|due| due <= now) {
                self.change(number, |robot| Machine::handle_timeout(robot, now));
            }
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        if self.in_line {
            return Some((InterfaceId::FIRST, self.pass_along(now, buf)?));
        }
        self.next(|robot| Machine::poll_transmit(robot, now, buf))
            .map(|(number, transmit)| (InterfaceId(number), transmit))
    }

    fn poll_event(&mut self) -> Option<(u8, RobotEvent)> {
        let event = self.next(Machine::poll_event);
        if event.is_none() {
            // Frames and requests were taken before.
            self.pending.clear();
        }
        event
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.iter().copied().flatten().min()
    }
}

/// Serves the PLC until it is stopped.
#[derive(Debug)]
struct ServePlc {
    addresses: Vec<Ipv4Addr>,
}

impl Task<Robots> for ServePlc {
    type Command = ();
    type Notice = ();

    fn event(
        &mut self,
        now: Instant,
        robots: &mut Robots,
        (number, event): (u8, RobotEvent),
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        if let RobotEvent::Link(LinkEvent::SetAddress { address, .. }) = event {
            // The cables' ends have their addresses from the start.
            let is_own = self.addresses.get(usize::from(number)) == Some(&address);
            robots.change(number, |robot| robot.bus_mut().address_set(now, is_own));
        }
        ControlFlow::Continue(())
    }
}
