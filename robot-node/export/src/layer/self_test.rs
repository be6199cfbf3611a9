//! The self-test of the adapter: the cyclic task runs it before it writes a signal, and the motion task waits for it.
//!
//! `test` shows the number of the test that is under way. One that fails is not left, so its number stays and the image stays zero.

use super::words::{ask, not, number, set};
use crate::form::{AdapterTest, Routine, Sense, Statement, WatchTimer};

/// Values that both languages write exactly, with their bits as IEEE 754 has them. No denormal one: controllers may take those as 0.
pub const REALS: [(&str, u32); 10] = [
    ("0.0", 0x0000_0000),
    ("1.0", 0x3F80_0000),
    ("-1.0", 0xBF80_0000),
    ("-2.5", 0xC020_0000),
    ("100.0", 0x42C8_0000),
    ("0.5", 0x3F00_0000),
    ("-0.125", 0xBE00_0000),
    ("1000.25", 0x447A_1000),
    ("123456.0", 0x47F1_2000),
    ("-0.0009765625", 0xBA80_0000),
];

/// Numbers of two bytes.
const SHORT: [u16; 3] = [0x1234, 0x00FF, 0xFE01];

/// Numbers of four bytes: the sign of KRL's INT is set in some of them, before the swap or after it.
const LONG: [u32; 4] = [0x1234_5678, 0x0000_00FF, 0xFF00_FE01, 0x0102_0384];

/// Bits of REAL, and whether they are an infinity or not a number.
const UNUSUAL: [(u32, bool); 4] =
    [(0x7F80_0000, true), (0xFFC0_0000, true), (0x7F7F_FFFF, false), (0xC020_0000, false)];

/// Numbers of the tests.
pub(super) mod test {
    /// All passed.
    pub(crate) const PASSED: i64 = 0;
    /// A REAL becomes its bits.
    pub(crate) const BITS: i64 = 11;
    /// Bits become their REAL.
    pub(crate) const REAL: i64 = 12;
    /// Two bytes in the order of the bus.
    pub(crate) const WORD: i64 = 13;
    /// Four bytes in the order of the bus.
    pub(crate) const DOUBLE_WORD: i64 = 14;
    /// Infinities and NaN are found.
    pub(crate) const FINITE: i64 = 15;
    /// A stopwatch that was just started has not passed its limit.
    pub(crate) const CLOCK_STARTS: i64 = 16;
    /// A stopwatch passes its limit.
    pub(crate) const CLOCK_RUNS: i64 = 17;
}

/// Returns the routine.
pub(super) fn routine() -> Routine {
    let tests = REALS
        .map(|(literal, bits)| (test::BITS, AdapterTest::BitsOfReal(literal, bits)))
        .into_iter()
        .chain(REALS.map(|(literal, bits)| (test::REAL, AdapterTest::RealOfBits(bits, literal))))
        .chain(SHORT.map(|value| (test::WORD, AdapterTest::Word(value))))
        .chain(LONG.map(|value| (test::DOUBLE_WORD, AdapterTest::DoubleWord(value))))
        .chain(
            UNUSUAL.map(|(bits, is_not_finite)| (test::FINITE, AdapterTest::Finite(bits, !is_not_finite))),
        );
    let mut body = Vec::new();
    for (at, adapter_test) in tests {
        body.push(set("test", number(at)));
        body.push(Statement::While(not(ask(Sense::Passes(adapter_test))), vec![Statement::ShowFault]));
    }
    let expired = || ask(Sense::Expired(WatchTimer::Life));
    body.extend([
        set("test", number(test::CLOCK_STARTS)),
        Statement::Restart(WatchTimer::Life),
        Statement::While(expired(), vec![Statement::ShowFault]),
        set("test", number(test::CLOCK_RUNS)),
        Statement::While(not(expired()), vec![Statement::Yield]),
        Statement::Restart(WatchTimer::Life),
        Statement::Restart(WatchTimer::Count),
        set("test", number(test::PASSED)),
    ]);
    Routine {
        name: "self_test".into(),
        purpose: "Tests what depends on the controller; the number of a test that fails stays in `test`.",
        body,
    }
}
