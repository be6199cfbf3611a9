//! The tree of a program.

use crate::Place;

/// A way to write the language.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Dialect {
    /// IEC 61131-3.
    #[default]
    Standard,
    /// SCL: quoted names of blocks, `#` before local variables, `VERSION`, `BEGIN`, pragmas.
    Scl,
    /// Automation Studio: a function is declared in one file, and its body is in another one.
    Split,
}

/// A declaration at the top of a text.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Declaration {
    /// `TYPE … END_TYPE`, one type.
    Type(TypeDeclaration),
    /// `FUNCTION` or `FUNCTION_BLOCK`.
    Unit(Unit),
}

/// A type with a name.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct TypeDeclaration {
    /// Its name.
    pub name: String,
    /// Place of the name.
    pub place: Place,
    /// What it stands for.
    pub body: TypeBody,
}

/// What a type with a name stands for.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum TypeBody {
    /// A structure with its members.
    Structure(Vec<Declared>),
    /// Another name, or an array.
    Alias(TypeName),
}

/// A type as a declaration names it.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum TypeName {
    /// An elementary type, a declared type or a function block.
    Named(String, Place),
    /// `ARRAY[low..high] OF element`; the element has a name.
    Array(i64, i64, String, Place),
}

/// A variable or member.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Declared {
    /// Its name.
    pub name: String,
    /// Place of the name.
    pub place: Place,
    /// Its type.
    pub of_type: TypeName,
    /// Its initial value.
    pub initial: Option<Initial>,
}

/// An initial value.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Initial {
    /// Of an elementary variable.
    One(Expression),
    /// Of an array: values, each with how often it is repeated.
    Many(Vec<(u32, Expression)>),
}

/// Role of variables.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Role {
    /// `VAR_INPUT`.
    Input,
    /// `VAR_OUTPUT`.
    Output,
    /// `VAR_IN_OUT`.
    InOut,
    /// `VAR`.
    Local,
    /// `VAR CONSTANT`.
    Constant,
}

/// A function or a function block.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Unit {
    /// Its name.
    pub name: String,
    /// Place of the name.
    pub place: Place,
    /// The type of a function's result; none for a function block.
    pub result: Option<TypeName>,
    /// Its variables, in the order of their declaration.
    pub variables: Vec<(Role, Declared)>,
    /// Its statements.
    pub body: Vec<Statement>,
}

/// A statement with its place.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Statement {
    /// Place of its first word.
    pub place: Place,
    /// What it does.
    pub kind: StatementKind,
}

/// Kinds of statements.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum StatementKind {
    /// `target := value;`
    Assign(Path, Expression),
    /// `instance(name := value, …);`
    Call(Path, Vec<(String, Place, Expression)>),
    /// `IF … ELSIF … ELSE … END_IF`.
    If(Vec<(Expression, Vec<Statement>)>, Vec<Statement>),
    /// `CASE … OF labels: … ELSE … END_CASE`.
    Case(Expression, Vec<(Vec<Expression>, Vec<Statement>)>, Vec<Statement>),
    /// `FOR variable := from TO to BY by DO … END_FOR`.
    For(Path, Expression, Expression, Option<Expression>, Vec<Statement>),
    /// `WHILE … DO … END_WHILE`.
    While(Expression, Vec<Statement>),
    /// `REPEAT … UNTIL … END_REPEAT`.
    Repeat(Vec<Statement>, Expression),
    /// `EXIT`.
    Exit,
    /// `RETURN`.
    Return,
}

/// A variable with members and indices: `group.slots[index]`.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Path {
    /// The variable.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// What follows it.
    pub steps: Vec<Step>,
}

/// A step of a path.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Step {
    /// `.member`
    Member(String, Place),
    /// `[index]`
    Index(Box<Expression>),
}

/// An expression with its place.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Expression {
    /// Place of its operator, or of its only word.
    pub place: Place,
    /// What it computes.
    pub kind: ExpressionKind,
}

/// Kinds of expressions.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum ExpressionKind {
    /// An integer, with its type if it has one.
    Integer(Option<String>, u64),
    /// A real number, with its type if it has one.
    Real(Option<String>, f32),
    /// `TRUE` or `FALSE`.
    Bool(bool),
    /// A variable.
    Path(Path),
    /// `function(argument, …)` or `function(name := argument, …)`.
    Call(String, Vec<(Option<String>, Expression)>),
    /// `NOT` or `-`.
    Unary(&'static str, Box<Expression>),
    /// Two operands.
    Binary(&'static str, Box<Expression>, Box<Expression>),
}
