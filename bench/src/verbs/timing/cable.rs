//! A cable of its own for a contender, with an arrival log at each end.

use std::ffi::{OsStr, OsString};
use std::net::Ipv4Addr;
use std::process::{Child, Command, Stdio};

use anyhow::Context as _;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Arrival, ArrivalLog, Interface, veth};

pub(super) const PLC: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
pub(super) const ROBOT: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
pub(super) const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// Direction of frames.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum TimedWay {
    /// T→O.
    ToPlc,
    /// O→T.
    ToRobot,
}

/// One end: its network, its interface, and the log of what arrives there.
#[derive(Debug)]
pub(super) struct End {
    network: NetworkNamespace,
    name: &'static str,
    log: ArrivalLog,
}

impl End {
    fn new(network: NetworkNamespace, name: &'static str, address: Ipv4Addr) -> anyhow::Result<Self> {
        let log = network.run(|| -> anyhow::Result<_> {
            let interface = Interface::open(name)?;
            interface.set_address(address, MASK)?;
            interface.set_up()?;
            Ok(ArrivalLog::start(&interface)?)
        })??;
        Ok(Self { network, name, log })
    }

    /// Runs `work` at this end.
    pub(super) fn run<T: Send>(
        &self,
        work: impl FnOnce(Interface) -> anyhow::Result<T> + Send,
    ) -> anyhow::Result<T> {
        self.network.run(|| work(Interface::open(self.name)?))?
    }
}

#[derive(Debug)]
pub(super) struct Cable {
    pub(super) plc: End,
    pub(super) robot: End,
}

impl Cable {
    pub(super) fn set_up() -> anyhow::Result<Self> {
        let (plc, robot) = (NetworkNamespace::new()?, NetworkNamespace::new()?);
        veth::connect(&plc, "plc0", &robot, "robot0")?;
        Ok(Self { plc: End::new(plc, "plc0", PLC)?, robot: End::new(robot, "robot0", ROBOT)? })
    }

    /// Starts a foreign program at the robot's end.
    pub(super) fn spawn_at_robot(&self, program: &OsStr, arguments: &[OsString]) -> anyhow::Result<Process> {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null());
        self.robot.network.confine(&mut command)?;
        let child = command.spawn().with_context(|| format!("starting {}", program.display()))?;
        Ok(Process(child))
    }

    /// Ends the logs and returns what arrived at each end.
    pub(super) fn arrivals(self) -> anyhow::Result<Arrivals> {
        Ok(Arrivals { at_plc: self.plc.log.stop()?, at_robot: self.robot.log.stop()? })
    }
}

/// What arrived at the ends of a cable.
#[derive(Debug)]
pub(super) struct Arrivals {
    at_plc: Vec<Arrival>,
    at_robot: Vec<Arrival>,
}

impl Arrivals {
    pub(super) fn of(&self, way: TimedWay) -> &[Arrival] {
        match way {
            TimedWay::ToPlc => &self.at_plc,
            TimedWay::ToRobot => &self.at_robot,
        }
    }
}

/// A foreign program, killed when it is dropped.
#[derive(Debug)]
pub(super) struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
