//! Types, functions, function blocks and their variables.

use super::{Parsed, Parser};
use crate::lexer::Kind;
use crate::syntax::{Declaration, Declared, Initial, Role, TypeBody, TypeDeclaration, TypeName, Unit};
use crate::{Dialect, Mistake};

impl Parser {
    pub(crate) fn declarations(&mut self) -> Parsed<Vec<Declaration>> {
        let mut found = Vec::new();
        while self.peek().is_some() {
            if self.take_word("TYPE") {
                while !self.take_word("END_TYPE") {
                    let declared = self.type_declaration()?;
                    match (&mut self.normal, &declared.body) {
                        (Some(normal), TypeBody::Alias(array @ TypeName::Array(..))) => {
                            normal.arrays.insert(declared.name.to_ascii_lowercase(), array.clone());
                        }
                        _ => found.push(Declaration::Type(declared)),
                    }
                }
            } else if self.take_word("FUNCTION") {
                let unit = self.unit(true)?;
                if let Some(normal) = &mut self.normal
                    && !unit.variables.is_empty()
                {
                    let is_parameter = |role: Role| matches!(role, Role::Input | Role::InOut);
                    let parameters = unit.variables.iter().filter(|(role, _)| is_parameter(*role));
                    let names = parameters.map(|(_, variable)| variable.name.clone()).collect();
                    normal.parameters.insert(unit.name.to_ascii_lowercase(), names);
                }
                found.push(Declaration::Unit(unit));
            } else if self.take_word("FUNCTION_BLOCK") {
                found.push(Declaration::Unit(self.unit(false)?));
            } else {
                return self.mistake("TYPE, FUNCTION or FUNCTION_BLOCK");
            }
        }
        Ok(found)
    }

    fn type_declaration(&mut self) -> Parsed<TypeDeclaration> {
        let (name, place) = self.name()?;
        self.skip_version();
        if self.dialect != Dialect::Scl {
            self.symbol(":")?;
        }
        let body = if self.take_word("STRUCT") {
            let mut members = Vec::new();
            while !self.take_word("END_STRUCT") {
                self.declared(&mut |member| members.push(member))?;
            }
            self.take_symbol(";");
            TypeBody::Structure(members)
        } else {
            let alias = TypeBody::Alias(self.type_name()?);
            self.symbol(";")?;
            alias
        };
        Ok(TypeDeclaration { name, place, body })
    }

    /// Parses `a, b : TYPE := value;`, which declares each of the names.
    fn declared(&mut self, declare: &mut dyn FnMut(Declared)) -> Parsed<()> {
        self.operators = 0;
        let mut names = vec![self.name()?];
        while self.take_symbol(",") {
            names.push(self.name()?);
        }
        self.symbol(":")?;
        let of_type = self.type_name()?;
        let initial = if self.take_symbol(":=") { Some(self.initial()?) } else { None };
        self.symbol(";")?;
        for (name, place) in names {
            declare(Declared { name, place, of_type: of_type.clone(), initial: initial.clone() });
        }
        Ok(())
    }

    fn type_name(&mut self) -> Parsed<TypeName> {
        let place = self.place();
        if !self.take_word("ARRAY") {
            let (name, place) = self.name()?;
            let array = self.normal.as_ref().and_then(|normal| normal.arrays.get(&name.to_ascii_lowercase()));
            return Ok(array.cloned().unwrap_or(TypeName::Named(name, place)));
        }
        self.symbol("[")?;
        let low = self.bound()?;
        self.symbol("..")?;
        let high = self.bound()?;
        if self.is_symbol(",") {
            return self.mistake("`]`: arrays have one dimension");
        }
        self.symbol("]")?;
        self.word("OF")?;
        if self.is_word("ARRAY") {
            return self.mistake("an element that is not an array");
        }
        Ok(TypeName::Array(low, high, self.name()?.0, place))
    }

    fn bound(&mut self) -> Parsed<i64> {
        let is_negative = self.take_symbol("-");
        let Some(Kind::Integer(None, value)) = self.peek() else { return self.mistake("a bound") };
        let Ok(value) = i32::try_from(*value) else { return self.mistake("a bound of a DINT") };
        self.next += 1;
        Ok(if is_negative { -i64::from(value) } else { value.into() })
    }

    fn initial(&mut self) -> Parsed<Initial> {
        if !self.take_symbol("[") {
            return Ok(Initial::One(self.expression()?));
        }
        let mut values = Vec::new();
        loop {
            let value = self.expression()?;
            if self.take_symbol("(") {
                let crate::syntax::ExpressionKind::Integer(None, times) = value.kind else {
                    return Err(Mistake::new(value.place, "the number of repetitions must be an integer"));
                };
                let times = u32::try_from(times)
                    .map_err(|_| Mistake::new(value.place, "too many repetitions for an array"))?;
                values.push((times, self.expression()?));
                self.symbol(")")?;
            } else {
                values.push((1, value));
            }
            if !self.take_symbol(",") {
                self.symbol("]")?;
                return Ok(Initial::Many(values));
            }
        }
    }

    fn unit(&mut self, is_function: bool) -> Parsed<Unit> {
        let (name, place) = self.name()?;
        // Of a function that was declared elsewhere only the body is here.
        let is_body = self.dialect == Dialect::Split && !self.is_symbol(":");
        let result = if is_function && !is_body {
            self.symbol(":")?;
            Some(self.type_name()?)
        } else {
            None
        };
        self.skip_version();
        let mut variables = Vec::new();
        while let Some(role) = self.section() {
            let role = if role == Role::Local && self.take_word("CONSTANT") { Role::Constant } else { role };
            while !self.take_word("END_VAR") {
                self.declared(&mut |variable| variables.push((role, variable)))?;
            }
        }
        if self.dialect == Dialect::Scl {
            self.take_word("BEGIN");
        }
        let end = if is_function { "END_FUNCTION" } else { "END_FUNCTION_BLOCK" };
        let body = self.statements(&[end])?;
        self.word(end)?;
        Ok(Unit { name, place, result, variables, body })
    }

    fn section(&mut self) -> Option<Role> {
        let sections = [
            ("VAR_INPUT", Role::Input),
            ("VAR_OUTPUT", Role::Output),
            ("VAR_IN_OUT", Role::InOut),
            ("VAR", Role::Local),
            ("VAR_TEMP", Role::Local),
        ];
        let is_scl = self.dialect == Dialect::Scl;
        let mut sections = sections.into_iter().filter(|(word, _)| *word != "VAR_TEMP" || is_scl);
        sections.find_map(|(word, role)| self.take_word(word).then_some(role))
    }
}
