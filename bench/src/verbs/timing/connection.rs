//! A contender: a connection over one bus between this project's two ends, or between its PLC's end and another
//! maker's device.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::thread;

use anyhow::bail;
use machine::{Duration, Instant, Machine};
use plc_node::bus::PlcBus;
use protocol::fieldbus::{Down, DownCause, Fieldbus as _, LinkEvent};
use protocol::one_station::FirstStation;
use protocol_linux::handover::Received;
use protocol_linux::{CyclicThread, Driver, Interface, NoticeSender, Notifier, Task, clock};
use robot_node::bus::RobotBus;
use setup::Bus;

use super::INTERVAL;
use super::cable::{Cable, ROBOT};
use super::stopwatch::{RoundTrip, Stopwatch, Times};
use report::errln;

/// Longest time for a connection to be established, and to be closed.
const PATIENCE: Duration = Duration::from_secs(10);

/// Time between two looks at whether the connection is up.
const LOOK: Duration = Duration::from_millis(5);

/// Time from the connection to the first look at how the ends' cycles lie to each other.
const RUNNING: Duration = Duration::from_millis(20);

/// The device at the other end.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum TimedPeer {
    /// This project's.
    Ours,
    /// Anybody else's, which runs there already.
    Foreign,
}

/// A connection that is up.
#[derive(Debug)]
pub(super) struct Connection {
    plc: CyclicThread<Stopwatch<FirstStation<PlcBus>>, TimedCall>,
    robot: Option<CyclicThread<Stopwatch<RobotBus>, Serve>>,
    times: Arc<Times>,
    up_at: Instant,
}

impl Connection {
    /// Connects. `turn` makes the connection's numbers its own.
    pub(super) fn open(cable: &Cable, bus: &Bus, peer: TimedPeer, turn: u32) -> anyhow::Result<Self> {
        let times = Arc::new(Times::default());
        let seed = u64::from(turn) << 8;
        let robot = match peer {
            TimedPeer::Foreign => None,
            TimedPeer::Ours => Some(cable.robot.run(|interface| {
                let endpoint = robot_node::bus::open(bus, interface.mac(), Some(ROBOT), seed, clock::now);
                start(Stopwatch::of_robot(endpoint, Arc::clone(&times)), interface, Serve)
            })?),
        };
        let plc = cable.plc.run(|interface| {
            let bus = plc_node::bus::open(bus, interface.mac(), seed, clock::now())?;
            let endpoint = FirstStation { bus };
            start(Stopwatch::of_plc(endpoint, Arc::clone(&times)), interface, TimedCall::default())
        })?;
        let mut own = Self { plc, robot, times, up_at: Instant::ZERO };
        if let (0, Some(warning)) = (turn, own.plc.warning()) {
            errln!("warning: {warning}");
        }
        let until = clock::now() + PATIENCE;
        own.up_at = loop {
            match own.plc.next_notice() {
                Received::Item(Notice::Up(at)) => break at,
                Received::Item(Notice::Down(down)) if clock::now() >= until => {
                    bail!("no connection came about: {down}")
                }
                Received::Item(Notice::Down(_)) => {}
                Received::Nothing if clock::now() >= until => {
                    bail!("nobody answered at {ROBOT} within {PATIENCE:?}")
                }
                Received::Nothing => thread::sleep(LOOK),
                Received::Ended => bail!("the PLC's end stopped before it had a connection"),
            }
        };
        thread::sleep(RUNNING);
        Ok(own)
    }

    /// Returns when the connection came up.
    pub(super) const fn up_at(&self) -> Instant {
        self.up_at
    }

    /// Returns how long before a frame of the PLC's end the robot's end sends one.
    pub(super) fn phase(&self) -> Duration {
        self.times.phase(INTERVAL)
    }

