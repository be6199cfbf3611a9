//! The real-time formats of both directions, as a scanner writes and reads them.

use ethernet_ip::connection::RealTimeFormat::{self, Heartbeat, Modeless, RunIdleHeader, ZeroLength};
use ethernet_ip::{ConnectionConfig, IO_PORT, class1};
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Machine, Port, Source};

use crate::cell::{ROBOT, wanted};
use crate::client::peer;
use crate::scanner_alone::Dialogue;

/// Bytes before what a frame carries behind its sequence count.
const HEAD: usize = 20;

fn config(consumed_format: RealTimeFormat, produced_format: RealTimeFormat) -> ConnectionConfig {
    ConnectionConfig { consumed_format, produced_format, o_t_size: 3, t_o_size: 3, ..wanted() }
}

/// Returns a scanner whose connection is open, with outputs of 9.
fn open(consumed_format: RealTimeFormat, produced_format: RealTimeFormat) -> Dialogue {
    let mut dialogue = Dialogue::opening_of(config(consumed_format, produced_format));
    dialogue.open(1_000);
    dialogue.scanner.connection_mut(dialogue.id).unwrap().set_output(&[9; 3]).unwrap();
    dialogue
}

/// Returns what the next cyclic frame carries behind its sequence count.
fn sent(dialogue: &mut Dialogue, run: bool) -> Vec<u8> {
    dialogue.scanner.connection_mut(dialogue.id).unwrap().set_run(run);
    let mut buf = vec![0; FRAME_CAPACITY];
    let frame = dialogue.scanner.poll_transmit(dialogue.now, &mut buf).unwrap();
    dialogue.now += Duration::from_millis(1);
    buf[HEAD..frame.len].to_vec()
}

/// Receives a frame that carries these bytes. Returns whether it was taken, and the inputs.
fn receive(dialogue: &mut Dialogue, sequence: u32, payload: &[u8]) -> (bool, Option<Vec<u8>>) {
    let before = dialogue.counters().received;
    let mut frame = [0; 64];
    let len = class1::emit(&mut frame, (2, sequence, sequence as u16), None, payload).unwrap();
    let from = Source { port: Port::Udp(IO_PORT), peer: Some(peer(ROBOT, IO_PORT)) };
    dialogue.scanner.handle_frame(dialogue.now, from, &frame[..len]);
    let input = dialogue.scanner.connection(dialogue.id).unwrap().input().map(<[u8]>::to_vec);
    (dialogue.counters().received > before, input)
}

#[test]
fn each_format_asks_for_the_size_of_what_its_frames_carry() {
    let sizes = [Modeless, ZeroLength, Heartbeat, RunIdleHeader].map(|format| {
        let config = config(format, format);
        (config.o_t().size, config.t_o().size)
    });
    assert_eq!(sizes, [(5, 5), (5, 5), (2, 2), (9, 9)], "with the sequence count");
}

#[test]
fn each_format_shows_run_and_idle_to_the_adapter_in_its_own_way_or_not_at_all() {
    let frames = |format| {
        let mut dialogue = open(format, Modeless);
        [true, false].map(|run| sent(&mut dialogue, run))
    };
    assert_eq!(frames(Modeless), [[9; 3], [9; 3]]);
    assert_eq!(frames(ZeroLength), [vec![9; 3], vec![]]);
    assert_eq!(frames(Heartbeat), [[]; 2]);
    assert_eq!(frames(RunIdleHeader), [[1, 0, 0, 0, 9, 9, 9], [0, 0, 0, 0, 9, 9, 9]]);
}

#[test]
fn an_adapter_that_sends_data_alone_is_in_run_and_nothing_is_no_frame_of_it() {
    let mut dialogue = open(RunIdleHeader, Modeless);
    assert_eq!(receive(&mut dialogue, 1, &[7; 3]), (true, Some(vec![7; 3])));
    assert_eq!(receive(&mut dialogue, 2, &[]), (false, Some(vec![7; 3])));
    assert_eq!(receive(&mut dialogue, 3, &[1, 0, 0, 0, 8, 8, 8]), (false, Some(vec![7; 3])));
}

#[test]
fn an_adapter_that_sends_nothing_in_idle_has_no_inputs_until_it_runs_again() {
    let mut dialogue = open(RunIdleHeader, ZeroLength);
    assert_eq!(receive(&mut dialogue, 1, &[7; 3]), (true, Some(vec![7; 3])));
    assert_eq!(receive(&mut dialogue, 2, &[]), (true, None));
    assert_eq!(receive(&mut dialogue, 3, &[8; 2]), (false, None));
    assert_eq!(receive(&mut dialogue, 4, &[9; 3]), (true, Some(vec![9; 3])));
}

#[test]
fn an_adapter_that_sends_a_heartbeat_alone_is_up_without_inputs() {
    let mut dialogue =
        Dialogue::opening_of(ConnectionConfig { t_o_size: 0, ..config(RunIdleHeader, Heartbeat) });
    dialogue.open(1_000);
    assert_eq!(receive(&mut dialogue, 1, &[]), (true, Some(vec![])));
    assert_eq!(receive(&mut dialogue, 2, &[1]), (false, Some(vec![])));
}
