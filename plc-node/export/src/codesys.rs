//! The code for CODESYS: one PLCopen XML file with its additional data, where each interface is also there as plain text. A plain text
//! import would lose types and global variables.

use std::fmt::Write as _;

use ::structured_text::{Piece, pieces};

use crate::parts::{CodePart, Parts, Unit, joined};
use crate::{ExportFile, ExportedApplication, Refused};

/// The maker in messages.
const MAKER: &str = "CODESYS";

/// The file.
pub const XML_FILE: &str = "skillbench.xml";

/// Words of CODESYS that are no names of IEC 61131-3.
const WORDS: [&str; 36] = [
    "ABSTRACT",
    "ADR",
    "AND_THEN",
    "BITADR",
    "CAL",
    "CALC",
    "EXTENDS",
    "FINAL",
    "GET",
    "GOTO",
    "IMPLEMENTS",
    "INDEXOF",
    "INI",
    "INTERFACE",
    "INTERNAL",
    "JMP",
    "LDATE",
    "LDT",
    "LTIME",
    "LTOD",
    "METHOD",
    "OR_ELSE",
    "PARAMS",
    "PERSISTENT",
    "POINTER",
    "PRIVATE",
    "PROPERTY",
    "PROTECTED",
    "PUBLIC",
    "REFERENCE",
    "SET",
    "SIZEOF",
    "SUPER",
    "THIS",
    "UNION",
    "XSIZEOF",
];

const INTERFACE: &str = "http://www.3s-software.com/plcopenxml/interfaceasplaintext";

/// The adapter: REAL and bits, clock, I/O, and the program. Its blocks are parted by lines of `====`, each body by a line of `----`.
const ADAPTER: &str = include_str!("../templates/codesys-adapter.st");

/// Returns the files.
///
/// # Errors
/// The first thing that does not fit.
pub(crate) fn codesys(application: &ExportedApplication, text: &str) -> Result<Vec<ExportFile>, Refused> {
    let mut blocks = String::new();
    for block in ADAPTER.split("====\n") {
        let Some((interface, body)) = block.split_once("----\n") else { continue };
        let kind = interface.lines().find_map(|line| {
            let (word, rest) = line.split_once(' ')?;
            let kind = match word {
                "FUNCTION" => "function",
                "PROGRAM" => "program",
                _ => return None,
            };
            Some((kind, rest.split([' ', ':']).next()?))
        });
        let Some((kind, name)) = kind else { continue };
        let big_endian = if application.big_endian { "TRUE" } else { "FALSE" };
        write_block(name, kind, interface, &body.replace("@BIG_ENDIAN@", big_endian), &mut blocks);
    }
    let xml = document(text, &blocks, true)?;
    Ok(vec![ExportFile { path: XML_FILE.into(), text: xml }])
}

/// Rewrites the code as PLCopen XML, without the adapter.
///
/// # Errors
/// It is not in the form of the templates, or a name is a word of CODESYS.
pub fn xml_of(text: &str) -> Result<String, Refused> {
    document(text, "", false)
}

fn document(text: &str, adapter: &str, has_io: bool) -> Result<String, Refused> {
    let parts = crate::names::checked_parts(text, MAKER, &WORDS)?;
    let (mut types, mut blocks) = (String::new(), String::new());
    for part in &parts.parts {
        match part {
            // An array has no type of its own: its name is replaced where it stands.
            CodePart::Type { name, .. } if parts.is_array(name) => {}
            CodePart::Type { comment, name, body } => {
                let mut declaration = String::new();
                parts.write_declarations(body, "", &mut declaration);
                write_type(name, comment, &declaration, &mut types)?;
            }
            CodePart::Unit(unit) => {
                let kind = if unit.result.is_some() { "function" } else { "functionBlock" };
                write_block(unit.name, kind, &interface_of(unit, &parts), &joined(&unit.body), &mut blocks);
            }
        }
    }
    let io = if has_io { global_variables() } else { String::new() };
    Ok(format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n\
         <!-- Written by skillbench's plc-node export. The logic was executed against a robot; a grammar of others (blark) read the \
         syntax; SB_AdapterTest proves the adapter on the PLC. Import with Project, Import PLCopenXML. -->\n\
         <project xmlns=\"http://www.plcopen.org/xml/tc6_0200\">\n\
         <fileHeader companyName=\"\" productName=\"skillbench\" productVersion=\"1\" creationDateTime=\"2000-01-01T00:00:00\" />\n\
         <contentHeader name=\"skillbench\"><coordinateInfo><fbd><scaling x=\"1\" y=\"1\" /></fbd><ld><scaling x=\"1\" y=\"1\" /></ld>\
         <sfc><scaling x=\"1\" y=\"1\" /></sfc></coordinateInfo></contentHeader>\n\
         <types>\n<dataTypes>\n{types}</dataTypes>\n<pous>\n{blocks}{adapter}</pous>\n</types>\n\
         <instances><configurations /></instances>\n{io}</project>\n"
    ))
}

/// Returns a block's declaration: all before its body.
fn interface_of(unit: &Unit<'_>, parts: &Parts<'_>) -> String {
    let mut text = format!("{}\n", unit.comment);
    match unit.result {
        Some(result) => {
            let _ = write!(text, "FUNCTION {} : {result}", unit.name);
        }
        None => {
            let _ = write!(text, "FUNCTION_BLOCK {}", unit.name);
        }
    }
    for section in &unit.sections {
        let constant = if section.is_constant { " CONSTANT" } else { "" };
        text.extend(["\n", section.role.text, constant]);
        parts.write_declarations(&section.declarations, "", &mut text);
        text.extend([section.end.before, section.end.text]);
    }
    text
}

