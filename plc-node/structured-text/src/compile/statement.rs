//! Statements and calls of function blocks.

use super::Compiler;
use super::code::{Argument, Code, For, Instruction, Located, VariableAddress};
use super::declare::constant;
use crate::syntax::{Expression, ExpressionKind, Path, Role, Statement, StatementKind};
use crate::types::{Type, TypeLayout};
use crate::{Mistake, Place, Scalar};

/// The body of a unit under way.
pub(super) struct Body<'a> {
    pub(super) compiler: &'a Compiler,
    pub(super) layout: &'a TypeLayout,
    pub(super) loops: u32,
}

type Checked<T> = Result<T, Mistake>;

impl Body<'_> {
    pub(super) fn statements(&mut self, statements: &[Statement]) -> Checked<Vec<Located>> {
        let located = |statement: &Statement| {
            Ok(Located { place: statement.place, instruction: self.statement(statement)? })
        };
        statements.iter().map(located).collect()
    }

    fn statement(&mut self, statement: &Statement) -> Checked<Instruction> {
        Ok(match &statement.kind {
            StatementKind::Assign(target, value) => self.assignment(target, value)?,
            StatementKind::Call(instance, parameters) => self.call(instance, parameters)?,
            StatementKind::If(branches, otherwise) => {
                let branches = branches
                    .iter()
                    .map(|(condition, body)| {
                        Ok((self.value(condition, Scalar::Bool)?, self.statements(body)?))
                    })
                    .collect::<Checked<_>>()?;
                Instruction::If(branches, self.statements(otherwise)?)
            }
            StatementKind::Case(value, branches, otherwise) => self.case(value, branches, otherwise)?,
            StatementKind::For(variable, from, to, by, body) => {
                let (address, of_type) = self.target(variable)?;
                let Type::Scalar(scalar) = of_type else { return Err(not_an_integer(variable)) };
                if !scalar.is_integer() {
                    return Err(not_an_integer(variable));
                }
                let by = by.as_ref().map_or(Ok(Code::Constant(1)), |by| self.value(by, scalar))?;
                let (from, to) = (self.value(from, scalar)?, self.value(to, scalar)?);
                let body = self.in_loop(body)?;
                Instruction::For(Box::new(For { variable: address, scalar, from, to, by, body }))
            }
            StatementKind::While(condition, body) => {
                Instruction::While(self.value(condition, Scalar::Bool)?, self.in_loop(body)?)
            }
            StatementKind::Repeat(body, condition) => {
                Instruction::Repeat(self.in_loop(body)?, self.value(condition, Scalar::Bool)?)
            }
            StatementKind::Exit if self.loops == 0 => {
                return Err(Mistake::new(statement.place, "EXIT outside a loop"));
            }
            StatementKind::Exit => Instruction::Exit,
            StatementKind::Return => Instruction::Return,
        })
    }

    fn in_loop(&mut self, body: &[Statement]) -> Checked<Vec<Located>> {
        self.loops += 1;
        let body = self.statements(body);
        self.loops -= 1;
        body
    }

    fn case(
        &mut self,
        value: &Expression,
        branches: &[(Vec<Expression>, Vec<Statement>)],
        otherwise: &[Statement],
    ) -> Checked<Instruction> {
        let (code, scalar) = self.expression(value, None)?;
        if !scalar.is_integer() {
            return Err(Mistake::new(value.place, format!("CASE of {}: must be an integer", scalar.name())));
        }
        let mut seen = Vec::new();
        let mut compiled = Vec::new();
        for (labels, body) in branches {
            let mut values = Vec::new();
            for label in labels {
                let value = constant(label, scalar)?;
                if seen.contains(&value) {
                    return Err(Mistake::new(label.place, format!("label {value} is there twice")));
                }
                seen.push(value);
                values.push(value);
            }
            compiled.push((values, self.statements(body)?));
        }
        Ok(Instruction::Case(code, compiled, self.statements(otherwise)?))
    }

    fn assignment(&self, target: &Path, value: &Expression) -> Checked<Instruction> {
        let (address, of_type) = self.target(target)?;
        if let Type::Scalar(scalar) = of_type {
            return Ok(Instruction::Store(address, self.value(value, scalar)?));
        }
        let ExpressionKind::Path(source) = &value.kind else { return Err(differs(value.place, &of_type)) };
        let (from, from_type) = self.address(source)?;
        if matches!(of_type, Type::Instance(_)) || !of_type.is_same(&from_type) {
            return Err(differs(value.place, &of_type));
        }
        Ok(Instruction::Copy(address, from, of_type.size() as u32))
    }

    /// Returns the address of a variable that this unit may change.
    fn target(&self, path: &Path) -> Checked<(VariableAddress, Type)> {
        match self.layout.member(&path.name).map(|member| member.role) {
            Some(Role::Input) => {
                Err(Mistake::new(path.place, format!("input `{}` cannot be assigned", path.name)))
            }
            Some(Role::Constant) => {
                Err(Mistake::new(path.place, format!("constant `{}` cannot be assigned", path.name)))
            }
            _ if self.passes_instance(path)? => Err(Mistake::new(
                path.place,
                format!("outputs of instance `{}` cannot be assigned", path.name),
            )),
            _ => self.address(path),
        }
    }

    fn call(&self, instance: &Path, parameters: &[(String, Place, Expression)]) -> Checked<Instruction> {
        let (address, of_type) = self.address(instance)?;
        let Type::Instance(layout) = of_type else {
            return Err(Mistake::new(
                instance.place,
                format!("`{}` is not an instance of a function block", instance.name),
            ));
        };
        let mut arguments = Vec::new();
        let mut given = Vec::new();
        for (name, place, value) in parameters {
            arguments.push(self.argument(&layout, name, *place, value)?);
            let key = name.to_ascii_lowercase();
            if given.contains(&key) {
                return Err(Mistake::new(*place, format!("parameter `{name}` is given twice")));
            }
            given.push(key);
        }
        self.check_references(&layout, &given, instance.place)?;
        Ok(Instruction::Call(layout.unit, address, arguments))
    }

    /// Checks that each IN_OUT is given.
    pub(super) fn check_references(
        &self,
        layout: &TypeLayout,
        given: &[String],
        place: Place,
    ) -> Checked<()> {
        let is_missing = |name: &str| !given.contains(&name.to_ascii_lowercase());
        let mut members = layout.members.iter();
        match members.find(|member| member.role == Role::InOut && is_missing(&member.name)) {
            Some(member) => Err(Mistake::new(
                place,
                format!("call of `{}` without IN_OUT `{}`", layout.name, member.name),
            )),
            None => Ok(()),
        }
    }

    pub(super) fn argument(
        &self,
        layout: &TypeLayout,
        name: &str,
        place: Place,
        value: &Expression,
    ) -> Checked<Argument> {
        let member = layout
            .member(name)
            .filter(|member| matches!(member.role, Role::Input | Role::InOut))
            .ok_or_else(|| {
                Mistake::new(place, format!("`{}` has no input or IN_OUT `{name}`", layout.name))
            })?;
        let slot = member.offset;
        if let (Role::Input, Type::Scalar(scalar)) = (member.role, &member.of_type) {
            return Ok(Argument::Value(slot, self.value(value, *scalar)?));
        }
        let ExpressionKind::Path(path) = &value.kind else {
            return Err(differs(value.place, &member.of_type));
        };
        let (address, of_type) =
            if member.role == Role::InOut { self.target(path)? } else { self.address(path)? };
        if !of_type.is_same(&member.of_type) {
            return Err(differs(value.place, &member.of_type));
        }
        Ok(match member.role {
            Role::InOut => Argument::Reference(slot, address),
            _ => Argument::Copy(slot, address, of_type.size() as u32),
        })
    }
}

fn differs(place: Place, expected: &Type) -> Mistake {
    Mistake::new(place, format!("expected a variable of type {}", expected.name()))
}

fn not_an_integer(path: &Path) -> Mistake {
    Mistake::new(path.place, format!("`{}`: the variable of FOR must be an integer", path.name))
}
