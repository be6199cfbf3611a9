//! The adapter of an EDS: one connection with data, and what else may be opened beside it.

use serde::{Deserialize, Serialize};

use super::config::DeviceChoice;
use super::error::{ChoiceError, refuse};
use super::path::{self, ConnectionPoints};
use crate::eds::{ConnectionEnd, ConnectionUse, Eds, EdsConnection, RealTimeFormat};
use crate::fault::excerpt;

/// EtherNet/IP adapter with one connection.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ChosenAdapter {
    /// Number of the connection in the file.
    pub connection: u32,
    /// Vendor ID.
    pub vendor_id: u16,
    /// Vendor's name.
    pub vendor: String,
    /// Device type.
    pub device_type: u16,
    /// Product code.
    pub product_code: u16,
    /// Major and minor revision.
    pub revision: (u8, u8),
    /// Product name.
    pub product_name: String,
    /// Data to the device; none for a connection with inputs only.
    pub consumed: Option<ChosenAssembly>,
    /// Connection point of the data to the device, also where these are a heartbeat.
    pub consumed_point: u32,
    /// Data from the device.
    pub produced: ChosenAssembly,
    /// Configuration, if the path names it.
    pub configuration: Option<ChosenAssembly>,
    /// Heartbeats of other connections to the same inputs.
    pub heartbeats: Vec<(u32, HeartbeatUse)>,
    /// Shortest packet interval in µs, if the file limits it.
    pub min_rpi_us: Option<u32>,
    /// Longest packet interval in µs, if the file limits it.
    pub max_rpi_us: Option<u32>,
}

/// Use of a connection without outputs.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeartbeatUse {
    /// Receives inputs.
    InputOnly,
    /// Receives inputs while another connection gets them.
    ListenOnly,
}

/// Assembly of a connection.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ChosenAssembly {
    /// Instance, which is the connection point too.
    pub instance: u32,
    /// Bytes.
    pub size: u16,
    /// True if a run/idle header is before the data.
    pub has_header: bool,
    /// Name.
    pub name: String,
}

const OPTION: &str = "--connection";

/// Largest data of a connection that Large_Forward_Open carries.
const LARGEST_DATA: u32 = 65_511;

/// Makes the adapter of a choice.
pub(super) fn choose(eds: &Eds, choice: &DeviceChoice) -> Result<ChosenAdapter, ChoiceError> {
    const FORMAT: &str = "an EDS";
    refuse("--access-point", choice.access_point.is_some(), FORMAT)?;
    refuse("--module", !choice.modules.is_empty(), FORMAT)?;
    refuse("--device-name", choice.device_name.is_some(), FORMAT)?;
    refuse("--revision", choice.revision.is_some(), FORMAT)?;
    refuse("--pdo", choice.pdos.is_some(), FORMAT)?;
    let connection = find(eds, choice)?;
    let name = excerpt(&connection.name);
    let fault = |text: String| ChoiceError::new(OPTION, format!("`{name}`: {text}")).with(list(eds));
    let is_safety = [&connection.o_to_t, &connection.t_to_o]
        .iter()
        .any(|end| end.real_time_format == RealTimeFormat::Safety);
    if is_safety {
        return Err(fault("CIP Safety is not made; choose a connection without it".to_owned()));
    }
    let points = path::points(&connection.path, &eds.parameters)
        .map_err(|reason| fault(format!("path `{}`: {reason}; choose another", excerpt(&connection.path))))?;
    let produced = assembly(eds, points.produced, &connection.t_to_o, "T->O").map_err(fault)?;
    let has_outputs = connection.o_to_t.real_time_format != RealTimeFormat::Heartbeat
        && connection
            .uses
            .iter()
            .any(|it| *it == ConnectionUse::ExclusiveOwner || *it == ConnectionUse::RedundantOwner);
    let consumed = match has_outputs {
        true => Some(assembly(eds, points.consumed, &connection.o_to_t, "O->T").map_err(fault)?),
        false => None,
    };
    let configuration = points.configuration.map(|instance| ChosenAssembly {
        instance,
        size: size_of(connection.configuration_size.unwrap_or(0)),
        has_header: false,
        name: "Configuration".to_owned(),
    });
    let taken = [consumed.as_ref().map(|it| it.instance), Some(produced.instance), points.configuration];
    let (min_rpi_us, max_rpi_us) = limits(connection);
    Ok(ChosenAdapter {
        connection: connection.number,
        vendor_id: eds.vendor_id,
        vendor: eds.vendor.clone(),
        device_type: eds.device_type,
        product_code: eds.product_code,
        revision: (eds.major_revision, eds.minor_revision),
        product_name: eds.product_name.clone(),
        heartbeats: heartbeats(eds, &points, &taken),
        consumed,
        consumed_point: points.consumed,
        produced,
        configuration,
        min_rpi_us,
        max_rpi_us,
    })
}

