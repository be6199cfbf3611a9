//! What a recorder sees of the frames on a cable.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::ops::Range;
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

use capture_file::Packet;
use protocol_linux::{Interface, Recorder, RecorderError, clock};

use super::machines::{Cable, PRIORITY_TAG, Station};
use super::test_network::{ADDRESSES, TIMEOUT, TestNetwork};

/// UDP port that nothing else uses.
const NUMBERS: u16 = 4_200;

/// Frames that a recorder holds while its listener is busy.
const SLOTS: u32 = 4_096;

/// Sends numbered datagrams to everybody, so that no address resolution is among them.
fn send(network: &TestNetwork, numbers: Range<u32>) {
    network.run(0, |_| {
        let socket = UdpSocket::bind(SocketAddrV4::new(ADDRESSES[0], 0)).unwrap();
        socket.set_broadcast(true).unwrap();
        for number in numbers {
            let to = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 255), NUMBERS);
            socket.send_to(&number.to_be_bytes(), to).unwrap();
        }
    });
}

/// Returns the number in such a frame: Ethernet, 14 bytes; IPv4, 20; UDP, 8. `None` for other frames.
fn number(frame: &[u8]) -> Option<u32> {
    let is_ours = frame.get(12..14)? == [8, 0] && frame.get(36..38)? == NUMBERS.to_be_bytes();
    let number = frame.get(42..46).filter(|_| is_ours)?;
    number.try_into().ok().map(u32::from_be_bytes)
}

/// Records the numbers that pass the near end.
fn numbers(network: &TestNetwork) -> (Recorder, Receiver<u32>) {
    let (sender, numbers) = mpsc::channel();
    let see = move |_, packet: &Packet<'_>| {
        if let Some(number) = number(packet.data) {
            assert_eq!(packet.sent, Some(true));
            let _ = sender.send(number);
        }
    };
    (network.run(0, |near| Recorder::watch(near, see).unwrap()), numbers)
}

pub(crate) fn frames_come_out_in_order_after_the_ring_wrapped_many_times() {
    let network = TestNetwork::new();
    let (recorder, numbers) = numbers(&network);
    let some = SLOTS / 2;
    for round in 0..7 {
        let sent = round * some..(round + 1) * some;
        send(&network, sent.clone());
        for number in sent {
            assert_eq!(numbers.recv_timeout(TIMEOUT), Ok(number));
        }
    }
    recorder.stop().unwrap();
}

pub(crate) fn a_listener_that_is_busy_for_too_long_gets_the_number_of_missed_frames() {
    let network = TestNetwork::new();
    let (go, wait) = mpsc::channel::<()>();
    let (sender, seen) = mpsc::channel();
    let see = move |_, packet: &Packet<'_>| {
        if let Some(number) = number(packet.data) {
            let _ = sender.send(number);
            let _ = wait.recv();
        }
    };
    let recorder = network.run(0, |near| Recorder::watch(near, see).unwrap());
    send(&network, 0..1);
    assert_eq!(seen.recv(), Ok(0));
    let more = SLOTS + 100;
    send(&network, 1..1 + more);
    drop(go);
    let missed = match recorder.stop() {
        Err(RecorderError::LeftOut { frames }) => frames,
        other => unreachable!("{other:?}"),
    };
    let seen: Vec<_> = seen.iter().collect();
    assert_eq!(seen, Vec::from_iter(1..=seen.len() as u32));
    // Where IPv6 cannot be switched off, frames of the kernel may be among both the missed and the received ones.
    assert!((100..120).contains(&missed), "{missed}");
    assert!(seen.len() as u64 + missed >= u64::from(more));
}

pub(crate) fn no_frame_of_another_interface_and_none_while_paused_is_seen() {
    let network = TestNetwork::new();
    let (sender, elsewhere) = mpsc::channel();
    let see = move |_, packet: &Packet<'_>| {
        let _ = number(packet.data).map(|number| sender.send(number));
    };
    let loopback = || {
        let loopback = Interface::open("lo").unwrap();
        loopback.set_up().unwrap();
        Recorder::watch(&loopback, see).unwrap()
    };
    let on_loopback = network.ends[0].0.run(loopback).unwrap();
    let (recorder, numbers) = numbers(&network);
    send(&network, 1..2);
    recorder.pause(true).unwrap();
    send(&network, 2..3);
    recorder.pause(false).unwrap();
    send(&network, 3..4);
    recorder.stop().unwrap();
    on_loopback.stop().unwrap();
    assert_eq!(numbers.iter().collect::<Vec<_>>(), [1, 3]);
    assert_eq!(elsewhere.iter().next(), None);
}

pub(crate) fn a_frame_has_the_instant_at_which_it_passed() {
    // The two clocks differ: one may be ahead of the other by this much.
    const AHEAD: Duration = Duration::from_millis(1);
    let network = TestNetwork::new();
    let (sender, instants) = mpsc::channel();
    let see = move |_, packet: &Packet<'_>| {
        let _ = number(packet.data).map(|_| sender.send(packet.since_1970));
    };
    let recorder = network.run(0, |near| Recorder::watch(near, see).unwrap());
    let before = clock::utc();
    send(&network, 1..2);
    let after = clock::utc();
    recorder.stop().unwrap();
    let passed = instants.iter().next().unwrap();
    assert!((before - AHEAD..=after + AHEAD).contains(&passed), "{before:?}, {passed:?}, {after:?}");
}

pub(crate) fn a_removed_interface_is_reported_as_an_error() {
    let network = TestNetwork::new();
    let (recorder, _numbers) = numbers(&network);
    let TestNetwork { ends: [(network, name), far] } = network;
    drop(far);
    // The kernel removes the far end, and the near one with it, some time after its last user has gone.
    let started = std::time::Instant::now();
    while network.run(|| Interface::open(name).is_ok()).unwrap() {
        assert!(started.elapsed() < TIMEOUT, "the interface is still there");
        std::thread::sleep(Duration::from_millis(1));
    }
    let error = recorder.stop().unwrap_err();
    assert!(matches!(error, RecorderError::Socket { .. }), "{error}");
    assert!(error.to_string().starts_with("cannot capture on left0: Network is down"), "{error}");
}

pub(crate) fn a_tag_that_the_kernel_removed_from_a_received_frame_is_put_back() {
    let network = TestNetwork::new();
    let (sender, tags) = mpsc::channel();
    let see = move |_, packet: &Packet<'_>| {
        if packet.sent == Some(false) && packet.data.get(16..18) == Some(&super::machines::ETHERTYPE) {
            let _ = sender.send(packet.data[12..16].to_vec());
        }
    };
    let recorder = network.run(1, |far| Recorder::watch(far, see).unwrap());
    let nobody = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
    let station =
        network.start(0, |near| Station::new(Cable::PriorityTagged, near.mac(), nobody, clock::now()));
    let tag = tags.recv_timeout(TIMEOUT);
    station.stop();
    recorder.stop().unwrap();
    assert_eq!(tag.as_deref(), Ok(&PRIORITY_TAG[..]));
}
