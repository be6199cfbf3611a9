//! EtherCAT's part of a listing: SubDevices in their order on the cable.

use std::fmt;

use ethercat_maindevice::{Found, FoundSubDevice, Identity, Unreadable};
use node::screen;
use serde::Serialize;

use crate::printable::printable;

/// What a search on EtherCAT found.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct SubDevices {
    /// Whether any frame came back.
    frames_return: bool,
    /// Whether the end of the cable was reached in time.
    complete: bool,
    devices: Vec<SubDevice>,
}

#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct SubDevice {
    /// The device next to the MainDevice has 1, as for `plc-node io --at`.
    position: u16,
    /// Given by a MainDevice; 0 before.
    station_address: u16,
    /// From the EEPROM or switches; 0 if there is none.
    alias: u16,
    order_code: Option<String>,
    name: Option<String>,
    vendor_id: Option<u32>,
    product_code: Option<u32>,
    revision: Option<u32>,
    serial_number: Option<u32>,
    /// Why the EEPROM could not be read; null if it was.
    unreadable: Option<&'static str>,
    state: String,
    al_status: u16,
    al_status_code: u16,
}

impl From<Found> for SubDevices {
    fn from(found: Found) -> Self {
        let Found { devices, frames_return, complete } = found;
        Self { frames_return, complete, devices: devices.iter().map(SubDevice::from).collect() }
    }
}

impl From<&FoundSubDevice> for SubDevice {
    fn from(device: &FoundSubDevice) -> Self {
        let identity = device.identity.as_ref().ok();
        let number = |number: fn(&Identity) -> u32| identity.map(number);
        let text = |text: fn(&Identity) -> &Vec<u8>| identity.map(|identity| printable(text(identity)));
        let mut state = String::new();
        // A string takes every character.
        let _ = device.write_state(&mut state);
        Self {
            position: device.position.saturating_add(1),
            station_address: device.station_address,
            alias: device.alias,
            order_code: text(|identity| &identity.order_code),
            name: text(|identity| &identity.name),
            vendor_id: number(|identity| identity.vendor),
            product_code: number(|identity| identity.product),
            revision: number(|identity| identity.revision),
            serial_number: number(|identity| identity.serial_number),
            unreadable: device.identity.as_ref().err().map(|reason| words(*reason)),
            state,
            al_status: device.status,
            al_status_code: device.status_code,
        }
    }
}

const fn words(reason: Unreadable) -> &'static str {
    match reason {
        Unreadable::HeldByDevice => "the device itself holds its EEPROM",
        Unreadable::Failed => "its EEPROM cannot be read",
        Unreadable::NoAnswer => "it stopped answering",
    }
}

impl SubDevices {
    /// Writes the table, or says why there is none.
    pub(super) fn write(&self, f: &mut fmt::Formatter<'_>, interface: &str) -> fmt::Result {
        let Self { frames_return, complete, devices } = self;
        if !frames_return {
            return writeln!(f, "EtherCAT: no frame came back on {interface}, so there is no SubDevice.");
        }
        if devices.is_empty() {
            return writeln!(f, "EtherCAT: frames come back on {interface}, but no SubDevice counted them.");
        }
        writeln!(f, "EtherCAT: {} SubDevice{}", devices.len(), if devices.len() == 1 { "" } else { "s" })?;
        let mut table = screen::ruled();
        table.set_header([
            "Position",
            "Address",
            "Alias",
            "Order code",
            "Vendor",
            "Product",
            "Revision",
            "Serial number",
            "State",
        ]);
        table.add_rows(devices.iter().map(SubDevice::row));
        writeln!(f, "{}", screen::drawn(&table))?;
        if !complete {
            writeln!(f, "The time was over before the end of the cable: a longer --timeout may find more.")?;
        }
        Ok(())
    }
}

impl SubDevice {
    fn row(&self) -> Vec<String> {
        let address = |number: u16| if number == 0 { "–".to_owned() } else { format!("0x{number:04X}") };
        let number = |number: Option<u32>| number.map_or_else(|| "–".to_owned(), |id| format!("0x{id:08X}"));
        let what = self.order_code.clone().or_else(|| self.unreadable.map(|reason| format!("({reason})")));
        vec![
            self.position.to_string(),
            address(self.station_address),
            address(self.alias),
            what.unwrap_or_default(),
            number(self.vendor_id),
            number(self.product_code),
            number(self.revision),
            number(self.serial_number),
            self.state.clone(),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Shown(SubDevices);

    impl fmt::Display for Shown {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            self.0.write(f, "eth0")
        }
    }

    fn found(devices: Vec<FoundSubDevice>) -> Found {
        Found { devices, frames_return: true, complete: true }
    }

    fn running() -> FoundSubDevice {
        let identity = Identity {
            vendor: 2,
            product: 0x044C_2C52,
            revision: 0x0011_0000,
            serial_number: 0,
            order_code: b"EK1100".to_vec(),
            name: b"EK1100 EtherCAT Coupler".to_vec(),
        };
        FoundSubDevice {
            position: 0,
            station_address: 0x1000,
            alias: 0,
            status: 8,
            status_code: 0,
            identity: Ok(identity),
        }
    }

    #[test]
    fn each_device_has_a_row_and_what_cannot_be_read_says_why() {
        let fallen = FoundSubDevice {
            position: 1,
            station_address: 0,
            alias: 7,
            status: 0x14,
            status_code: 0x1B,
            identity: Err(Unreadable::HeldByDevice),
        };
        let listing = Found { complete: false, ..found(vec![running(), fallen]) };
        insta::assert_snapshot!(Shown(listing.into()).to_string(), @"
        EtherCAT: 2 SubDevices
        ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
         Position   Address   Alias    Order code                             Vendor       Product      Revision     Serial number   State
        ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
         1          0x1000    –        EK1100                                 0x00000002   0x044C2C52   0x00110000   0x00000000      OP
         2          –         0x0007   (the device itself holds its EEPROM)   –            –            –            –               SAFE-OP, AL status code 0x001b: Sync manager watchdog
        ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
        The time was over before the end of the cable: a longer --timeout may find more.
        ");
    }

    #[test]
    fn a_cable_without_devices_says_whether_frames_come_back() {
        let nobody = Shown(found(Vec::new()).into()).to_string();
        assert_eq!(nobody, "EtherCAT: frames come back on eth0, but no SubDevice counted them.\n");
        let silence = Shown(Found::default().into()).to_string();
        assert_eq!(silence, "EtherCAT: no frame came back on eth0, so there is no SubDevice.\n");
    }

    #[test]
    fn the_json_has_the_numbers_of_the_standard_and_null_for_what_is_not_known() {
        let unreadable = FoundSubDevice { identity: Err(Unreadable::Failed), ..running() };
        let listing = SubDevices::from(found(vec![unreadable]));
        insta::assert_snapshot!(serde_json::to_string(&listing).unwrap(), @r#"{"frames_return":true,"complete":true,"devices":[{"position":1,"station_address":4096,"alias":0,"order_code":null,"name":null,"vendor_id":null,"product_code":null,"revision":null,"serial_number":null,"unreadable":"its EEPROM cannot be read","state":"OP","al_status":8,"al_status_code":0}]}"#);
    }
}
