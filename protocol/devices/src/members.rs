//! Members of the image, by which device files name its bytes: the fields of its tables, a list of numbers as single ones, and
//! the motions of the slots field by field.

use protocol::image::{COMMAND_FIELDS, FEEDBACK_FIELDS, FieldType, ImageField, MOTION_FIELDS};

/// Type of a member.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum MemberType {
    /// Unsigned number of so many bits.
    Unsigned(u16),
    /// 16 bits of their own, with names from bit 0.
    Bits(&'static [&'static str]),
    /// IEEE 754, 32 bits.
    Real,
    /// So many bytes without a meaning.
    Bytes(usize),
}

/// One member.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct ImageMember {
    /// Name.
    pub name: String,
    /// Type.
    pub form: MemberType,
    /// Unit; empty where there is none.
    pub unit: &'static str,
}

impl ImageMember {
    /// Returns the length in bits.
    pub(crate) const fn bits(&self) -> usize {
        match self.form {
            MemberType::Unsigned(bits) => bits as usize,
            MemberType::Bits(_) => 16,
            MemberType::Real => 32,
            MemberType::Bytes(len) => 8 * len,
        }
    }

    /// Returns whether the bytes mean something.
    pub(crate) const fn is_named(&self) -> bool {
        !matches!(self.form, MemberType::Bytes(_))
    }
}

/// Returns the members of the command.
pub(crate) fn of_command() -> Vec<ImageMember> {
    members(COMMAND_FIELDS, "")
}

/// Returns the members of the feedback.
pub(crate) fn of_feedback() -> Vec<ImageMember> {
    members(FEEDBACK_FIELDS, "")
}

fn members(fields: &[ImageField], prefix: &str) -> Vec<ImageMember> {
    let mut members = Vec::new();
    for ImageField { name, form, unit, .. } in fields {
        let name = format!("{prefix}{name}");
        let unit = if *unit == "bits" { "" } else { unit };
        // Of six numbers with two units the first three are a place, the others angles.
        let units = unit.split_once(", ").unwrap_or((unit, unit));
        let mut add = |name: String, form| members.push(ImageMember { name, form, unit: units.0 });
        match form {
            FieldType::Real(1) => add(name, MemberType::Real),
            FieldType::Real(count) => {
                members.extend((1..=*count).map(|number| ImageMember {
                    name: format!("{name} {number}"),
                    form: MemberType::Real,
                    unit: if number <= 3 { units.0 } else { units.1 },
                }));
            }
            FieldType::Int(count) => {
                (0..*count).for_each(|number| add(format!("{name} {number}"), MemberType::Unsigned(16)))
            }
            FieldType::Word(bits) => add(name, MemberType::Bits(bits)),
            FieldType::Motion => members.extend(self::members(MOTION_FIELDS, &format!("{name} "))),
            FieldType::Reserved(len) => add(name, MemberType::Bytes(*len)),
            FieldType::Usint
            | FieldType::Uint
            | FieldType::Udint
            | FieldType::Ulint
            | FieldType::Code(_)
            | FieldType::Check => add(name, MemberType::Unsigned(8 * form.len() as u16)),
        }
    }
    members
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_members_of_each_image_fill_it_and_no_two_have_one_name() {
        for members in [of_command(), of_feedback()] {
            assert_eq!(members.iter().map(ImageMember::bits).sum::<usize>(), 8 * protocol::image::IMAGE_LEN);
            let named: Vec<_> = members.iter().filter(|member| member.is_named()).collect();
            let names: std::collections::BTreeSet<_> = named.iter().map(|member| &member.name).collect();
            assert_eq!(names.len(), named.len());
            assert!(names.iter().all(|name| name.len() <= 32), "EDS: names of at most 32 characters");
        }
    }
}
