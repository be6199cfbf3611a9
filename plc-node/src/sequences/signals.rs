//! Outputs by which robots meet at the marks of their stored programs: the PLC passes those of each robot on to the others.

use planning::{WaitAt, outputs_of_waits};

use crate::Station;
use crate::sequence::Sequence;

/// The outputs by which an arm meets others.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MarkOutputs {
    /// Bits of its robot's digital outputs.
    own: u16,
    /// Bits of all arms.
    all: u16,
    /// State that is passed on.
    shown: u16,
}

impl MarkOutputs {
    /// Takes the outputs of an arm's waits.
    pub(super) fn of(waits: &[WaitAt]) -> Self {
        let own = outputs_of_waits(waits);
        let signals = waits.iter().filter_map(|wait| wait.signal);
        Self { own, all: signals.fold(own, |all, signal| all | signal.inputs), shown: 0 }
    }

    /// Begins a run: what an output still shows of the last run is not passed on.
    pub(super) const fn begin(&mut self) {
        self.shown = 0;
    }

    /// Returns the state that is passed on.
    pub(super) const fn shown(self) -> u16 {
        self.shown
    }

    /// Takes the outputs of a robot that has taken up its program of this run, which clears them before. Those of a robot that is lost, or was
    /// started again, stay as they were.
    pub(super) fn read(&mut self, sequence: &Sequence, station: &Station) {
        let group = station.group();
        let number = group.command().number;
        let feedback = group.feedback().filter(|feedback| feedback.number == number);
        if let Some(feedback) = feedback.filter(|_| sequence.was_called() && station.is_connected()) {
            self.shown = feedback.inputs & self.own;
        }
    }

    /// Sets the robot's inputs to what the other arms show.
    pub(super) fn pass_on(self, shown_by_all: u16, station: &mut Station) {
        if self.all == 0 {
            return;
        }
        let of_others = shown_by_all & self.all & !self.own;
        let group = station.group_mut();
        group.set_outputs(group.outputs() & !self.all | of_others);
    }
}

#[cfg(test)]
mod tests {
    use machine::{Duration, Instant};
    use planning::MarkSignal;
    use protocol::image::{Feedback, Motion, MotionKind, Order, State, Status};
    use setup::Refill;

    use super::*;
    use crate::sequence::Reach;
    use crate::{ExecutionType, MotionList, StationConfig};

    /// A sequence of RC, its station, and the outputs of an arm that has 14 and sees 12.
    struct Bed {
        sequence: Sequence,
        station: Station,
        outputs: MarkOutputs,
    }

    impl Bed {
        fn new() -> Self {
            let signal = Some(MarkSignal { output: 14, set: true, inputs: 1 << 12 });
            let wait = WaitAt { mark: 1, after: 1, after_action: false, signal };
            let mut station =
                Station::new(0, StationConfig::patient(100), Order::BigEndian, Duration::from_millis(1));
            station.connect();
            let sequence = Sequence::new(ExecutionType::Rc, 1, 5).refilled_by(Refill::Executed);
            Self { sequence, station, outputs: MarkOutputs::of(&[wait]) }
        }

        /// Scans with the robot's outputs; `number` is the command that it echoes.
        fn scan(&mut self, inputs: u16, number: u16) -> u16 {
            let status = Status::ENABLED | Status::AT_REST;
            let feedback = Feedback { state: State::Ready, status, inputs, number, ..Feedback::default() };
            self.station.group_mut().read(Some(feedback));
            self.outputs.read(&self.sequence, &self.station);
            let mut motions =
                MotionList::from(vec![Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY }]);
            let group = self.station.group_mut();
            self.sequence.scan(Instant::ZERO, &mut motions, &[], Reach::END, group);
            self.outputs.shown()
        }
    }

    #[test]
    fn outputs_are_passed_on_only_once_the_robot_echoes_the_command_of_its_program() {
        let mut bed = Bed::new();
        assert_eq!(bed.scan(0xFFFF, 0), 0, "not called yet");
        let number = bed.station.group().command().number;
        assert_eq!(bed.scan(0xFFFF, number.wrapping_sub(1)), 0, "not taken up: stale");
        assert_eq!(bed.scan(0, number), 0);
        assert_eq!(bed.scan(0xFFFF, number), 1 << 14, "its own, and no others");
        assert_eq!(bed.scan(0, 0), 1 << 14, "a robot that was started again has come nevertheless");
        bed.station.disarm();
        assert_eq!(bed.scan(0, number), 1 << 14, "so has one whose connection is lost");
    }

    #[test]
    fn the_inputs_of_an_arm_are_what_the_others_show_and_all_other_outputs_of_the_plc_stay() {
        let mut bed = Bed::new();
        bed.station.group_mut().set_outputs(0b101);
        bed.outputs.pass_on(1 << 12 | 1 << 14 | 1 << 9, &mut bed.station);
        assert_eq!(bed.station.group().outputs(), 0b101 | 1 << 12);
        bed.outputs.pass_on(0, &mut bed.station);
        assert_eq!(bed.station.group().outputs(), 0b101);
    }
}
