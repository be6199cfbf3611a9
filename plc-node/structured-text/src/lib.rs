//! Structured Text of IEC 61131-3, in the subset that the PLC code of the export uses: parsed, checked strictly, executed.
//!
//! ```text
//! lexer     text → tokens, each with its place
//! syntax    the tree; parser makes it of tokens
//! tree      trees of several dialects, to compare them; pieces is a text for those who rewrite it
//! types     elementary types, layouts of structures, arrays and instances
//! compile   the strict checker: tree → instructions over one flat memory
//! run       executes them with a budget of steps; traps where a real PLC would go wrong silently
//! search    executes loops that compare arrays at once
//! ```
//!
//! # The subset
//!
//! `TYPE` (structures, arrays of one dimension), `FUNCTION`, `FUNCTION_BLOCK`; `VAR_INPUT`, `VAR_OUTPUT`, `VAR_IN_OUT`, `VAR`,
//! `VAR CONSTANT`; `IF`, `CASE`, `FOR`, `WHILE`, `REPEAT`, `EXIT`, `RETURN`; `BOOL`, `USINT`, `UINT`, `UDINT`, `SINT`, `INT`, `DINT`,
//! `BYTE`, `WORD`, `DWORD`, `REAL`. A type, function or function block is declared before its use, so nothing calls itself.
//!
//! It is stricter than makers' compilers: no conversion is implicit, an operation never wraps, a conversion never truncates, each
//! parameter of type IN_OUT is given, and an index is within its bounds. A program that passes here does not depend on how a
//! maker treats these cases.
//!
//! ```
//! use structured_text::{Program, Source};
//!
//! let text = "FUNCTION_BLOCK Counter VAR_INPUT more : UINT; END_VAR VAR_OUTPUT total : UINT; END_VAR total := total + more; END_FUNCTION_BLOCK";
//! let program = Program::compile(&[Source { file: "counter.st", text }])?;
//! let mut counter = program.instance("Counter")?;
//! let (more, total) = (program.variable("Counter", "more")?, program.variable("Counter", "total")?);
//! counter.set(more, 0, 40_000);
//! counter.scan(&program, 100)?;
//! assert_eq!(counter.get(total, 0), 40_000);
//! let trap = counter.scan(&program, 100).unwrap_err(); // 80,000 is not a UINT
//! assert!(trap.to_string().starts_with("counter.st:1:103: scan 2: "), "{trap}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod compile;
mod lexer;
mod mistake;
mod parser;
mod pieces;
mod run;
mod search;
mod syntax;
mod tree;
mod types;

pub use compile::{Program, Source, Variable};
pub use mistake::{Mistake, Place, RunError, Trap};
pub use pieces::{Piece, PieceKind, pieces};
pub use run::Instance;
pub use syntax::Dialect;
pub use tree::Tree;
pub use types::Scalar;