    /// Closes the connection and returns the ways of all numbers.
    pub(super) fn close(mut self) -> anyhow::Result<Vec<RoundTrip>> {
        self.plc.send(())?;
        let (plc, call) = finish(self.plc)?;
        if let Some(mut robot) = self.robot {
            robot.send(())?;
            finish(robot)?;
        }
        match call.down {
            Some(Down { cause: DownCause::ClosedHere, .. }) => Ok(plc.machine().round_trips().to_vec()),
            Some(down) => bail!("the connection was lost in the middle of a turn: {down}"),
            None => bail!("the connection was not closed within {PATIENCE:?}"),
        }
    }
}

fn start<M, T>(machine: M, interface: Interface, task: T) -> anyhow::Result<CyclicThread<M, T>>
where
    M: Machine + Send + 'static,
    T: Task<M>,
{
    let (waker, reader) = (Notifier::new()?, Notifier::new()?);
    let driver = Driver::new(machine, interface, waker.clone())?;
    Ok(CyclicThread::start(driver, task, waker, reader)?)
}

fn finish<M: Machine + Send + 'static, T: Task<M>>(
    thread: CyclicThread<M, T>,
) -> anyhow::Result<(Driver<M>, T)> {
    let finished = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    finished.result?;
    Ok((finished.driver, finished.task))
}

/// Serves the PLC until it is stopped.
#[derive(Debug)]
struct Serve;

impl Task<Stopwatch<RobotBus>> for Serve {
    type Command = ();
    type Notice = ();

    fn event(
        &mut self,
        now: Instant,
        robot: &mut Stopwatch<RobotBus>,
        event: LinkEvent,
        _: &mut NoticeSender<()>,
    ) -> ControlFlow<()> {
        if let LinkEvent::SetAddress { address, .. } = event {
            // The cable's ends have their addresses from the start.
            robot.bus_mut().address_set(now, address == ROBOT);
        }
        ControlFlow::Continue(())
    }
}

/// What the PLC's thread reports.
#[derive(Clone, Copy, Debug)]
enum Notice {
    Up(Instant),
    Down(Down),
}

/// Keeps a connection until the command to close it.
#[derive(Default, Debug)]
struct TimedCall {
    up: bool,
    /// When to give up waiting for the end.
    deadline: Option<Instant>,
    /// How the connection ended.
    down: Option<Down>,
}

impl Task<Stopwatch<FirstStation<PlcBus>>> for TimedCall {
    type Command = ();
    type Notice = Notice;

    fn command(
        &mut self,
        now: Instant,
        plc: &mut Stopwatch<FirstStation<PlcBus>>,
        _: &protocol_linux::Statistics,
        (): (),
        _: &mut NoticeSender<Notice>,
    ) -> ControlFlow<()> {
        self.deadline = Some(now + PATIENCE);
        plc.bus_mut().disconnect(now);
        ControlFlow::Continue(())
    }

    fn event(
        &mut self,
        now: Instant,
        _: &mut Stopwatch<FirstStation<PlcBus>>,
        event: LinkEvent,
        notices: &mut NoticeSender<Notice>,
    ) -> ControlFlow<()> {
        match event {
            LinkEvent::Up => {
                self.up = true;
                notices.send(Notice::Up(now));
            }
            LinkEvent::Down(down) => {
                // Before the first connection the PLC keeps trying.
                if self.up {
                    self.down = Some(down);
                    return ControlFlow::Break(());
                }
                notices.send(Notice::Down(down));
            }
            LinkEvent::SetAddress { .. }
            | LinkEvent::Store
            | LinkEvent::Foreign(_)
            | LinkEvent::Owner(_)
            | LinkEvent::Conflict(_)
            | LinkEvent::Health => {}
        }
        ControlFlow::Continue(())
    }

    fn expired(&mut self, _: Instant, _: &mut Stopwatch<FirstStation<PlcBus>>) -> ControlFlow<()> {
        ControlFlow::Break(())
    }

    fn deadline(&self) -> Option<Instant> {
        self.deadline
    }
}
