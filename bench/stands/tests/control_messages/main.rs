//! The messages of the control port are those of its schema, and the schema has no others.

#![cfg(all(feature = "real", target_os = "linux"))]
#![expect(clippy::expect_used, reason = "a helper of a test may panic as the test may")]

mod json_schema;

use json_schema::Schema;
use machine::Counters;
use node::message::{CellText, Hello, Instruction, Message, NodeHost, PROTOCOL};
use node::report::{Allocations, LatenessReport, NodeReport};
use node::role::NodeRole;
use node::station_message::StationMessage;
use plc_node::process::{PlcInstruction, PlcMessage};
use plc_node::{Commanded, Execution, ExecutionType, Seen};
use robot_node::Disturbance;
use robot_node::process::{RobotInstruction, RobotMessage};
use serde::Serialize;
use serde_json::Value;

const SCHEMA: &str = include_str!("../../../../node/schemas/control.schema.json");

fn text() -> String {
    "a text".to_owned()
}

fn report() -> NodeReport {
    NodeReport {
        cycle: LatenessReport { runs: 3, buckets: vec![(1.5, 2), (3.0, 1)], ..LatenessReport::default() },
        allocations: Some(Allocations::default()),
        last_send_error: Some(text()),
        ..NodeReport::default()
    }
}

fn hello() -> Hello {
    Hello {
        protocol: PROTOCOL,
        node: NodeRole::Plc,
        setup: text(),
        bus: text(),
        interface: text(),
        mac: text(),
        warning: None,
        cell: Some(CellText { setup: text(), application: text() }),
        host: Some(NodeHost::this()),
    }
}

/// Returns each message that both nodes can send, with each optional part present and absent.
fn common<M: Clone>() -> Vec<Message<M>> {
    let all = vec![
        Message::Hello(hello()),
        Message::Hello(Hello { warning: Some(text()), cell: None, host: None, ..hello() }),
        Message::LinkUp,
        Message::LinkDown { reason: text() },
        Message::Address { address: [10, 0, 0, 1].into(), problem: None },
        Message::Address { address: [10, 0, 0, 1].into(), problem: Some(text()) },
        Message::Waiting { seconds: 10, reason: text(), is_owed: true },
        Message::Identity { text: text() },
        Message::Remark { text: text() },
        Message::Foreign { request: text() },
        Message::Owner { owner: text() },
        Message::Conflict { conflict: text() },
        Message::Report(report()),
        Message::Report(NodeReport::default()),
        Message::Farewell { report: Some(report()), problem: None },
        Message::Farewell { report: None, problem: Some(text()) },
        Message::Busy { controller: ([127, 0, 0, 1], 7700).into() },
        Message::Denied { reason: text() },
    ];
    // A new message does not compile here: add it above and to the schema.
    for message in &all {
        match message {
            Message::Hello(_) | Message::LinkUp | Message::LinkDown { .. } | Message::Address { .. } => {}
            Message::Waiting { .. } | Message::Remark { .. } | Message::Foreign { .. } => {}
            Message::Identity { .. } => {}
            Message::Owner { .. } | Message::Conflict { .. } | Message::Report(_) => {}
            Message::Farewell { .. } | Message::Busy { .. } | Message::Denied { .. } | Message::Node(_) => {}
        }
    }
    all
}

fn execution() -> Execution {
    Execution {
        execution_type: ExecutionType::Cm,
        execution_time_ns: 3_700_000_000,
        robot_execution_ns: 3_690_000_000,
        motions: 13,
        blends_suppressed: 0,
        scans: 3_700,
        frames: Counters::default(),
        commanded: Commanded { motions: 13, digest: u64::MAX, override_percent: [100; 2], end: [-1.5; 6] },
        seen: Some(Seen::default()),
        after: Some(7),
        zone_wait_ns: None,
    }
}

