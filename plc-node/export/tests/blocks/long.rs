use plc_export::Maker;

use crate::random::random_scans;

/// The example `random_scans` does this for millions of scans.
#[test]
fn no_byte_differs_in_random_scans_of_the_code_of_each_maker_read_back() {
    for maker in [Maker::St, Maker::Siemens, Maker::Codesys, Maker::Br] {
        random_scans(maker, 10_000, 7);
    }
}
