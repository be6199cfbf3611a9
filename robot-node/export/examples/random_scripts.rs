//! Executes the second layer against the PLC's function blocks over random scripts: `random_scripts [SCRIPTS [FIRST]]`, by default
//! a hundred thousand. A motion that is lost, doubled, reordered or begun after a halt is a panic.
#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "it ends at the first difference, and says so"
)]

#[path = "../tests/scripts/causes.rs"]
mod causes;
#[path = "../tests/scripts/cell.rs"]
mod cell;
#[path = "../tests/scripts/plc.rs"]
mod plc;
#[path = "../tests/scripts/random.rs"]
mod random;
#[path = "../tests/scripts/rules.rs"]
mod rules;

fn main() {
    let mut numbers = std::env::args().skip(1).map(|number| number.parse::<u64>().unwrap());
    let scripts = numbers.next().unwrap_or(100_000);
    let first = numbers.next().unwrap_or(0);
    let codes = [true, false].map(|has_sign| cell::code(None, has_sign));
    let mut motions = 0;
    for seed in first..first + scripts {
        let code = &codes[(seed % 2) as usize];
        motions += random::script(code, seed).unwrap_or_else(|broken| panic!("script {seed}: {broken}"));
    }
    println!(
        "{scripts} random scripts, {motions} motions: none lost, doubled or reordered, none after a halt"
    );
}
