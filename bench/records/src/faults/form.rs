//! The forms of a fault as a user writes them, and the errors for a text that has none of them.

use std::fmt::Write as _;

/// A form of a fault: its key, an example, and what it does.
struct Form {
    key: &'static str,
    example: &'static str,
    effect: &'static str,
}

const fn form(key: &'static str, example: &'static str, effect: &'static str) -> Form {
    Form { key, example, effect }
}

/// Faults of frames at random, in one direction or in both.
const RANDOM: [Form; 7] = [
    form("loss", "loss=0.001", "share of frames that are lost"),
    form("duplicate", "duplicate=0.01", "share of frames that arrive twice"),
    form("corrupt", "corrupt=0.001@memory", "share with a flipped bit after the checks"),
    form("corrupt", "corrupt=0.001@wire", "the same before the checks, so the frame is lost"),
    form("reorder", "reorder=0.01@2ms", "share that is held, so later frames overtake"),
    form("delay", "delay=100us", "more delay for each frame"),
    form("jitter", "jitter=50us", "random delay up to this"),
];

/// Faults of the cable or a node at a time; they have no direction.
const TIMED: [Form; 3] = [
    form("cut-at", "cut-at=2s..2.1s", "the cable is cut from 2 s to 2.1 s"),
    form("kill-robot-at", "kill-robot-at=2s", "the robot's node ends"),
    form("kill-plc-at", "kill-plc-at=2s", "the PLC's node ends"),
];

/// Faults of one frame, which need a direction.
const OF_FRAME: [Form; 5] = [
    form("lose-frame", "to-robot:lose-frame=17", "frame 17 is lost"),
    form("double-frame", "to-plc:double-frame=17", "frame 17 arrives twice"),
    form("hold-frame", "to-plc:hold-frame=17@2ms", "frame 17 arrives 2 ms later"),
    form("flip-frame", "to-robot:flip-frame=17.93@memory", "bit 93 of frame 17 flips after the checks"),
    form("flip-frame", "to-robot:flip-frame=17@wire", "a bit flips before the checks"),
];

/// Faults from one frame on, which need a direction and virtual mode.
const FROM_FRAME: [Form; 3] = [
    form("cut-frame", "to-robot:cut-frame=17@10ms", "the cable is cut for 10 ms"),
    form("restart-robot", "to-robot:restart-robot=17@100ms", "the robot's node restarts"),
    form("restart-plc", "to-plc:restart-plc=17@100ms", "the PLC's node restarts"),
];

/// Faults of the drive of an axis.
const OF_DRIVE: [Form; 3] = [
    form("drive-fault", "drive-fault=3@2s", "the drive of axis 3 reports a fault"),
    form("drive-stop", "drive-stop=3@2s", "the drive stops"),
    form("drive-block", "drive-block=3@2s..2.5s", "the shaft is held"),
];

/// All forms in groups, each under a heading.
const GROUPS: [(&str, &[Form]); 5] = [
    ("In both directions, or in one as to-robot:loss=0.001 or to-plc:loss=0.001:", &RANDOM),
    ("At a time, counted from the moment that the robot is ready:", &TIMED),
    ("One frame, counted from 1 in its direction:", &OF_FRAME),
    ("In virtual mode, from one frame on:", &FROM_FRAME),
    ("Drives, with --drives ethercat:", &OF_DRIVE),
];

fn forms() -> impl Iterator<Item = &'static Form> {
    GROUPS.iter().flat_map(|(_, forms)| forms.iter())
}

/// Returns the list of all faults for the help of the command line, in lines of at most 70 characters.
#[must_use]
pub fn help() -> String {
    let mut text = "Inject a fault; can be given several times\n\nThe same seed gives the same faults. With several stations, \
                    the station comes first, as in left/to-robot:loss=0.001; kill-plc-at has none."
        .to_owned();
    for (heading, forms) in GROUPS {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n\n{heading}");
        for Form { example, effect, .. } in forms {
            let _ = write!(text, "\n  {example}: {effect}");
        }
    }
    text
}

