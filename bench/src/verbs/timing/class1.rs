//! The contenders: a class 1 connection between this project's scanner and an adapter.

use std::net::Ipv4Addr;
use std::ops::ControlFlow;

use anyhow::bail;
use ethernet_ip::connection::TimeoutMultiplier;
use ethernet_ip::{AdapterConfig, ConnectionConfig, ScannerConfig};
use machine::{Duration, Instant, Machine};
use protocol::buses::EthernetIpScanner;
use protocol::fieldbus::{Down, DownCause, Fieldbus as _, LinkEvent};
use protocol::stations::{ETHERNET_IP_ROBOT, ETHERNET_IP_VENDOR};
use protocol_linux::{CyclicThread, Driver, Interface, Notifier, Outbox, Task, clock};

use super::cable::{Cable, MASK, ROBOT};
use super::{INTERVAL, SETTLE, TURN};
use crate::output::errln;

/// Longest time for a connection to be established, and to be closed.
const PATIENCE: Duration = Duration::from_secs(5);

/// The adapter of a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Peer {
    /// The adapter of this project; it must have its own identity.
    Ours,
    /// Any other adapter.
    Foreign,
}

/// Our adapter at the robot's end.
#[derive(Debug)]
pub(super) struct Adapter(CyclicThread<ethernet_ip::Adapter, Serve>);

impl Adapter {
    pub(super) fn start(cable: &Cable) -> anyhow::Result<Self> {
        let adapter = |interface: &Interface| {
            ethernet_ip::Adapter::new(AdapterConfig {
                description: &ETHERNET_IP_ROBOT,
                serial_number: 1,
                address: ROBOT,
                mask: MASK,
                gateway: Ipv4Addr::UNSPECIFIED,
                mac: interface.mac().0,
                first_id: 1,
                originators: machine::Allowed::default(),
            })
        };
        let thread = cable.robot.run(|interface| start(adapter(&interface), interface, Serve))?;
        if let Some(warning) = thread.warning() {
            errln!("warning: {warning}");
        }
        Ok(Self(thread))
    }

    pub(super) fn stop(mut self) -> anyhow::Result<()> {
        self.0.send(())?;
        finish(self.0).map(drop)
    }
}

/// Connects, exchanges data for a turn, and closes the connection. Returns when it was up.
pub(super) fn exchange(cable: &Cable, peer: Peer, turn: u32) -> anyhow::Result<Instant> {
    let own = ConnectionConfig::exclusive_owner(ROBOT, &ETHERNET_IP_ROBOT, INTERVAL.as_micros() as u32);
    let connection = ConnectionConfig {
        key: own.key.filter(|_| peer == Peer::Ours),
        retry_after: Duration::from_millis(100),
        // A stall of the host should be measured, not end the connection.
        multiplier: TimeoutMultiplier::covering(512).unwrap_or(own.multiplier),
        ..own
    };
    let config = ScannerConfig { vendor: ETHERNET_IP_VENDOR, serial_number: 1, first_id: turn << 8 };
    let now = clock::now();
    let task = Turn { deadline: now + PATIENCE, up_at: None, down: None };
    let scanner = EthernetIpScanner::new(config, connection, now);
    let thread = cable.plc.run(|interface| start(scanner, interface, task))?;
    let turn = finish(thread)?;
    match (turn.up_at, turn.down) {
        (Some(up_at), Some(Down { cause: DownCause::ClosedHere, .. })) => Ok(up_at),
        (Some(_), Some(down)) => bail!("the connection was lost in the middle of a turn: {down}"),
        (None, Some(down)) => bail!("no connection came about: {down}"),
        (_, None) => bail!("no adapter answered at {ROBOT} within {PATIENCE:?}"),
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

fn finish<M: Machine + Send + 'static, T: Task<M>>(thread: CyclicThread<M, T>) -> anyhow::Result<T> {
    let finished = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    finished.result?;
    Ok(finished.task)
}

/// Serves every scanner until it is stopped.
#[derive(Debug)]
struct Serve;

impl Task<ethernet_ip::Adapter> for Serve {
    type Command = ();
    type News = ();

    fn event(
        &mut self,
        _: Instant,
        _: &mut ethernet_ip::Adapter,
        _: LinkEvent,
        _: &mut Outbox<()>,
    ) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Keeps a connection up for a turn, then closes it.
#[derive(Debug)]
struct Turn {
    deadline: Instant,
    up_at: Option<Instant>,
    /// How the connection ended, or why there is none yet.
    down: Option<Down>,
}

impl Task<EthernetIpScanner> for Turn {
    type Command = ();
    type News = ();

    fn event(
        &mut self,
        now: Instant,
        _: &mut EthernetIpScanner,
        event: LinkEvent,
        _: &mut Outbox<()>,
    ) -> ControlFlow<()> {
        match event {
            LinkEvent::Up => {
                self.up_at = Some(now);
                self.deadline = now + SETTLE + TURN;
            }
            LinkEvent::Down(down) => {
                self.down = Some(down);
                // Before the first connection the scanner keeps trying.
                if self.up_at.is_some() {
                    return ControlFlow::Break(());
                }
            }
            LinkEvent::SetAddress { .. } | LinkEvent::Foreign(_) => {}
        }
        ControlFlow::Continue(())
    }

    fn expired(&mut self, now: Instant, scanner: &mut EthernetIpScanner) -> ControlFlow<()> {
        if self.up_at.is_none() {
            return ControlFlow::Break(());
        }
        self.deadline = now + PATIENCE;
        scanner.disconnect(now);
        ControlFlow::Continue(())
    }

    fn deadline(&self) -> Option<Instant> {
        Some(self.deadline)
    }
}
