//! Types, functions, function blocks and their variables.

use super::{Parsed, Parser};
use crate::Mistake;
use crate::lexer::Kind;
use crate::syntax::{Declaration, Declared, Initial, Role, TypeBody, TypeDeclaration, TypeName, Unit};

impl Parser {
    pub(super) fn declarations(&mut self) -> Parsed<Vec<Declaration>> {
        let mut found = Vec::new();
        while self.peek().is_some() {
            if self.take_word("TYPE") {
                while !self.take_word("END_TYPE") {
                    found.push(Declaration::Type(self.type_declaration()?));
                }
            } else if self.take_word("FUNCTION") {
                found.push(Declaration::Unit(self.unit(true)?));
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
        self.symbol(":")?;
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
            return Ok(TypeName::Named(name, place));
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
        let result = if is_function {
            self.symbol(":")?;
            Some(self.type_name()?)
        } else {
            None
        };
        let mut variables = Vec::new();
        while let Some(role) = self.section() {
            let role = if role == Role::Local && self.take_word("CONSTANT") { Role::Constant } else { role };
            while !self.take_word("END_VAR") {
                self.declared(&mut |variable| variables.push((role, variable)))?;
            }
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
        ];
        sections.into_iter().find_map(|(word, role)| self.take_word(word).then_some(role))
    }
}
