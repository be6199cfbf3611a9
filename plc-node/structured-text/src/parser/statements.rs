//! Statements.

use super::{Parsed, Parser};
use crate::lexer::Kind;
use crate::syntax::{Expression, Statement, StatementKind};

impl Parser {
    /// Parses statements up to one of these words, which stays.
    pub(super) fn statements(&mut self, ends: &[&str]) -> Parsed<Vec<Statement>> {
        self.statements_until(|parser| ends.iter().any(|end| parser.is_word(end)))
    }

    fn statements_until(&mut self, is_end: impl Fn(&Self) -> bool) -> Parsed<Vec<Statement>> {
        let mut statements = Vec::new();
        while !is_end(self) {
            if self.take_symbol(";") {
                continue;
            }
            let place = self.place();
            let kind = self.deeper(Self::statement)?;
            self.symbol(";")?;
            statements.push(Statement { place, kind });
        }
        Ok(statements)
    }

    fn statement(&mut self) -> Parsed<StatementKind> {
        self.operators = 0;
        if self.take_word("IF") {
            self.if_statement()
        } else if self.take_word("CASE") {
            self.case()
        } else if self.take_word("FOR") {
            self.for_loop()
        } else if self.take_word("WHILE") {
            let condition = self.expression()?;
            self.word("DO")?;
            let body = self.statements(&["END_WHILE"])?;
            self.word("END_WHILE")?;
            Ok(StatementKind::While(condition, body))
        } else if self.take_word("REPEAT") {
            let body = self.statements(&["UNTIL"])?;
            self.word("UNTIL")?;
            let condition = self.expression()?;
            self.word("END_REPEAT")?;
            Ok(StatementKind::Repeat(body, condition))
        } else if self.take_word("EXIT") {
            Ok(StatementKind::Exit)
        } else if self.take_word("RETURN") {
            Ok(StatementKind::Return)
        } else {
            self.assignment_or_call()
        }
    }

    fn assignment_or_call(&mut self) -> Parsed<StatementKind> {
        let target = self.path()?;
        if !self.take_symbol("(") {
            self.symbol(":=")?;
            return Ok(StatementKind::Assign(target, self.expression()?));
        }
        let mut parameters = Vec::new();
        if self.take_symbol(")") {
            return Ok(StatementKind::Call(target, parameters));
        }
        loop {
            let (name, place) = self.name()?;
            self.symbol(":=")?;
            parameters.push((name, place, self.expression()?));
            if !self.take_symbol(",") {
                self.symbol(")")?;
                return Ok(StatementKind::Call(target, parameters));
            }
        }
    }

    fn if_statement(&mut self) -> Parsed<StatementKind> {
        let mut branches = Vec::new();
        loop {
            let condition = self.expression()?;
            self.word("THEN")?;
            branches.push((condition, self.statements(&["ELSIF", "ELSE", "END_IF"])?));
            if !self.take_word("ELSIF") {
                break;
            }
        }
        let otherwise = if self.take_word("ELSE") { self.statements(&["END_IF"])? } else { Vec::new() };
        self.word("END_IF")?;
        Ok(StatementKind::If(branches, otherwise))
    }

    fn case(&mut self) -> Parsed<StatementKind> {
        let value = self.expression()?;
        self.word("OF")?;
        let mut branches = Vec::new();
        while !self.is_word("ELSE") && !self.is_word("END_CASE") {
            let mut labels = vec![self.expression()?];
            while self.take_symbol(",") {
                labels.push(self.expression()?);
            }
            self.symbol(":")?;
            branches.push((labels, self.branch()?));
        }
        let otherwise = if self.take_word("ELSE") { self.statements(&["END_CASE"])? } else { Vec::new() };
        self.word("END_CASE")?;
        Ok(StatementKind::Case(value, branches, otherwise))
    }

    /// Parses the statements of a branch of CASE, which end where the next label begins.
    fn branch(&mut self) -> Parsed<Vec<Statement>> {
        self.statements_until(|parser| {
            parser.is_word("ELSE")
                || parser.is_word("END_CASE")
                || parser.is_symbol("-")
                || matches!(parser.peek(), None | Some(Kind::Integer(..)))
        })
    }

    fn for_loop(&mut self) -> Parsed<StatementKind> {
        let variable = self.path()?;
        self.symbol(":=")?;
        let from = self.expression()?;
        self.word("TO")?;
        let to = self.expression()?;
        let by: Option<Expression> = if self.take_word("BY") { Some(self.expression()?) } else { None };
        self.word("DO")?;
        let body = self.statements(&["END_FOR"])?;
        self.word("END_FOR")?;
        Ok(StatementKind::For(variable, from, to, by, body))
    }
}
