//! When a run is compared with the paper's figures.
//!
//! This is so only for a run of the paper's cell: setup and application have the content of the built-in ones, and
//! nothing was changed for the run. Otherwise one line gives the reason.

use planning::Application;
use plc_node::OverrideSchedule;
use setup::{Difference, Setup};

use crate::calibrated;
use crate::faults::Fault;
use crate::results::{PerType, Results};
use crate::statistics::AetMad;

/// The paper's application (section 6.1), by its built-in name.
const APPLICATION: &str = "pick-and-place";

/// Keys of a setup that the paper says nothing of: how long nodes tolerate a stalled host, and how frames are carried.
const UNCOMPARED_KEYS: [&str; 2] = ["bus.watchdog_cycles", "bus.profinet.cyclic"];

/// Returns whether a key of a setup changes nothing of what the cell does: it tells where its nodes are in a network, or
/// what something is called.
pub fn is_only_a_name(key: &str) -> bool {
    const KEYS: [&str; 7] = [
        "title",
        "application",
        "bus.plc_address",
        "bus.robot_address",
        "bus.subnet_mask",
        "bus.profinet.plc_station_name",
        "bus.profinet.robot_station_name",
    ];
    KEYS.contains(&key)
}

/// Whether a run is compared with the paper's figures.
#[derive(Clone, PartialEq, Debug)]
pub enum PaperComparison {
    /// It is the paper's cell, whose figures are these.
    Comparable(PerType<AetMad>),
    /// Its setup has figures of the paper, but the run is of something else, for this reason.
    NotComparable(String),
    /// Its setup has no figures of the paper.
    NoPaper,
}

impl PaperComparison {
    /// Returns the comparison of a run under these conditions.
    #[must_use]
    pub fn of(
        setup: &Setup,
        application: &Application,
        overrides: Option<&OverrideSchedule>,
        faults: &[Fault],
    ) -> Self {
        let Some(paper) = &setup.paper else { return Self::NoPaper };
        if let Some(overrides) = overrides.filter(|overrides| !overrides.is_full()) {
            return Self::NotComparable(format!("the paper had no override, and this run has {overrides}"));
        }
        if !faults.is_empty() {
            return Self::NotComparable("faults were put into the cable".to_owned());
        }
        match other_than_the_paper(setup, application) {
            Some(reason) => Self::NotComparable(reason),
            None => Self::Comparable(PerType {
                rc: Some(paper.rc.into()),
                sm: Some(paper.sm.into()),
                cm: Some(paper.cm.into()),
            }),
        }
    }
}

impl Results {
    /// Returns these results without what is only true of our model of the robot, for a run with another one.
    #[must_use]
    pub fn without_calibration(self) -> Self {
        Self { calibrated: Vec::new(), ..self }
    }

    /// Returns whether the robot is our model of one.
    #[must_use]
    pub fn has_modelled_robot(&self) -> bool {
        self.origin.is_none() && self.attached.as_ref().is_none_or(|attached| attached.robot.is_some())
    }

    /// Adds the paper's figures and the numbers that were calibrated to them, or the reason why there are none. A run that is
    /// compared has the numbers of the built-in setup, and so they are calibrated, whatever its own file says of their source.
    #[must_use]
    pub fn with_paper(self, setup: &Setup, comparison: PaperComparison) -> Self {
        match comparison {
            PaperComparison::Comparable(paper) => {
                let shipped = built_in(&setup.name);
                let calibrated = calibrated::of(shipped.as_ref().unwrap_or(setup));
                Self { paper: Some(paper), calibrated, ..self }
            }
            PaperComparison::NotComparable(reason) => Self { no_paper: Some(reason), ..self },
            PaperComparison::NoPaper => self,
        }
    }
}

/// Returns the first difference between a cell and the paper's; `None` if there is none.
fn other_than_the_paper(setup: &Setup, application: &Application) -> Option<String> {
    let name = &setup.name;
    let Some(shipped) = built_in(name) else {
        let has_paper = |name: &str| built_in(name).is_some_and(|setup| setup.paper.is_some());
        let known: Vec<_> =
            setup::SETUPS.iter().map(|(name, _)| *name).filter(|name| has_paper(name)).collect();
        return Some(format!("`{name}` is not a setup of the paper; those are {}", known.join(" and ")));
    };
    let differences = match setup.differences(&shipped) {
        Ok(differences) => differences,
        Err(error) => return Some(error.to_string()),
    };
    let counts = |Difference { key, .. }: &Difference| {
        !is_only_a_name(key) && !UNCOMPARED_KEYS.contains(&key.as_str())
    };
    if let Some(Difference { key, first, second }) = differences.into_iter().find(counts) {
        let text = |value: Option<String>| value.unwrap_or_else(|| "missing".to_owned());
        return Some(format!("{key} is {} and in the paper's setup {name} {}", text(first), text(second)));
    }
    let is_papers =
        planning::application(APPLICATION, None).is_ok_and(|found| found.application == *application);
    (!is_papers).then(|| {
        format!("the application `{}` differs from the paper's, the built-in {APPLICATION}", application.name)
    })
}

