//! The devices on one bus, for whoever looks for one of them.

use std::net::Ipv4Addr;

use anyhow::bail;
use ethercat_maindevice::Found;
use ethernet_ip::FoundDevice;
use machine::Duration;
use profinet::description::Identity;
use profinet::{
    FoundStation, RecordPlace, RecordReadError, RecordReader, RecordReaderConfig, StationSetError,
    StationSetter, Uuid,
};
use protocol::search::Search;
use protocol_linux::{Interface, clock};
use setup::BusKind;

use super::{UntilFound, UntilSearchEnded, ethernet_ip_search, searched};

/// The devices that answered on a bus.
#[derive(Clone, Debug)]
pub enum FoundDevices {
    /// Stations that answered DCP Identify.
    Profinet(Vec<FoundStation>),
    /// Devices that answered ListIdentity.
    EthernetIp(Vec<FoundDevice>),
    /// SubDevices, in their order on the cable.
    Ethercat(Found),
}

/// Asks for `length` which devices are on a bus of this kind. It changes none of them.
///
/// # Errors
///
/// Nothing can be sent on the interface, or EtherNet/IP has no IPv4 address there.
pub fn find_devices(interface: &Interface, bus: &BusKind, length: Duration) -> anyhow::Result<FoundDevices> {
    Ok(match bus {
        BusKind::Profinet(..) => FoundDevices::Profinet(find_stations(interface, length)?),
        BusKind::EthernetIp(..) => FoundDevices::EthernetIp(find_adapters(interface, length)?),
        BusKind::Ethercat(_) => FoundDevices::Ethercat(find_sub_devices(interface, length)?),
    })
}

/// Looks for at most `length` which SubDevices are on EtherCAT. They stay in their states.
pub(crate) fn find_sub_devices(interface: &Interface, length: Duration) -> anyhow::Result<Found> {
    let search = ethercat_maindevice::search(clock::now(), length).on_interface(interface.mac());
    match searched(search, interface, UntilFound(None))?.1 {
        UntilFound(Some(found)) => Ok(found),
        UntilFound(None) => bail!("the search on `{}` ended without a result", interface.name()),
    }
}

/// Asks for `length` which stations are on PROFINET.
pub(crate) fn find_stations(interface: &Interface, length: Duration) -> anyhow::Result<Vec<FoundStation>> {
    let start = clock::now();
    let first_xid = (start.as_nanos() >> 10) as u32;
    let config = profinet::SearchConfig { mac: interface.mac(), first_xid, length };
    let search = Search::new(Some(profinet::Search::new(config, start)), None);
    let (search, _) = searched(search, interface, UntilSearchEnded)?;
    let stations = search.profinet().map(|search| search.answers().devices().to_vec());
    Ok(stations.unwrap_or_default())
}

/// Asks for `length` which devices are on EtherNet/IP.
pub(crate) fn find_adapters(interface: &Interface, length: Duration) -> anyhow::Result<Vec<FoundDevice>> {
    let start = clock::now();
    let config = ethernet_ip_search(interface, length)?;
    let search = Search::new(None, Some(ethernet_ip::Search::new(config, start)));
    let (search, _) = searched(search, interface, UntilSearchEnded)?;
    let devices = search.ethernet_ip().map(|search| search.answers().devices().to_vec());
    Ok(devices.unwrap_or_default())
}

/// Changes a PROFINET station, and returns what it answered.
pub(crate) fn set_station(
    setter: StationSetter,
    interface: &Interface,
) -> anyhow::Result<Result<(), StationSetError>> {
    let (setter, _) = searched(setter, interface, UntilSearchEnded)?;
    Ok(setter.result().unwrap_or(Err(StationSetError::NoAnswer)))
}

/// Reads records of a PROFINET device without a connection.
///
/// # Errors
///
/// Nothing can be sent on the interface. A record that the device does not give is an error in its place.
pub fn read_records(
    interface: &Interface,
    address: Ipv4Addr,
    identity: Identity,
    records: &[RecordPlace],
) -> anyhow::Result<Vec<Result<Vec<u8>, RecordReadError>>> {
    let start = clock::now();
    // No two readers of a host begin in the same nanosecond.
    let activity = Uuid((u128::from(start.as_nanos()) << 64 | 0x8001).to_be_bytes());
    // The kernel chooses the port.
    let config = RecordReaderConfig { address, identity, local_port: 0, activity, records: records.to_vec() };
    let (reader, _) = searched(RecordReader::new(config, start), interface, UntilSearchEnded)?;
    Ok(reader.answers().to_vec())
}
