//! The override: by a run's schedule, by an order between and in runs, and one that is none.

use ::node::Node as _;
use machine::{Duration, Instant};
use plc_node::ExecutionType::{self, Cm};
use plc_node::process::{PlcInstruction, PlcOrder, PlcRefusal};
use plc_node::{OverrideSchedule, PlcEvent};

use crate::scripted::{Cell, cell, pause, start, until_ready, wait_for};

fn override_of(cell: &Cell) -> u8 {
    cell.a().command().override_percent
}

/// Returns the changes of the override and their times since the start edge, in ms of the PLC's scans, until the run
/// finishes.
fn changes(cell: &mut Cell, execution_type: ExecutionType) -> Vec<(u64, u8)> {
    start(cell, execution_type);
    let started: Instant = wait_for(cell, |event| match event {
        PlcEvent::Started { at, .. } => Some(at),
        _ => None,
    });
    let mut changes = vec![(0, override_of(cell))];
    for _ in 0..200 {
        pause(cell, Duration::from_millis(1));
        let now = override_of(cell);
        if changes.last().is_some_and(|(_, last)| *last != now) {
            changes.push((cell.now().since(started).as_millis() as u64, now));
        }
    }
    wait_for(cell, |event| matches!(event, PlcEvent::Finished(_)).then_some(()));
    changes
}

fn order(cell: &mut Cell, json: &str) -> Option<PlcRefusal> {
    let instruction: PlcInstruction = serde_json::from_str(json).unwrap();
    cell.command_a(|plc, now| plc.order(now, PlcOrder::from(instruction)))
}

#[test]
fn a_schedule_counts_from_the_start_edge_of_each_run_and_its_last_step_stays() {
    let schedule: OverrideSchedule = "80,0@50ms,30@120.5ms".parse().unwrap();
    for execution_type in ExecutionType::ALL {
        let mut cell = cell(13);
        until_ready(&mut cell);
        cell.command_a(|plc, _| plc.schedule_overrides(Some(schedule)));
        assert_eq!(override_of(&cell), 100);
        for _ in 0..2 {
            // The scan after 120.5 ms is at 121 ms.
            let expected = [(0, 80), (50, 0), (121, 30)];
            assert_eq!(changes(&mut cell, execution_type), expected, "{execution_type}");
        }
        cell.command_a(|plc, _| plc.schedule_overrides(None));
        assert_eq!(changes(&mut cell, execution_type), [(0, 30)]);
    }
}

#[test]
fn an_order_sets_the_override_at_once_in_a_run_and_between_two() {
    let mut cell = cell(13);
    until_ready(&mut cell);
    assert_eq!(order(&mut cell, r#"{"set_override":{"percent":40}}"#), None);
    pause(&mut cell, Duration::from_millis(2));
    assert_eq!(override_of(&cell), 40);
    assert_eq!(order(&mut cell, r#"{"start":{"execution_type":"cm"}}"#), None);
    pause(&mut cell, Duration::from_millis(300));
    assert_eq!(override_of(&cell), 40, "without a schedule it stays");
    assert_eq!(order(&mut cell, r#"{"set_override":{"percent":0}}"#), None);
    pause(&mut cell, Duration::from_millis(2));
    assert_eq!(override_of(&cell), 0);
    wait_for(&mut cell, |event| matches!(event, PlcEvent::Finished(_)).then_some(()));
    assert_eq!(order(&mut cell, r#"{"start":{"execution_type":"cm","override":"70"}}"#), None);
    pause(&mut cell, Duration::from_millis(10));
    assert_eq!(override_of(&cell), 70);
}

#[test]
fn an_override_that_is_none_is_refused_in_words_and_the_run_goes_on_undisturbed() {
    let mut undisturbed = cell(13);
    until_ready(&mut undisturbed);
    let expected = crate::scripted::run(&mut undisturbed, Cm);
    let mut cell = cell(13);
    until_ready(&mut cell);
    start(&mut cell, Cm);
    pause(&mut cell, Duration::from_millis(300));
    for percent in ["300", "-1", "100.5"] {
        let refusal = order(&mut cell, &format!(r#"{{"set_override":{{"percent":{percent}}}}}"#));
        let Some(PlcRefusal::Override(error)) = refusal else { panic!("{refusal:?}") };
        let words = "it is 0 (the arm stops on its path) to 100 %";
        assert!(error.to_string().contains(percent) && error.to_string().contains(words), "{error}");
    }
    assert_eq!(override_of(&cell), 100);
    let execution = wait_for(&mut cell, |event| match event {
        PlcEvent::Finished(execution) => Some(execution),
        PlcEvent::Failed(failure) => panic!("{failure}"),
        _ => None,
    });
    assert_eq!(execution, expected);
}

#[test]
fn a_schedule_that_is_none_is_no_instruction_and_says_what_is_wrong() {
    let text = r#"{"start":{"execution_type":"cm","override":"50@1s,120@2s"}}"#;
    let error = serde_json::from_str::<PlcInstruction>(text).unwrap_err().to_string();
    assert!(error.contains("`120@2s`: an override of 120 % was asked for"), "{error}");
}
