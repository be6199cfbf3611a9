//! Ethernet Link, class F6 (volume 2, 5-5): state and counters of the interface, as the adapter's owner reports them.

use super::super::Writer;
use super::super::cip::{General, Target, Violation, service};
use super::{Device, Object, write_short_string};
use machine::{LinkCounters, LinkStatus, Medium};

/// State of the interface, and what its counters were when each attribute was cleared.
#[derive(Clone, Copy, Default, Debug)]
pub(in super::super) struct ReportedLink {
    /// `None` until the owner reports it.
    pub(in super::super) status: Option<LinkStatus>,
    cleared: [LinkCounters; 4],
}

/// An attribute with counters.
#[derive(Clone, Copy)]
enum Counted {
    /// Attribute 4.
    Interface,
    /// Attribute 5.
    Media,
    /// Attribute 12.
    InterfaceHigh,
    /// Attribute 13.
    MediaHigh,
}

impl Counted {
    const fn of(attribute: u16) -> Option<Self> {
        match attribute {
            4 => Some(Self::Interface),
            5 => Some(Self::Media),
            12 => Some(Self::InterfaceHigh),
            13 => Some(Self::MediaHigh),
            _ => None,
        }
    }

    /// Number of bytes that Get_Attributes_All has of it where the counters are not known.
    const fn zeros(self) -> usize {
        match self {
            Self::Interface => 11 * 4,
            Self::Media => 12 * 4,
            Self::InterfaceHigh => 8 * 8,
            Self::MediaHigh => 6 * 8,
        }
    }

    fn write(self, writer: &mut Writer<'_>, now: &LinkCounters, cleared: &LinkCounters) {
        let since = |of: fn(&LinkCounters) -> u64| of(now).wrapping_sub(of(cleared));
        // Counters of 32 bits wrap around.
        let mut low = |of: fn(&LinkCounters) -> u64| writer.u32(since(of) as u32);
        match self {
            Self::Interface => {
                low(|c| c.in_octets);
                low(|c| c.in_unicast);
                low(|c| c.in_multicast.wrapping_add(c.in_broadcast));
                low(|c| c.in_discards);
                low(|c| c.in_errors);
                low(|c| c.in_unknown_protocols);
                low(|c| c.out_octets);
                low(|c| c.out_unicast);
                low(|c| c.out_multicast.wrapping_add(c.out_broadcast));
                low(|c| c.out_discards);
                low(|c| c.out_errors);
            }
            Self::Media => {
                low(|c| c.alignment_errors);
                low(|c| c.fcs_errors);
                low(|c| c.single_collisions);
                low(|c| c.multiple_collisions);
                low(|c| c.sqe_test_errors);
                low(|c| c.deferred);
                low(|c| c.late_collisions);
                low(|c| c.excessive_collisions);
                low(|c| c.transmit_errors);
                low(|c| c.carrier_sense_errors);
                low(|c| c.too_long);
                low(|c| c.receive_errors);
            }
            Self::InterfaceHigh => {
                let counters: [fn(&LinkCounters) -> u64; 8] = [
                    |c| c.in_octets,
                    |c| c.in_unicast,
                    |c| c.in_multicast,
                    |c| c.in_broadcast,
                    |c| c.out_octets,
                    |c| c.out_unicast,
                    |c| c.out_multicast,
                    |c| c.out_broadcast,
                ];
                counters.into_iter().for_each(|of| writer.bytes(&since(of).to_le_bytes()));
            }
            Self::MediaHigh => {
                let counters: [fn(&LinkCounters) -> u64; 6] = [
                    |c| c.alignment_errors,
                    |c| c.fcs_errors,
                    |c| c.transmit_errors,
                    |c| c.too_long,
                    |c| c.receive_errors,
                    |c| c.symbol_errors,
                ];
                counters.into_iter().for_each(|of| writer.bytes(&since(of).to_le_bytes()));
            }
        }
    }
}

impl ReportedLink {
    fn write_counters(&self, counted: Counted, writer: &mut Writer<'_>) {
        let cleared = self.cleared.get(counted as usize);
        match self.status.zip(cleared) {
            Some((status, cleared)) => counted.write(writer, &status.counters, cleared),
            None => writer.zeros(counted.zeros()),
        }
    }

