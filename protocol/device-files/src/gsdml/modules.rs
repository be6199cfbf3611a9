//! Modules and submodules.

use serde::Serialize;

use super::data::IoDirection;
use super::names::{GsdmlNames, PlacementKind};
use super::records::{self, ParameterRecord};
use super::slots::{Placement, SlotRanges};
use crate::fault::FileFault;
use crate::xml::Element;

/// Module: what is plugged into a slot.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct GsdmlModule {
    /// ID that references name.
    pub id: String,
    /// Name.
    pub name: String,
    /// Description.
    pub info: String,
    /// Order number, if the file gives one.
    pub order_number: Option<String>,
    /// Hardware release, if the file gives one.
    pub hardware_release: Option<String>,
    /// Software release, if the file gives one.
    pub software_release: Option<String>,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// Subslots that exist, if the file lists them.
    pub physical_subslots: SlotRanges,
    /// Submodules that the module always has.
    pub submodules: Vec<GsdmlSubmodule>,
    /// Interface and ports.
    pub system_submodules: Vec<SystemSubmodule>,
    /// Submodules that may be plugged, and the subslots that they fit into.
    pub pluggable: Vec<Placement>,
}

/// Submodule: what has data and records.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct GsdmlSubmodule {
    /// ID that references name.
    pub id: String,
    /// Name.
    pub name: String,
    /// Description.
    pub info: String,
    /// SubmoduleIdentNumber.
    pub ident: u32,
    /// Application process identifier.
    pub api: u32,
    /// Subslots in which it always is; subslot 1 without an entry.
    pub fixed_in_subslots: SlotRanges,
    /// Data from the device.
    pub inputs: IoDirection,
    /// Data to the device.
    pub outputs: IoDirection,
    /// Bytes of the provider status.
    pub iops_length: u8,
    /// Bytes of the consumer status.
    pub iocs_length: u8,
    /// Records in the order in which they are written.
    pub records: Vec<ParameterRecord>,
    /// True if its data are PROFIsafe, which this program shows as bytes and never makes.
    pub is_safety: bool,
    /// True if it may send process alarms.
    pub may_issue_process_alarm: bool,
    /// I&M records that may be written.
    pub writeable_im_records: SlotRanges,
}

/// Interface or port of a device.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SystemSubmodule {
    /// ID; empty in files without one.
    pub id: String,
    /// True if it is a port rather than the interface.
    pub is_port: bool,
    /// Subslot, such as 32768 for the interface.
    pub subslot: u16,
    /// SubmoduleIdentNumber.
    pub ident: u32,
    /// Name.
    pub name: String,
    /// Records in the order in which they are written.
    pub records: Vec<ParameterRecord>,
}

impl GsdmlModule {
    /// Reads a module or the head module of an access point.
    pub(super) fn read(context: &mut GsdmlNames<'_>, module: Element<'_>) -> Result<Self, FileFault> {
        let words = ModuleWords::read(context, module)?;
        let mut submodules = Vec::new();
        if let Some(within) = module.child("VirtualSubmoduleList") {
            submodules = within.list("VirtualSubmoduleItem", |item| GsdmlSubmodule::read(context, item))?;
        }
        let mut system_submodules = Vec::new();
        if let Some(within) = module.child("SystemDefinedSubmoduleList") {
            for (name, is_port) in [("InterfaceSubmoduleItem", false), ("PortSubmoduleItem", true)] {
                system_submodules
                    .extend(within.list(name, |item| SystemSubmodule::read(context, item, is_port))?);
            }
        }
        let pluggable =
            Placement::list(context, module.child("UseableSubmodules"), PlacementKind::Submodule)?;
        Ok(Self {
            id: module.keep(module.required("ID")?)?,
            name: words.name,
            info: words.info,
            order_number: words.order_number,
            hardware_release: words.hardware_release,
            software_release: words.software_release,
            ident: module.required_number("ModuleIdentNumber")?,
            physical_subslots: SlotRanges::of(module, "PhysicalSubslots")?,
            submodules,
            system_submodules,
            pluggable,
        })
    }
}

/// Words of an element `ModuleInfo`.
struct ModuleWords {
    name: String,
    info: String,
    order_number: Option<String>,
    hardware_release: Option<String>,
    software_release: Option<String>,
}

impl ModuleWords {
    fn read(context: &mut GsdmlNames<'_>, module: Element<'_>) -> Result<Self, FileFault> {
        let info = module.child("ModuleInfo");
        let mut text = |name: &str| {
            let element = info.and_then(|info| info.child(name));
            element.map(|element| context.text_of(element)).transpose().map(Option::unwrap_or_default)
        };
        let (name, description) = (text("Name")?, text("InfoText")?);
        let value = |name: &str| {
            let element = info.and_then(|info| info.child(name));
            module.keep_some(element.and_then(|element| element.attribute("Value")))
        };
        Ok(Self {
            name,
            info: description,
            order_number: value("OrderNumber")?,
            hardware_release: value("HardwareRelease")?,
            software_release: value("SoftwareRelease")?,
        })
    }
}

impl GsdmlSubmodule {
    /// Reads a submodule, a fixed or a pluggable one.
    pub(super) fn read(context: &mut GsdmlNames<'_>, item: Element<'_>) -> Result<Self, FileFault> {
        let words = ModuleWords::read(context, item)?;
        let io_data = item.child("IOData");
        let status = |name: &str| io_data.map_or(Ok(None), |io_data| io_data.number(name));
        Ok(Self {
            id: item.keep(item.required("ID")?)?,
            name: words.name,
            info: words.info,
            ident: item.required_number("SubmoduleIdentNumber")?,
            api: item.number("API")?.unwrap_or(0),
            fixed_in_subslots: SlotRanges::of(item, "FixedInSubslots")?,
            inputs: IoDirection::read(context, item, "Input")?,
            outputs: IoDirection::read(context, item, "Output")?,
            iops_length: status("IOPS_Length")?.unwrap_or(1),
            iocs_length: status("IOCS_Length")?.unwrap_or(1),
            records: records::read(context, item)?,
            is_safety: item.is("PROFIsafeSupported")?,
            may_issue_process_alarm: item.is("MayIssueProcessAlarm")?,
            writeable_im_records: SlotRanges::of(item, "Writeable_IM_Records")?,
        })
    }
}

impl SystemSubmodule {
    fn read(context: &mut GsdmlNames<'_>, item: Element<'_>, is_port: bool) -> Result<Self, FileFault> {
        // The subslots of the interface and of its first port (IEC 61158-6-10, SubslotNumber).
        let usual = if is_port { 0x8001 } else { 0x8000 };
        Ok(Self {
            // Optional before version 2.1.
            id: item.keep(item.attribute("ID").unwrap_or_default())?,
            is_port,
            subslot: item.number("SubslotNumber")?.unwrap_or(usual),
            ident: item.required_number("SubmoduleIdentNumber")?,
            name: context.text_of(item)?,
            records: records::read(context, item)?,
        })
    }
}
