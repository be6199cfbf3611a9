//! Instructions over one flat memory. `this` is the first slot of the unit that runs.

use crate::{Place, Scalar};

/// Where a variable is.
#[derive(Debug)]
pub(crate) enum VariableAddress {
    /// In this unit.
    Local(u32),
    /// In what an IN_OUT refers to: the slot with its first slot, and the offset there.
    Through(u32, u32),
    /// An element of an array.
    Element(Box<Element>),
}

/// An element of an array, or a member of one.
#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) base: VariableAddress,
    pub(crate) index: Code,
    pub(crate) low: i64,
    pub(crate) len: u32,
    pub(crate) stride: u32,
    pub(crate) offset: u32,
    pub(crate) place: Place,
}

impl VariableAddress {
    /// Returns the address of what is `by` slots farther.
    pub(crate) fn plus(self, by: u32) -> Self {
        match self {
            Self::Local(offset) => Self::Local(offset + by),
            Self::Through(slot, offset) => Self::Through(slot, offset + by),
            Self::Element(element) => {
                Self::Element(Box::new(Element { offset: element.offset + by, ..*element }))
            }
        }
    }
}

/// Arithmetic of two operands.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Arithmetic {
    Add,
    Subtract,
    Multiply,
    Divide,
    Modulo,
}

/// A comparison.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum ComparisonOperator {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

/// An operation on bits, also on BOOL.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Bitwise {
    And,
    Or,
    Xor,
}

/// An expression with an elementary result.
#[derive(Debug)]
pub(crate) enum Code {
    Constant(i64),
    Load(VariableAddress),
    /// Flips these bits.
    Flip(Box<Code>, i64),
    Negate(Box<Code>, Scalar, Place),
    Absolute(Box<Code>, Scalar, Place),
    Integer(Arithmetic, Scalar, Box<[Code; 2]>, Place),
    Real(Arithmetic, Box<[Code; 2]>, Place),
    Compare(ComparisonOperator, Box<[Code; 2]>),
    CompareReal(ComparisonOperator, Box<[Code; 2]>),
    Bits(Bitwise, Box<[Code; 2]>),
    /// Shifts left (or right) within the type's bits.
    Shift(bool, Scalar, Box<[Code; 2]>, Place),
    Convert(Scalar, Scalar, Box<Code>, Place),
    Function(Box<Function>),
}

/// A call of a function.
#[derive(Debug)]
pub(crate) struct Function {
    pub(crate) unit: usize,
    pub(crate) arguments: Vec<Argument>,
}

/// A parameter of a call, with its slot in the unit that is called.
#[derive(Debug)]
pub(crate) enum Argument {
    Value(u32, Code),
    /// A structure or an array, which is copied.
    Copy(u32, VariableAddress, u32),
    Reference(u32, VariableAddress),
}

/// A statement.
#[derive(Debug)]
pub(crate) enum Instruction {
    Store(VariableAddress, Code),
    Copy(VariableAddress, VariableAddress, u32),
    Call(usize, VariableAddress, Vec<Argument>),
    If(Vec<(Code, Vec<Located>)>, Vec<Located>),
    Case(Code, Vec<(Vec<i64>, Vec<Located>)>, Vec<Located>),
    For(Box<For>),
    While(Code, Vec<Located>),
    Repeat(Vec<Located>, Code),
    Exit,
    Return,
}

/// A FOR.
#[derive(Debug)]
pub(crate) struct For {
    pub(crate) variable: VariableAddress,
    pub(crate) scalar: Scalar,
    pub(crate) from: Code,
    pub(crate) to: Code,
    pub(crate) by: Code,
    pub(crate) body: Vec<Located>,
}

/// A statement with its place.
#[derive(Debug)]
pub(crate) struct Located {
    pub(crate) place: Place,
    pub(crate) instruction: Instruction,
}