/// Why a text is not a fault.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum FaultError {
    /// No fault has this key.
    #[error("unknown fault `{text}`: {}`bench --help` lists all under --fault", did_you_mean(.nearest))]
    Unknown {
        /// The user's text.
        text: String,
        /// An example of the fault with the most similar key.
        nearest: Option<&'static str>,
    },
    /// The key is right, and the rest has another form.
    #[error("invalid fault `{text}`: write it as {}", .examples.join(" or "))]
    Form {
        /// The user's text.
        text: String,
        /// Examples of the key's forms.
        examples: Vec<&'static str>,
    },
    /// The part before the fault is not a direction.
    #[error(
        "invalid direction `{direction}` in `{text}`: write to-robot or to-plc, as in to-robot:loss=0.001"
    )]
    Direction {
        /// The user's text.
        text: String,
        /// The part that is not a direction.
        direction: String,
    },
    /// It is not a share of the frames.
    #[error("invalid share of frames `{0}`: write a number from 0 to 1, such as 0.001, or 0.1%")]
    Share(String),
    /// It is not a time.
    #[error("invalid time `{0}`: write a number with its unit, such as 100us, 2.5ms or 2s")]
    Time(String),
    /// It is not the number of a frame.
    #[error("invalid frame number `{0}`: write 1 for the first frame in that direction")]
    Frame(String),
    /// A cut, or the time for which a shaft is held, does not end after it begins.
    #[error("`{0}` ends before it begins: write the earlier time first")]
    Backwards(String),
    /// It has no axis and time.
    #[error("invalid axis and time `{0}`: write 3@2s for axis 3 after 2 s, or 3@2s..2.5s for drive-block")]
    Axis(String),
}

fn did_you_mean(example: &Option<&'static str>) -> String {
    example.map_or_else(String::new, |example| format!("did you mean {example}? "))
}

impl FaultError {
    /// Returns the error for a text that is not in the form of a fault.
    pub(super) fn form(text: &str) -> Self {
        let fault = text.rsplit_once('/').map_or(text, |(_, fault)| fault);
        let fault = fault.split_once('=').map_or(fault, |(key, _)| key);
        let key = fault.rsplit_once(':').map_or(fault, |(_, key)| key);
        let examples: Vec<_> = forms().filter(|form| form.key == key).map(|form| form.example).collect();
        if !examples.is_empty() {
            return Self::Form { text: text.to_owned(), examples };
        }
        let mut keys: Vec<_> = forms().map(|form| form.key).collect();
        keys.dedup();
        let nearest = setup::nearest(key, keys);
        let nearest = nearest.and_then(|key| forms().find(|form| form.key == key)).map(|form| form.example);
        Self::Unknown { text: text.to_owned(), nearest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::Fault;

    #[test]
    fn every_example_of_the_help_is_a_fault() {
        for Form { key, example, .. } in forms() {
            assert!(example.parse::<Fault>().is_ok(), "{example}");
            assert!(example.contains(&format!("{key}=")), "{example}");
            assert!(help().contains(example));
        }
        assert!(
            help()
                .lines()
                .skip(2)
                .filter(|line| line.starts_with("  "))
                .all(|line| line.chars().count() <= 78)
        );
    }

    #[test]
    fn an_unknown_fault_names_the_nearest_one_and_is_short() {
        let said = |text: &str| text.parse::<Fault>().unwrap_err().to_string();
        insta::assert_snapshot!(said("xyz"), @"unknown fault `xyz`: `bench --help` lists all under --fault");
        insta::assert_snapshot!(said("los=0.1"), @"unknown fault `los=0.1`: did you mean loss=0.001? `bench --help` lists all under --fault");
        insta::assert_snapshot!(said("left/to-plc:dealy=1ms"), @"unknown fault `left/to-plc:dealy=1ms`: did you mean delay=100us? `bench --help` lists all under --fault");
        insta::assert_snapshot!(said("cut=2s"), @"unknown fault `cut=2s`: did you mean cut-at=2s..2.1s? `bench --help` lists all under --fault");
        insta::assert_snapshot!(said("loss"), @"invalid fault `loss`: write it as loss=0.001");
        insta::assert_snapshot!(said("flip-frame=3.1@memory"), @"invalid fault `flip-frame=3.1@memory`: write it as to-robot:flip-frame=17.93@memory or to-robot:flip-frame=17@wire");
        insta::assert_snapshot!(said("to-robot:cut-at=1s..2s"), @"invalid fault `to-robot:cut-at=1s..2s`: write it as cut-at=2s..2.1s");
        insta::assert_snapshot!(said("to-rbot:loss=0.1"), @"invalid direction `to-rbot` in `to-rbot:loss=0.1`: write to-robot or to-plc, as in to-robot:loss=0.001");
        insta::assert_snapshot!(said("left/robot:cut-frame=3@1ms"), @"invalid direction `robot` in `left/robot:cut-frame=3@1ms`: write to-robot or to-plc, as in to-robot:loss=0.001");
    }
}
