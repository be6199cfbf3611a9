//! Writes an ESI file (EtherCAT SubDevice information, ETG.2000) from the description of a SubDevice.

use std::fmt::{self, Write};
use std::ops::Range;

use ethercat_subdevice::description::{ClockMode, DataType, Description, Pdo};
use ethercat_subdevice::{SyncManagerLayout, Usage, sii_image, sync_managers};

use crate::xml::Xml;

/// The vendor's name.
const VENDOR_NAME: &str = "skillbench";

/// Locale of the names: English, United States.
const LOCALE: u32 = 1033;

/// Bytes of the EEPROM from its start that an ESI file names: the configuration of the chip without its checksum.
const CONFIG_BYTES: usize = 14;

/// Bytes of the EEPROM that say where the mailbox is in BOOT, which a device with a file service has.
const BOOTSTRAP: Range<usize> = 0x28..0x30;

/// Writes the file.
#[must_use]
pub fn write(device: &Description) -> String {
    let mut xml = Xml::default();
    // Writing to a String cannot fail.
    let _ = write_all(&mut xml, device);
    xml.text
}

/// Returns the name of a type of values (ETG.1020, base data types).
#[must_use]
pub const fn type_name(data_type: DataType) -> &'static str {
    match data_type {
        DataType::Boolean => "BOOL",
        DataType::Integer8 => "SINT",
        DataType::Integer16 => "INT",
        DataType::Integer32 => "DINT",
        DataType::Integer64 => "LINT",
        DataType::Unsigned8 => "USINT",
        DataType::Unsigned16 => "UINT",
        DataType::Unsigned32 => "UDINT",
        DataType::Unsigned64 => "ULINT",
        DataType::Real32 => "REAL",
        DataType::Real64 => "LREAL",
        DataType::Bit1 => "BIT1",
        DataType::Bit2 => "BIT2",
        DataType::Bit3 => "BIT3",
        DataType::Bit4 => "BIT4",
        DataType::Bit5 => "BIT5",
        DataType::Bit6 => "BIT6",
        DataType::Bit7 => "BIT7",
        DataType::Bit8 => "BIT8",
        DataType::VisibleString => "STRING",
        DataType::OctetString | DataType::Identity | DataType::PdoMapping => "OCTET_STRING",
    }
}

fn write_all(xml: &mut Xml, device: &Description) -> fmt::Result {
    writeln!(xml.text, "<?xml version=\"1.0\" encoding=\"utf-8\"?>")?;
    let attributes = "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:noNamespaceSchemaLocation=\"EtherCATInfo.xsd\" Version=\"1.2\"";
    xml.within("EtherCATInfo", attributes, |xml| {
        xml.within("Vendor", "", |xml| {
            xml.leaf("Id", &hexadecimal(device.vendor_id, 8))?;
            xml.leaf("Name", VENDOR_NAME)
        })?;
        xml.within("Descriptions", "", |xml| {
            xml.within("Groups", "", |xml| {
                xml.within("Group", "", |xml| {
                    xml.leaf("Type", device.group)?;
                    name(xml, device.group)
                })
            })?;
            xml.within("Devices", "", |xml| {
                // Ports 0 and 1 are MII.
                xml.within("Device", "Physics=\"YY\"", |xml| write_device(xml, device))
            })
        })
    })
}

fn write_device(xml: &mut Xml, device: &Description) -> fmt::Result {
    let attributes = format_args!(
        "Type ProductCode=\"{}\" RevisionNo=\"{}\"",
        hexadecimal(device.product_code, 8),
        hexadecimal(device.revision, 8)
    );
    text(xml, attributes, "Type", device.order_code)?;
    name(xml, device.name)?;
    xml.leaf("GroupType", device.group)?;
    let sync_managers = sync_managers(device);
    let fmmus = [(Usage::Outputs, "Outputs"), (Usage::Inputs, "Inputs"), (Usage::MailboxSend, "MBoxState")];
    for (_, name) in fmmus.iter().filter(|(usage, _)| sync_managers.iter().any(|unit| unit.usage == *usage)) {
        xml.leaf("Fmmu", name)?;
    }
    sync_managers.iter().try_for_each(|layout| write_sync_manager(xml, *layout))?;
    let number = |usage| sync_managers.iter().position(|layout| layout.usage == usage).unwrap_or_default();
    device
        .outputs
        .iter()
        .try_for_each(|pdo| write_pdo(xml, device, ("RxPdo", number(Usage::Outputs)), pdo))?;
    device.inputs.iter().try_for_each(|pdo| write_pdo(xml, device, ("TxPdo", number(Usage::Inputs)), pdo))?;
    write_mailbox(xml, device)?;
    if device.has_clocks() {
        write_clocks(xml, device.clock_modes)?;
    }
    write_eeprom(xml, device)
}

