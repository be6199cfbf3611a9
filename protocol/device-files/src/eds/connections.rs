//! Connections that an originator may open.

use std::collections::HashMap;

use serde::Serialize;

use super::assemblies::EdsAssembly;
use super::parameters::EdsParameter;
use super::syntax::{Sheet, SheetEntry, SheetSection, numbered};
use crate::fault::{FileFault, excerpt};

/// Connection, as the Connection Manager of the adapter accepts it.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EdsConnection {
    /// Number in the file.
    pub number: u32,
    /// Name.
    pub name: String,
    /// Help.
    pub help: String,
    /// Rights of the originator.
    pub uses: Vec<ConnectionUse>,
    /// Transport classes.
    pub transport_classes: Vec<u8>,
    /// Triggers of production: `cyclic`, `change of state`, `application`.
    pub triggers: Vec<&'static str>,
    /// Data to the device.
    pub o_to_t: ConnectionEnd,
    /// Data from the device.
    pub t_to_o: ConnectionEnd,
    /// Bytes of configuration data in the Forward_Open.
    pub configuration_size: Option<u32>,
    /// Assembly or format of the configuration data.
    pub configuration_format: String,
    /// Connection path, such as `20 04 24 97 2C 96 2C 64`.
    pub path: String,
}

/// One direction of a connection.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ConnectionEnd {
    /// Bytes of data without sequence count and run/idle header; none if the originator decides.
    pub size: Option<u32>,
    /// Assembly or format of the data.
    pub format: String,
    /// Requested packet interval that the file proposes, in µs; none if it proposes none.
    pub rpi_us: Option<u32>,
    /// Shortest and longest interval in µs, if the file limits it.
    pub rpi_limits_us: Option<(u32, u32)>,
    /// True if the size must be that of the file.
    pub is_fixed_size: bool,
    /// True if the size may vary.
    pub is_variable_size: bool,
    /// Format of run/idle.
    pub real_time_format: RealTimeFormat,
    /// Connection types: `null`, `multicast`, `point to point`.
    pub types: Vec<&'static str>,
    /// Priorities: `low`, `high`, `scheduled`, `urgent`.
    pub priorities: Vec<&'static str>,
}

/// Right of an originator on a connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum ConnectionUse {
    /// Receives inputs while another originator owns the outputs.
    ListenOnly,
    /// Receives inputs.
    InputOnly,
    /// Sends outputs alone.
    ExclusiveOwner,
    /// Sends outputs beside another owner.
    RedundantOwner,
}

/// Format in which a direction says run or idle.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum RealTimeFormat {
    /// None.
    Modeless,
    /// No data means idle.
    ZeroLength,
    /// Without any data.
    Heartbeat,
    /// A header of 32 bits.
    Header32Bit,
    /// CIP Safety, which this program does not make.
    Safety,
    /// Value that the specification reserves.
    Reserved,
}

/// Reads the connections (CIP volume 1, 7-3.6.10).
pub(super) fn read(
    sheet: &Sheet<'_>,
    section: &SheetSection<'_>,
    parameters: &[EdsParameter],
    assemblies: &[EdsAssembly],
) -> Result<Vec<EdsConnection>, FileFault> {
    let assemblies = assemblies.iter().map(|assembly| (assembly.number, assembly)).collect();
    let catalogue = References { parameters, assemblies };
    let mut connections = Vec::new();
    for (number, entry) in section.numbered("Connection") {
        sheet.charge(size_of::<EdsConnection>())?;
        connections.push(read_one(sheet, &catalogue, number, entry)?);
    }
    Ok(connections)
}

fn read_one(
    sheet: &Sheet<'_>,
    catalogue: &References<'_>,
    number: u32,
    entry: &SheetEntry<'_>,
) -> Result<EdsConnection, FileFault> {
    let mask: u32 =
        entry.number(0)?.ok_or_else(|| entry.finding(0, "trigger and transport is empty; add it"))?;
    let parameters: u32 =
        entry.number(1)?.ok_or_else(|| entry.finding(1, "parameters are empty; add them"))?;
    let uses = [
        (24, ConnectionUse::ListenOnly),
        (25, ConnectionUse::InputOnly),
        (26, ConnectionUse::ExclusiveOwner),
        (27, ConnectionUse::RedundantOwner),
    ];
    Ok(EdsConnection {
        number,
        name: sheet.keep(entry.field(12))?,
        help: sheet.keep(entry.field(13))?,
        uses: uses.into_iter().filter(|(bit, _)| mask & 1 << bit != 0).map(|(_, it)| it).collect(),
        transport_classes: (0..7).filter(|class| mask & 1 << class != 0).collect(),
        triggers: set(mask, 16, &["cyclic", "change of state", "application"]),
        o_to_t: catalogue.end(
            sheet,
            entry,
            2,
            &Bits { parameters, size: 0, format: 8, types: 16, priority: 24 },
        )?,
        t_to_o: catalogue.end(
            sheet,
            entry,
            5,
            &Bits { parameters, size: 2, format: 12, types: 20, priority: 28 },
        )?,
        configuration_size: match catalogue.size(entry, 10)? {
            Some(size) => Some(size),
            None => catalogue.size_of_format(entry, 11)?,
        },
        configuration_format: sheet.keep(entry.field(11))?,
        path: sheet.keep(entry.field(14))?,
    })
}

