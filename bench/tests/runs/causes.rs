//! What ends a run is named by what it was, on every bus, in virtual time.

use crate::failure::failure;

/// Runs CM once on a built-in setup with a fault, and returns the reason of its failure.
fn failure_on(setup: &str, fault: &str) -> Option<String> {
    let (setup, found) = planning::setup_with_application(setup).unwrap();
    failure(&setup, &found.application, fault)
}

#[test]
fn a_cut_cable_is_never_called_a_controller_that_does_not_run() {
    for setup in ["A", "B", "C"] {
        let cuts = [10, 40, 80, 160, 320, 480, 520, 700, 1_500];
        let reasons: Vec<_> = cuts
            .into_iter()
            .filter_map(|ms| failure_on(setup, &format!("cut-at=1s..{}ms", 1_000 + ms)))
            .collect();
        assert!(reasons.len() > 1 && reasons.len() < cuts.len(), "{setup}: {reasons:?}");
        for reason in reasons {
            assert!(!reason.contains("its controller does not run"), "{setup}: {reason}");
            assert!(reason.contains("lost") || reason.contains("cut"), "{setup}: {reason}");
        }
    }
}

#[test]
fn a_killed_plc_is_named_with_the_fault_that_killed_it() {
    for setup in ["A", "B", "C"] {
        let reason = failure_on(setup, "kill-plc-at=1s").unwrap();
        assert!(reason.contains("the plc-node was killed by this run's fault `kill-plc-at`"), "{reason}");
    }
}