/// Returns the built-in setup of this name.
fn built_in(name: &str) -> Option<Setup> {
    let (name, _) = setup::SETUPS.iter().find(|(known, _)| *known == name)?;
    setup::setup(name).ok()
}

#[cfg(test)]
mod tests {
    use plc_node::ExecutionType;
    use setup::{BusKind, Provenance};

    use super::*;
    use crate::mode::Mode;
    use crate::schedule::Schedule;

    fn cell(name: &str) -> (Setup, Application) {
        let (setup, found) = planning::setup_with_application(name).unwrap();
        (setup, found.application)
    }

    fn reason(setup: &Setup, application: &Application) -> String {
        match PaperComparison::of(setup, application, None, &[]) {
            PaperComparison::NotComparable(reason) => reason,
            comparison => panic!("{comparison:?}"),
        }
    }

    #[test]
    fn the_papers_cell_is_known_by_its_content_wherever_its_nodes_are() {
        for name in ["A", "B"] {
            let (mut setup, application) = cell(name);
            match &mut setup.bus.kind {
                BusKind::Profinet(addresses, _) | BusKind::EthernetIp(addresses, _) => {
                    addresses.robot = "10.0.0.2".parse().unwrap();
                }
                BusKind::Ethercat(_) => panic!("the paper has no setup on EtherCAT"),
            }
            setup.bus.watchdog_cycles.value = 3;
            setup.application = "copy.toml".to_owned();
            setup.motions.velocity_percent.note.clear();
            let comparison = PaperComparison::of(&setup, &application, None, &[]);
            assert!(matches!(comparison, PaperComparison::Comparable(_)), "{comparison:?}");
        }
    }

    #[test]
    fn a_cell_with_another_number_has_no_column_of_the_paper_and_the_number_is_named() {
        let (shipped, application) = cell("A");
        let mut setup = shipped.clone();
        setup.motions.velocity_percent.value = 50.0;
        let papers = shipped.motions.velocity_percent.value;
        let found = format!("motions.velocity_percent is 50.0 and in the paper's setup A {papers:?}");
        assert_eq!(reason(&setup, &application), found);
        let mut setup = shipped.clone();
        setup.robot.cycle_us.value = 2_000;
        insta::assert_snapshot!(reason(&setup, &application), @"robot.cycle_us is 2000 and in the paper's setup A 4000");
        let mut setup = shipped.clone();
        setup.paper.as_mut().unwrap().cm.aet_ms = 1.0;
        insta::assert_snapshot!(reason(&setup, &application), @"paper.cm.aet_ms is 1.0 and in the paper's setup A 3729.0");
        let mut setup = shipped;
        setup.name = "my-cell".to_owned();
        insta::assert_snapshot!(reason(&setup, &application), @"`my-cell` is not a setup of the paper; those are A and B");
        setup.paper = None;
        assert_eq!(PaperComparison::of(&setup, &application, None, &[]), PaperComparison::NoPaper);
    }

    #[test]
    fn another_application_an_override_and_faults_are_named() {
        let (setup, application) = cell("A");
        let mut moved = application.clone();
        moved.start.0.pose.point.z += 1.0;
        insta::assert_snapshot!(reason(&setup, &moved), @"the application `pick-and-place` differs from the paper's, the built-in pick-and-place");
        let overrides = "50".parse().unwrap();
        let found = PaperComparison::of(&setup, &application, Some(&overrides), &[]);
        assert_eq!(
            found,
            PaperComparison::NotComparable("the paper had no override, and this run has 50".to_owned())
        );
        let found = PaperComparison::of(&setup, &application, None, &["loss=0.1".parse().unwrap()]);
        assert_eq!(found, PaperComparison::NotComparable("faults were put into the cable".to_owned()));
    }

    #[test]
    fn an_override_of_100_percent_is_none() {
        let (setup, application) = cell("A");
        for full in ["100", "100,100@2s"] {
            let overrides = full.parse().unwrap();
            let found = PaperComparison::of(&setup, &application, Some(&overrides), &[]);
            assert!(matches!(found, PaperComparison::Comparable(_)), "{full}: {found:?}");
            let schedule =
                Schedule { overrides: Some(overrides), ..Schedule::new(&[ExecutionType::Rc], 1, 1) };
            assert_eq!(Results::new(&setup, "pick-and-place", Mode::Virtual, &schedule).overrides, None);
        }
    }

    #[test]
    fn a_number_of_the_built_in_setup_is_calibrated_whatever_a_copy_says_of_its_source() {
        let (shipped, application) = cell("A");
        let mut setup = shipped.clone();
        setup.motions.velocity_percent.from = Provenance::Assumed;
        setup.robot.skill_overhead_us.from = Provenance::Assumed;
        let schedule = Schedule::new(&[ExecutionType::Rc], 1, 1);
        let of = |setup: &Setup| {
            let comparison = PaperComparison::of(setup, &application, None, &[]);
            let results = Results::new(setup, "pick-and-place", Mode::Virtual, &schedule);
            results.with_paper(setup, comparison).calibrated
        };
        assert!(!of(&shipped).is_empty());
        assert_eq!(of(&setup), of(&shipped));
    }
}