/// Positions of a direction's bits in the connection parameters.
struct Bits {
    parameters: u32,
    size: u32,
    format: u32,
    types: u32,
    priority: u32,
}

/// Returns the names of the bits that are set, from one bit on.
fn set(mask: u32, first: u32, names: &[&'static str]) -> Vec<&'static str> {
    (first..).zip(names).filter(|(bit, _)| mask & 1 << bit != 0).map(|(_, name)| *name).collect()
}

/// Parameters and assemblies that fields of a connection name.
struct References<'s> {
    parameters: &'s [EdsParameter],
    assemblies: HashMap<u32, &'s EdsAssembly>,
}

impl References<'_> {
    fn parameter(&self, entry: &SheetEntry<'_>, field: usize) -> Result<Option<&EdsParameter>, FileFault> {
        let text = entry.field(field);
        let Some(number) = numbered(text, "Param") else { return Ok(None) };
        let at = self.parameters.binary_search_by_key(&number, |parameter| parameter.number);
        let parameter = at.ok().and_then(|at| self.parameters.get(at));
        parameter
            .map(Some)
            .ok_or_else(|| entry.finding(field, format!("`{}` is not in the file; add it", excerpt(text))))
    }

    /// Returns the bytes of a field that is a number or names a parameter.
    fn size(&self, entry: &SheetEntry<'_>, field: usize) -> Result<Option<u32>, FileFault> {
        match self.parameter(entry, field)? {
            Some(parameter) => Ok(parameter.default_number()),
            None => entry.number(field),
        }
    }

    /// Returns the bytes of what a format names; of several, their sum.
    fn size_of_format(&self, entry: &SheetEntry<'_>, field: usize) -> Result<Option<u32>, FileFault> {
        let text = entry.field(field);
        if let Some(parameter) = self.parameter(entry, field)? {
            return Ok(parameter.size);
        }
        let Some(number) = numbered(text, "Assem") else { return Ok(None) };
        let missing = || entry.finding(field, format!("`{}` is not in the file; add it", excerpt(text)));
        Ok(self.assemblies.get(&number).ok_or_else(missing)?.size)
    }

    fn end(
        &self,
        sheet: &Sheet<'_>,
        entry: &SheetEntry<'_>,
        field: usize,
        bits: &Bits,
    ) -> Result<ConnectionEnd, FileFault> {
        let rpi = self.parameter(entry, field)?;
        let fixed: Option<u32> = if rpi.is_some() { None } else { entry.number(field)? };
        let limits =
            rpi.and_then(|rpi| Some((crate::xml::number(&rpi.minimum)?, crate::xml::number(&rpi.maximum)?)));
        let of_format = self.size_of_format(entry, field + 2)?;
        let size = self.size(entry, field + 1)?.or(of_format);
        let has = |bit: u32| bits.parameters & 1 << bit != 0;
        Ok(ConnectionEnd {
            size,
            format: sheet.keep(entry.field(field + 2))?,
            rpi_us: fixed.or_else(|| rpi?.default_number()),
            rpi_limits_us: limits,
            is_fixed_size: has(bits.size),
            is_variable_size: has(bits.size + 1),
            real_time_format: match bits.parameters >> bits.format & 7 {
                0 => RealTimeFormat::Modeless,
                1 => RealTimeFormat::ZeroLength,
                3 => RealTimeFormat::Heartbeat,
                4 => RealTimeFormat::Header32Bit,
                5 => RealTimeFormat::Safety,
                _ => RealTimeFormat::Reserved,
            },
            types: set(bits.parameters, bits.types, &["null", "multicast", "point to point"]),
            priorities: set(bits.parameters, bits.priority, &["low", "high", "scheduled", "urgent"]),
        })
    }
}