fn plain_text(text: &str) -> String {
    format!(
        "<addData><data name=\"{INTERFACE}\" handleUnknown=\"implementation\"><InterfaceAsPlainText>\
         <xhtml xmlns=\"http://www.w3.org/1999/xhtml\">{}</xhtml></InterfaceAsPlainText></data></addData>",
        escaped(text)
    )
}

fn write_block(name: &str, kind: &str, interface: &str, body: &str, text: &mut String) {
    let result =
        interface.split_once("FUNCTION ").and_then(|(_, rest)| rest.lines().next()?.split_once(" : "));
    let result = result
        .filter(|_| kind == "function")
        .map_or_else(String::new, |(_, of_type)| format!("<returnType><{} /></returnType>", of_type.trim()));
    let _ = writeln!(
        text,
        "<pou name=\"{name}\" pouType=\"{kind}\"><interface>{result}{}</interface><body><ST>\
         <xhtml xmlns=\"http://www.w3.org/1999/xhtml\">{}</xhtml></ST></body></pou>",
        plain_text(interface.trim_end()),
        escaped(body.trim_start_matches('\n'))
    );
}

/// Writes a structure as the standard has it, and as plain text.
fn write_type(name: &str, comment: &str, declaration: &str, text: &mut String) -> Result<(), Refused> {
    let fault = |text: String| Refused::Rewrite { maker: MAKER, text };
    let body = pieces(declaration).map_err(|mistake| fault(mistake.to_string()))?;
    let members = body.get(1..).unwrap_or_default().split(|piece| piece.is_symbol(";"));
    let members: String = members.filter_map(member_in_xml).collect();
    let plain = plain_text(&format!("{comment}\nTYPE {name} : {}\nEND_TYPE", declaration.trim()));
    let _ = writeln!(
        text,
        "<dataType name=\"{name}\"><baseType><struct>{members}</struct></baseType>{plain}</dataType>"
    );
    Ok(())
}

fn member_in_xml(member: &[Piece<'_>]) -> Option<String> {
    let [name, colon, of_type @ ..] = member else { return None };
    if !colon.is_symbol(":") {
        return None;
    }
    let initial = of_type.iter().position(|piece| piece.is_symbol(":="));
    let value = initial.and_then(|at| of_type.get(at + 1)).map_or_else(String::new, |value| {
        format!("<initialValue><simpleValue value=\"{}\" /></initialValue>", value.text)
    });
    let of_type = of_type.get(..initial.unwrap_or(of_type.len())).unwrap_or_default();
    Some(format!("<variable name=\"{}\"><type>{}</type>{value}</variable>", name.text, type_in_xml(of_type)))
}

/// Returns a type in XML: elementary, declared, or an array.
fn type_in_xml(of_type: &[Piece<'_>]) -> String {
    let texts: Vec<&str> = of_type.iter().map(|piece| piece.text).collect();
    match texts.as_slice() {
        ["ARRAY", "[", low, "..", high, "]", "OF", element, ..] => format!(
            "<array><dimension lower=\"{low}\" upper=\"{high}\" /><baseType>{}</baseType></array>",
            name_in_xml(element)
        ),
        [name, ..] => name_in_xml(name),
        [] => String::new(),
    }
}

fn name_in_xml(name: &str) -> String {
    if name.starts_with("SB_") { format!("<derived name=\"{name}\" />") } else { format!("<{name} />") }
}

/// Returns the images as global variables, which the project maps to the robot's device.
fn global_variables() -> String {
    let plain = "VAR_GLOBAL\n    (* Map these to the 256 bytes from and to the robot. *)\n    feedback : ARRAY[0..255] OF USINT;\n    \
                 command : ARRAY[0..255] OF USINT;\nEND_VAR";
    let variable = |name: &str| {
        format!(
            "<variable name=\"{name}\"><type><array><dimension lower=\"0\" upper=\"255\" /><baseType><USINT /></baseType></array></type></variable>"
        )
    };
    format!(
        "<addData><data name=\"http://www.3s-software.com/plcopenxml/globalvars\" handleUnknown=\"implementation\">\
         <globalVars name=\"SB_IO\">{}{}{}</globalVars></data></addData>\n",
        variable("feedback"),
        variable("command"),
        plain_text(plain)
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Returns the declarations in a file of [`xml_of`] as the text that a person would see in CODESYS, to read them back.
#[must_use]
pub fn text_of(xml: &str) -> String {
    let mut text = String::new();
    for part in xml.split("<InterfaceAsPlainText>").skip(1) {
        let texts: Vec<&str> =
            part.split("xhtml\">").skip(1).filter_map(|text| text.split("</xhtml>").next()).collect();
        let is_function =
            texts.first().is_some_and(|text| text.lines().any(|line| line.starts_with("FUNCTION ")));
        for of_part in &texts {
            let _ =
                writeln!(text, "{}", of_part.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"));
        }
        if texts.len() == 2 {
            text.push_str(if is_function { "END_FUNCTION\n" } else { "END_FUNCTION_BLOCK\n" });
        }
    }
    text
}
