//! Mailbox protocols, and commands for the start of a device.

use serde::{Deserialize, Serialize};

use super::pdo::depends_on_slot;
use crate::fault::{FileFault, excerpt};
use crate::xml::Element;

/// Mailbox of a device.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiMailbox {
    /// True if the data link layer repeats lost mail.
    pub has_repeat: bool,
    /// Protocols: `AoE`, `EoE`, `CoE`, `FoE`, `SoE`, `VoE`.
    pub protocols: Vec<String>,
    /// CANopen over EtherCAT.
    pub coe: Option<CoeService>,
}

/// CANopen over EtherCAT.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CoeService {
    /// True if the device lists its objects.
    pub has_sdo_info: bool,
    /// True if PDOs can be assigned to sync managers.
    pub has_pdo_assign: bool,
    /// True if the entries of PDOs can be changed.
    pub has_pdo_config: bool,
    /// True if the controller uploads the PDOs instead of using those of the file.
    pub has_pdo_upload: bool,
    /// True if an object can be read and written with all its entries at once.
    pub has_complete_access: bool,
    /// Commands that the controller sends at the start.
    pub init_commands: Vec<StartupCommand>,
}

/// SDO that the controller writes on a transition.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StartupCommand {
    /// Transitions, such as `PS`.
    pub transitions: Vec<String>,
    /// Index.
    pub index: u16,
    /// True if the index of a module's object moves with its slot.
    pub depends_on_slot: bool,
    /// Subindex.
    pub subindex: u8,
    /// True if all entries are written at once.
    pub is_complete_access: bool,
    /// Data.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub data: Vec<u8>,
    /// Comment.
    pub comment: String,
}

const PROTOCOLS: [&str; 6] = ["AoE", "EoE", "CoE", "FoE", "SoE", "VoE"];

impl EsiMailbox {
    /// Reads the mailbox of a device or module, if it has one.
    pub(super) fn read(within: Element<'_>) -> Result<Option<Self>, FileFault> {
        let Some(mailbox) = within.child("Mailbox") else { return Ok(None) };
        let protocols = PROTOCOLS.iter().filter(|name| mailbox.child(name).is_some());
        Ok(Some(Self {
            has_repeat: mailbox.is("DataLinkLayer")?,
            protocols: protocols.map(|name| (*name).to_owned()).collect(),
            coe: mailbox.child("CoE").map(CoeService::read).transpose()?,
        }))
    }
}

impl CoeService {
    fn read(coe: Element<'_>) -> Result<Self, FileFault> {
        Ok(Self {
            has_sdo_info: coe.is("SdoInfo")?,
            has_pdo_assign: coe.is("PdoAssign")?,
            has_pdo_config: coe.is("PdoConfig")?,
            has_pdo_upload: coe.is("PdoUpload")?,
            has_complete_access: coe.is("CompleteAccess")?,
            init_commands: coe.list("InitCmd", StartupCommand::read)?,
        })
    }
}

impl StartupCommand {
    fn read(command: Element<'_>) -> Result<Self, FileFault> {
        let data = command.child("Data");
        let index = command.child_number("Index")?;
        Ok(Self {
            transitions: command.list("Transition", |transition| transition.keep(transition.text()))?,
            index: index.ok_or_else(|| command.finding("element Index is missing; add it"))?,
            depends_on_slot: depends_on_slot(command)?,
            subindex: command.child_number("SubIndex")?.unwrap_or(0),
            is_complete_access: command.is("CompleteAccess")?,
            data: data.map_or(Ok(Vec::new()), hex_bytes)?,
            comment: command.keep(command.child_text("Comment").unwrap_or_default())?,
        })
    }
}

/// Returns the bytes of an element whose text is hexadecimal, such as `0800`.
pub(super) fn hex_bytes(element: Element<'_>) -> Result<Vec<u8>, FileFault> {
    let text = element.text();
    element.charge(text.len() / 2)?;
    let fault =
        || element.finding(format!("`{}`: must be bytes in hexadecimal, such as 0800", excerpt(text)));
    let digits: Option<Vec<u8>> = text
        .chars()
        .filter(|it| !it.is_whitespace())
        .map(|it| it.to_digit(16).and_then(|digit| u8::try_from(digit).ok()))
        .collect();
    let digits = digits.ok_or_else(fault)?;
    let (pairs, rest) = digits.as_chunks::<2>();
    if rest.is_empty() { Ok(pairs.iter().map(|[high, low]| high << 4 | low).collect()) } else { Err(fault()) }
}
