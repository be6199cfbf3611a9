//! Assemblies and their members.

use std::collections::HashMap;

use serde::Serialize;

use super::parameters::EdsParameter;
use super::syntax::{Sheet, SheetEntry, SheetSection, numbered};
use crate::fault::{FileFault, excerpt};

/// Assembly: data that are exchanged together.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EdsAssembly {
    /// Number by which others name it.
    pub number: u32,
    /// Name.
    pub name: String,
    /// Path of its data, such as `20 04 24 64 30 03`.
    pub path: String,
    /// Bytes; none if the device decides.
    pub size: Option<u32>,
    /// Members in their order.
    pub members: Vec<EdsMember>,
}

/// Member of an assembly.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EdsMember {
    /// Bits; none if they are those of what it names.
    pub bits: Option<u32>,
    /// Parameter or assembly, such as `Param3`; empty for bits without a name.
    pub target: String,
}

/// Parameter or assembly that a member, or the format of a connection's data, names.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum EdsReference {
    /// Parameter of this number.
    Parameter(u32),
    /// Assembly of this number.
    Assembly(u32),
}

impl EdsReference {
    /// Parses a reference such as `Param3` or `Assem101`, in any case; `None` for other texts.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let parameter = numbered(text, "Param").map(Self::Parameter);
        parameter.or_else(|| numbered(text, "Assem").map(Self::Assembly))
    }
}

/// Reads the assemblies (CIP volume 1, 7-3.6.8).
pub(super) fn read(
    sheet: &Sheet<'_>,
    section: &SheetSection<'_>,
    parameters: &[EdsParameter],
) -> Result<Vec<EdsAssembly>, FileFault> {
    let mut assemblies = Vec::new();
    let mut entries = HashMap::new();
    for (number, entry) in section.numbered("Assem") {
        sheet.charge(size_of::<EdsAssembly>())?;
        let mut members = Vec::new();
        // Pairs of bits and what has them follow the six fields of the assembly itself.
        for at in (6..entry.count()).step_by(2) {
            sheet.charge(size_of::<EdsMember>())?;
            members.push(EdsMember { bits: entry.number(at)?, target: sheet.keep(entry.field(at + 1))? });
        }
        if entries.insert(number, (entry, assemblies.len())).is_some() {
            return Err(entry.finding(0, "the number is there twice; rename one"));
        }
        assemblies.push(EdsAssembly {
            number,
            name: sheet.keep(entry.field(0))?,
            path: sheet.keep(entry.field(1))?,
            size: assembly_size(entry)?,
            members,
        });
    }
    let parameters = parameters.iter().map(|parameter| (parameter.number, parameter)).collect();
    let mut sizes = Sizes { assemblies: &assemblies, entries: &entries, parameters, known: HashMap::new() };
    let mut found = Vec::with_capacity(assemblies.len());
    for assembly in &assemblies {
        found.push(sizes.bytes(assembly.number, 0)?);
    }
    for (assembly, bytes) in assemblies.iter_mut().zip(found) {
        assembly.size = bytes;
    }
    Ok(assemblies)
}

/// Returns the size that an entry gives; none if it is the sum of its members, or a parameter.
fn assembly_size(entry: &SheetEntry<'_>) -> Result<Option<u32>, FileFault> {
    if numbered(entry.field(2), "Param").is_some() { Ok(None) } else { entry.number(2) }
}

/// Sizes of assemblies that name each other.
struct Sizes<'s, 'a> {
    assemblies: &'s [EdsAssembly],
    entries: &'s HashMap<u32, (&'s SheetEntry<'a>, usize)>,
    parameters: HashMap<u32, &'s EdsParameter>,
    known: HashMap<u32, Option<u32>>,
}

/// Assemblies within assemblies; deeper is a ring.
const MOST_DEPTH: usize = 16;

impl Sizes<'_, '_> {
    /// Returns the bytes of an assembly; none if the device decides.
    fn bytes(&mut self, number: u32, depth: usize) -> Result<Option<u32>, FileFault> {
        if let Some(known) = self.known.get(&number) {
            return Ok(*known);
        }
        let Some((entry, index)) = self.entries.get(&number).copied() else { return Ok(None) };
        if depth > MOST_DEPTH {
            return Err(
                entry.finding(6, format!("Assem{number} names itself through others; remove the ring"))
            );
        }
        let Some(assembly) = self.assemblies.get(index) else { return Ok(None) };
        let mut total = Some(0_u32);
        for (at, member) in assembly.members.iter().enumerate() {
            let bits = match member.bits {
                Some(bits) => Some(bits),
                None => self.member_bits(entry, 6 + 2 * at + 1, &member.target, depth)?,
            };
            total = total.and_then(|total| total.checked_add(bits?));
        }
        let sum = total.map(|bits| bits.div_ceil(8));
        let by_parameter = numbered(entry.field(2), "Param").and_then(|number| self.parameters.get(&number));
        let bytes = match (assembly.size, by_parameter) {
            (Some(size), _) => Some(size),
            (None, Some(parameter)) => parameter.default_number(),
            (None, None) => sum.filter(|_| !assembly.members.is_empty()),
        };
        self.known.insert(number, bytes);
        Ok(bytes)
    }

    fn member_bits(
        &mut self,
        entry: &SheetEntry<'_>,
        field: usize,
        target: &str,
        depth: usize,
    ) -> Result<Option<u32>, FileFault> {
        if target.is_empty() {
            return Ok(Some(0));
        }
        let missing = || entry.finding(field, format!("`{}` is not in the file; add it", excerpt(target)));
        if let Some(number) = numbered(target, "Param") {
            let parameter = self.parameters.get(&number).ok_or_else(missing)?;
            return Ok(parameter.size.and_then(|size| size.checked_mul(8)));
        }
        if let Some(number) = numbered(target, "Assem") {
            self.entries.get(&number).ok_or_else(missing)?;
            return Ok(self.bytes(number, depth + 1)?.and_then(|bytes| bytes.checked_mul(8)));
        }
        // Variants and values, such as `Variant1` and `0x00`, have a size of their own.
        Ok(None)
    }
}
