//! A device that is connected and not well, as its alarms and its frames say.

use profinet::alarm::{AlarmHead, Notification};
use profinet::rt::DataStatus;

use super::life::deliver;
use super::*;

const DIAGNOSIS: u16 = 1;
const PROCESS: u16 = 2;
const PULL: u16 = 3;
const DIAGNOSIS_ENDS: u16 = 0x0C;

const APPEARS: u16 = 1 << 11;
const DISAPPEARS: u16 = 2 << 11;

struct Ill {
    cell: Cell,
    alarms: u16,
}

impl Ill {
    fn connected() -> Self {
        let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
        assert_eq!(cell.run(50), [LinkEvent::Up]);
        Self { cell, alarms: 0xFFFF }
    }

    /// Sends an alarm whose items are these words, and returns what is remarkable then.
    fn after(&mut self, alarm_type: u16, (slot, subslot): (u16, u16), items: &[u16]) -> String {
        let head = AlarmHead { alarm_type, slot, subslot, ..samples::DIAGNOSIS.head };
        let items: Vec<u8> = items.iter().flat_map(|word| word.to_be_bytes()).collect();
        deliver(&mut self.cell, Notification { head, items: &items, ..samples::DIAGNOSIS }, self.alarms);
        self.alarms = if self.alarms == 0xFFFF { 0 } else { (self.alarms + 1) & 0x7FFF };
        self.remark()
    }

    fn remark(&mut self) -> String {
        let mut words = String::new();
        self.cell.ar().remark(&mut words).unwrap();
        words
    }
}

#[test]
fn a_fault_is_remarkable_with_slot_channel_and_name_until_it_disappears() {
    let mut ill = Ill::connected();
    assert_eq!(ill.remark(), "");
    let line_break = "the device reports a fault in slot 1, subslot 1, channel 3: line break (0x0006)";
    assert_eq!(ill.after(DIAGNOSIS, (1, 1), &[0x8000, 3, APPEARS, 6]), line_break);
    // The same once more, now with a request for maintenance.
    assert_eq!(ill.after(DIAGNOSIS, (1, 1), &[0x8000, 3, APPEARS | 1 << 9, 6]), line_break);
    let both = format!("{line_break}; a fault in slot 3, subslot 1, error (0x1234/0x5678)");
    assert_eq!(ill.after(DIAGNOSIS, (3, 1), &[0x8002, 0x8000, APPEARS, 0x1234, 0x5678, 0, 0]), both);
    let extended = "the device reports a fault in slot 3, subslot 1, error (0x1234/0x5678)";
    assert_eq!(ill.after(DIAGNOSIS, (1, 1), &[0x8000, 3, DISAPPEARS, 6]), extended);
    assert_eq!(ill.after(DIAGNOSIS_ENDS, (3, 1), &[]), "");
}

#[test]
fn every_fault_of_an_alarm_counts_and_a_pulled_module_has_none() {
    let mut ill = Ill::connected();
    let two = [0x8000, 1, APPEARS, 7, 2, APPEARS, 8];
    let words = ill.after(DIAGNOSIS, (1, 1), &two);
    assert!(words.contains("channel 1: upper limit exceeded (0x0007)"), "{words}");
    assert!(words.contains("channel 2: lower limit exceeded (0x0008)"), "{words}");
    assert_eq!(ill.after(PULL, (1, 1), &[]), "");
    let data = "the device reports a fault in slot 4, subslot 1, data 0x0042 of its maker";
    assert_eq!(ill.after(DIAGNOSIS, (4, 1), &[0x0042, 0xBEEF]), data);
    assert_eq!(ill.after(DIAGNOSIS_ENDS, (4, 1), &[0x0042, 0xBEEF]), "");
}

#[test]
fn more_faults_than_are_named_are_counted_and_cut_ones_do_no_harm() {
    let mut ill = Ill::connected();
    for channel in 0..11 {
        ill.after(DIAGNOSIS, (1, 1), &[0x8000, channel, APPEARS, 1]);
    }
    let words = ill.remark();
    assert!(words.ends_with("channel 7: short circuit (0x0001); 3 more faults"), "{words}");
    for channel in 0..11 {
        ill.after(DIAGNOSIS, (1, 1), &[0x8000, channel, DISAPPEARS, 1]);
    }
    assert_eq!(ill.remark(), "");
    for items in [&[][..], &[0x8000], &[0x8000, 1], &[0x8000, 1, APPEARS], &[0x8003, 1, APPEARS, 2, 3]] {
        assert_eq!(ill.after(DIAGNOSIS, (1, 1), items), "", "{items:04X?}");
    }
}

#[test]
fn process_alarms_are_counted_and_forgotten_with_the_connection() {
    let mut ill = Ill::connected();
    let words = "the device reports a process alarm of slot 4, subslot 1, number 1 on this connection";
    assert_eq!(ill.after(PROCESS, (4, 1), &[0x0007, 1]), words);
    assert_eq!(ill.after(PROCESS, (4, 1), &[0x0007, 1]), words.replace("number 1", "number 2"));
    ill.cell.peer.script.no_cyclic = true;
    ill.cell.goes_down(30, &[(DownCause::Watchdog, 0xCF81_FD05, "no cyclic frame came within")]);
    assert_eq!(ill.remark(), "");
    ill.cell.peer.script.no_cyclic = false;
    assert_eq!(ill.cell.run(400), [LinkEvent::Up]);
    assert_eq!(ill.remark(), "");
}

#[test]
fn the_problem_bit_and_the_backup_bit_are_remarkable_while_they_are_there() {
    let mut ill = Ill::connected();
    for (status, expected) in [
        (0x15, "the device reports a problem by its frames (DataStatus 0x15); look at its diagnosis"),
        (0x34, "the device reports that it is the backup of a redundant pair (DataStatus 0x34)"),
        (0x35, ""),
    ] {
        ill.cell.peer.script.data_status = Some(DataStatus(status));
        assert_eq!(ill.cell.run(1_000), [LinkEvent::Health], "data go on");
        assert_eq!(ill.remark(), expected);
    }
}

#[test]
fn a_change_is_reported_in_the_cycle_after_it_and_one_that_flutters_once_a_second() {
    let mut ill = Ill::connected();
    ill.after(DIAGNOSIS, (1, 1), &[0x8000, 3, APPEARS, 6]);
    assert_eq!(ill.cell.run(2), [LinkEvent::Health]);
    ill.after(DIAGNOSIS, (1, 1), &[0x8000, 3, DISAPPEARS, 6]);
    assert_eq!(ill.cell.run(990), [], "too soon after the last one");
    assert_eq!(ill.cell.run(20), [LinkEvent::Health]);
    assert_eq!(ill.cell.run(5_000), [], "nothing changes");
    let mut reports = 0;
    for cycle in 0..5_000 {
        ill.cell.peer.script.data_status = Some(DataStatus(if cycle % 2 == 0 { 0x15 } else { 0x35 }));
        reports += ill.cell.run(1).len();
    }
    assert_eq!(reports, 5);
}
