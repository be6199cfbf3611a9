//! EDS: the catalogue of an EtherNet/IP adapter. Sections and fields are those of the CIP specification, volume 1,
//! chapter 7, and volume 2, chapter 7.

mod assemblies;
mod connections;
mod parameters;
mod read;
mod syntax;

use serde::Serialize;

pub use self::assemblies::{EdsAssembly, EdsMember, EdsReference};
pub use self::connections::{ConnectionEnd, ConnectionUse, EdsConnection, RealTimeFormat};
pub use self::parameters::{EdsParameter, EdsScale, ParameterText};
pub(crate) use self::read::{is_canopen, read};

use crate::fault::FileFault;

/// Catalogue of an EtherNet/IP adapter.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Eds {
    /// Description of the file.
    pub description: String,
    /// Revision of the file.
    pub file_revision: String,
    /// Vendor ID.
    pub vendor_id: u16,
    /// Vendor's name.
    pub vendor: String,
    /// Device type.
    pub device_type: u16,
    /// Device type in words.
    pub device_type_name: String,
    /// Product code.
    pub product_code: u16,
    /// Major revision.
    pub major_revision: u8,
    /// Minor revision.
    pub minor_revision: u8,
    /// Product name.
    pub product_name: String,
    /// Catalogue number, if the file gives one.
    pub catalog: Option<String>,
    /// Networks, such as `EtherNetIP`.
    pub classes: Vec<String>,
    /// Parameters.
    pub parameters: Vec<EdsParameter>,
    /// Assemblies.
    pub assemblies: Vec<EdsAssembly>,
    /// Connections that an originator may open.
    pub connections: Vec<EdsConnection>,
    /// Ports.
    pub ports: Vec<EdsPort>,
    /// Limits, such as `MaxIOProducers`.
    pub capacity: Vec<CapacityLimit>,
    /// Sections that this reader does not use.
    pub other_sections: Vec<String>,
    /// Faults that do not keep the file from being used.
    pub warnings: Vec<FileFault>,
}

/// Port of a device.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EdsPort {
    /// Number in the file.
    pub entry: u32,
    /// Type, such as `TCP`.
    pub kind: String,
    /// Name.
    pub name: String,
    /// Path of its object.
    pub path: String,
    /// Port number.
    pub number: Option<u16>,
}

/// Limit of a device.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CapacityLimit {
    /// Key, such as `MaxIOProducers` or `TSpec1`.
    pub key: String,
    /// Fields as the file writes them.
    pub fields: Vec<String>,
}

impl Eds {
    /// Returns the parameter of a number.
    #[must_use]
    pub fn parameter(&self, number: u32) -> Option<&EdsParameter> {
        self.parameters.iter().find(|parameter| parameter.number == number)
    }

    /// Returns the assembly of an entry's number, which need not be its instance.
    #[must_use]
    pub fn assembly(&self, number: u32) -> Option<&EdsAssembly> {
        self.assemblies.iter().find(|assembly| assembly.number == number)
    }
}
