//! The strict checker: tree → instructions. What it passes runs without any check of types.

pub(crate) mod code;
mod declare;
mod expression;
mod names;
mod statement;

use std::collections::HashMap;
use std::sync::Arc;

use crate::syntax::{Declaration, Role, TypeDeclaration, Unit};
use crate::tree::{joined, parse_all};
use crate::types::{LARGEST, Type, TypeLayout};
use crate::{Dialect, Instance, Mistake, Place, Scalar};
use code::Located;
pub(crate) use expression::MOST_ARGUMENTS;

/// Most declarations of a program: calls and types nest as deep.
const MOST_DECLARATIONS: usize = 512;

/// A text to compile.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Its file, for messages.
    pub file: &'a str,
    /// The text.
    pub text: &'a str,
}

/// A function or function block that was compiled.
#[derive(Debug)]
pub(crate) struct CompiledUnit {
    pub(crate) file: Arc<str>,
    pub(crate) layout: Arc<TypeLayout>,
    /// First slot of a function's variables.
    pub(crate) frame: usize,
    /// Slot of a function's result there, and its type.
    pub(crate) result: Option<Scalar>,
    pub(crate) body: Vec<Located>,
}

/// A program that was checked.
#[derive(Debug)]
pub struct Program {
    pub(crate) units: Vec<CompiledUnit>,
    /// Slots of all functions together.
    pub(crate) frames: Vec<i64>,
}

/// An elementary variable of a function block, or an array of such.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Variable {
    pub(crate) offset: u32,
    /// Number of values.
    pub len: u32,
    /// Their type.
    pub scalar: Scalar,
}

impl Program {
    /// Compiles texts, in which everything is declared before its use.
    ///
    /// # Errors
    /// The first mistake found, with its file and place.
    pub fn compile(sources: &[Source<'_>]) -> Result<Self, Mistake> {
        Self::compile_dialect(sources, Dialect::Standard)
    }

    /// Compiles texts of a dialect like [`compile`](Self::compile). A body that is not in the file of its declaration is named by
    /// the file of the declaration.
    ///
    /// # Errors
    /// The first mistake found, with its file and place.
    pub fn compile_dialect(sources: &[Source<'_>], dialect: Dialect) -> Result<Self, Mistake> {
        let mut compiler = Compiler::default();
        let (files, declarations): (Vec<_>, Vec<_>) = parse_all(sources, dialect)?.into_iter().unzip();
        // Bodies of a split text come after all declarations, so the files keep their order.
        let declarations = if dialect == Dialect::Split { joined(declarations) } else { declarations };
        for (file, declaration) in files.into_iter().zip(declarations) {
            if *compiler.file != *file {
                compiler.file = file.as_str().into();
            }
            compiler.declaration(declaration).map_err(|mistake| mistake.in_file(&file))?;
        }
        Ok(Self { units: compiler.units, frames: compiler.frames })
    }

    /// Makes an instance of a function block, with its initial values.
    ///
    /// # Errors
    /// There is no such function block, or it has parameters of type IN_OUT.
    pub fn instance(&self, block: &str) -> Result<Instance, Mistake> {
        let (index, unit) = self.block(block)?;
        if let Some(member) = unit.layout.members.iter().find(|member| member.role == Role::InOut) {
            let text = format!("`{block}` needs IN_OUT `{}`; an instance of the top has none", member.name);
            return Err(missing(&unit.file, text));
        }
        Ok(Instance::new(self, index))
    }

    /// Finds a variable of a function block, also a local one, and one of a structure or an instance in it: `group.c_life`.
    ///
    /// # Errors
    /// There is no such function block or variable, or it is neither elementary nor an array of elementary values.
    pub fn variable(&self, block: &str, name: &str) -> Result<Variable, Mistake> {
        let (_, unit) = self.block(block)?;
        let bad = |text: &str| missing(&unit.file, format!("variable `{name}` of `{block}`: {text}"));
        let (mut layout, mut offset) = (&unit.layout, 0);
        let (path, last) = name.rsplit_once('.').map_or((None, name), |(path, last)| (Some(path), last));
        for step in path.into_iter().flat_map(|path| path.split('.')) {
            let member = layout.member(step).ok_or_else(|| bad("not found"))?;
            offset += member.offset;
            layout = match &member.of_type {
                _ if member.role == Role::InOut => return Err(bad("passes an IN_OUT")),
                Type::Structure(inner) | Type::Instance(inner) => inner,
                _ => return Err(bad("passes what has no members")),
            };
        }
        let member = layout.member(last).ok_or_else(|| bad("not found"))?;
        let (len, scalar) = match &member.of_type {
            _ if member.role == Role::InOut => return Err(bad("is an IN_OUT")),
            Type::Scalar(scalar) => (1, *scalar),
            Type::Array(array) => match array.element {
                Type::Scalar(scalar) => (array.len, scalar),
                _ => return Err(bad("its elements are not elementary")),
            },
            _ => return Err(bad("is not elementary")),
        };
        Ok(Variable { offset: offset + member.offset, len, scalar })
    }

    fn block(&self, name: &str) -> Result<(usize, &CompiledUnit), Mistake> {
        let found = self
            .units
            .iter()
            .position(|unit| unit.result.is_none() && unit.layout.name.eq_ignore_ascii_case(name));
        found
            .and_then(|index| Some((index, self.units.get(index)?)))
            .ok_or_else(|| missing("program", format!("function block `{name}` not found")))
    }
}

fn missing(file: &str, text: String) -> Mistake {
    Mistake::new(Place { line: 1, column: 1 }, text).in_file(file)
}

/// State of the checker.
#[derive(Default)]
struct Compiler {
    file: Arc<str>,
    types: HashMap<String, Type>,
    units: Vec<CompiledUnit>,
    unit_by_name: HashMap<String, usize>,
    frames: Vec<i64>,
    declarations: usize,
}

impl Compiler {
    fn declaration(&mut self, declaration: Declaration) -> Result<(), Mistake> {
        self.declarations += 1;
        match declaration {
            Declaration::Type(TypeDeclaration { place, .. }) | Declaration::Unit(Unit { place, .. })
                if self.declarations > MOST_DECLARATIONS =>
            {
                let text = format!("more than {MOST_DECLARATIONS} types, functions and function blocks");
                Err(Mistake::new(place, text))
            }
            Declaration::Type(declared) => self.declare_type(declared),
            Declaration::Unit(unit) => self.unit(unit),
        }
    }

    fn unit(&mut self, unit: Unit) -> Result<(), Mistake> {
        self.check_new(&unit.name, unit.place)?;
        let index = self.units.len();
        let (layout, result) = self.layout_of(&unit, index)?;
        let layout = Arc::new(layout);
        let body = statement::Body { compiler: self, layout: &layout, loops: 0 }.statements(&unit.body)?;
        let frame = self.frames.len();
        if result.is_some() {
            self.frames.extend_from_slice(&layout.initial);
        } else {
            self.types.insert(unit.name.to_ascii_lowercase(), Type::Instance(Arc::clone(&layout)));
        }
        if self.frames.len() > LARGEST {
            return Err(Mistake::new(unit.place, format!("the functions exceed {LARGEST} values")));
        }
        self.unit_by_name.insert(unit.name.to_ascii_lowercase(), index);
        let file = Arc::clone(&self.file);
        self.units.push(CompiledUnit { file, layout, frame, result, body });
        Ok(())
    }
}