fn of_plc() -> Vec<PlcMessage> {
    let execution_type = ExecutionType::Sm;
    let all = vec![
        PlcMessage::ImageBad,
        PlcMessage::ImageGood,
        PlcMessage::LifeStill,
        PlcMessage::MovingToStart,
        PlcMessage::Ready,
        PlcMessage::Started { execution_type, at_ns: 1, after: 65_535 },
        PlcMessage::Passed { mark: 1, came_ns: 2, passed_ns: 3 },
        PlcMessage::Finished(execution()),
        PlcMessage::Finished(Execution { seen: None, after: None, zone_wait_ns: Some(5), ..execution() }),
        PlcMessage::Failed { execution_type, reason: text() },
        PlcMessage::Refused { reason: text() },
    ];
    for message in &all {
        match message {
            PlcMessage::ImageBad | PlcMessage::ImageGood | PlcMessage::LifeStill => {}
            PlcMessage::MovingToStart | PlcMessage::Ready | PlcMessage::Started { .. } => {}
            PlcMessage::Passed { .. } | PlcMessage::Finished(_) | PlcMessage::Failed { .. } => {}
            PlcMessage::Refused { .. } => {}
        }
    }
    all
}

fn of_robot() -> Vec<RobotMessage> {
    let executed = |began_ns| RobotMessage::Executed {
        number: 7,
        motions: 13,
        execution_ns: 9,
        began_ns,
        quality: robot_node::quality::Quality::default(),
        account: robot_node::Account::default(),
    };
    let all = vec![
        executed(None),
        executed(Some(5)),
        RobotMessage::ImagesAltered(true),
        RobotMessage::ImagesOutdated(false),
        RobotMessage::LifeStill,
        RobotMessage::DrivesFailed(text()),
        RobotMessage::Trouble { number: 7, reason: text() },
        RobotMessage::Refused { reason: text() },
    ];
    for message in &all {
        match message {
            RobotMessage::Executed { .. } | RobotMessage::ImagesAltered(_) => {}
            RobotMessage::ImagesOutdated(_) | RobotMessage::LifeStill | RobotMessage::DrivesFailed(_) => {}
            RobotMessage::Trouble { .. } | RobotMessage::Refused { .. } => {}
        }
    }
    all
}

fn instructions<O>(of_node: Vec<O>) -> Vec<Instruction<O>> {
    let mut all =
        vec![Instruction::Token(text()), Instruction::Report, Instruction::Stop, Instruction::Record(true)];
    all.extend(of_node.into_iter().map(Instruction::Node));
    for instruction in &all {
        match instruction {
            Instruction::Token(_) | Instruction::Report | Instruction::Stop => {}
            Instruction::Record(_) | Instruction::Node(_) => {}
        }
    }
    all
}

fn to_plc() -> Vec<PlcInstruction> {
    let start = |overrides| PlcInstruction::Start { execution_type: ExecutionType::Cm, overrides };
    let schedule = "80,0@2s,100@3s".parse().expect("a schedule");
    let all = vec![
        start(None),
        start(Some(schedule)),
        PlcInstruction::SetOverride { percent: 50.5 },
        PlcInstruction::Abort,
    ];
    for instruction in &all {
        match instruction {
            PlcInstruction::Start { .. } | PlcInstruction::SetOverride { .. } | PlcInstruction::Abort => {}
        }
    }
    all
}

fn to_robot() -> Vec<RobotInstruction> {
    [Disturbance::Fault, Disturbance::Stop, Disturbance::Block, Disturbance::Release]
        .map(|disturbance| match disturbance {
            Disturbance::Fault | Disturbance::Stop | Disturbance::Block | Disturbance::Release => {
                RobotInstruction::Disturb { axis: 6, disturbance }
            }
        })
        .to_vec()
}

/// Checks that each line conforms to one branch of a definition alone, and each branch has a line.
fn check(definition: &str, lines: &[String]) {
    let root: Value = serde_json::from_str(SCHEMA).expect("the schema is JSON");
    let schema = Schema::new(&root);
    let mut seen = vec![0; schema.branch_count(definition)];
    for line in lines {
        let value: Value = serde_json::from_str(line).expect("a message is JSON");
        let branches = schema.branches(definition, &value);
        assert_eq!(branches.len(), 1, "{definition}: {line}: {:?}", schema.check(definition, &value));
        seen[branches[0]] += 1;
    }
    assert!(seen.iter().all(|count| *count > 0), "{definition}: branches without a message: {seen:?}");
}