/// Finds the connection by name or number, or the only one with outputs.
fn find<'e>(eds: &'e Eds, choice: &DeviceChoice) -> Result<&'e EdsConnection, ChoiceError> {
    let with_data = || eds.connections.iter().filter(|connection| has_data(connection));
    if let Some(wanted) = &choice.connection {
        let mut named = eds.connections.iter().filter(|connection| connection.name == *wanted);
        let by_name = named.next();
        if named.next().is_some() {
            let fault = format!("`{}` is the name of several; give the number", excerpt(wanted));
            return Err(ChoiceError::new(OPTION, fault).with(list(eds)));
        }
        let by_number = || eds.connections.iter().find(|connection| connection.number.to_string() == *wanted);
        return by_name.or_else(by_number).ok_or_else(|| {
            ChoiceError::new(OPTION, format!("`{}` is not in the file; choose one", excerpt(wanted)))
                .with(list(eds))
        });
    }
    let is_owner = |connection: &&EdsConnection| connection.uses.contains(&ConnectionUse::ExclusiveOwner);
    let owners: Vec<_> = with_data().filter(is_owner).collect();
    match (owners.as_slice(), with_data().collect::<Vec<_>>().as_slice()) {
        ([only], _) | ([], [only]) => Ok(only),
        (_, []) => Err(ChoiceError::new(OPTION, "the file has no connection with data; use another file")),
        (_, all) => {
            let fault = format!("the file has {}; choose one by name or number", all.len());
            Err(ChoiceError::new(OPTION, fault).with(list(eds)))
        }
    }
}

/// Returns whether a connection carries data in class 0 or 1 that are not CIP Safety.
fn has_data(connection: &EdsConnection) -> bool {
    connection.transport_classes.iter().any(|class| *class < 2)
        && connection.o_to_t.real_time_format != RealTimeFormat::Safety
        && connection.t_to_o.real_time_format != RealTimeFormat::Safety
}

fn list(eds: &Eds) -> impl Iterator<Item = (String, String)> {
    eds.connections.iter().map(|connection| (connection.number.to_string(), connection.name.clone()))
}

fn size_of(size: u32) -> u16 {
    u16::try_from(size.min(LARGEST_DATA)).unwrap_or(u16::MAX)
}

fn assembly(
    eds: &Eds,
    instance: u32,
    end: &ConnectionEnd,
    direction: &str,
) -> Result<ChosenAssembly, String> {
    let size = end.size.ok_or_else(|| {
        format!("the file leaves the size of {direction} to the originator; choose a connection with a size")
    })?;
    let has_header = end.real_time_format == RealTimeFormat::Header32Bit;
    if size > LARGEST_DATA {
        return Err(format!("{size} bytes of {direction}: a connection carries at most {LARGEST_DATA}"));
    }
    let named = eds.assemblies.iter().find(|assembly| assembly.number == instance);
    let name = named.map_or_else(|| format!("Assembly {instance}"), |assembly| assembly.name.clone());
    Ok(ChosenAssembly { instance, size: size_of(size), has_header, name })
}

/// Returns the heartbeats of connections to the same inputs that own no outputs.
fn heartbeats(eds: &Eds, points: &ConnectionPoints, taken: &[Option<u32>]) -> Vec<(u32, HeartbeatUse)> {
    let mut found: Vec<(u32, HeartbeatUse)> = Vec::new();
    for connection in eds.connections.iter().filter(|connection| has_data(connection)) {
        let kind = match connection.uses.as_slice() {
            uses if uses.contains(&ConnectionUse::ExclusiveOwner) => continue,
            uses if uses.contains(&ConnectionUse::InputOnly) => HeartbeatUse::InputOnly,
            uses if uses.contains(&ConnectionUse::ListenOnly) => HeartbeatUse::ListenOnly,
            _ => continue,
        };
        let Ok(others) = path::points(&connection.path, &eds.parameters) else { continue };
        let is_known = found.iter().any(|(instance, _)| *instance == others.consumed);
        if others.produced == points.produced && !taken.contains(&Some(others.consumed)) && !is_known {
            found.push((others.consumed, kind));
        }
    }
    found
}

/// Returns the shortest and the longest packet interval that both directions accept.
fn limits(connection: &EdsConnection) -> (Option<u32>, Option<u32>) {
    let of = |end: &ConnectionEnd| end.rpi_limits_us.filter(|(least, most)| 0 < *least && least <= most);
    match (of(&connection.o_to_t), of(&connection.t_to_o)) {
        (Some(one), Some(other)) => {
            (Some(one.0.max(other.0)), Some(one.1.min(other.1).max(one.0.max(other.0))))
        }
        (Some(limits), None) | (None, Some(limits)) => (Some(limits.0), Some(limits.1)),
        (None, None) => (None, None),
    }
}

impl ChosenAdapter {
    pub(super) fn choice(&self) -> DeviceChoice {
        DeviceChoice { connection: Some(self.connection.to_string()), ..DeviceChoice::default() }
    }
}
