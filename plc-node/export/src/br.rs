//! The code for B&R: a library with the blocks and a program in Automation Studio's files, in one package.

use ::structured_text::pieces;

use crate::names::check_length;
use crate::parts::{CodePart, Parts, Unit, joined};
use crate::{ExportFile, ExportedApplication, Refused};

/// The maker in messages.
const MAKER: &str = "B&R";

/// Longest name of a block, type or object on the target, in characters.
pub const LONGEST_NAME: usize = 10;

/// Names of the neutral code that are longer, with those that they get.
pub const SHORT_NAMES: [(&str, &str); 19] = [
    ("SB_AdapterTest", "SB_AdptTst"),
    ("SB_AxesGroup", "SB_Group"),
    ("SB_BitsOfReal", "SB_BitsOfR"),
    ("SB_GroupCommand", "SB_GrpCmd"),
    ("SB_LifeMonitor", "SB_LifeMon"),
    ("SB_MoveContinuous", "SB_MoveCon"),
    ("SB_NextUint", "SB_NxtUint"),
    ("SB_Progress", "SB_Progr"),
    ("SB_ReadUdint", "SB_RdUdint"),
    ("SB_ReadUint", "SB_RdUint"),
    ("SB_Readiness", "SB_Ready"),
    ("SB_RealOfBits", "SB_ROfBits"),
    ("SB_RunProgram", "SB_RunProg"),
    ("SB_SelfTest", "SB_SelfTst"),
    ("SB_Sequence", "SB_Sequ"),
    ("SB_SingleMotion", "SB_Single"),
    ("SB_TakeFeedback", "SB_TakeFb"),
    ("SB_TestBits", "SB_TstBits"),
    ("SB_WriteCommand", "SB_WrtCmd"),
];

const LIBRARY: &str = "SkillBench";
const PROGRAM: &str = "SBProgram";

/// Words of Automation Studio that are no names of IEC 61131-3, and those of C: it makes C headers of declarations.
const WORDS: [&str; 38] = [
    "ACCESS",
    "ADR",
    "ALIAS",
    "AUTO",
    "BREAK",
    "CHAR",
    "CONST",
    "DEFAULT",
    "DOUBLE",
    "ENUM",
    "EXTERN",
    "FLOAT",
    "GOTO",
    "INHERITS",
    "LONG",
    "PERSISTENT",
    "PLC",
    "PUBLIC",
    "REFERENCE",
    "REGISTER",
    "SHORT",
    "SIGNED",
    "SIZEOF",
    "STATIC",
    "SWITCH",
    "SELECT",
    "TYPEDEF",
    "UNION",
    "UNSIGNED",
    "VOID",
    "VOLATILE",
    "WHEN",
    "NEXT",
    "ENDIF",
    "LOOP",
    "ENDLOOP",
    "TASKNAME",
    "BEGIN",
];

/// The head of each file with code.
const HEAD: &str = "(* Written by skillbench's plc-node export --for br. The logic was executed against a robot, scan by scan, and these files were read back
   to the same code. No grammar of Automation Studio by others exists in public, so nothing but our own reader checked this syntax; the
   adapter is proven by SB_AdptTst on the PLC only. *)\n";

const XML: &str = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<?AutomationStudio FileVersion=\"4.9\"?>\n";

/// The program: cyclic part, and its variables.
const MAIN: &str = include_str!("../templates/br-main.st");
const VARIABLES: &str = include_str!("../templates/br-variables.var");

/// Lines for the `Cpu.sw` of a configuration.
pub const CPU_SW: &str = "  <TaskClass Name=\"Cyclic#1\">\n    <Task Name=\"SBProgram\" Source=\"SkillKit.SBProgram.prg\" Memory=\"UserROM\" \
     Language=\"IEC\" Debugging=\"true\" />\n  </TaskClass>\n  <Libraries>\n    <LibraryObject Name=\"SkillBench\" \
     Source=\"SkillKit.SkillBench.lby\" Memory=\"UserROM\" Language=\"IEC\" Debugging=\"true\" />\n  </Libraries>\n";

