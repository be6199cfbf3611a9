//! The plant of a measurement: a number of stations on one bus, all like Setup A.

use std::net::Ipv4Addr;

use anyhow::{Context as _, anyhow};
use planning::Plan;
use setup::{BusKind, Cyclic, Setup};
use stands::planned_cell::PlannedCell;
use stands::planned_station::PlannedStation;
use studies::each_bus::over_each_bus;

/// Largest number of stations: their addresses and their interfaces are numbered in a byte.
pub const MOST_STATIONS: u32 = 128;

/// Address of the PLC.
pub const PLC: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
/// Mask of all addresses.
pub const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// A bus to measure.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub enum ScaledBus {
    /// PROFINET, RT_CLASS_UDP.
    ProfinetUdp,
    /// PROFINET, RT_CLASS_1.
    ProfinetRt1,
    /// EtherNet/IP.
    EthernetIp,
    /// EtherCAT, the robots in line.
    Ethercat,
}

impl ScaledBus {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 4] = [Self::ProfinetUdp, Self::ProfinetRt1, Self::EthernetIp, Self::Ethercat];

    /// Returns the name of the option's value, which is also that in results.
    pub const fn key(self) -> &'static str {
        match self {
            Self::ProfinetUdp => "profinet-udp",
            Self::ProfinetRt1 => "profinet-rt1",
            Self::EthernetIp => "ethernet-ip",
            Self::Ethercat => "ethercat",
        }
    }

    fn is_bus_of(self, setup: &Setup) -> bool {
        match &setup.bus.kind {
            BusKind::Profinet(_, profinet) => match profinet.cyclic {
                Cyclic::Udp => self == Self::ProfinetUdp,
                Cyclic::Rt1 => self == Self::ProfinetRt1,
            },
            BusKind::EthernetIp(..) => self == Self::EthernetIp,
            BusKind::Ethercat(_) => self == Self::Ethercat,
        }
    }
}

/// Returns the address of a station, by its number from 0.
pub fn address(station: u8) -> Ipv4Addr {
    let [a, b, c, _] = PLC.octets();
    Ipv4Addr::new(a, b, c, station.saturating_add(2))
}

/// The stations on one bus, planned once.
#[derive(Debug)]
pub struct ScalePlant {
    setup: Setup,
    planned: PlannedCell,
    plan: Plan,
}

impl ScalePlant {
    /// Plans Setup A on a bus.
    ///
    /// # Errors
    ///
    /// Setup A cannot be planned on it.
    pub fn on(bus: ScaledBus) -> anyhow::Result<Self> {
        let (setup, application) = planning::setup_with_application("A")?;
        let all = over_each_bus(&setup)?.into_iter();
        let found = all.map(|(_, setup)| setup).find(|setup| bus.is_bus_of(setup));
        let setup = found.ok_or_else(|| anyhow!("Setup A does not run on {}", bus.key()))?;
        let plan = application.plan(&setup)?;
        let planned = PlannedCell::of_plan(&setup, &application.application, &plan)?;
        Ok(Self { setup, planned, plan })
    }

    /// Returns a station by its number from 0.
    pub fn station(&self, number: u8) -> PlannedStation {
        let mut setup = self.setup.clone();
        match &mut setup.bus.kind {
            BusKind::Profinet(addresses, profinet) => {
                (addresses.plc, addresses.robot, addresses.mask) = (PLC, address(number), MASK);
                profinet.robot_station_name = format!("robot-{number}");
            }
            BusKind::EthernetIp(addresses, _) => {
                (addresses.plc, addresses.robot, addresses.mask) = (PLC, address(number), MASK);
            }
            BusKind::Ethercat(_) => {}
        }
        PlannedStation {
            name: format!("robot-{number}"),
            setup,
            position: None,
            planned: self.planned.clone(),
            waits: Vec::new(),
            visits: Vec::new(),
            zones: None,
            programs: self.plan.sections(),
            sections: self.plan.sections_between_rests(),
            in_step: None,
        }
    }

    /// Returns the first stations.
    ///
    /// # Errors
    ///
    /// There are more than a byte can number.
    pub fn stations(&self, count: u32) -> anyhow::Result<Vec<PlannedStation>> {
        let count = u8::try_from(count).context("the number of stations does not fit a byte")?;
        Ok((0..count).map(|number| self.station(number)).collect())
    }

    /// Returns the bus cycle and the PLC's scan, in µs; both are the same.
    pub const fn cycle_us(&self) -> u32 {
        self.setup.bus.cycle_us.value
    }
}
