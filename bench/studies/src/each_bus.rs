//! The same setup over every bus, for the verbs that compare the buses.

use setup::{Addresses, BusKind, Cyclic, Error, Ethercat, EthernetIp, Profinet, Setup};

/// Returns the setup on each bus.
pub fn over_each_bus(setup: &Setup) -> Result<[(&'static str, Setup); 4], Error> {
    let (addresses, profinet) = profinet_of(setup)?;
    let profinet =
        |cyclic| BusKind::Profinet(addresses, Profinet { cyclic, device: None, ..profinet.clone() });
    let over = |kind| {
        let mut setup = setup.clone();
        setup.bus.kind = kind;
        setup
    };
    Ok([
        ("PROFINET udp", over(profinet(Cyclic::Udp))),
        ("PROFINET rt1", over(profinet(Cyclic::Rt1))),
        ("EtherNet/IP", over(BusKind::EthernetIp(addresses, EthernetIp::default()))),
        ("EtherCAT", over(BusKind::Ethercat(Ethercat::default()))),
    ])
}

/// Returns the settings for PROFINET: the setup's own, or those of Setup A.
fn profinet_of(setup: &Setup) -> Result<(Addresses, Profinet), Error> {
    match &setup.bus.kind {
        BusKind::Profinet(addresses, profinet) => Ok((*addresses, profinet.clone())),
        BusKind::EthernetIp(..) | BusKind::Ethercat(_) => profinet_of(&setup::setup("A")?),
    }
}
