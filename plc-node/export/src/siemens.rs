//! The code for Siemens: external sources in SCL, and a `.udt` for each structure.

use ::structured_text::{Piece, PieceKind};

use crate::parts::{CodePart, Parts, Unit};
use crate::{ExportFile, ExportedApplication, Refused};

/// The maker in messages.
const MAKER: &str = "Siemens";

/// File of the functions and function blocks.
pub const SCL_FILE: &str = "skillbench.scl";

/// Words of SCL in TIA Portal that are no names of IEC 61131-3. A block's name is in quotes and a variable has its `#`; members have
/// neither.
const WORDS: [&str; 24] = [
    "BEGIN",
    "BLOCK_DB",
    "BLOCK_FB",
    "BLOCK_FC",
    "COUNTER",
    "DATA_BLOCK",
    "GOTO",
    "LABEL",
    "NIL",
    "OK",
    "ORGANIZATION_BLOCK",
    "POINTER",
    "REGION",
    "S5TIME",
    "TIMER",
    "VARIANT",
    "VERSION",
    "VOID",
    "ANY",
    "DTL",
    "NETWORK",
    "TITLE",
    "AUTHOR",
    "FAMILY",
];

/// The head of the file: no grammar of SCL that others wrote is public.
const HEAD: &str = "(* Written by skillbench's plc-node export --for siemens. The logic was executed against a robot, scan by scan, and this file was read
   back to the same code. No grammar of SCL by others exists in public, so nothing but our own reader checked this syntax; the adapter is
   proven by SB_AdapterTest on the PLC only. Import the .udt first, then this file, then skillbench_adapter.scl. *)\n";

/// The adapter: REAL and bits, clock, I/O.
const ADAPTER: &str = include_str!("../templates/siemens-adapter.scl");

/// File of the adapter.
const ADAPTER_FILE: &str = "skillbench_adapter.scl";

/// Returns the files.
///
/// # Errors
/// The first thing that does not fit.
pub(crate) fn siemens(application: &ExportedApplication, text: &str) -> Result<Vec<ExportFile>, Refused> {
    let mut files = rewritten(text)?;
    let big_endian = if application.big_endian { "TRUE" } else { "FALSE" };
    let adapter =
        ADAPTER.replace("@BIG_ENDIAN@", big_endian).replace("@SCAN_US@", &application.scan_us.to_string());
    files.push(ExportFile { path: ADAPTER_FILE.into(), text: adapter });
    Ok(files)
}

/// Rewrites the code in SCL.
///
/// # Errors
/// It is not in the form of the templates, or a name is a word of SCL.
pub fn rewritten(text: &str) -> Result<Vec<ExportFile>, Refused> {
    let parts = crate::names::checked_parts(text, MAKER, &WORDS)?;
    let (mut files, mut scl) = (Vec::new(), String::from(HEAD));
    for part in &parts.parts {
        match part {
            // An array has no type of its own: its name is replaced where it stands.
            CodePart::Type { name, .. } if parts.is_array(name) => {}
            CodePart::Type { comment, name, body } => {
                let mut udt = format!("{comment}\nTYPE \"{name}\"\nVERSION : 0.1\n   ");
                parts.write_declarations(body, "\"", &mut udt);
                udt.push_str("\n\nEND_TYPE\n");
                files.push(ExportFile { path: format!("{name}.udt"), text: udt });
            }
            CodePart::Unit(unit) => write_unit(unit, &parts, &mut scl)?,
        }
    }
    files.push(ExportFile { path: SCL_FILE.into(), text: scl });
    Ok(files)
}

fn write_unit(unit: &Unit<'_>, parts: &Parts<'_>, scl: &mut String) -> Result<(), Refused> {
    scl.extend(["\n", unit.comment, "\n"]);
    let name = unit.name;
    match unit.result {
        Some(result) => scl.push_str(&format!("FUNCTION \"{name}\" : {result}\n")),
        None => scl.push_str(&format!("FUNCTION_BLOCK \"{name}\"\n")),
    }
    scl.push_str("{ S7_Optimized_Access := 'TRUE' }\nVERSION : 0.1");
    for section in &unit.sections {
        // A function of a Siemens PLC keeps nothing.
        let is_temporary = unit.result.is_some() && section.role.text == "VAR" && !section.is_constant;
        let role = if is_temporary { "VAR_TEMP" } else { section.role.text };
        let constant = if section.is_constant { " CONSTANT" } else { "" };
        scl.extend(["\n", role, constant]);
        parts.write_declarations(&section.declarations, "\"", scl);
        scl.extend([section.end.before, section.end.text]);
    }
    scl.push_str("\nBEGIN");
    write_body(unit, parts, scl)?;
    scl.extend([unit.end.before, unit.end.text, "\n"]);
    Ok(())
}

/// Parameters of a call under way, and how many of them were written.
struct OpenCall<'a> {
    parameters: &'a [&'a str],
    written: usize,
}

/// Writes statements: local variables with `#`, functions in quotes with the names of their parameters.
fn write_body(unit: &Unit<'_>, parts: &Parts<'_>, scl: &mut String) -> Result<(), Refused> {
    let variables = unit.variables();
    // Calls and other parentheses, from the outer to the inner one.
    let mut open: Vec<Option<OpenCall<'_>>> = Vec::new();
    let mut starts_argument = false;
    let mut before: Option<&Piece<'_>> = None;
    for (index, piece) in unit.body.iter().enumerate() {
        let next = unit.body.get(index + 1);
        let follows = |symbol: &str| next.is_some_and(|next| next.is_symbol(symbol));
        let is_named = piece.kind == PieceKind::Word && follows(":=") && !open.is_empty();
        scl.push_str(piece.before);
        if std::mem::take(&mut starts_argument)
            && !is_named
            && let Some(Some(call)) = open.last_mut()
        {
            let name = call.parameters.get(call.written).ok_or_else(|| Refused::Rewrite {
                maker: MAKER,
                text: format!("`{}` has more parameters than its function", piece.text),
            })?;
            call.written += 1;
            scl.extend([*name, " := "]);
        }
        let is_member = before.is_some_and(|before| before.is_symbol("."));
        match piece.kind {
            PieceKind::Word if is_member || is_named => scl.push_str(piece.text),
            PieceKind::Word if parts.parameters(piece.text).is_some() && follows("(") => {
                scl.extend(["\"", piece.text, "\""]);
            }
            PieceKind::Word if variables.contains(&piece.text) || unit.name == piece.text => {
                scl.extend(["#", piece.text]);
            }
            _ => scl.push_str(piece.text),
        }
        if piece.is_symbol("(") {
            let of_function = before.filter(|before| before.kind == PieceKind::Word);
            let parameters = of_function.and_then(|function| match function.text {
                "SHL" | "SHR" => Some(&["IN", "N"][..]),
                name => parts.parameters(name),
            });
            open.push(parameters.map(|parameters| OpenCall { parameters, written: 0 }));
            starts_argument = true;
        } else if piece.is_symbol(",") {
            starts_argument = true;
        } else if piece.is_symbol(")") {
            open.pop();
        }
        before = Some(piece);
    }
    Ok(())
}
