//! The cables between devices, and the way of a frame: it enters a device by one port and leaves it by
//! the next open one.

use alloc::vec::Vec;

use machine::Duration;

use crate::config::DeviceConfig;

/// Ports of a chip.
pub(crate) const PORTS: usize = 4;

/// A port of a device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Place {
    pub(crate) device: usize,
    pub(crate) port: usize,
}

/// What is at the other end of a cable.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum End {
    MainDevice,
    Device(Place),
}

/// What is connected at a port, and how long the cable takes.
pub(crate) type Peer = Option<(End, Duration)>;

/// A device, and its cable towards the MainDevice.
#[derive(Clone, Copy, Debug)]
struct Station {
    upstream: End,
    /// Its own port with that cable.
    upstream_port: usize,
    cable_delay: Duration,
    forwarding_delay: Duration,
    cut: bool,
    powered: bool,
    /// What its ports reach now.
    peers: [Peer; PORTS],
}

/// The cables of a segment.
#[derive(Default, Debug)]
pub(crate) struct Cabling {
    stations: Vec<Station>,
}

impl Cabling {
    /// Returns whether there is such a port, and nothing is plugged into it.
    pub(crate) fn is_free(&self, place: Place) -> bool {
        self.stations.get(place.device).is_some_and(|station| station.upstream_port != place.port)
            && place.port < PORTS
            && self.stations.iter().all(|station| station.upstream != End::Device(place))
    }

    /// Adds a device at a free place.
    pub(crate) fn add(&mut self, upstream: End, config: &DeviceConfig) {
        self.stations.push(Station {
            upstream,
            upstream_port: config.upstream_port.min(PORTS - 1),
            cable_delay: config.cable_delay,
            forwarding_delay: config.forwarding_delay,
            cut: false,
            powered: true,
            peers: [None; PORTS],
        });
        self.update();
    }

    pub(crate) fn set_cut(&mut self, device: usize, cut: bool) {
        if let Some(station) = self.stations.get_mut(device) {
            station.cut = cut;
        }
        self.update();
    }

    /// Returns whether this changes anything.
    pub(crate) fn set_power(&mut self, device: usize, powered: bool) -> bool {
        let changed = self.stations.get_mut(device).is_some_and(|station| {
            let before = core::mem::replace(&mut station.powered, powered);
            before != powered
        });
        self.update();
        changed
    }

    pub(crate) fn is_powered(&self, device: usize) -> bool {
        self.stations.get(device).is_some_and(|station| station.powered)
    }

    pub(crate) fn forwarding_delay(&self, device: usize) -> Duration {
        self.stations.get(device).map_or(Duration::ZERO, |station| station.forwarding_delay)
    }

    /// Returns what a port reaches, if the cable is whole and both ends have power.
    pub(crate) fn peer(&self, place: Place) -> Peer {
        *self.stations.get(place.device)?.peers.get(place.port)?
    }

    /// Returns which ports of a device have a link.
    pub(crate) fn links(&self, device: usize) -> [bool; PORTS] {
        self.stations.get(device).map_or([false; PORTS], |station| station.peers.map(|peer| peer.is_some()))
    }

    /// Returns the port that leads towards the MainDevice.
    pub(crate) fn upstream_port(&self, device: usize) -> usize {
        self.stations.get(device).map_or(0, |station| station.upstream_port)
    }

    /// Returns the port at which the device next to the MainDevice is reached, and the delay of the cable, if it is.
    pub(crate) fn first(&self) -> Option<(Place, Duration)> {
        let number = self.stations.iter().position(|station| station.upstream == End::MainDevice)?;
        let station = self.stations.get(number).filter(|station| !station.cut && station.powered)?;
        Some((Place { device: number, port: station.upstream_port }, station.cable_delay))
    }

    fn update(&mut self) {
        for device in 0..self.stations.len() {
            let peers = core::array::from_fn(|port| self.find_peer(Place { device, port }));
            if let Some(station) = self.stations.get_mut(device) {
                station.peers = peers;
            }
        }
    }

    fn find_peer(&self, place: Place) -> Peer {
        let station = self.stations.get(place.device)?;
        if place.port == station.upstream_port {
            let live = match station.upstream {
                End::MainDevice => true,
                End::Device(upstream) => self.is_powered(upstream.device),
            };
            return (live && station.powered && !station.cut)
                .then_some((station.upstream, station.cable_delay));
        }
        let number = self.stations.iter().position(|station| station.upstream == End::Device(place))?;
        let station = self.stations.get(number).filter(|station| !station.cut && station.powered)?;
        self.is_powered(place.device).then_some((
            End::Device(Place { device: number, port: station.upstream_port }),
            station.cable_delay,
        ))
    }
}

/// Returns the port after `port` in the order in which a chip passes frames on: 0, 3, 1, 2. The processing unit is
/// between ports 0 and 3.
pub(crate) const fn next_port(port: usize) -> usize {
    match port {
        0 => 3,
        3 => 1,
        1 => 2,
        _ => 0,
    }
}