/// Returns the files; the directory is a package, which a project calls SkillKit.
///
/// # Errors
/// The first thing that does not fit.
pub(crate) fn br(application: &ExportedApplication, text: &str) -> Result<Vec<ExportFile>, Refused> {
    let mut files = library(text)?;
    let file = |path: String, text: String| ExportFile { path, text };
    let big_endian = if application.big_endian { "TRUE" } else { "FALSE" };
    let listed =
        |path: &str, description: &str| format!("    <File Description=\"{description}\">{path}</File>\n");
    let of_library = ["SkillBench.typ", "SkillBench.fun", "SkillBench.var", "SkillBench.st"];
    let of_library: String = of_library
        .into_iter()
        .zip(["Data types", "Functions and function blocks", "Constants", "Bodies"])
        .map(|(path, description)| listed(path, description))
        .collect();
    files.extend([
        file(
            format!("{LIBRARY}/IEC.lby"),
            format!(
                "{XML}<Library SubType=\"IEC\" xmlns=\"http://br-automation.co.at/AS/Library\">\n  <Files>\n{of_library}  </Files>\n</Library>\n"
            ),
        ),
        file(format!("{LIBRARY}/SkillBench.var"), format!("{HEAD}VAR CONSTANT\n    SB_IMG_LEN : UINT := 256;\nEND_VAR\n")),
        file(
            format!("{PROGRAM}/IEC.prg"),
            format!(
                "{XML}<Program SubType=\"IEC\" xmlns=\"http://br-automation.co.at/AS/Program\">\n  <Files>\n{}{}{}  </Files>\n</Program>\n",
                listed("Main.st", "Init, cyclic and exit part"),
                listed("Types.typ", "Local data types"),
                listed("Variables.var", "Local variables")
            ),
        ),
        file(format!("{PROGRAM}/Main.st"), format!("{HEAD}{}", MAIN.replace("@BIG_ENDIAN@", big_endian))),
        file(format!("{PROGRAM}/Types.typ"), format!("{HEAD}TYPE\n    SBInfo_typ : STRUCT\n        self_test : UINT := 1;\n        now_us : UDINT;\n    END_STRUCT;\nEND_TYPE\n")),
        file(format!("{PROGRAM}/Variables.var"), format!("{HEAD}{VARIABLES}")),
        file(
            "Package.pkg".into(),
            format!(
                "{XML}<Package xmlns=\"http://br-automation.co.at/AS/Package\">\n  <Objects>\n    <Object Type=\"Library\" \
                 Language=\"IEC\">{LIBRARY}</Object>\n    <Object Type=\"Program\" Language=\"IEC\">{PROGRAM}</Object>\n  </Objects>\n</Package>\n"
            ),
        ),
        file("Cpu.sw.txt".into(), CPU_SW.into()),
    ]);
    Ok(files)
}

/// Rewrites the code as a library: types, declarations and bodies.
///
/// # Errors
/// It is not in the form of the templates, or a name is a word of Automation Studio.
pub fn library(text: &str) -> Result<Vec<ExportFile>, Refused> {
    let text = with_short_names(text)?;
    let parts = crate::names::checked_parts(&text, MAKER, &WORDS)?;
    check_length(&parts, MAKER, LONGEST_NAME)?;
    let (mut types, mut declarations, mut bodies) =
        (String::from(HEAD), String::from(HEAD), String::from(HEAD));
    for part in &parts.parts {
        match part {
            // An array has no type of its own: its name is replaced where it stands.
            CodePart::Type { name, .. } if parts.is_array(name) => {}
            CodePart::Type { comment, name, body } => {
                types.push_str(&format!("\n{comment}\nTYPE\n    {name} : "));
                parts.write_declarations(body, "", &mut types);
                types.push_str("\nEND_TYPE\n");
            }
            CodePart::Unit(unit) => {
                write_declaration(unit, &parts, &mut declarations);
                let (word, end) = (word_of(unit), unit.end);
                bodies.extend(["\n", word, " ", unit.name, &joined(&unit.body), end.before, end.text, "\n"]);
            }
        }
    }
    let file = |path: &str, text| ExportFile { path: format!("{LIBRARY}/{path}"), text };
    Ok(vec![
        file("SkillBench.typ", types),
        file("SkillBench.fun", declarations),
        file("SkillBench.st", bodies),
    ])
}

/// Gives the blocks and types of the code names that fit the target.
///
/// # Errors
/// A token is malformed.
pub fn with_short_names(text: &str) -> Result<String, Refused> {
    let all = pieces(text).map_err(|mistake| Refused::Rewrite { maker: MAKER, text: mistake.to_string() })?;
    let mut short = String::with_capacity(text.len());
    for piece in &all {
        let known = SHORT_NAMES.iter().find(|(long, _)| piece.is_word(long));
        short.extend([piece.before, known.map_or(piece.text, |(_, name)| name)]);
    }
    // What follows the last token is white space.
    short.push('\n');
    Ok(short)
}

const fn word_of(unit: &Unit<'_>) -> &'static str {
    if unit.result.is_some() { "FUNCTION" } else { "FUNCTION_BLOCK" }
}

fn write_declaration(unit: &Unit<'_>, parts: &Parts<'_>, text: &mut String) {
    text.extend(["\n", unit.comment, "\n", word_of(unit), " ", unit.name]);
    if let Some(result) = unit.result {
        text.extend([" : ", result]);
    }
    for section in &unit.sections {
        let constant = if section.is_constant { " CONSTANT" } else { "" };
        text.extend(["\n", section.role.text, constant]);
        parts.write_declarations(&section.declarations, "", text);
        text.extend([section.end.before, section.end.text]);
    }
    text.extend(["\n", unit.end.text, "\n"]);
}