fn write_sync_manager(xml: &mut Xml, layout: SyncManagerLayout) -> fmt::Result {
    let SyncManagerLayout { usage, start, len, control } = layout;
    let usage = match usage {
        Usage::MailboxReceive => "MBoxOut",
        Usage::MailboxSend => "MBoxIn",
        Usage::Outputs => "Outputs",
        Usage::Inputs => "Inputs",
    };
    let attributes = format_args!(
        "Sm DefaultSize=\"{len}\" StartAddress=\"{}\" ControlByte=\"{}\" Enable=\"{}\"",
        hexadecimal(start.into(), 4),
        hexadecimal(control.into(), 2),
        u8::from(len > 0)
    );
    text(xml, attributes, "Sm", usage)
}

fn write_pdo(
    xml: &mut Xml,
    device: &Description,
    (element, sync_manager): (&str, usize),
    pdo: &Pdo,
) -> fmt::Result {
    let attributes = format_args!("Fixed=\"1\" Mandatory=\"1\" Sm=\"{sync_manager}\"");
    xml.within(element, attributes, |xml| {
        xml.leaf("Index", &hexadecimal(pdo.index.into(), 4))?;
        xml.leaf("Name", pdo.name)?;
        pdo.entries.iter().try_for_each(|entry| {
            xml.within("Entry", "", |xml| {
                xml.leaf("Index", &hexadecimal(entry.index.into(), 4))?;
                // A gap is an object 0 with a length alone.
                if entry.index != 0 {
                    xml.leaf("SubIndex", &entry.subindex.to_string())?;
                }
                xml.leaf("BitLen", &entry.bits.to_string())?;
                if entry.index == 0 {
                    return Ok(());
                }
                xml.leaf("Name", &device.full_name(entry))?;
                xml.leaf("DataType", type_name(entry.data_type))
            })
        })
    })
}

fn write_mailbox(xml: &mut Xml, device: &Description) -> fmt::Result {
    let Some(mailbox) = device.mailbox else { return Ok(()) };
    xml.within("Mailbox", "DataLinkLayer=\"true\"", |xml| {
        xml.empty(
            "CoE SdoInfo=\"true\" SegmentedSdo=\"true\" CompleteAccess=\"true\" PdoAssign=\"false\" PdoConfig=\"false\"",
        )?;
        if mailbox.file_capacity > 0 { xml.empty("FoE") } else { Ok(()) }
    })
}

/// Writes the modes of a device with distributed clocks.
fn write_clocks(xml: &mut Xml, modes: &[ClockMode]) -> fmt::Result {
    xml.within("Dc", "", |xml| {
        modes.iter().try_for_each(|mode| {
            xml.within("OpMode", "", |xml| {
                xml.leaf("Name", mode.name)?;
                xml.leaf("Desc", mode.description)?;
                xml.leaf("AssignActivate", &hexadecimal(mode.assign_activate.into(), 4))?;
                if mode.sync0_factor == 0 {
                    return Ok(());
                }
                let start = format_args!("CycleTimeSync0 Factor=\"{}\"", mode.sync0_factor);
                text(xml, start, "CycleTimeSync0", "0")
            })
        })
    })
}

fn write_eeprom(xml: &mut Xml, device: &Description) -> fmt::Result {
    let image = sii_image(device, 0, 0);
    let part = |bytes: Range<usize>| -> String {
        image.get(bytes).unwrap_or_default().iter().map(|byte| format!("{byte:02X}")).collect()
    };
    xml.within("Eeprom", "", |xml| {
        xml.leaf("ByteSize", &image.len().to_string())?;
        xml.leaf("ConfigData", &part(0..CONFIG_BYTES))?;
        match device.mailbox {
            Some(mailbox) if mailbox.file_capacity > 0 => xml.leaf("BootStrap", &part(BOOTSTRAP)),
            _ => Ok(()),
        }
    })
}

fn name(xml: &mut Xml, name: &str) -> fmt::Result {
    text(xml, format_args!("Name LcId=\"{LOCALE}\""), "Name", name)
}

/// Writes an element with attributes and a text.
fn text(xml: &mut Xml, start: fmt::Arguments<'_>, name: &str, content: &str) -> fmt::Result {
    xml.line(format_args!("<{start}>{content}</{name}>"))
}

/// Returns a number in the notation of ESI files.
fn hexadecimal(number: u32, digits: usize) -> String {
    format!("#x{number:0digits$X}")
}
