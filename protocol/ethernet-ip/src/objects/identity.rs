//! Identity, class 01: the identity of the device (volume 1, 5-2).

use super::super::cip::{ElectronicKey, General, Target, Violation, service};
use super::super::cpf::{kind, write_address, write_item};
use super::super::encapsulation::PROTOCOL_VERSION;
use super::super::{ENCAPSULATION_PORT, Writer};
use super::{Device, Object, write_short_string};
use core::net::SocketAddrV4;

/// State of cyclic connections in the Identity's status.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(in super::super) struct IoState {
    /// The outputs have an owner.
    pub(in super::super) owned: bool,
    /// Class 1 connections that are open.
    pub(in super::super) connections: usize,
    /// The owner's frames report run.
    pub(in super::super) running: bool,
    /// The last owner's connection timed out, and none was opened since.
    pub(in super::super) faulted: bool,
}

/// State attribute: operational.
const OPERATIONAL: u8 = 3;

pub(super) struct Identity;

impl Device {
    /// Returns the status word (volume 1, table 5-2.4): bit 0 owned, bit 2 configured, bits 4 to 7 state of I/O, bit
    /// 8 minor recoverable fault.
    fn identity_status(&self) -> u16 {
        let IoState { owned, connections, running, faulted } = self.io;
        let io = match (faulted, connections, running) {
            (true, _, _) => 2,
            (false, 0, _) => 3,
            (false, _, true) => 6,
            (false, _, false) => 7,
        };
        u16::from(owned) | 1 << 2 | io << 4 | u16::from(faulted) << 8
    }
}

impl Object for Identity {
    const REVISION: u16 = 1;
    const ATTRIBUTES: &'static [u16] = &[1, 2, 3, 4, 5, 6, 7, 8];
    const CLASS_ATTRIBUTES: &'static [u16] = &[1, 2, 6, 7];

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        let ElectronicKey { vendor, device_type, product_code, revision, .. } = device.description.key();
        match attribute {
            1 => writer.u16(vendor),
            2 => writer.u16(device_type),
            3 => writer.u16(product_code),
            4 => writer.bytes(&[revision.major, revision.minor]),
            5 => writer.u16(device.identity_status()),
            6 => writer.u32(device.serial_number),
            7 => write_short_string(writer, device.description.product_name),
            8 => writer.u8(OPERATIONAL),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    /// Handles Reset: of type 0, as a power cycle, or of type 1, which also resets settings and configuration. A device in use
    /// is not reset. Sessions and class 3 connections end behind the reply.
    fn own_service(
        device: &mut Device,
        target: Target,
        service: u8,
        data: &[u8],
        _writer: &mut Writer<'_>,
    ) -> Result<General, Violation> {
        if service != service::RESET || target.instance != Some(1) {
            return Err(Violation::UnknownService);
        }
        let to_defaults = match data {
            [] | [0] => false,
            [1] => true,
            [_] => return Err(Violation::BadParameter),
            _ => return Err(Violation::TooLong),
        };
        if device.io.connections > 0 {
            return Err(Violation::InUse);
        }
        if to_defaults {
            device.qos = Default::default();
            device.network.restore_defaults();
            device.assemblies.restore_defaults();
        }
        device.restarts = true;
        device.io.faulted = false;
        device.manager = Default::default();
        Ok(General::Success)
    }
}

/// Writes the item of the answer to ListIdentity (volume 2, table 2-4.4).
pub(in super::super) fn write_identity_item(device: &Device, writer: &mut Writer<'_>) {
    write_item(writer, kind::LIST_IDENTITY, |writer| {
        writer.u16(PROTOCOL_VERSION);
        write_address(writer, SocketAddrV4::new(device.network.address, ENCAPSULATION_PORT));
        for attribute in 1..=8 {
            // All of these attributes exist.
            let _ = Identity::get(device, 1, attribute, writer);
        }
    });
}
