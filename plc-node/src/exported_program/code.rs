//! Exported code that was checked, and its variables.

use core::fmt;
use std::sync::Arc;

use plc_export::FILE;
use protocol::image::IMAGE_LEN;
use structured_text::{Instance, Mistake, Place, Program, RunError, Scalar, Source, Trap, Variable};

/// The function block that a program calls.
const CORE: &str = "SB_Core";

/// Exported code that was checked.
#[derive(Clone, Debug)]
pub struct ExportedCode {
    program: Arc<Program>,
    variables: Variables,
    text: Arc<str>,
}

/// The variables of the function block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Variables {
    pub(super) feedback: Variable,
    pub(super) now_us: Variable,
    pub(super) start: Variable,
    pub(super) execution_type: Variable,
    pub(super) repetitions: Variable,
    pub(super) big_endian: Variable,
    pub(super) override_percent: Variable,
    pub(super) command: Variable,
    pub(super) samples: Variable,
    pub(super) ready: Variable,
    pub(super) busy: Variable,
    pub(super) done: Variable,
    pub(super) error: Variable,
    pub(super) error_id: Variable,
    /// Number of what the block does at present, for messages.
    pub(super) mode: Option<Variable>,
}

/// Why code cannot be executed.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum CodeError {
    /// The text is not in the subset, or not correct.
    #[error(transparent)]
    Mistake(#[from] Mistake),
    /// A variable of the block has another type.
    #[error("{FILE}: `{CORE}.{name}` is {found}; a PLC needs {expected} there")]
    Variable {
        /// Its name.
        name: &'static str,
        /// Its type, and the number of its values.
        found: String,
        /// The type that it must have.
        expected: String,
    },
}

/// A trap of exported code: where, and in which scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ProgramTrap {
    /// Place in the file.
    pub place: Place,
    /// Scan since the PLC's start, from 1.
    pub scan: u64,
    /// The trap.
    pub trap: Trap,
}

impl From<RunError> for ProgramTrap {
    fn from(RunError { place, scan, trap, .. }: RunError) -> Self {
        Self { place, scan, trap }
    }
}

impl fmt::Display for ProgramTrap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{FILE}:{}: scan {}: {}", self.place, self.scan, self.trap)
    }
}

impl ExportedCode {
    /// Checks code that `plc-node export --for st` wrote, and that somebody may have edited.
    ///
    /// # Errors
    ///
    /// The first mistake, with its place.
    pub fn compile(text: &str) -> Result<Self, CodeError> {
        let program = Program::compile(&[Source { file: FILE, text }])?;
        let of_type = |name: &'static str, scalar: Scalar, len: u32| {
            let variable = program.variable(CORE, name)?;
            if variable.scalar == scalar && variable.len >= len {
                return Ok(variable);
            }
            let named = |scalar: Scalar, len: u32| format!("{len} of {}", scalar.name());
            let (found, expected) = (named(variable.scalar, variable.len), named(scalar, len));
            Err(CodeError::Variable { name, found, expected })
        };
        let image_len = u32::try_from(IMAGE_LEN).unwrap_or(u32::MAX);
        let variables = Variables {
            feedback: of_type("feedback_bytes", Scalar::Usint, image_len)?,
            now_us: of_type("now_us", Scalar::Udint, 1)?,
            start: of_type("start", Scalar::Bool, 1)?,
            execution_type: of_type("execution_type", Scalar::Usint, 1)?,
            repetitions: of_type("repetitions", Scalar::Uint, 1)?,
            big_endian: of_type("bus_big_endian", Scalar::Bool, 1)?,
            override_percent: of_type("override_percent", Scalar::Usint, 1)?,
            command: of_type("command_bytes", Scalar::Usint, image_len)?,
            samples: of_type("sample_us", Scalar::Udint, 1)?,
            ready: of_type("ready", Scalar::Bool, 1)?,
            busy: of_type("busy", Scalar::Bool, 1)?,
            done: of_type("done", Scalar::Bool, 1)?,
            error: of_type("error", Scalar::Bool, 1)?,
            error_id: of_type("error_id", Scalar::Uint, 1)?,
            mode: of_type("mode", Scalar::Usint, 1).ok(),
        };
        Ok(Self { program: Arc::new(program), variables, text: text.into() })
    }

    /// Returns its text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    pub(super) fn program(&self) -> &Program {
        &self.program
    }

    pub(super) const fn variables(&self) -> &Variables {
        &self.variables
    }

    pub(super) fn instance(&self) -> Result<Instance, CodeError> {
        Ok(self.program.instance(CORE)?)
    }
}
