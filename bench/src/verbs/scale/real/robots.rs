//! Processes of robots: several robot nodes as one machine, each on an interface of its own.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Read as _};
use std::net::Ipv4Addr;
use std::ops::ControlFlow;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use clap::ValueEnum as _;
use machine::ethernet::Mac;
use machine::{Instant, LinkEvent, Machine, Machines, Multihomed, PortRequest, Source, Transmit};
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

/// The robots of a process send at multiples of this time, as many together as there are: else each of them would wake the process in
/// each cycle.
const GRID: Duration = Duration::from_micros(250);

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
    let task = ServePlc { addresses: numbers.clone().map(address).collect() };
    if in_line {
        run(RobotLine::new(robots.collect()), interfaces, task)
    } else {
        run(Machines::new(robots.collect()).on_grid(GRID), interfaces, task)
    }
}

/// Runs a machine until the standard input ends: the bench ends the process by closing it.
fn run<M>(machine: M, interfaces: Vec<Interface>, task: ServePlc) -> anyhow::Result<()>
where
    M: Multihomed<Event: Send> + Send + 'static,
    ServePlc: Task<M, Command = (), Notice = ()>,
{
    let (waker, reader) = (Notifier::new()?, Notifier::new()?);
    let driver = Driver::new(machine, interfaces, waker.clone())?;
    let mut thread = CyclicThread::start(driver, task, waker, reader)?;
    outln!("{READY}");
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

/// Robot nodes in line at one interface, as one machine.
#[derive(Debug)]
struct RobotLine(Vec<Robot>);

impl RobotLine {
    fn new(mut robots: Vec<Robot>) -> Self {
        let before_the_last = robots.len().saturating_sub(1);
        for robot in robots.iter_mut().take(before_the_last) {
            if let RobotBus::Ethercat(sub_device) = robot.bus_mut() {
                sub_device.lead_on();
            }
        }
        Self(robots)
    }
}

impl Machine for RobotLine {
    type Event = RobotEvent;

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        if let Some(first) = self.0.first_mut() {
            Machine::handle_frame(first, now, from, frame);
        }
    }

    fn ports(&self) -> &[PortRequest] {
        self.0.first().map_or(&[], Machine::ports)
    }

    fn handle_timeout(&mut self, now: Instant) {
        for robot in &mut self.0 {
            if Machine::poll_timeout(robot).is_some_and(|due| due <= now) {
                Machine::handle_timeout(robot, now);
            }
        }
    }

    /// Gives each robot what the one before it sends, and returns what the last one sends.
    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let mut sent: Option<Transmit> = None;
        for robot in &mut self.0 {
            if let Some(Transmit { port, len, .. }) = sent.take() {
                let from = Source { port, peer: None };
                Machine::handle_frame(robot, now, from, buf.get(..len).unwrap_or_default());
            }
            sent = Machine::poll_transmit(robot, now, buf);
        }
        sent
    }

    fn poll_event(&mut self) -> Option<RobotEvent> {
        self.0.iter_mut().find_map(Machine::poll_event)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.0.iter().filter_map(Machine::poll_timeout).min()
    }
}

/// Serves the PLC until it is stopped.
#[derive(Debug)]
struct ServePlc {
    addresses: Vec<Ipv4Addr>,
}

impl Task<Machines<Robot>> for ServePlc {
    type Command = ();
    type Notice = ();

    fn event(
        &mut self,
        now: Instant,
        robots: &mut Machines<Robot>,
        (number, event): (usize, RobotEvent),
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        if let RobotEvent::Link(LinkEvent::SetAddress { address, .. }) = event {
            // The cables' ends have their addresses from the start.
            let is_own = self.addresses.get(number) == Some(&address);
            robots.change(number, |robot| robot.bus_mut().address_set(now, is_own));
        }
        ControlFlow::Continue(())
    }
}

impl Task<RobotLine> for ServePlc {
    type Command = ();
    type Notice = ();

    fn event(
        &mut self,
        _: Instant,
        _: &mut RobotLine,
        _: RobotEvent,
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}
