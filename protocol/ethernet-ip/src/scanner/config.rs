//! Configuration of a scanner: its own identity, and for each connection the adapter, the assemblies and the intervals.

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use crate::Writer;
use crate::cip::{ElectronicKey, Logical, class, write_logical};
use crate::class1::SEQUENCE_LEN;
use crate::connection::{ConnectionType, Parameters, Priority, RealTimeFormat, TimeoutMultiplier};
use crate::description::{Description, Role};
use machine::Duration;

/// Configuration of a scanner itself.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ScannerConfig {
    /// Its own ODVA vendor number.
    pub vendor: u16,
    /// Its own serial number, which no other device of the vendor has.
    pub serial_number: u32,
    /// First connection number. Choose another one at each start, so that frames of an old connection are not accepted for
    /// a new one.
    pub first_id: u32,
}

/// Configuration of a connection.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ConnectionConfig {
    /// The adapter's address.
    pub target: Ipv4Addr,
    /// Port segments to an adapter behind a bridge, as a padded path; empty for an adapter on this network.
    pub route: Vec<u8>,
    /// The device that the adapter must be; `None` for any.
    pub key: Option<ElectronicKey>,
    /// The serial number that the adapter must have; `None` for any.
    pub serial_number: Option<u32>,
    /// What the EDS file of that device says; the text of a refusal quotes it.
    pub described: Option<&'static Description>,
    /// Configuration assembly, if the adapter has one.
    pub configuration: Option<u32>,
    /// Configuration data that the Forward_Open carries; empty for none. At most 400 bytes.
    pub configuration_data: Vec<u8>,
    /// O→T assembly.
    pub consumed: u32,
    /// T→O assembly.
    pub produced: u32,
    /// Whether T→O data goes to a multicast group, which other scanners may join, and not to this scanner alone.
    pub multicast: bool,
    /// Bytes of data O→T, without sequence count and header.
    pub o_t_size: u16,
    /// Bytes of data T→O, without sequence count and header.
    pub t_o_size: u16,
    /// Real-time format of the O→T assembly.
    pub consumed_format: RealTimeFormat,
    /// Real-time format of the T→O assembly.
    pub produced_format: RealTimeFormat,
    /// Requested packet interval O→T in µs.
    pub o_t_rpi_us: u32,
    /// Requested packet interval T→O in µs.
    pub t_o_rpi_us: u32,
    /// Intervals without a frame after which either side ends the connection.
    pub multiplier: TimeoutMultiplier,
    /// How long to wait for an answer.
    pub request_timeout: Duration,
    /// How long to wait for the answer to a Forward_Open: a device may configure itself before it answers.
    pub open_timeout: Duration,
    /// How long to wait before the next attempt to connect.
    pub retry_after: Duration,
}

impl ConnectionConfig {
    /// Returns the configuration of a connection that owns the outputs of such a device, at this packet interval both
    /// ways.
    ///
    /// The timeout is 128 intervals (code 5), requests may take 1 s and a Forward_Open 5 s, and the next attempt comes
    /// after 1 s.
    #[must_use]
    pub fn exclusive_owner(target: Ipv4Addr, device: &'static Description, rpi_us: u32) -> Self {
        let role = |role| device.role(role).map_or((0, 0), |assembly| (assembly.instance, assembly.size));
        let (consumed, o_t_size) = role(Role::Consumed);
        let (produced, t_o_size) = role(Role::Produced);
        Self {
            target,
            route: Vec::new(),
            key: Some(device.key()),
            serial_number: None,
            described: Some(device),
            configuration: device.role(Role::Configuration).map(|assembly| assembly.instance),
            configuration_data: Vec::new(),
            consumed,
            produced,
            multicast: false,
            o_t_size,
            t_o_size,
            consumed_format: RealTimeFormat::RunIdleHeader,
            produced_format: RealTimeFormat::Modeless,
            o_t_rpi_us: rpi_us,
            t_o_rpi_us: rpi_us,
            multiplier: TimeoutMultiplier::TIMES_128,
            request_timeout: Duration::from_secs(1),
            open_timeout: Duration::from_secs(5),
            retry_after: Duration::from_secs(1),
        }
    }

    /// Returns the parameters of one direction.
    fn parameters(kind: ConnectionType, size: u16, format: RealTimeFormat) -> Parameters {
        Parameters {
            redundant_owner: false,
            kind,
            priority: Priority::Scheduled,
            variable: false,
            size: format.data_len(size).saturating_add(SEQUENCE_LEN + format.header_len()),
        }
    }

    /// Returns the parameters O→T.
    #[must_use]
    pub fn o_t(&self) -> Parameters {
        Self::parameters(ConnectionType::PointToPoint, self.o_t_size, self.consumed_format)
    }

    /// Returns the parameters T→O.
    #[must_use]
    pub fn t_o(&self) -> Parameters {
        let kind = if self.multicast { ConnectionType::Multicast } else { ConnectionType::PointToPoint };
        Self::parameters(kind, self.t_o_size, self.produced_format)
    }

    /// Returns whether the sizes need a Large_Forward_Open.
    #[must_use]
    pub fn is_large(&self) -> bool {
        self.o_t().size.max(self.t_o().size) > Parameters::MAX_PLAIN_SIZE
    }

    /// Returns the connection path: route, key, assemblies in their shortest form.
    pub(super) fn path(&self) -> Vec<u8> {
        let mut buf = [0; 64];
        let mut writer = Writer::new(&mut buf);
        if let Some(key) = &self.key {
            key.emit(&mut writer);
        }
        write_logical(&mut writer, Logical::Class, class::ASSEMBLY);
        if let Some(configuration) = self.configuration {
            write_logical(&mut writer, Logical::Instance, configuration);
        }
        write_logical(&mut writer, Logical::ConnectionPoint, self.consumed);
        write_logical(&mut writer, Logical::ConnectionPoint, self.produced);
        // 64 bytes hold a key and four numbers of 32 bits.
        let len = writer.finish().unwrap_or(0);
        let mut path = self.route.clone();
        path.extend_from_slice(buf.get(..len).unwrap_or_default());
        let data = &self.configuration_data;
        if let (false, Ok(words)) = (data.is_empty(), u8::try_from(data.len().div_ceil(2))) {
            // Simple data segment (volume 1, C-1.4.5.1): its length in words, and a byte that fills the last one.
            path.extend_from_slice(&[0x80, words]);
            path.extend_from_slice(data);
            path.resize(path.len().next_multiple_of(2), 0);
        }
        path
    }
}
