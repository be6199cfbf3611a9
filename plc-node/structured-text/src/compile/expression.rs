//! Expressions and paths. A literal without a type takes the one that its context expects.

use super::code::{
    Argument, Arithmetic, Bitwise, Code, ComparisonOperator, Element, Function, VariableAddress,
};
use super::declare::constant;
use super::names::conversion;
use super::statement::Body;
use crate::syntax::{Expression, ExpressionKind, Path, Role, Step};
use crate::types::Type;
use crate::{Mistake, Place, Scalar};

type Checked<T> = Result<T, Mistake>;

/// Most parameters of a function.
pub(crate) const MOST_ARGUMENTS: usize = 8;

impl Body<'_> {
    /// Compiles an expression that must have this type.
    pub(super) fn value(&self, expression: &Expression, expected: Scalar) -> Checked<Code> {
        let (code, found) = self.expression(expression, Some(expected))?;
        if found != expected {
            let text = format!("expected {}, found {}; convert it explicitly", expected.name(), found.name());
            return Err(Mistake::new(expression.place, text));
        }
        Ok(code)
    }

    /// Compiles an expression; `expected` gives literals their type.
    pub(super) fn expression(
        &self,
        expression: &Expression,
        expected: Option<Scalar>,
    ) -> Checked<(Code, Scalar)> {
        let place = expression.place;
        match &expression.kind {
            ExpressionKind::Bool(on) => Ok((Code::Constant(i64::from(*on)), Scalar::Bool)),
            ExpressionKind::Integer(named, _) | ExpressionKind::Real(named, _) => {
                let scalar = match named {
                    Some(name) => Some(
                        Scalar::named(name)
                            .ok_or_else(|| Mistake::new(place, format!("type `{name}` unknown")))?,
                    ),
                    None => expected,
                };
                let scalar = scalar
                    .ok_or_else(|| Mistake::new(place, "literal without a type; write it as `UDINT#5`"))?;
                Ok((Code::Constant(constant(expression, scalar)?), scalar))
            }
            ExpressionKind::Path(path) => match self.address(path)? {
                (address, Type::Scalar(scalar)) => Ok((Code::Load(address), scalar)),
                (_, of_type) => {
                    Err(Mistake::new(place, format!("{} is not an elementary value", of_type.name())))
                }
            },
            ExpressionKind::Call(name, arguments) => self.function(name, arguments, place, expected),
            ExpressionKind::Unary(operator, operand) => {
                if *operator == "-"
                    && let Some(scalar) = expected
                    && let Ok(value) = constant(expression, scalar)
                {
                    return Ok((Code::Constant(value), scalar));
                }
                let (code, scalar) = self.expression(operand, expected)?;
                match (*operator, scalar) {
                    ("NOT", Scalar::Bool) => Ok((Code::Flip(Box::new(code), 1), scalar)),
                    ("NOT", _) if scalar.is_bits() => {
                        Ok((Code::Flip(Box::new(code), scalar.range().1), scalar))
                    }
                    ("-", Scalar::Real | Scalar::Sint | Scalar::Int | Scalar::Dint) => {
                        Ok((Code::Negate(Box::new(code), scalar, place), scalar))
                    }
                    _ => {
                        Err(Mistake::new(place, format!("`{operator}` does not apply to {}", scalar.name())))
                    }
                }
            }
            ExpressionKind::Binary(operator, left, right) => {
                self.binary(operator, [left, right], place, expected)
            }
        }
    }

    fn binary(
        &self,
        operator: &str,
        [left, right]: [&Expression; 2],
        place: Place,
        expected: Option<Scalar>,
    ) -> Checked<(Code, Scalar)> {
        let compares = matches!(operator, "=" | "<>" | "<" | "<=" | ">" | ">=");
        let expected = expected.filter(|_| !compares);
        // The operand whose type is known gives it to a literal at the other side.
        let is_literal = |operand: &Expression| {
            matches!(operand.kind, ExpressionKind::Integer(None, _) | ExpressionKind::Real(None, _))
        };
        let (left, right, scalar) = if is_literal(left) {
            let (right, scalar) = self.expression(right, expected)?;
            (self.value(left, scalar)?, right, scalar)
        } else {
            let (left, scalar) = self.expression(left, expected)?;
            (left, self.value(right, scalar)?, scalar)
        };
        let operands = Box::new([left, right]);
        let bad = || Mistake::new(place, format!("`{operator}` does not apply to {}", scalar.name()));
        if compares {
            let comparison = comparison(operator);
            let is_ordered = scalar.is_integer() || scalar == Scalar::Real;
            if !is_ordered && !matches!(comparison, ComparisonOperator::Equal | ComparisonOperator::NotEqual)
            {
                return Err(bad());
            }
            let code = if scalar == Scalar::Real {
                Code::CompareReal(comparison, operands)
            } else {
                Code::Compare(comparison, operands)
            };
            return Ok((code, Scalar::Bool));
        }
        if let Some(bitwise) = bitwise(operator) {
            let applies = scalar == Scalar::Bool || scalar.is_bits();
            return if applies { Ok((Code::Bits(bitwise, operands), scalar)) } else { Err(bad()) };
        }
        let arithmetic = arithmetic(operator);
        match scalar {
            Scalar::Real if arithmetic != Arithmetic::Modulo => {
                Ok((Code::Real(arithmetic, operands, place), scalar))
            }
            _ if scalar.is_integer() => Ok((Code::Integer(arithmetic, scalar, operands, place), scalar)),
            _ => Err(bad()),
        }
    }

    fn function(
        &self,
        name: &str,
        arguments: &[(Option<String>, Expression)],
        place: Place,
        expected: Option<Scalar>,
    ) -> Checked<(Code, Scalar)> {
        if let Some((from, to)) = conversion(name) {
            let [(None, value)] = arguments else {
                return Err(Mistake::new(place, format!("`{name}` takes one value")));
            };
            return Ok((Code::Convert(from, to, Box::new(self.convertible(value, from, to)?), place), to));
        }
        let is_named = |standard: &str| name.eq_ignore_ascii_case(standard);
        match arguments {
            [(None, value), (None, by)] if is_named("SHL") || is_named("SHR") => {
                let (value, scalar) = self.expression(value, expected)?;
                if !scalar.is_bits() {
                    return Err(Mistake::new(
                        place,
                        format!("`{name}` shifts BYTE, WORD and DWORD, not {}", scalar.name()),
                    ));
                }
                let (by, of_by) = self.expression(by, Some(Scalar::Int))?;
                if !of_by.is_integer() {
                    return Err(Mistake::new(place, "the distance of a shift must be an integer"));
                }
                Ok((Code::Shift(is_named("SHL"), scalar, Box::new([value, by]), place), scalar))
            }
            [(None, value)] if is_named("ABS") => {
                let (value, scalar) = self.expression(value, expected)?;
                if !scalar.is_integer() && scalar != Scalar::Real {
                    return Err(Mistake::new(place, format!("`ABS` does not apply to {}", scalar.name())));
                }
                Ok((Code::Absolute(Box::new(value), scalar, place), scalar))
            }
            _ => self.declared_function(name, arguments, place),
        }
    }

    fn convertible(&self, value: &Expression, from: Scalar, to: Scalar) -> Checked<Code> {
        let is_refused = to == Scalar::Bool
            || from == to
            || [from, to].contains(&Scalar::Real) && (from.is_bits() || to.is_bits());
        if is_refused {
            let text = format!("{}_TO_{}: makers differ in it, or it is needless", from.name(), to.name());
            return Err(Mistake::new(value.place, text));
        }
        self.value(value, from)
    }

    fn declared_function(
        &self,
        name: &str,
        arguments: &[(Option<String>, Expression)],
        place: Place,
    ) -> Checked<(Code, Scalar)> {
        let unit = self.compiler.unit_by_name.get(&name.to_ascii_lowercase());
        let found = unit.and_then(|index| Some((*index, self.compiler.units.get(*index)?)));
        let (index, unit, result) = found
            .and_then(|(index, unit)| Some((index, unit, unit.result?)))
            .ok_or_else(|| Mistake::new(place, format!("function `{name}` not declared before its use")))?;
        let parameters: Vec<_> = unit
            .layout
            .members
            .iter()
            .filter(|member| matches!(member.role, Role::Input | Role::InOut))
            .collect();
        if arguments.len() != parameters.len() || parameters.len() > MOST_ARGUMENTS {
            let text = format!(
                "`{name}` takes {} parameters, at most {MOST_ARGUMENTS}; found {}",
                parameters.len(),
                arguments.len()
            );
            return Err(Mistake::new(place, text));
        }
        let mut given = Vec::new();
        let mut compiled = Vec::new();
        for ((named, value), in_order) in arguments.iter().zip(&parameters) {
            let name = named.as_deref().unwrap_or(&in_order.name);
            let argument = self.argument(&unit.layout, name, value.place, value)?;
            if matches!(argument, Argument::Copy(..)) || given.contains(&name.to_ascii_lowercase()) {
                return Err(Mistake::new(
                    value.place,
                    format!("parameter `{name}`: given twice, or not elementary; use IN_OUT"),
                ));
            }
            given.push(name.to_ascii_lowercase());
            compiled.push(argument);
        }
        Ok((Code::Function(Box::new(Function { unit: index, arguments: compiled })), result))
    }

    /// Returns whether a path leads into an instance.
    pub(super) fn passes_instance(&self, path: &Path) -> Checked<bool> {
        let member = self.layout.member(&path.name).ok_or_else(|| undeclared(path))?;
        let is_instance = |of_type: &Type| match of_type {
            Type::Instance(_) => true,
            Type::Array(array) => matches!(array.element, Type::Instance(_)),
            _ => false,
        };
        Ok(is_instance(&member.of_type) && path.steps.iter().any(|step| matches!(step, Step::Member(..))))
    }

    /// Returns the address and type of a path.
    pub(super) fn address(&self, path: &Path) -> Checked<(VariableAddress, Type)> {
        let member = self.layout.member(&path.name).ok_or_else(|| undeclared(path))?;
        let mut address = match member.role {
            Role::InOut => VariableAddress::Through(member.offset, 0),
            _ => VariableAddress::Local(member.offset),
        };
        let mut of_type = member.of_type.clone();
        for step in &path.steps {
            let is_structure = matches!(of_type, Type::Structure(_));
            (address, of_type) = match (step, of_type) {
                (Step::Member(name, place), Type::Structure(layout) | Type::Instance(layout)) => {
                    let member = layout
                        .member(name)
                        .filter(|member| is_structure || member.role == Role::Output)
                        .ok_or_else(|| {
                            Mistake::new(
                                *place,
                                format!("`{}` has no member or output `{name}`", layout.name),
                            )
                        })?;
                    (address.plus(member.offset), member.of_type.clone())
                }
                (Step::Index(index), Type::Array(array)) => {
                    let (code, scalar) = self.expression(index, Some(Scalar::Dint))?;
                    if !scalar.is_integer() {
                        return Err(Mistake::new(
                            index.place,
                            format!("index of type {}: must be an integer", scalar.name()),
                        ));
                    }
                    let stride = array.element.size() as u32;
                    let element = Element {
                        base: address,
                        index: code,
                        low: array.low,
                        len: array.len,
                        stride,
                        offset: 0,
                        place: index.place,
                    };
                    (VariableAddress::Element(Box::new(element)), array.element.clone())
                }
                (_, of_type) => {
                    return Err(Mistake::new(
                        path.place,
                        format!("{} has neither members nor elements here", of_type.name()),
                    ));
                }
            };
        }
        Ok((address, of_type))
    }
}

fn undeclared(path: &Path) -> Mistake {
    Mistake::new(path.place, format!("`{}` is not declared", path.name))
}

fn comparison(operator: &str) -> ComparisonOperator {
    match operator {
        "=" => ComparisonOperator::Equal,
        "<>" => ComparisonOperator::NotEqual,
        "<" => ComparisonOperator::Less,
        "<=" => ComparisonOperator::LessOrEqual,
        ">" => ComparisonOperator::Greater,
        _ => ComparisonOperator::GreaterOrEqual,
    }
}

fn bitwise(operator: &str) -> Option<Bitwise> {
    match operator {
        "AND" => Some(Bitwise::And),
        "OR" => Some(Bitwise::Or),
        "XOR" => Some(Bitwise::Xor),
        _ => None,
    }
}

fn arithmetic(operator: &str) -> Arithmetic {
    match operator {
        "+" => Arithmetic::Add,
        "-" => Arithmetic::Subtract,
        "*" => Arithmetic::Multiply,
        "/" => Arithmetic::Divide,
        _ => Arithmetic::Modulo,
    }
}
