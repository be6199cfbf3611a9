use robot_export::layer::Flaw;

use crate::cell::code;
use crate::random::script;

/// Scripts of a test; the example `random_scripts` runs as many as it is asked for.
const SCRIPTS: u64 = 400;

#[test]
fn no_motion_is_lost_doubled_or_reordered_and_none_begins_after_a_halt() {
    for has_sign in [true, false] {
        let code = code(None, has_sign);
        for seed in 0..SCRIPTS {
            script(&code, seed).unwrap_or_else(|broken| panic!("script {seed}: {broken}"));
        }
    }
}

#[test]
fn each_flaw_of_the_layer_is_found() {
    for flaw in [
        Flaw::SingleRead,
        Flaw::SlotBeforeWritten,
        Flaw::CountAtBegin,
        Flaw::CountWhenGiven,
        Flaw::GuardByEdgeOnly,
        Flaw::GrantUnseen,
        Flaw::NumberBeforeFlags,
        Flaw::LifeAfterControl,
    ] {
        let code = code(Some(flaw), true);
        let found = (0..20_000).find_map(|seed| Some((seed, script(&code, seed).err()?)));
        let (seed, broken) = found.unwrap_or_else(|| panic!("{flaw:?} is not found"));
        println!("{flaw:?}: script {seed}: {broken}");
    }
}
