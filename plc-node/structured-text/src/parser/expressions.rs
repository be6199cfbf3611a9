//! Expressions, by precedence: `OR`, `XOR`, `AND`, equality, order, sums, products, `NOT` and `-`.

use super::{Parsed, Parser};
use crate::Dialect;
use crate::lexer::Kind;
use crate::syntax::{Expression, ExpressionKind, Path, Step};

/// Binary operators, from the weakest to the strongest.
const LEVELS: [&[&str]; 7] = [
    &["OR"],
    &["XOR"],
    &["AND", "&"],
    &["=", "<>"],
    &["<=", ">=", "<", ">"],
    &["+", "-"],
    &["*", "/", "MOD"],
];

/// Most operators of one statement: the tree is as deep.
const MOST_OPERATORS: u32 = 256;

/// Most members and indices of one path.
const LONGEST_PATH: usize = 16;

impl Parser {
    pub(super) fn expression(&mut self) -> Parsed<Expression> {
        self.deeper(|parser| parser.level(0))
    }

    fn level(&mut self, level: usize) -> Parsed<Expression> {
        let Some(operators) = LEVELS.get(level) else { return self.unary() };
        let mut left = self.level(level + 1)?;
        loop {
            let place = self.place();
            let taken =
                operators.iter().find(|operator| self.take_symbol(operator) || self.take_word(operator));
            let Some(operator) = taken else { return Ok(left) };
            self.operators += 1;
            if self.operators > MOST_OPERATORS {
                return self.mistake("a shorter expression: a statement has at most 256 operators");
            }
            let operator = if *operator == "&" { "AND" } else { operator };
            let right = self.level(level + 1)?;
            left =
                Expression { place, kind: ExpressionKind::Binary(operator, Box::new(left), Box::new(right)) };
        }
    }

    fn unary(&mut self) -> Parsed<Expression> {
        let place = self.place();
        let operator = if self.take_word("NOT") {
            "NOT"
        } else if self.take_symbol("-") {
            "-"
        } else {
            return self.primary();
        };
        let operand = self.deeper(Self::unary)?;
        Ok(Expression { place, kind: ExpressionKind::Unary(operator, Box::new(operand)) })
    }

    fn primary(&mut self) -> Parsed<Expression> {
        let place = self.place();
        let kind = match self.peek().cloned() {
            Some(Kind::Integer(of_type, value)) => {
                self.next += 1;
                ExpressionKind::Integer(of_type, value)
            }
            Some(Kind::Real(of_type, value)) => {
                self.next += 1;
                ExpressionKind::Real(of_type, value)
            }
            Some(Kind::Symbol("(")) => {
                self.next += 1;
                let inner = self.expression()?;
                self.symbol(")")?;
                return Ok(inner);
            }
            _ if self.take_word("TRUE") => ExpressionKind::Bool(true),
            _ if self.take_word("FALSE") => ExpressionKind::Bool(false),
            _ => {
                let path = self.path()?;
                if path.steps.is_empty() && self.take_symbol("(") {
                    let arguments = self.arguments()?;
                    let arguments = self.named(&path.name, arguments);
                    ExpressionKind::Call(path.name, arguments)
                } else {
                    ExpressionKind::Path(path)
                }
            }
        };
        Ok(Expression { place, kind })
    }

    fn arguments(&mut self) -> Parsed<Vec<(Option<String>, Expression)>> {
        let mut arguments = Vec::new();
        loop {
            let start = self.next;
            let name = match self.peek() {
                Some(Kind::Word(word)) => Some(word.clone()),
                _ => None,
            };
            self.next += 1;
            let name = name.filter(|_| self.take_symbol(":="));
            if name.is_none() {
                self.next = start;
            }
            arguments.push((name, self.expression()?));
            if !self.take_symbol(",") {
                self.symbol(")")?;
                return Ok(arguments);
            }
        }
    }

    /// Names the parameters of a function in a tree that is compared. Those of SHL and SHR, which SCL names, lose their names.
    fn named(
        &self,
        function: &str,
        mut arguments: Vec<(Option<String>, Expression)>,
    ) -> Vec<(Option<String>, Expression)> {
        if self.dialect == Dialect::Scl
            && ["SHL", "SHR"].iter().any(|shift| shift.eq_ignore_ascii_case(function))
        {
            arguments.iter_mut().for_each(|(name, _)| *name = None);
        }
        let parameters = self.normal.as_ref().map(|normal| &normal.parameters);
        if let Some(names) = parameters.and_then(|parameters| parameters.get(&function.to_ascii_lowercase()))
        {
            for ((name, _), parameter) in arguments.iter_mut().zip(names) {
                name.get_or_insert_with(|| parameter.clone());
            }
        }
        arguments
    }

    pub(super) fn path(&mut self) -> Parsed<Path> {
        let (name, place) = self.name()?;
        let mut steps = Vec::new();
        loop {
            if steps.len() > LONGEST_PATH {
                return self.mistake("a shorter path: at most 16 members and indices");
            }
            if self.take_symbol(".") {
                let (member, place) = self.name()?;
                steps.push(Step::Member(member, place));
            } else if self.take_symbol("[") {
                steps.push(Step::Index(Box::new(self.expression()?)));
                self.symbol("]")?;
            } else {
                return Ok(Path { name, place, steps });
            }
        }
    }
}
