//! Loops that look for the first element that differs, executed at once: a scan compares images of 256 bytes.

use crate::Program;
use crate::compile::code::{Code, ComparisonOperator, Element, For, Instruction, VariableAddress};
use crate::run::{Instance, Run};

/// The other side of the comparison.
enum Sought<'a> {
    Elements(&'a Element),
    Value(i64),
}

impl Instance {
    /// Returns how many passes of a loop do nothing, from `value` of its variable up to `to`: those of `FOR i := a TO b DO IF
    /// x[i] <> y[i] THEN … END_IF; END_FOR` whose elements are equal. Each takes two steps.
    pub(crate) fn idle_passes(
        &mut self,
        program: &Program,
        of: &For,
        value: i64,
        to: i64,
        this: usize,
    ) -> Run<usize> {
        let Some((elements, sought)) = search(of) else { return Ok(0) };
        let Some(passes) = to.checked_sub(value).and_then(|more| usize::try_from(more).ok()) else {
            return Ok(0);
        };
        // Passes beyond an array or the budget are executed one by one, up to the trap.
        let passes = passes.saturating_add(1).min(usize::try_from(self.steps / 2).unwrap_or(usize::MAX));
        let Some((first, len)) = self.elements(program, elements, value, this)? else { return Ok(0) };
        let passes = passes.min(len);
        match sought {
            Sought::Value(sought) => {
                let found = self.memory.get(first..first + passes).unwrap_or_default();
                Ok(found.iter().take_while(|found| **found == sought).count())
            }
            Sought::Elements(others) => {
                let Some((other, len)) = self.elements(program, others, value, this)? else { return Ok(0) };
                let passes = passes.min(len);
                let both =
                    [first, other].map(|first| self.memory.get(first..first + passes).unwrap_or_default());
                let [one, other] = both;
                if one == other {
                    return Ok(one.len());
                }
                Ok(one.iter().zip(other).take_while(|(one, other)| one == other).count())
            }
        }
    }

    /// Returns the slot of an element, and how many follow up to the end of the array, with it; `None` outside of it.
    fn elements(
        &mut self,
        program: &Program,
        of: &Element,
        index: i64,
        this: usize,
    ) -> Run<Option<(usize, usize)>> {
        let at = index - of.low;
        let left = i64::from(of.len) - at;
        if at < 0 || left <= 0 {
            return Ok(None);
        }
        let base = self.slot(program, &of.base, this)?;
        Ok(Some((base + at as usize, left as usize)))
    }
}

/// Returns what a loop compares, if it does nothing but that while they are equal.
fn search(of: &For) -> Option<(&Element, Sought<'_>)> {
    let VariableAddress::Local(variable) = of.variable else { return None };
    let Code::Constant(1) = of.by else { return None };
    let [only] = of.body.as_slice() else { return None };
    let Instruction::If(branches, otherwise) = &only.instruction else { return None };
    let ([(Code::Compare(ComparisonOperator::NotEqual, operands), _)], []) =
        (branches.as_slice(), otherwise.as_slice())
    else {
        return None;
    };
    let [left, right] = &**operands;
    let sought = match right {
        Code::Constant(value) => Sought::Value(*value),
        code => Sought::Elements(element_of(code, variable)?),
    };
    Some((element_of(left, variable)?, sought))
}

/// Returns the element of an array of elementary values that has this variable as its index.
fn element_of(code: &Code, variable: u32) -> Option<&Element> {
    let Code::Load(VariableAddress::Element(element)) = code else { return None };
    let Code::Load(VariableAddress::Local(index)) = element.index else { return None };
    let is_flat = matches!(element.base, VariableAddress::Local(_) | VariableAddress::Through(..));
    (index == variable && is_flat && (element.stride, element.offset) == (1, 0)).then_some(element)
}
