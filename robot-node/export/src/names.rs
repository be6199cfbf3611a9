//! Names in the files of an export: none is a word of the maker's language, none is too long, none stands for two things, and each
//! that is used is declared.
//!
//! Read from the text, so the names of the adapters count as well. Both languages ignore case.

mod words;

use std::collections::BTreeMap;

use crate::application::Maker;
use crate::printed::ExportFile;

/// A name that a maker's controller would not take, or would take for something else.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum NameFault {
    /// A keyword, a type, a standard function or a variable of the controller.
    #[error("{file}: `{name}` is a word of {language}")]
    Word {
        /// The file.
        file: String,
        /// The name.
        name: String,
        /// The language.
        language: &'static str,
    },
    /// More characters than the language takes.
    #[error("{file}: `{name}` has {len} characters, {language} takes {most}")]
    Long {
        /// The file.
        file: String,
        /// The name.
        name: String,
        /// Its length in characters.
        len: usize,
        /// Most characters of a name.
        most: usize,
        /// The language.
        language: &'static str,
    },
    /// Two declarations that the language takes for one.
    #[error("{file}: `{name}` is declared in {other} as `{first}`; {language} ignores case")]
    Twice {
        /// The file.
        file: String,
        /// The name.
        name: String,
        /// File of the first declaration.
        other: String,
        /// The first declaration.
        first: String,
        /// The language.
        language: &'static str,
    },
    /// A use of a name that neither the files of its task nor the controller declare.
    #[error("{file}, line {line}: `{name}` is used, and no file of its task declares it")]
    Undeclared {
        /// The file.
        file: String,
        /// Number of the line, from 1.
        line: usize,
        /// The name.
        name: String,
    },
}

/// Most characters of a name: KRL, as `$config.dat` takes them; RAPID and its I/O configuration.
const fn most_characters(maker: Maker) -> usize {
    match maker {
        Maker::Kuka => 24,
        Maker::Abb => 32,
    }
}

/// A declared name: the routine that it belongs to, in upper case, and empty for one that all see.
#[derive(Clone, PartialEq, Eq, Debug)]
struct DeclaredName<'a> {
    scope: String,
    name: &'a str,
}

/// Checks the names in the files of an export.
///
/// # Errors
/// The first name that collides with a word of the language or with another name, is too long, or is used and not declared.
pub fn check_names(files: &[ExportFile], maker: Maker) -> Result<(), NameFault> {
    let (language, most) = (maker.language(), most_characters(maker));
    let words = words::reserved(maker);
    let declared: Vec<(&ExportFile, Vec<DeclaredName<'_>>)> =
        files.iter().map(|file| (file, declared_in(file, maker))).collect();
    for (file, names) in &declared {
        for DeclaredName { name, .. } in names {
            let (file, owned) = (file.path.clone(), (*name).to_owned());
            if words.contains(name.to_ascii_uppercase().as_str()) {
                return Err(NameFault::Word { file, name: owned, language });
            }
            if name.len() > most {
                return Err(NameFault::Long { file, name: owned, len: name.len(), most, language });
            }
        }
    }
    for task in tasks(maker) {
        let mut seen = BTreeMap::new();
        for (file, names) in declared.iter().filter(|(file, _)| task.is_none_or(|task| task != file.path)) {
            for DeclaredName { scope, name } in names {
                let key = (scope, name.to_ascii_uppercase());
                if let Some((other, first)) = seen.insert(key, (&file.path, *name)) {
                    return Err(NameFault::Twice {
                        file: file.path.clone(),
                        name: (*name).to_owned(),
                        other: other.clone(),
                        first: first.to_owned(),
                        language,
                    });
                }
            }
        }
        for (file, _) in declared.iter().filter(|(file, _)| task.is_none_or(|task| task != file.path)) {
            check_uses(file, &seen, maker)?;
        }
    }
    Ok(())
}

/// Names of a task by the routine that declares them, both in upper case.
type TaskNames<'a> = BTreeMap<(&'a String, String), (&'a String, &'a str)>;

/// Checks that each name in a file is one that its task or its routine declares, or one that the controller has.
fn check_uses(file: &ExportFile, declared: &TaskNames<'_>, maker: Maker) -> Result<(), NameFault> {
    if file.path.ends_with(".cfg") {
        return Ok(()); // it declares signals and uses none
    }
    let (used, components) = (words::used(maker), words::components(maker));
    let is_declared = |scope: &String, name: &str| {
        [scope, &String::new()].iter().any(|scope| declared.contains_key(&(*scope, name.to_owned())))
    };
    let mut scope = String::new();
    for (number, line) in (1..).zip(file.text.lines()) {
        let mut here = Vec::new();
        // A routine's first line belongs to it, and so does its last one.
        let before = scope.clone();
        declare(file, line, &mut scope, &mut here, maker);
        let scope = if scope.is_empty() { &before } else { &scope };
        for word in line_words(line, maker)
            .into_iter()
            .filter(|word| !word.starts_with(|first: char| first.is_ascii_digit()))
        {
            let mut parts = word.split('.').map(str::to_ascii_uppercase);
            let is_name_known =
                parts.next().is_none_or(|name| used.contains(name.as_str()) || is_declared(scope, &name));
            let are_components_known = parts.all(|part| components.contains(part.as_str()));
            if !(is_name_known && are_components_known) {
                return Err(NameFault::Undeclared {
                    file: file.path.clone(),
                    line: number,
                    name: word.to_owned(),
                });
            }
        }
    }
    Ok(())
}

