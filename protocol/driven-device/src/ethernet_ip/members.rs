//! Members of an assembly of an EDS, with their places in its data.

use std::collections::HashMap;

use device_files::{Eds, EdsAssembly, EdsParameter, EdsReference};

use super::signal;
use crate::config::DriveError;
use crate::signal::Signal;

/// Most members of one assembly, those of assemblies within it counted too.
const MOST_MEMBERS: usize = 8192;

/// Deepest assembly within assemblies; a ring is deeper.
const MOST_DEPTH: usize = 16;

/// Parameter in the data of an assembly.
#[derive(Debug)]
pub(super) struct PlacedMember<'e> {
    pub(super) parameter: &'e EdsParameter,
    pub(super) signal: Signal,
}

/// Lists the parameters in the data of a parameter or an assembly, in the order of their places.
///
/// # Errors
///
/// It has more members, or assemblies deeper within each other, than an adapter has.
pub(super) fn members<'e>(
    eds: &'e Eds,
    reference: EdsReference,
    place: &str,
) -> Result<Vec<PlacedMember<'e>>, DriveError> {
    let mut layout = AssemblyLayout {
        parameters: eds.parameters.iter().map(|parameter| (parameter.number, parameter)).collect(),
        assemblies: eds.assemblies.iter().map(|assembly| (assembly.number, assembly)).collect(),
        place,
        seen: 0,
        members: Vec::new(),
    };
    match reference {
        EdsReference::Parameter(number) => layout.parameter(number, None, 0),
        EdsReference::Assembly(number) => layout.assembly(number, 0, 0)?,
    };
    Ok(layout.members)
}

struct AssemblyLayout<'e, 'p> {
    parameters: HashMap<u32, &'e EdsParameter>,
    assemblies: HashMap<u32, &'e EdsAssembly>,
    place: &'p str,
    /// Members seen so far.
    seen: usize,
    members: Vec<PlacedMember<'e>>,
}

impl AssemblyLayout<'_, '_> {
    /// Adds a parameter from a bit on. Returns its bits.
    fn parameter(&mut self, number: u32, bits: Option<usize>, bit: usize) -> usize {
        let Some(parameter) = self.parameters.get(&number).copied() else { return bits.unwrap_or(0) };
        let bits = bits.unwrap_or_else(|| bits_of(parameter.size.unwrap_or(0)));
        self.members.push(PlacedMember { parameter, signal: signal(parameter, self.place, bit, bits) });
        bits
    }

    /// Adds the members of an assembly from a bit on. Returns their bits.
    fn assembly(&mut self, number: u32, first: usize, depth: usize) -> Result<usize, DriveError> {
        let Some(assembly) = self.assemblies.get(&number).copied() else { return Ok(0) };
        if depth > MOST_DEPTH {
            let fault = format!(
                "Assem{number}: more than {MOST_DEPTH} assemblies within each other; remove the ring from the file"
            );
            return Err(DriveError::File(fault));
        }
        let mut bit = first;
        for member in &assembly.members {
            self.seen += 1;
            if self.seen > MOST_MEMBERS {
                let fault = format!(
                    "Assem{number}: more than {MOST_MEMBERS} members; use a file with smaller assemblies"
                );
                return Err(DriveError::File(fault));
            }
            let given = member.bits.map(|bits| bits as usize);
            let bits = match EdsReference::parse(&member.target) {
                Some(EdsReference::Parameter(number)) => self.parameter(number, given, bit),
                Some(EdsReference::Assembly(number)) => self.within(number, given, bit, depth + 1)?,
                None => given.unwrap_or(0),
            };
            bit = bit.saturating_add(bits);
        }
        Ok(bit - first)
    }

    /// Adds the members of an assembly within another one. Returns the bits of its place, which may be more than those of the
    /// members, or fewer: then the last members have no data.
    fn within(
        &mut self,
        number: u32,
        given: Option<usize>,
        bit: usize,
        depth: usize,
    ) -> Result<usize, DriveError> {
        let from = self.members.len();
        let sum = self.assembly(number, bit, depth)?;
        let size = self.assemblies.get(&number).and_then(|assembly| assembly.size);
        let bits = given.or(size.map(bits_of)).unwrap_or(sum);
        if bits < sum {
            let end = bit.saturating_add(bits);
            let inside =
                |member: &PlacedMember<'_>| member.signal.bit.saturating_add(member.signal.bits) <= end;
            let added = self.members.split_off(from);
            self.members.extend(added.into_iter().filter(inside));
        }
        Ok(bits)
    }
}

const fn bits_of(bytes: u32) -> usize {
    (bytes as usize).saturating_mul(8)
}

