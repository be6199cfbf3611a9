//! The code of a maker's files, read back: as a tree to compare, and as a program to execute.

use plc_export::{ExportFile, FILE, Maker, br, codesys, siemens};
use structured_text::{Dialect, Program, Source, Tree};

/// Makers whose files are rewritten from the neutral one.
pub(crate) const MAKERS: [Maker; 3] = [Maker::Siemens, Maker::Codesys, Maker::Br];

/// Returns the files of the code alone, without adapters.
pub(crate) fn code_of(text: &str, maker: Maker) -> Vec<ExportFile> {
    match maker {
        Maker::St => vec![ExportFile { path: FILE.into(), text: text.into() }],
        Maker::Siemens => siemens::rewritten(text).unwrap(),
        Maker::Br => br::library(text).unwrap(),
        Maker::Codesys => {
            vec![ExportFile { path: codesys::XML_FILE.into(), text: codesys::xml_of(text).unwrap() }]
        }
    }
}

/// Calls `read` with the texts of the code in the order of their declarations, and their dialect.
fn with_sources<T>(files: &[ExportFile], maker: Maker, read: impl Fn(&[Source<'_>], Dialect) -> T) -> T {
    let (ends, dialect): (&[&str], _) = match maker {
        Maker::St => (&[FILE], Dialect::Standard),
        Maker::Siemens => (&[".udt", siemens::SCL_FILE], Dialect::Scl),
        Maker::Br => (&["/SkillBench.typ", "/SkillBench.fun", "/SkillBench.st"], Dialect::Split),
        Maker::Codesys => (&[codesys::XML_FILE], Dialect::Standard),
    };
    let found = ends.iter().flat_map(|end| files.iter().filter(move |file| file.path.ends_with(end)));
    let texts: Vec<(&str, String)> = found
        .map(|ExportFile { path, text }| {
            let is_xml = maker == Maker::Codesys;
            (path.as_str(), if is_xml { codesys::text_of(text) } else { text.clone() })
        })
        .collect();
    let sources: Vec<_> = texts.iter().map(|(file, text)| Source { file, text }).collect();
    read(&sources, dialect)
}

/// Reads a maker's files back as a tree.
pub(crate) fn tree_of(files: &[ExportFile], maker: Maker) -> Tree {
    with_sources(files, maker, |sources, dialect| {
        Tree::parse(sources, dialect).unwrap_or_else(|mistake| panic!("{mistake}"))
    })
}

/// Reads a maker's files back as a program.
pub(crate) fn program_of(files: &[ExportFile], maker: Maker) -> Program {
    with_sources(files, maker, |sources, dialect| {
        Program::compile_dialect(sources, dialect).unwrap_or_else(|mistake| panic!("{mistake}"))
    })
}