/// Returns the tasks, each by the file that it does not load: modules of different tasks may declare the same names.
const fn tasks(maker: Maker) -> &'static [Option<&'static str>] {
    match maker {
        Maker::Kuka => &[None],
        Maker::Abb => &[Some("SB_Cyclic.mod"), Some("SB_Motion.mod")],
    }
}

fn declared_in(file: &ExportFile, maker: Maker) -> Vec<DeclaredName<'_>> {
    let mut names = Vec::new();
    let mut scope = String::new();
    file.text.lines().for_each(|line| declare(file, line, &mut scope, &mut names, maker));
    names
}

/// Adds the names that a line declares, and follows in which routine the next line is.
fn declare<'a>(
    file: &ExportFile,
    line: &'a str,
    scope: &mut String,
    names: &mut Vec<DeclaredName<'a>>,
    maker: Maker,
) {
    match maker {
        Maker::Abb if file.path.ends_with(".cfg") => {
            let quoted = line.split_once("-Name \"").and_then(|(_, rest)| rest.split_once('"'));
            names.extend(quoted.map(|(name, _)| DeclaredName { scope: String::new(), name }));
        }
        Maker::Abb => rapid_line(line, scope, names),
        Maker::Kuka => krl_line(line, scope, names),
    }
}

/// Returns the words of a line up to its comment, without what is quoted.
fn line_words(line: &str, maker: Maker) -> Vec<&str> {
    let (comment, quote) = match maker {
        // An attribute of the file: it has no names of the program.
        Maker::Kuka if line.starts_with('&') => return Vec::new(),
        Maker::Kuka => (';', '\''),
        Maker::Abb => ('!', '"'),
    };
    let is_of_word =
        |character: char| character.is_ascii_alphanumeric() || matches!(character, '_' | '$' | '.' | '#');
    let unquoted = line
        .split(quote)
        .step_by(2)
        .map(|part| part.split_once(comment).map_or((part, false), |(part, _)| (part, true)));
    let mut words = Vec::new();
    for (part, is_last) in unquoted {
        words.extend(part.split(|character| !is_of_word(character)).filter(|word| !word.is_empty()));
        if is_last {
            break;
        }
    }
    words
}

fn krl_line<'a>(line: &'a str, scope: &mut String, names: &mut Vec<DeclaredName<'a>>) {
    let words: Vec<_> = line_words(line, Maker::Kuka).into_iter().filter(|word| *word != "GLOBAL").collect();
    let (mut of_file, mut of_routine) = (None, None);
    match words.as_slice() {
        ["DEF", name, ..] | ["DEFFCT", _, name, ..] => {
            of_file = Some(*name);
            *scope = name.to_ascii_uppercase();
        }
        ["DEFDAT", name, ..] | ["SIGNAL", name, ..] => of_file = Some(*name),
        ["END" | "ENDFCT"] => scope.clear(),
        ["DECL", "CONST", _, name, ..] | ["DECL", _, name, ..] => of_routine = Some(*name),
        _ => {}
    }
    names.extend(of_file.map(|name| DeclaredName { scope: String::new(), name }));
    names.extend(of_routine.map(|name| DeclaredName { scope: scope.clone(), name }));
}

fn rapid_line<'a>(line: &'a str, scope: &mut String, names: &mut Vec<DeclaredName<'a>>) {
    let words = line_words(line, Maker::Abb);
    let words = words.strip_prefix(&["LOCAL"]).unwrap_or(&words);
    let (mut of_module, mut of_routine): (Option<&str>, &[&str]) = (None, &[]);
    let parameters;
    match words {
        ["MODULE", name, ..] => of_module = Some(name),
        ["PROC", name, typed @ ..] | ["FUNC", _, name, typed @ ..] | ["TRAP", name, typed @ ..] => {
            of_module = Some(name);
            *scope = name.to_ascii_uppercase();
            // A type and a name each.
            parameters = typed.iter().skip(1).step_by(2).copied().collect::<Vec<_>>();
            of_routine = &parameters;
        }
        ["ENDPROC" | "ENDFUNC" | "ENDTRAP"] => scope.clear(),
        ["VAR" | "PERS" | "CONST", _, name, ..] => of_routine = std::slice::from_ref(name),
        // Several loops of a routine may have the same one.
        ["FOR", name, ..] if !names.iter().any(|one| one.scope == *scope && one.name == *name) => {
            of_routine = std::slice::from_ref(name);
        }
        _ => {}
    }
    names.extend(of_module.map(|name| DeclaredName { scope: String::new(), name }));
    names.extend(of_routine.iter().map(|name| DeclaredName { scope: scope.clone(), name }));
}
