//! Writes a GSDML file (V2.4) from the description of an IO-Device: XML in the form of ISO 15745-4.

use std::fmt::{self, Write};

use profinet::MauType;
use profinet::description::{Description, INTERFACE_SUBSLOT, Module, PORT_SUBSLOT, Submodule};
use profinet::record::Maintenance;

use crate::Date;
use crate::members::{self, ImageMember, MemberType};
use crate::xml::Xml;

const NAMESPACE: &str = "http://www.profibus.com/GSDML/2003/11/DeviceProfile";

/// The vendor's name.
const VENDOR_NAME: &str = "skillbench";

/// Send clocks of RT_CLASS_1, in 31.25 µs (IEC 61158-6-10).
const SEND_CLOCKS: [u16; 8] = [1, 2, 4, 8, 16, 32, 64, 128];

/// The send clock of 1 ms, which every device supports.
const MILLISECOND: u16 = 32;

/// Reduction ratios that the device supports at each send clock, up to a cycle of 512 ms (IEC 61158-6-10).
const REDUCTION_RATIOS: &str = "1 2 4 8 16 32 64 128 256 512";

/// Returns the file's name, which contains the date of the last change.
#[must_use]
pub fn file_name(device: &Description, Date { year, month, day }: Date) -> String {
    let name = device.order_id.strip_prefix("skillbench-").unwrap_or(device.order_id);
    format!("GSDML-V2.4-{VENDOR_NAME}-{name}-{year:04}{month:02}{day:02}.xml")
}

/// Writes the file.
#[must_use]
pub fn write(device: &Description) -> String {
    let mut xml = Xml::default();
    // Writing to a String cannot fail.
    let _ = write_all(&mut xml, device);
    xml.text
}

/// Returns the length in bytes of the frames from the device and to it, with IOPS and IOCS.
///
/// A submodule without data provides a status, as an input of zero bytes does. The consumer of data answers with a
/// status in the other direction.
#[must_use]
pub fn frame_lengths(device: &Description) -> (u16, u16) {
    device.submodules().fold((0, 0), |(input, output), (_, submodule)| {
        let (is_input, is_output) = directions(submodule);
        let iops_and_iocs = u16::from(is_input) + u16::from(is_output);
        (input + submodule.input_len + iops_and_iocs, output + submodule.output_len + iops_and_iocs)
    })
}

const fn directions(submodule: &Submodule) -> (bool, bool) {
    (submodule.input_len > 0 || submodule.output_len == 0, submodule.output_len > 0)
}

impl Xml {
    /// Adds a text for people to the list of texts. Returns its identifier.
    fn refer_to(&mut self, id: &str, text: &str) -> String {
        let id = format!("IDT_{id}");
        self.texts.push((id.clone(), text.to_owned()));
        id
    }

    fn module_info(&mut self, id: &str, name: &str, info: &str) -> fmt::Result {
        let (name, info) = (self.refer_to(id, name), self.refer_to(&format!("{id}_Info"), info));
        self.within("ModuleInfo", "", |xml| {
            xml.empty(format_args!("Name TextId=\"{name}\""))?;
            xml.empty(format_args!("InfoText TextId=\"{info}\""))
        })
    }
}

fn write_all(xml: &mut Xml, device: &Description) -> fmt::Result {
    writeln!(xml.text, "<?xml version=\"1.0\" encoding=\"utf-8\"?>")?;
    let attributes = format!(
        "xmlns=\"{NAMESPACE}\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"{NAMESPACE} ..\\xsd\\GSDML-DeviceProfile-V2.4.xsd\""
    );
    xml.within("ISO15745Profile", attributes, |xml| {
        write_header(xml)?;
        xml.within("ProfileBody", "", |xml| {
            let identity = device.identity;
            let attributes =
                format!("VendorID=\"0x{:04X}\" DeviceID=\"0x{:04X}\"", identity.vendor, identity.device);
            let info = xml.refer_to("Device_Info", "A robot that executes skills which a PLC calls");
            xml.within("DeviceIdentity", attributes, |xml| {
                xml.empty(format_args!("InfoText TextId=\"{info}\""))?;
                xml.empty(format_args!("VendorName Value=\"{VENDOR_NAME}\""))
            })?;
            xml.within("DeviceFunction", "", |xml| {
                xml.empty(format_args!("Family MainFamily=\"General\" ProductFamily=\"{VENDOR_NAME}\""))
            })?;
            xml.within("ApplicationProcess", "", |xml| {
                let (access_point, modules) = device.modules.split_first().ok_or(fmt::Error)?;
                xml.within("DeviceAccessPointList", "", |xml| {
                    write_access_point(xml, device, access_point, modules)
                })?;
                xml.within("ModuleList", "", |xml| {
                    modules.iter().try_for_each(|module| write_module(xml, module))
                })?;
                write_texts(xml)
            })
        })
    })
}

