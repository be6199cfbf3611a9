//! Steps the PLC's function blocks and the exported code of each maker, read back from its files, through random scans: `random_scans
//! [SCANS [SEED]]`, by default a million for `st` and `siemens` and ten thousand for the others. A byte that differs is a panic.
#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "it ends at the first difference, and says so"
)]
#![allow(dead_code, reason = "the tests use more of these modules")]

#[path = "../tests/blocks/bed.rs"]
mod bed;
#[path = "../tests/blocks/random.rs"]
mod random;
#[path = "../tests/blocks/read_back.rs"]
mod read_back;

use plc_export::Maker;

fn main() {
    let mut numbers = std::env::args().skip(1).map(|number| number.parse::<u64>().unwrap());
    let scans = numbers.next().unwrap_or(1_000_000);
    let seed = numbers.next().unwrap_or(1);
    for (maker, scans) in [
        (Maker::St, scans),
        (Maker::Siemens, scans),
        (Maker::Codesys, scans.div_ceil(100)),
        (Maker::Br, scans.div_ceil(100)),
    ] {
        random::random_scans(maker, scans, seed);
        println!("{maker:?}: {scans} random scans, no byte differs");
    }
}
