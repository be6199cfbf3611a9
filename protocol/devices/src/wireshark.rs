//! Writes a dissector of the image for Wireshark, in Lua, from the image's own tables
//! ([`protocol::image::COMMAND_FIELDS`] and those beside it).

use std::fmt::{self, Write};

use protocol::image::{
    AuxiliaryForm, COMMAND_CHECK, COMMAND_FIELDS, CodeTable, Control, FEEDBACK_CHECK, FEEDBACK_FIELDS,
    FieldType, IMAGE_LEN, ImageField, MOTION_FIELDS, MOTION_LEN, MotionKind, OPTION_FIELDS, POINT_FIELDS,
    Skill,
};

/// Everything that does not depend on the tables.
const TEMPLATE: &str = include_str!("../templates/skillbench-image.lua");

/// Name of the file.
pub const FILE_NAME: &str = "skillbench-image.lua";

/// Writes the file.
#[must_use]
pub fn write() -> String {
    let mut tables = String::new();
    // Writing to a String cannot fail.
    let _ = write_tables(&mut tables);
    TEMPLATE.replace("--TABLES--\n", &tables)
}

fn write_tables(lua: &mut String) -> fmt::Result {
    let kind_at = position(MOTION_FIELDS, "kind");
    writeln!(lua, "local LEN, MOTION_LEN, KIND_AT = {IMAGE_LEN}, {MOTION_LEN}, {kind_at}")?;
    writeln!(lua, "local CHECK_OF_COMMAND, CHECK_OF_FEEDBACK = {COMMAND_CHECK}, {FEEDBACK_CHECK}")?;
    let life = |fields| position(fields, "life counter");
    writeln!(
        lua,
        "local LIFE_OF_COMMAND, LIFE_OF_FEEDBACK = {}, {}",
        life(COMMAND_FIELDS),
        life(FEEDBACK_FIELDS)
    )?;
    write_codes(lua, "COMMAND_CODES", CodeTable::Skill)?;
    write_codes(lua, "FEEDBACK_CODES", CodeTable::State)?;
    write_codes(lua, "KINDS_OF_MOTION", CodeTable::Kind)?;
    write_codes(lua, "ERRORS", CodeTable::Error)?;
    write_fields(lua, "COMMAND", COMMAND_FIELDS)?;
    write_fields(lua, "FEEDBACK", FEEDBACK_FIELDS)?;
    write_fields(lua, "MOTION", MOTION_FIELDS)?;
    write_fields(lua, "OPTIONS", OPTION_FIELDS)?;
    write_fields(lua, "COMPACT", POINT_FIELDS)?;
    let (skill, bit) = (u8::from(Skill::MoveTrajectory), Control::COMPACT.0);
    let skill_at = position(COMMAND_FIELDS, "skill");
    writeln!(lua, "local SKILL_AT, COMPACT_SKILL, COMPACT_BIT = {skill_at}, {skill}, {bit}")?;
    let real = |name, unit| ImageField { first: 24, name, form: FieldType::Real(3), unit };
    write_fields(lua, "POINT", &[real("point", "mm")])?;
    write_fields(lua, "FORCE", &[real("force", "N")])?;
    write!(lua, "local AUXILIARY = {{")?;
    for kind in MotionKind::standard() {
        let table = match kind.traits().map(|traits| traits.auxiliary) {
            Some(AuxiliaryForm::Options) => "OPTIONS",
            Some(AuxiliaryForm::Point) => "POINT",
            Some(AuxiliaryForm::Force) => "FORCE",
            None => continue,
        };
        write!(lua, " [{}] = {table},", u8::from(kind))?;
    }
    writeln!(lua, " }}")
}

/// Returns the first byte of the field with this name.
fn position(fields: &[ImageField], name: &str) -> usize {
    fields.iter().find(|field| field.name == name).map_or(0, |field| field.first)
}

const fn codes_of(table: CodeTable) -> &'static str {
    match table {
        CodeTable::Skill => "COMMAND_CODES",
        CodeTable::State => "FEEDBACK_CODES",
        CodeTable::Error => "ERRORS",
        CodeTable::Kind => "KINDS_OF_MOTION",
    }
}

fn write_codes(lua: &mut String, name: &str, table: CodeTable) -> fmt::Result {
    writeln!(lua, "local {name} = {{")?;
    table.for_each(|code, value| {
        // Writing to a String cannot fail.
        let _ = writeln!(lua, "    [{code}] = \"{value:?}\",");
    });
    writeln!(lua, "}}")
}

fn write_fields(lua: &mut String, name: &str, fields: &[ImageField]) -> fmt::Result {
    writeln!(lua, "local {name} = {{")?;
    for ImageField { first, name, form, unit } in fields {
        write!(lua, "    {{ first = {first}, len = {}, name = \"{name}\", unit = \"{unit}\"", form.len())?;
        match form {
            FieldType::Usint => write!(lua, ", form = \"usint\""),
            FieldType::Uint => write!(lua, ", form = \"uint\""),
            FieldType::Udint => write!(lua, ", form = \"udint\""),
            FieldType::Ulint => write!(lua, ", form = \"ulint\""),
            FieldType::Real(_) => write!(lua, ", form = \"real\""),
            FieldType::Int(_) => write!(lua, ", form = \"int\""),
            FieldType::Check => write!(lua, ", form = \"check\""),
            FieldType::Motion => write!(lua, ", form = \"motion\""),
            FieldType::Reserved(_) => write!(lua, ", form = \"reserved\""),
            FieldType::Code(table) => write!(lua, ", form = \"code\", codes = {}", codes_of(*table)),
            FieldType::Word(bits) => {
                let bits: Vec<_> = bits.iter().map(|bit| format!("\"{bit}\"")).collect();
                write!(lua, ", form = \"word\", bits = {{ {} }}", bits.join(", "))
            }
        }?;
        writeln!(lua, " }},")?;
    }
    writeln!(lua, "}}")
}