fn write_header(xml: &mut Xml) -> fmt::Result {
    xml.within("ProfileHeader", "", |xml| {
        xml.leaf("ProfileIdentification", "PROFINET Device Profile")?;
        xml.leaf("ProfileRevision", "1.00")?;
        xml.leaf("ProfileName", "Device Profile for PROFINET Devices")?;
        xml.leaf("ProfileSource", "PROFIBUS Nutzerorganisation e. V. (PNO)")?;
        xml.leaf("ProfileClassID", "Device")?;
        xml.within("ISO15745Reference", "", |xml| {
            xml.leaf("ISO15745Part", "4")?;
            xml.leaf("ISO15745Edition", "1")?;
            xml.leaf("ProfileTechnology", "GSDML")
        })
    })
}

fn write_access_point(
    xml: &mut Xml,
    device: &Description,
    access_point: &Module,
    modules: &[Module],
) -> fmt::Result {
    let last = modules.last().map_or(access_point.slot, |module| module.slot);
    let attributes = format!(
        "ID=\"ID_AccessPoint\" PNIO_Version=\"V2.3\" PhysicalSlots=\"{}..{last}\" ModuleIdentNumber=\"0x{:08X}\" \
         MinDeviceInterval=\"{}\" DNS_CompatibleName=\"{}\" FixedInSlots=\"{}\" ObjectUUID_LocalIndex=\"1\" \
         RequiredSchemaVersion=\"V2.1\" MultipleWriteSupported=\"false\" CheckDeviceID_Allowed=\"true\" \
         NameOfStationNotTransferable=\"false\" LLDP_NoD_Supported=\"true\"",
        access_point.slot, access_point.ident, device.min_device_interval, device.order_id, access_point.slot
    );
    xml.within("DeviceAccessPointItem", attributes, |xml| {
        let name = xml.refer_to("AccessPoint", device.station_type);
        let info = xml.refer_to("AccessPoint_Info", "The robot node of skillbench");
        xml.within("ModuleInfo", "", |xml| {
            xml.empty(format_args!("Name TextId=\"{name}\""))?;
            xml.empty(format_args!("InfoText TextId=\"{info}\""))?;
            xml.empty(format_args!("VendorName Value=\"{VENDOR_NAME}\""))?;
            xml.empty(format_args!("OrderNumber Value=\"{}\"", device.order_id))?;
            xml.empty(format_args!("HardwareRelease Value=\"{}\"", device.hardware_revision))?;
            let [major, minor, patch] = device.software_revision;
            xml.empty(format_args!("SoftwareRelease Value=\"V{major}.{minor}.{patch}\""))
        })?;
        xml.empty("CertificationInfo ConformanceClass=\"A\" ApplicationClass=\"\" NetloadClass=\"I\"")?;
        let (input, output) = frame_lengths(device);
        xml.empty(format_args!("IOConfigData MaxInputLength=\"{input}\" MaxOutputLength=\"{output}\""))?;
        xml.within("UseableModules", "", |xml| {
            modules.iter().try_for_each(|Module { slot, .. }| {
                xml.empty(format_args!(
                    "ModuleItemRef ModuleItemTarget=\"ID_Module{slot}\" FixedInSlots=\"{slot}\""
                ))
            })
        })?;
        write_virtual_submodules(xml, access_point)?;
        write_system_submodules(xml, device, access_point)
    })
}

fn write_module(xml: &mut Xml, module: &Module) -> fmt::Result {
    let id = format!("Module{}", module.slot);
    let attributes = format!("ID=\"ID_{id}\" ModuleIdentNumber=\"0x{:08X}\"", module.ident);
    xml.within("ModuleItem", attributes, |xml| {
        xml.module_info(&id, "Skill process image", "Commands to the robot and its feedback")?;
        write_virtual_submodules(xml, module)
    })
}

fn is_system(submodule: &Submodule) -> bool {
    submodule.subslot >= INTERFACE_SUBSLOT
}

/// Returns the attribute with the numbers of the I&M records that can be written.
fn writable_maintenance() -> String {
    let numbers = (1..16).filter(|number| Maintenance::SUPPORTED >> number & 1 == 1);
    let numbers: Vec<_> = numbers.map(|number: u16| number.to_string()).collect();
    format!(" Writeable_IM_Records=\"{}\"", numbers.join(" "))
}

