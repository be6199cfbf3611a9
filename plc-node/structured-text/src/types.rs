//! Types and layouts. Each elementary value takes one slot of the memory.

use std::collections::HashMap;
use std::sync::Arc;

use crate::Place;
use crate::syntax::Role;

/// An elementary type.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Scalar {
    /// `BOOL`, kept as 0 or 1.
    Bool,
    /// `USINT`
    Usint,
    /// `UINT`
    Uint,
    /// `UDINT`
    Udint,
    /// `SINT`
    Sint,
    /// `INT`
    Int,
    /// `DINT`
    Dint,
    /// `BYTE`
    Byte,
    /// `WORD`
    Word,
    /// `DWORD`
    Dword,
    /// `REAL`, kept as its 32 bits.
    Real,
}

impl Scalar {
    pub(crate) const ALL: [(&'static str, Self); 11] = [
        ("BOOL", Self::Bool),
        ("USINT", Self::Usint),
        ("UINT", Self::Uint),
        ("UDINT", Self::Udint),
        ("SINT", Self::Sint),
        ("INT", Self::Int),
        ("DINT", Self::Dint),
        ("BYTE", Self::Byte),
        ("WORD", Self::Word),
        ("DWORD", Self::Dword),
        ("REAL", Self::Real),
    ];

    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find_map(|(word, scalar)| word.eq_ignore_ascii_case(name).then_some(scalar))
    }

    /// Returns the type's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.into_iter().find_map(|(word, scalar)| (scalar == self).then_some(word)).unwrap_or("")
    }

    pub(crate) const fn is_integer(self) -> bool {
        matches!(self, Self::Usint | Self::Uint | Self::Udint | Self::Sint | Self::Int | Self::Dint)
    }

    pub(crate) const fn is_bits(self) -> bool {
        matches!(self, Self::Byte | Self::Word | Self::Dword)
    }

    /// Returns the least and the greatest value of a type that is not REAL.
    #[inline]
    pub(crate) const fn range(self) -> (i64, i64) {
        match self {
            Self::Bool => (0, 1),
            Self::Usint | Self::Byte => (0, 0xFF),
            Self::Uint | Self::Word => (0, 0xFFFF),
            Self::Udint | Self::Dword | Self::Real => (0, 0xFFFF_FFFF),
            Self::Sint => (-0x80, 0x7F),
            Self::Int => (-0x8000, 0x7FFF),
            Self::Dint => (-0x8000_0000, 0x7FFF_FFFF),
        }
    }

    #[inline]
    pub(crate) const fn holds(self, value: i64) -> bool {
        let (low, high) = self.range();
        low <= value && value <= high
    }
}

/// A type.
#[derive(Clone, Debug)]
pub(crate) enum Type {
    Scalar(Scalar),
    Structure(Arc<TypeLayout>),
    Array(Arc<Array>),
    /// An instance of a function block.
    Instance(Arc<TypeLayout>),
}

/// An array of one dimension.
#[derive(Clone, Debug)]
pub(crate) struct Array {
    pub(crate) low: i64,
    pub(crate) len: u32,
    pub(crate) element: Type,
}

/// The members of a structure, or the variables of a unit.
#[derive(Clone, Default, Debug)]
pub(crate) struct TypeLayout {
    pub(crate) name: String,
    /// Number of the unit in the program; of a structure unused.
    pub(crate) unit: usize,
    pub(crate) members: Vec<Member>,
    /// Position in `members` by the name in lower case.
    by_name: HashMap<String, usize>,
    pub(crate) initial: Vec<i64>,
}

/// A member with its first slot.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) role: Role,
    pub(crate) of_type: Type,
    pub(crate) offset: u32,
}

/// Most slots of a program's memory: 128 MiB.
pub(crate) const LARGEST: usize = 16 << 20;

impl TypeLayout {
    pub(crate) fn new(name: &str, unit: usize) -> Self {
        Self { name: name.into(), unit, ..Self::default() }
    }

    pub(crate) fn member(&self, name: &str) -> Option<&Member> {
        self.members.get(*self.by_name.get(&name.to_ascii_lowercase())?)
    }

    /// Appends a member with its initial slots.
    pub(crate) fn add(
        &mut self,
        (name, role, of_type): (&str, Role, Type),
        initial: &[i64],
        place: Place,
    ) -> Result<(), crate::Mistake> {
        let key = name.to_ascii_lowercase();
        if self.by_name.insert(key, self.members.len()).is_some() {
            return Err(crate::Mistake::new(place, format!("`{name}` is declared twice")));
        }
        let offset = self.initial.len();
        if offset + initial.len() > LARGEST {
            return Err(crate::Mistake::new(place, format!("the variables exceed {LARGEST} values")));
        }
        self.members.push(Member { name: name.into(), role, of_type, offset: offset as u32 });
        self.initial.extend_from_slice(initial);
        Ok(())
    }
}

impl Type {
    pub(crate) fn size(&self) -> usize {
        match self {
            Self::Scalar(_) => 1,
            Self::Structure(layout) | Self::Instance(layout) => layout.initial.len(),
            Self::Array(array) => array.len as usize * array.element.size(),
        }
    }

    pub(crate) fn name(&self) -> String {
        match self {
            Self::Scalar(scalar) => scalar.name().into(),
            Self::Structure(layout) | Self::Instance(layout) => layout.name.clone(),
            Self::Array(array) => format!("an array of {} {}", array.len, array.element.name()),
        }
    }

    pub(crate) fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Scalar(one), Self::Scalar(other)) => one == other,
            (Self::Structure(one), Self::Structure(other)) | (Self::Instance(one), Self::Instance(other)) => {
                one.name.eq_ignore_ascii_case(&other.name)
            }
            (Self::Array(one), Self::Array(other)) => {
                one.low == other.low && one.len == other.len && one.element.is_same(&other.element)
            }
            _ => false,
        }
    }
}
