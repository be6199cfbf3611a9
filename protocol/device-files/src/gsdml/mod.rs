//! GSDML: the catalogue of a PROFINET IO-Device. Numbers and names are those of the "GSDML Specification for PROFINET",
//! PNO order number 2.352.

mod data;
mod diagnosis;
mod modules;
mod names;
mod read;
mod records;
mod slots;

use serde::Serialize;

pub use self::data::{DataBit, DataItem, IoDirection};
pub use self::diagnosis::{ChannelDiagnosis, UnitDiagnosis};
pub use self::modules::{GsdmlModule, GsdmlSubmodule, SystemSubmodule};
pub(crate) use self::read::read;
pub use self::records::{ParameterRecord, RecordValue, ValueText, ValueTexts};
pub use self::slots::{Placement, SlotRanges};

use crate::fault::FileFault;

/// Catalogue of a PROFINET IO-Device.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Gsdml {
    /// Version of the schema, such as `2.35`.
    pub schema_version: String,
    /// Vendor ID.
    pub vendor_id: u16,
    /// Device ID, which the vendor gives.
    pub device_id: u16,
    /// Vendor's name.
    pub vendor: String,
    /// Description of the device.
    pub info: String,
    /// Main family, such as `I/O` or `Drives`.
    pub main_family: String,
    /// Product family.
    pub product_family: String,
    /// Access points: the variants of the device. One is chosen.
    pub access_points: Vec<AccessPoint>,
    /// Modules that the access points name.
    pub modules: Vec<GsdmlModule>,
    /// Submodules that modules and access points name.
    pub submodules: Vec<GsdmlSubmodule>,
    /// Texts of record values.
    pub values: Vec<ValueTexts>,
    /// Errors of channels.
    pub channel_diagnosis: Vec<ChannelDiagnosis>,
    /// Diagnosis in a format of the manufacturer.
    pub unit_diagnosis: Vec<UnitDiagnosis>,
    /// Faults that do not keep the file from being used.
    pub warnings: Vec<FileFault>,
}

/// Access point (DAP): the head module of a device, and what fits into its slots.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AccessPoint {
    /// Head module, with the submodules that it always has.
    pub module: GsdmlModule,
    /// Schema version that a reader must know to use it.
    pub required_schema_version: String,
    /// Slots that exist.
    pub physical_slots: SlotRanges,
    /// Slot of the head module.
    pub fixed_in_slots: SlotRanges,
    /// Station name that the maker proposes.
    pub dns_compatible_name: String,
    /// Shortest interval in units of 31.25 µs.
    pub min_device_interval: u16,
    /// Instance of the object UUID.
    pub object_uuid_index: u16,
    /// True if several records may be written in one request.
    pub has_multiple_write: bool,
    /// Conformance class, if the file gives it.
    pub conformance_class: Option<String>,
    /// Largest input data with their status, in bytes.
    pub max_input_length: Option<u32>,
    /// Largest output data with their status, in bytes.
    pub max_output_length: Option<u32>,
    /// Largest data of both directions with their status, in bytes.
    pub max_data_length: Option<u32>,
    /// Modules and the slots that they fit into.
    pub modules: Vec<Placement>,
    /// Cyclic timing for each real-time class.
    pub timing: Vec<CyclicTiming>,
    /// Start-up modes, such as `Legacy` and `Advanced`.
    pub startup_modes: Vec<String>,
}

/// Intervals of cyclic data: each send clock times each reduction ratio, not below the shortest interval.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CyclicTiming {
    /// Real-time class: 1 or 3.
    pub rt_class: u8,
    /// Send clocks in units of 31.25 µs.
    pub send_clocks: SlotRanges,
    /// Reduction ratios.
    pub reduction_ratios: SlotRanges,
}

impl Gsdml {
    /// Returns the module of an ID.
    #[must_use]
    pub fn module(&self, id: &str) -> Option<&GsdmlModule> {
        self.modules.iter().find(|module| module.id == id)
    }

    /// Returns the pluggable submodule of an ID.
    #[must_use]
    pub fn submodule(&self, id: &str) -> Option<&GsdmlSubmodule> {
        self.submodules.iter().find(|submodule| submodule.id == id)
    }

    /// Returns the access point of an ID.
    #[must_use]
    pub fn access_point(&self, id: &str) -> Option<&AccessPoint> {
        self.access_points.iter().find(|access_point| access_point.module.id == id)
    }
}