#[cfg(test)]
mod tests {
    use device_files::{DeviceFile, read};
    use proptest::prelude::*;

    use super::*;

    fn eds(parameters: &str, assemblies: &str) -> Result<Eds, String> {
        let text = include_str!("../../../../scripts/interop/files/made-up-adapter.eds")
            .replace("[Params]", &format!("[Params]\n{parameters}"))
            .replace("[Assembly]", &format!("[Assembly]\n{assemblies}"));
        match read("a.eds", text.into()).map_err(|error| error.to_string())? {
            DeviceFile::Eds(eds) => Ok(eds),
            _ => unreachable!("the file is an EDS"),
        }
    }

    /// Three parameters of 1, 2 and 4 bytes.
    const PARAMETERS: &str = "Param11 = 0,,,0,0xC6,1,\"A\",\"\",\"\",0,255,0,,,,,,,,,;\n\
         Param12 = 0,,,0,0xC7,2,\"B\",\"\",\"\",0,255,0,,,,,,,,,;\n\
         Param13 = 0,,,0,0xC8,4,\"C\",\"\",\"\",0,255,0,,,,,,,,,;\n";

    fn places(assemblies: &str) -> Vec<(String, usize, usize)> {
        let eds = eds(PARAMETERS, assemblies).unwrap();
        let members = members(&eds, EdsReference::Assembly(31), "").unwrap();
        members.into_iter().map(|it| (it.signal.name, it.signal.bit, it.signal.bits)).collect()
    }

    #[test]
    fn an_assembly_within_another_one_takes_the_bits_of_its_member_or_its_size() {
        let of = |name: &str, bit, bits| (name.to_owned(), bit, bits);
        let inner = "Assem32 = \"Inner\",,6,0,,,,Param11,,Param12;\n";
        let by_size = format!("{inner}Assem31 = \"Outer\",,,0,,,,ASSEM32,,param13;\n");
        assert_eq!(places(&by_size), [of("A", 0, 8), of("B", 8, 16), of("C", 48, 32)]);
        let by_bits = format!("{inner}Assem31 = \"Outer\",,,0,,,16,Assem32,,Param13;\n");
        assert_eq!(places(&by_bits), [of("A", 0, 8), of("C", 16, 32)], "B has no data");
    }

    #[test]
    fn assemblies_that_fan_out_or_form_a_ring_are_refused_in_words() {
        let mut fan = String::new();
        for number in 31..40 {
            let member = format!(",8,Assem{}", number + 1);
            fan += &format!("Assem{number} = \"\",,1,0,,{};\n", member.repeat(4));
        }
        let ring = "Assem31 = \"\",,1,0,,,8,Assem31;\n".to_owned();
        for (assemblies, said) in [
            (fan, "more than 8192 members; use a file with smaller assemblies"),
            (ring, "Assem31: more than 16 assemblies within each other; remove the ring from the file"),
        ] {
            let eds = eds("", &assemblies).unwrap();
            let error = members(&eds, EdsReference::Assembly(31), "").unwrap_err().to_string();
            assert!(error.ends_with(said), "{error}");
        }
    }

    proptest! {
        #[test]
        fn members_of_any_assemblies_follow_each_other_without_overlap(
            assemblies in prop::collection::vec(
                (
                    prop::option::of(0_u32..20),
                    prop::collection::vec(
                        (
                            prop::option::of(prop_oneof![0_u32..40, Just(u32::MAX)]),
                            prop_oneof![
                                (10_u32..15).prop_map(|number| format!("pARAM{number}")),
                                (30_u32..40).prop_map(|number| format!("Assem{number}")),
                                Just(String::new()),
                            ],
                        ),
                        0..5,
                    ),
                ),
                1..10,
            ),
        ) {
            let mut text = String::new();
            let option = |number: Option<u32>| number.map(|it| it.to_string()).unwrap_or_default();
            for (number, (size, members)) in (31..).zip(assemblies) {
                text += &format!("Assem{number} = \"\",,{},0,,", option(size));
                for (bits, target) in members {
                    text += &format!(",{},{target}", option(bits));
                }
                text += ";\n";
            }
            if let Ok(eds) = eds(PARAMETERS, &text)
                && let Ok(members) = members(&eds, EdsReference::Assembly(31), "")
            {
                prop_assert!(members.len() <= MOST_MEMBERS);
                let mut end = 0;
                for PlacedMember { signal, .. } in members {
                    prop_assert!(signal.bit >= end);
                    end = signal.bit.saturating_add(signal.bits);
                }
            }
        }
    }
}
