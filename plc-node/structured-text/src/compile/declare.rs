//! Types, layouts and initial values.

use std::sync::Arc;

use super::Compiler;
use crate::syntax::{
    Declared, Expression, ExpressionKind, Initial, Role, TypeBody, TypeDeclaration, TypeName, Unit,
};
use crate::types::{Array, LARGEST, Type, TypeLayout};
use crate::{Mistake, Place, Scalar};

impl Compiler {
    pub(super) fn declare_type(&mut self, declared: TypeDeclaration) -> Result<(), Mistake> {
        let TypeDeclaration { name, place, body } = declared;
        self.check_new(&name, place)?;
        let of_type = match body {
            TypeBody::Alias(alias) => self.type_of(&alias)?,
            TypeBody::Structure(members) => {
                let mut layout = TypeLayout::new(&name, 0);
                for member in &members {
                    self.check_variable(&member.name, member.place)?;
                    let of_type = self.type_of(&member.of_type)?;
                    if matches!(of_type, Type::Instance(_)) {
                        return Err(Mistake::new(
                            member.place,
                            "a structure cannot contain a function block",
                        ));
                    }
                    let initial = self.initial(&of_type, member)?;
                    layout.add((&member.name, Role::Local, of_type), &initial, member.place)?;
                }
                Type::Structure(Arc::new(layout))
            }
        };
        self.types.insert(name.to_ascii_lowercase(), of_type);
        Ok(())
    }

    fn named(&self, name: &str, place: Place) -> Result<Type, Mistake> {
        Scalar::named(name)
            .map(Type::Scalar)
            .or_else(|| self.types.get(&name.to_ascii_lowercase()).cloned())
            .ok_or_else(|| Mistake::new(place, format!("type `{name}` not declared before its use")))
    }

    pub(super) fn type_of(&self, name: &TypeName) -> Result<Type, Mistake> {
        let (low, high, element, place) = match name {
            TypeName::Named(name, place) => return self.named(name, *place),
            TypeName::Array(low, high, element, place) => (*low, *high, element, *place),
        };
        let element = self.named(element, place)?;
        if matches!(element, Type::Array(_)) {
            return Err(Mistake::new(place, "arrays of arrays are outside the subset; use one dimension"));
        }
        let len = u32::try_from(high - low + 1).ok().filter(|len| *len > 0);
        let len = len.ok_or_else(|| {
            Mistake::new(place, format!("array bounds {low}..{high}: the upper must not be below"))
        })?;
        if len as usize * element.size().max(1) > LARGEST {
            return Err(Mistake::new(place, format!("the array exceeds {LARGEST} values")));
        }
        Ok(Type::Array(Arc::new(Array { low, len, element })))
    }

    /// Returns the layout of a unit's variables, and the type of a function's result. A constant has its value as initial one.
    pub(super) fn layout_of(
        &self,
        unit: &Unit,
        index: usize,
    ) -> Result<(TypeLayout, Option<Scalar>), Mistake> {
        let mut layout = TypeLayout::new(&unit.name, index);
        let result = match &unit.result {
            None => None,
            Some(name) => match self.type_of(name)? {
                Type::Scalar(scalar) => Some(scalar),
                _ => return Err(Mistake::new(unit.place, "a function's result must be elementary")),
            },
        };
        if let Some(scalar) = result {
            layout.add((&unit.name, Role::Output, Type::Scalar(scalar)), &[0], unit.place)?;
        }
        for (role, variable) in &unit.variables {
            self.check_variable(&variable.name, variable.place)?;
            let of_type = self.type_of(&variable.of_type)?;
            let is_block = matches!(of_type, Type::Instance(_));
            let problem = match role {
                Role::InOut if variable.initial.is_some() => Some("an IN_OUT has no initial value"),
                Role::InOut | Role::Input | Role::Output if is_block => {
                    Some("an instance must be declared in VAR")
                }
                Role::Output if result.is_some() => Some("a function has one result and no outputs"),
                _ if is_block && result.is_some() => Some("a function has no memory for an instance"),
                Role::Constant if variable.initial.is_none() => Some("a constant needs its value"),
                _ => None,
            };
            if let Some(problem) = problem {
                return Err(Mistake::new(variable.place, format!("`{}`: {problem}", variable.name)));
            }
            // An IN_OUT takes one slot, with the place of what it refers to.
            let initial = if *role == Role::InOut { vec![0] } else { self.initial(&of_type, variable)? };
            layout.add((&variable.name, *role, of_type), &initial, variable.place)?;
        }
        Ok((layout, result))
    }

    fn initial(&self, of_type: &Type, declared: &Declared) -> Result<Vec<i64>, Mistake> {
        let bad = |text: &str| {
            Mistake::new(declared.place, format!("initial value of `{}`: {text}", declared.name))
        };
        match (&declared.initial, of_type) {
            (None, _) => Ok(default(of_type)),
            (Some(Initial::One(value)), Type::Scalar(scalar)) => Ok(vec![constant(value, *scalar)?]),
            (Some(Initial::Many(values)), Type::Array(array)) => {
                let Type::Scalar(scalar) = array.element else {
                    return Err(bad("the elements must be elementary"));
                };
                let mut slots = Vec::new();
                for (times, value) in values {
                    let value = constant(value, scalar)?;
                    if slots.len() + *times as usize > array.len as usize {
                        return Err(bad(&format!("more values than the {} elements", array.len)));
                    }
                    slots.extend((0..*times).map(|_| value));
                }
                if slots.len() < array.len as usize {
                    return Err(bad(&format!("{} values for {} elements", slots.len(), array.len)));
                }
                Ok(slots)
            }
            _ => Err(bad(&format!("does not fit {}", of_type.name()))),
        }
    }
}

fn default(of_type: &Type) -> Vec<i64> {
    match of_type {
        Type::Scalar(_) => vec![0],
        Type::Structure(layout) | Type::Instance(layout) => layout.initial.clone(),
        Type::Array(array) => {
            let element = default(&array.element);
            (0..array.len).flat_map(|_| element.iter().copied()).collect()
        }
    }
}

/// Returns the value of a literal, which may have a sign, as one of this type.
pub(super) fn constant(value: &Expression, scalar: Scalar) -> Result<i64, Mistake> {
    let (is_negative, literal) = match &value.kind {
        ExpressionKind::Unary("-", inner) => (true, inner.as_ref()),
        _ => (false, value),
    };
    let bad = || Mistake::new(value.place, format!("expected a literal of type {}", scalar.name()));
    let is_of =
        |named: &Option<String>| named.as_ref().is_none_or(|name| Scalar::named(name) == Some(scalar));
    match &literal.kind {
        ExpressionKind::Bool(on) if scalar == Scalar::Bool && !is_negative => Ok(i64::from(*on)),
        ExpressionKind::Integer(named, number) if is_of(named) && scalar != Scalar::Real => {
            if scalar == Scalar::Bool && named.is_none() {
                return Err(bad());
            }
            let number = i64::try_from(*number).map_err(|_| bad())?;
            let number = if is_negative { -number } else { number };
            if scalar.holds(number) {
                Ok(number)
            } else {
                Err(Mistake::new(value.place, format!("{number} is outside {}", scalar.name())))
            }
        }
        ExpressionKind::Real(named, number) if is_of(named) && scalar == Scalar::Real => {
            Ok(i64::from((if is_negative { -number } else { *number }).to_bits()))
        }
        _ => Err(bad()),
    }
}