    fn clear(&mut self, counted: Counted) {
        let counters = self.status.map(|status| status.counters).unwrap_or_default();
        if let Some(cleared) = self.cleared.get_mut(counted as usize) {
            *cleared = counters;
        }
    }

    /// Returns attribute 2: bit 0 link, bit 1 full duplex, bits 2 to 4 negotiation: 3 successful, 4 not attempted.
    fn flags(&self) -> u32 {
        let LinkStatus { is_up, is_full_duplex, is_negotiated, .. } = self.status.unwrap_or_default();
        let negotiation = if is_negotiated == Some(true) { 3 } else { 4 };
        // Without a report, the request itself shows that there is a link.
        let is_up = is_up || self.status.is_none();
        u32::from(is_up) | u32::from(is_full_duplex == Some(true)) << 1 | negotiation << 2
    }
}

pub(super) struct EthernetLink;

impl Object for EthernetLink {
    const REVISION: u16 = 4;
    const ATTRIBUTES: &'static [u16] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13];
    const ALL: &'static [u16] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

    /// Returns whether there is such an attribute. Counters are there once the owner has reported them: zeros would claim that
    /// nothing was ever sent.
    fn has_attribute(device: &Device, attribute: u16) -> bool {
        let is_known = Counted::of(attribute).is_none() || device.link.status.is_some();
        Self::ATTRIBUTES.contains(&attribute) && is_known
    }

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        let link = &device.link;
        let LinkStatus { is_up, speed_mbit_s, is_full_duplex, is_negotiated, medium, .. } =
            link.status.unwrap_or_default();
        // 0: not known.
        let speed = speed_mbit_s.unwrap_or(0);
        let short_speed = u16::try_from(speed).unwrap_or(u16::MAX);
        let is_forced = is_negotiated == Some(false);
        let is_full = is_full_duplex == Some(true);
        match attribute {
            1 => writer.u32(speed),
            2 => writer.u32(link.flags()),
            3 => writer.bytes(&device.network.mac),
            4 | 5 | 12 | 13 => {
                link.write_counters(Counted::of(attribute).ok_or(Violation::UnknownAttribute)?, writer);
            }
            // Interface control: bit 0 negotiation, bit 1 full duplex without it; the speed without it.
            6 => {
                writer.u16(u16::from(!is_forced) | u16::from(is_forced && is_full) << 1);
                writer.u16(if is_forced { short_speed } else { 0 });
            }
            7 => writer.u8(match medium {
                Medium::Unknown => 0,
                Medium::TwistedPair => 2,
                Medium::Fibre => 3,
            }),
            // 1: ready to send and receive; 0: not known.
            8 => writer.u8((is_up || link.status.is_none()).into()),
            // Enabled by its administrator.
            9 => writer.u8(1),
            10 => write_short_string(writer, "EtherNet/IP"),
            11 => {
                // Capability: auto-negotiation; the one speed that it has now, if it is known.
                writer.u32(u32::from(!is_forced) << 1);
                writer.u8(speed_mbit_s.is_some().into());
                if speed_mbit_s.is_some() {
                    writer.u16(short_speed);
                    writer.u8(is_full.into());
                }
            }
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    /// Executes Get_and_Clear: returns the counters of an attribute and sets them to zero (volume 2, 5-5.5).
    fn own_service(
        device: &mut Device,
        target: Target,
        service: u8,
        data: &[u8],
        writer: &mut Writer<'_>,
    ) -> Result<General, Violation> {
        if service != service::GET_AND_CLEAR || target.instance == Some(0) {
            return Err(Violation::UnknownService);
        }
        if !data.is_empty() {
            return Err(Violation::TooLong);
        }
        let attribute = target.attribute.and_then(|attribute| u16::try_from(attribute).ok());
        let attribute = attribute.filter(|attribute| Self::has_attribute(device, *attribute));
        let counted = attribute.and_then(Counted::of).ok_or(Violation::UnknownAttribute)?;
        device.link.write_counters(counted, writer);
        device.link.clear(counted);
        Ok(General::Success)
    }
}