fn with_stations<M: Clone + Serialize>(messages: Vec<Message<M>>) -> Vec<String> {
    let named =
        |message: &Message<M>| StationMessage { station: Some("left".to_owned()), message: message.clone() };
    let with = messages.iter().map(|message| named(message).to_json()).collect::<Vec<_>>();
    messages.iter().map(Message::to_json).chain(with).collect()
}

fn results<M: Serialize>(messages: &[M]) -> Vec<String> {
    messages.iter().map(|message| serde_json::to_string(message).expect("JSON")).collect()
}

#[test]
fn every_message_of_a_node_is_in_the_schema_of_the_control_port_and_the_schema_has_no_other() {
    let plc = [common(), of_plc().into_iter().map(Message::Node).collect()].concat();
    check("plc_message", &with_stations(plc));
    check("plc_result", &results(&of_plc()));
    let robot = [common(), of_robot().into_iter().map(Message::Node).collect()].concat();
    check("robot_message", &robot.iter().map(Message::to_json).collect::<Vec<_>>());
    check("robot_result", &results(&of_robot()));
}

#[test]
fn every_instruction_is_in_the_schema_of_the_control_port_and_what_it_allows_is_read() {
    check("plc_instruction", &results(&instructions(to_plc())));
    check("robot_instruction", &results(&instructions(to_robot())));
    for line in [
        r#"{"node":{"start":{"execution_type":"rc"}}}"#,
        r#"{"node":{"set_override":{"percent":50}}}"#,
        r#"{"node":"abort"}"#,
        r#"{"token":"0123456789abcdef"}"#,
    ] {
        check_one("plc_instruction", line);
        assert!(serde_json::from_str::<Instruction<PlcInstruction>>(line).is_ok(), "{line}");
    }
}

#[test]
fn an_instruction_with_a_key_that_the_schema_does_not_have_is_not_read() {
    for line in [
        r#"{"node":{"start":{"execution_type":"rc","speed":"50"}}}"#,
        r#"{"node":{"set_override":{"percent":50,"seconds":2}}}"#,
        r#"{"node":"abort","report":null}"#,
    ] {
        assert!(branches_of("plc_instruction", line).is_empty(), "{line}");
        assert!(serde_json::from_str::<Instruction<PlcInstruction>>(line).is_err(), "{line}");
    }
    let line = r#"{"node":{"disturb":{"axis":1,"disturbance":"stop","seconds":2}}}"#;
    assert!(branches_of("robot_instruction", line).is_empty());
    assert!(serde_json::from_str::<Instruction<RobotInstruction>>(line).is_err());
}

fn branches_of(definition: &str, line: &str) -> Vec<usize> {
    let root: Value = serde_json::from_str(SCHEMA).expect("the schema is JSON");
    Schema::new(&root).branches(definition, &serde_json::from_str(line).expect("JSON"))
}

fn check_one(definition: &str, line: &str) {
    let root: Value = serde_json::from_str(SCHEMA).expect("the schema is JSON");
    let value = serde_json::from_str(line).expect("JSON");
    assert_eq!(Schema::new(&root).check(definition, &value), Ok(()), "{line}");
}

#[test]
fn the_schema_refuses_what_is_not_a_message() {
    let root: Value = serde_json::from_str(SCHEMA).expect("the schema is JSON");
    for line in [
        r#""link_down""#,
        r#"{"link_down":{}}"#,
        r#"{"link_down":{"reason":7}}"#,
        r#"{"link_down":{"reason":"a","more":1}}"#,
        r#"{"node":"dance"}"#,
        r#"{"station":7,"link_up":null}"#,
    ] {
        let value = serde_json::from_str(line).expect("JSON");
        assert!(Schema::new(&root).check("plc_message", &value).is_err(), "{line}");
    }
}