fn write_virtual_submodules(xml: &mut Xml, module: &Module) -> fmt::Result {
    xml.within("VirtualSubmoduleList", "", |xml| {
        module.submodules.iter().filter(|submodule| !is_system(submodule)).try_for_each(|submodule| {
            let Submodule { subslot, ident, input_len, output_len, .. } = submodule;
            let id = format!("Submodule{}_{subslot}", module.slot);
            let is_access_point = input_len + output_len == 0;
            // I&M1 to 4 are those of the whole device, written at its access point.
            let maintenance = if is_access_point { writable_maintenance() } else { String::new() };
            let attributes = format!(
                "ID=\"ID_{id}\" SubmoduleIdentNumber=\"0x{ident:08X}\" FixedInSubslots=\"{subslot}\" \
                 MayIssueProcessAlarm=\"false\"{maintenance}"
            );
            xml.within("VirtualSubmoduleItem", attributes, |xml| {
                if is_access_point {
                    xml.empty("IOData")?;
                    return xml.module_info(&id, "Access point", "The device itself");
                }
                xml.within("IOData", "", |xml| {
                    let data = [
                        ("Input", *input_len, members::of_feedback()),
                        ("Output", *output_len, members::of_command()),
                    ];
                    data.into_iter().filter(|(_, len, _)| *len > 0).try_for_each(|(direction, _, members)| {
                        xml.within(direction, "Consistency=\"All items consistency\"", |xml| {
                            let id = format!("{id}_{direction}");
                            (1..).zip(&members).try_for_each(|(number, member)| {
                                write_item(xml, &format!("{id}_{number}"), member)
                            })
                        })
                    })
                })?;
                xml.module_info(&id, "Skill process image", "One image each way")
            })
        })
    })
}

/// Writes a member of the data, and its bits where they have names.
fn write_item(xml: &mut Xml, id: &str, member: &ImageMember) -> fmt::Result {
    let text = xml.refer_to(id, &member.name);
    let (data_type, bits) = match member.form {
        MemberType::Unsigned(bits) => (format!("DataType=\"Unsigned{bits}\""), [].as_slice()),
        MemberType::Bits(bits) => ("DataType=\"Unsigned16\"".to_owned(), bits),
        MemberType::Real => ("DataType=\"Float32\"".to_owned(), [].as_slice()),
        MemberType::Bytes(len) => (format!("DataType=\"OctetString\" Length=\"{len}\""), [].as_slice()),
    };
    if bits.is_empty() {
        return xml.empty(format_args!("DataItem {data_type} TextId=\"{text}\""));
    }
    xml.within("DataItem", format!("{data_type} UseAsBits=\"true\" TextId=\"{text}\""), |xml| {
        bits.iter().enumerate().try_for_each(|(offset, name)| {
            let text = xml.refer_to(&format!("{id}_{offset}"), name);
            xml.empty(format_args!("BitDataItem BitOffset=\"{offset}\" TextId=\"{text}\""))
        })
    })
}

/// Returns the send clocks that the device supports: at each of them it sends in every one.
fn send_clocks(device: &Description) -> String {
    let shortest = device.min_device_interval.min(MILLISECOND);
    let clocks = SEND_CLOCKS.iter().filter(|clock| **clock >= shortest).map(u16::to_string);
    clocks.collect::<Vec<_>>().join(" ")
}

fn write_system_submodules(xml: &mut Xml, device: &Description, module: &Module) -> fmt::Result {
    let (interface, port) = (xml.refer_to("Interface", "Interface"), xml.refer_to("Port", "Port 1"));
    xml.within("SystemDefinedSubmoduleList", "", |xml| {
        if let Some(Submodule { subslot, ident, .. }) = module.submodule(INTERFACE_SUBSLOT) {
            let send_clocks = send_clocks(device);
            let attributes = format!(
                "ID=\"ID_Interface\" SubslotNumber=\"{subslot}\" SubmoduleIdentNumber=\"0x{ident:08X}\" \
                 TextId=\"{interface}\" SupportedRT_Classes=\"RT_CLASS_1\" SupportedProtocols=\"LLDP\" \
                 NetworkComponentDiagnosisSupported=\"false\" PTP_BoundarySupported=\"false\" \
                 DCP_BoundarySupported=\"false\""
            );
            xml.within("InterfaceSubmoduleItem", attributes, |xml| {
                xml.within("ApplicationRelations", "StartupMode=\"Legacy;Advanced\"", |xml| {
                    xml.empty(format_args!(
                        "TimingProperties SendClock=\"{send_clocks}\" ReductionRatio=\"{REDUCTION_RATIOS}\""
                    ))
                })
            })?;
        }
        let Some(Submodule { subslot, ident, .. }) = module.submodule(PORT_SUBSLOT) else { return Ok(()) };
        let attributes = format!(
            "ID=\"ID_Port1\" SubslotNumber=\"{subslot}\" SubmoduleIdentNumber=\"0x{ident:08X}\" TextId=\"{port}\" \
             MaxPortRxDelay=\"0\" MaxPortTxDelay=\"0\""
        );
        xml.within("PortSubmoduleItem", attributes, |xml| {
            xml.within("MAUTypeList", "", |xml| {
                let mut types = MauType::ALL.iter().map(|it| it.code());
                types.try_for_each(|value| xml.empty(format_args!("MAUTypeItem Value=\"{value}\"")))
            })
        })
    })
}

fn write_texts(xml: &mut Xml) -> fmt::Result {
    let texts = std::mem::take(&mut xml.texts);
    xml.within("ExternalTextList", "", |xml| {
        xml.within("PrimaryLanguage", "", |xml| {
            texts
                .iter()
                .try_for_each(|(id, text)| xml.empty(format_args!("Text TextId=\"{id}\" Value=\"{text}\"")))
        })
    })
}
