//! Networks of more than two nodes: clocks, cables with faults, switches, streams and taps.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

mod talker;

use std::cell::RefCell;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::rc::Rc;

use machine::ethernet::Mac;
use machine::{Attempt, Duration, Instant, InterfaceId, StreamChange};
use talker::{Talker, address, mac};
use virtual_time::{
    CableId, Carrier, Clock, Impairment, Network, NodeId, Plug, Side, StationConfig, SwitchConfig, SwitchId,
};

const MS: Duration = Duration::from_millis(1);
const US: Duration = Duration::from_micros(1);
/// A frame and when it arrived.
type Heard = (Instant, Vec<u8>);

const ONE: InterfaceId = InterfaceId::FIRST;

/// A switch of 100 Mbit/s that forwards in 10 µs.
const SWITCH: SwitchConfig =
    SwitchConfig { forwarding: Duration::from_micros(10), bits_per_second: Some(100_000_000), queue_len: 8 };

/// Time of the shortest frame at 100 Mbit/s: 84 bytes with preamble, checksum and gap.
const SHORTEST: Duration = Duration::from_nanos(6_720);

fn delay(delay: Duration) -> Impairment {
    Impairment { delay, ..Impairment::default() }
}

fn at(time: Duration) -> Instant {
    Instant::ZERO + time
}

/// A network of so many talkers on a switch, each on a cable with this delay.
fn star(stations: u8, seed: u64, config: SwitchConfig, cable: Duration) -> (Network<Talker>, Vec<NodeId>) {
    let mut network = Network::with_switch(seed, config);
    let nodes = (0..stations).map(|number| {
        let config = StationConfig::new(mac(number), Some(address(number)), cable);
        network.add_station(
            SwitchId::FIRST,
            format!("station {number}"),
            Talker::with_mac(mac(number)),
            config,
        )
    });
    let nodes = nodes.collect();
    (network, nodes)
}

fn run(network: &mut Network<Talker>, until: Duration) {
    while network.next_event(at(until)).is_some() {}
}

fn heard(network: &Network<Talker>, node: NodeId) -> &[Heard] {
    &network.machine(node).unwrap().heard
}

fn cable_of(network: &Network<Talker>, node: NodeId) -> CableId {
    network.cable(node, ONE).unwrap()
}

#[test]
fn each_node_has_a_clock_of_its_own() {
    let clocks = [(0, 0), (500_000, 40_000), (7, -40_000)];
    let mut network = Network::new(1);
    let nodes = clocks.map(|(offset_ns, drift_ppb)| {
        network.add_node("clock", Talker::ticking(MS), Clock { offset_ns, drift_ppb })
    });
    run(&mut network, Duration::from_secs(10));
    let ticks = nodes.map(|node| network.machine(node).unwrap().ticks);
    let shown = nodes.map(|node| network.local_time(node).as_nanos());
    assert_eq!(shown, [10_000_000_000, 10_000_900_000, 9_999_600_007]);
    assert_eq!(ticks, [10_000, 10_000, 9_999]);
}

#[test]
fn a_frame_over_a_switch_takes_the_cable_the_forwarding_and_the_cable() {
    let (mut network, nodes) = star(3, 1, SWITCH, US * 3);
    network.command(nodes[0], |talker, _| talker.say_to(mac(2), b"x"));
    run(&mut network, MS);
    let [(arrived, _)] = heard(&network, nodes[2]) else { panic!("one frame arrives") };
    assert_eq!(*arrived, at(US * 3 + US * 10 + SHORTEST + US * 3));
    assert_eq!(network.forwarding_time(SwitchId::FIRST, 60), US * 10 + SHORTEST);
    assert!(heard(&network, nodes[1]).is_empty());
}

#[test]
fn a_switch_learns_where_a_station_is_and_sends_its_frames_nowhere_else() {
    let (mut network, nodes) = star(3, 1, SWITCH, US);
    let sent_to_1 =
        |network: &Network<Talker>| network.link_counters(cable_of(network, nodes[1]), Side::B).sent;
    network.command(nodes[0], |talker, _| talker.say_to(mac(2), b"to whom"));
    run(&mut network, MS);
    assert_eq!(sent_to_1(&network), 1, "an unknown address goes to all");
    network.command(nodes[2], |talker, _| talker.say_to(mac(0), b"I am here"));
    run(&mut network, MS * 2);
    network.command(nodes[0], |talker, _| talker.say_to(mac(2), b"to you"));
    run(&mut network, MS * 3);
    assert_eq!(sent_to_1(&network), 1);
    assert_eq!(heard(&network, nodes[2]).len(), 2);
    network.command(nodes[1], |talker, _| talker.say_to(Mac([0xFF; 6]), b"to all"));
    run(&mut network, MS * 4);
    assert_eq!([0, 1, 2].map(|node: usize| heard(&network, nodes[node]).len()), [2, 0, 3]);
}

/// Returns what stations 0 and 1 hear of each other while 2 and 3 talk too, the latter by a cable with these faults, and what
/// that cable loses of the frames of station 3.
fn beside(seed: u64, faulty: Impairment) -> ([Vec<Heard>; 2], u64) {
    let (mut network, nodes) = star(4, seed, SWITCH, US);
    for node in &nodes {
        network.command(*node, |talker, _| talker.say_to(Mac([0xFF; 6]), b"here"));
    }
    run(&mut network, MS);
    // All cables draw random numbers, so that a shifted stream would show.
    let jitter = Impairment { loss_ppm: 100_000, jitter: US * 50, ..delay(US) };
    for (node, impairment) in nodes.iter().zip([jitter, jitter, jitter, faulty]) {
        for side in [Side::A, Side::B] {
            network.set_impairment(cable_of(&network, *node), side, impairment);
        }
    }
    for round in 1..300 {
        for (node, to) in [(0, 1), (1, 0), (2, 3), (3, 2)] {
            network.command(nodes[node], |talker, _| talker.say_to(mac(to), &[node as u8; 30]));
        }
        run(&mut network, MS * (round + 1));
    }
    let lost = network.link_counters(cable_of(&network, nodes[3]), Side::A).lost;
    ([0, 1].map(|node: usize| heard(&network, nodes[node]).to_vec()), lost)
}

#[test]
fn faults_of_one_cable_touch_no_other_one() {
    let (clean, lost) = beside(7, Impairment { loss_ppm: 100_000, ..delay(US) });
    assert!(clean.iter().all(|heard| heard.len() > 200) && (10..60).contains(&lost), "{lost}");
    let faulty = Impairment { loss_ppm: 1_000_000, corrupt_ppm: 9, jitter: US * 7, ..delay(US) };
    let (beside_faulty, all_lost) = beside(7, faulty);
    assert!(beside_faulty == clean && all_lost == 299, "{all_lost}");
    assert!(beside(7, faulty).0 == clean, "the same seed");
    assert!(beside(8, faulty).0 != clean, "another seed");
}

#[test]
fn a_cut_cable_isolates_one_station_and_loses_what_is_on_it() {
    let (mut network, nodes) = star(3, 1, SWITCH, US * 100);
    network.command(nodes[0], |talker, _| talker.say_to(Mac([0xFF; 6]), b"to all"));
    run(&mut network, US * 150);
    // The copies are on the cables of stations 1 and 2.
    network.set_cut(cable_of(&network, nodes[2]), true);
    run(&mut network, MS);
    assert_eq!((heard(&network, nodes[1]).len(), heard(&network, nodes[2]).len()), (1, 0));
    assert_eq!(network.link_counters(cable_of(&network, nodes[2]), Side::B).lost, 1);
    assert_eq!(network.link_counters(cable_of(&network, nodes[1]), Side::B).lost, 0);
    network.set_cut(cable_of(&network, nodes[2]), false);
    network.command(nodes[0], |talker, _| talker.say_to(Mac([0xFF; 6]), b"again"));
    run(&mut network, MS * 2);
    assert_eq!((heard(&network, nodes[1]).len(), heard(&network, nodes[2]).len()), (2, 1));
}

#[test]
fn a_full_queue_drops_and_counts_and_the_rest_leaves_at_the_bit_rate() {
    let (mut network, nodes) = star(3, 1, SWITCH, US);
    network.command(nodes[2], |talker, _| talker.say_to(mac(0), b"here"));
    run(&mut network, MS);
    for node in [0, 1] {
        network.command(nodes[node], |talker, _| (0..10).for_each(|_| talker.say_to(mac(2), b"x")));
    }
    run(&mut network, MS * 2);
    let counters = network.switch_counters(SwitchId::FIRST, cable_of(&network, nodes[2]));
    assert_eq!((counters.forwarded, counters.dropped, counters.longest_queue), (8, 12, 8));
    let arrivals: Vec<_> = heard(&network, nodes[2]).iter().map(|(at, _)| *at).collect();
    assert_eq!(arrivals.len(), 8);
    assert!(arrivals.windows(2).all(|two| two[1].since(two[0]) == SHORTEST));
}

#[test]
fn stations_that_answer_each_broadcast_by_one_are_bounded_by_the_queues() {
    let (mut network, nodes) = star(8, 1, SWITCH, US);
    for node in &nodes {
        network.command(*node, |talker, _| talker.answers_all = true);
    }
    network.command(nodes[0], |talker, _| talker.say_to(Mac([0xFF; 6]), b"storm"));
    run(&mut network, MS * 20);
    for node in &nodes {
        let counters = network.switch_counters(SwitchId::FIRST, cable_of(&network, *node));
        assert!(counters.longest_queue == SWITCH.queue_len && counters.dropped > 0, "{counters:?}");
        // A port sends at most one shortest frame in its time.
        let most = (MS * 20).as_nanos() / SHORTEST.as_nanos() + 1 + SWITCH.queue_len as u128;
        assert!(u128::from(counters.forwarded) <= most, "{counters:?}");
    }
}

/// Returns what a station hears of a stream from another one, and its changes, over cables with these faults.
fn streamed(seed: u64, cable: Impairment, said: &[u8]) -> (Vec<u8>, Vec<(Instant, StreamChange)>) {
    let (mut network, nodes) = star(4, seed, SWITCH, US);
    for node in &nodes {
        network.set_impairment(cable_of(&network, *node), Side::A, cable);
        network.set_impairment(cable_of(&network, *node), Side::B, cable);
    }
    for (from, to) in [(0, 3), (2, 1)] {
        network.command(nodes[from], |talker, _| {
            talker.connect = Some((SocketAddrV4::new(address(to), 7), Attempt(from as u16)));
            talker.stream_out = said.to_vec();
        });
    }
    run(&mut network, Duration::from_secs(120));
    let [one, other] = [3, 1].map(|node: usize| network.machine(nodes[node]).unwrap());
    assert_eq!(one.stream_in, other.stream_in);
    (one.stream_in.clone(), network.machine(nodes[0]).unwrap().changes.clone())
}

#[test]
fn streams_between_stations_arrive_complete_and_in_order_over_lossy_cables() {
    let said: Vec<u8> = (0..9_000_u32).map(|number| number as u8 ^ (number >> 8) as u8).collect();
    let cable = Impairment { loss_ppm: 100_000, jitter: MS, duplicate_ppm: 100_000, ..delay(US) };
    let (stream, changes) = streamed(3, cable, &said);
    assert!(stream == said, "{} of {} bytes", stream.len(), said.len());
    assert!(matches!(changes[..], [(_, StreamChange::Connected(Attempt(0)))]), "{changes:?}");
    assert_eq!(streamed(3, cable, &said).1, changes);
    assert_ne!(streamed(4, cable, &said).1, changes);
}

#[test]
fn a_stream_waits_for_either_cable_and_closes_at_both_ends_if_it_stays_cut() {
    for cut in [0, 3] {
        let (mut network, nodes) = star(4, 1, SWITCH, US);
        let connect = Some((SocketAddrV4::new(address(3), 7), Attempt(1)));
        network.command(nodes[0], |talker, _| talker.connect = connect);
        run(&mut network, MS * 10);
        let cable = cable_of(&network, nodes[cut]);
        network.set_cut(cable, true);
        network.command(nodes[0], |talker, _| talker.stream_out = b"late".to_vec());
        run(&mut network, MS * 1_000);
        assert_eq!(network.machine(nodes[3]).unwrap().stream_in, b"");
        network.set_cut(cable_of(&network, nodes[1]), true);
        network.set_cut(cable_of(&network, nodes[1]), false);
        assert_eq!(network.machine(nodes[3]).unwrap().stream_in, b"", "the cable of another station");
        network.set_cut(cable, false);
        run(&mut network, MS * 1_001);
        assert_eq!(network.machine(nodes[3]).unwrap().stream_in, b"late");
        network.set_cut(cable, true);
        network.command(nodes[0], |talker, _| talker.stream_out = b"never".to_vec());
        run(&mut network, MS * 9_000);
        for node in [0, 3] {
            let last = network.machine(nodes[node]).unwrap().changes.last().copied();
            assert_eq!(last, Some((at(MS * 4_001), StreamChange::Closed)), "cut at {cut}, seen by {node}");
        }
    }
}

#[test]
fn a_refused_connection_and_one_to_nobody_end_as_over_a_cable() {
    let (mut network, nodes) = star(2, 1, SWITCH, US);
    for (to, port, attempt) in [(address(1), 8, 1), (Ipv4Addr::new(10, 0, 0, 99), 7, 2)] {
        network.command(nodes[0], |talker, _| {
            talker.connect = Some((SocketAddrV4::new(to, port), Attempt(attempt)));
        });
    }
    run(&mut network, Duration::from_secs(10));
    let changes = &network.machine(nodes[0]).unwrap().changes;
    let [(refused, first), (late, second)] = changes[..] else { panic!("{changes:?}") };
    assert_eq!(first, StreamChange::NotConnected(Attempt(1)));
    assert!(refused < at(MS), "{refused:?}");
    assert_eq!((late, second), (at(MS * 3_000), StreamChange::NotConnected(Attempt(2))));
}

#[test]
fn a_tap_sees_each_frame_at_both_ends_of_each_cable() {
    let (mut network, nodes) = star(3, 1, SWITCH, US);
    let seen = Rc::new(RefCell::new(Vec::new()));
    let tap = Rc::clone(&seen);
    network.set_tap(move |tapped| {
        let is_stream = matches!(tapped.carrier, Carrier::Tcp { .. });
        tap.borrow_mut().push((tapped.cable.index(), tapped.end, tapped.from, tapped.at, is_stream));
    });
    network.command(nodes[0], |talker, _| talker.say_to(Mac([0xFF; 6]), b"x"));
    run(&mut network, MS);
    let leaves = at(US + US * 10 + SHORTEST);
    let (a, b) = (Side::A, Side::B);
    assert_eq!(
        *seen.borrow(),
        [
            (0, a, a, at(Duration::ZERO), false),
            (0, b, a, at(US), false),
            (1, b, b, leaves, false),
            (2, b, b, leaves, false),
            (1, a, b, leaves + US, false),
            (2, a, b, leaves + US, false),
        ]
    );
    seen.borrow_mut().clear();
    network.command(nodes[0], |talker, _| {
        talker.connect = Some((SocketAddrV4::new(address(2), 7), Attempt(1)));
        talker.stream_out = b"bytes".to_vec();
    });
    run(&mut network, MS * 2);
    // Every segment passes four ends: of the cables of stations 0 and 2, and of no other.
    let mut ends = [0; 6];
    for (cable, end, ..) in seen.borrow().iter() {
        ends[2 * cable + end.index()] += 1;
    }
    assert!(ends[0] > 2 && ends[2] == 0 && ends[3] == 0, "{ends:?}");
    assert_eq!((ends[0], ends[0], ends[0]), (ends[1], ends[4], ends[5]), "{ends:?}");
}

#[test]
fn a_network_stops_at_a_frame_of_any_cable() {
    let (mut network, nodes) = star(3, 1, SWITCH, US);
    network.stop_at_frame(cable_of(&network, nodes[2]), Side::B, Some(1));
    network.command(nodes[0], |talker, _| talker.say_to(mac(2), b"x"));
    assert_eq!(network.next_event(at(MS)), None);
    assert_eq!(network.now(), at(US), "the switch queues it as it arrives");
    run(&mut network, MS);
    assert_eq!(network.now(), at(MS));
}

#[test]
fn a_node_on_two_networks_and_one_on_two_interfaces_of_one_cable_keep_their_ports_apart() {
    let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
    let other = network.add_switch(SwitchConfig::IDEAL);
    let two = [InterfaceId(0), InterfaceId(1)];
    let cable = [delay(US); 2];
    // The PLC: each interface of the machine at a switch of its own.
    let plc = network.add_node("plc", talker::Homes::new(), Clock::default());
    for (on, switch) in two.into_iter().zip([SwitchId::FIRST, other]) {
        let nic = network.add_nic(plc, &[on], Some(mac(on.0)), None);
        network.connect([Plug::Nic(nic), Plug::Switch(switch)], cable).unwrap();
    }
    // Another: both on one interface of the host.
    let bridged = network.add_node("bridged", talker::Homes::new(), Clock::default());
    let nic = network.add_nic(bridged, &two, Some(mac(9)), None);
    network.connect([Plug::Nic(nic), Plug::Switch(SwitchId::FIRST)], cable).unwrap();
    assert_eq!(network.connect([Plug::Nic(nic), Plug::Switch(other)], cable), None, "it has a cable");
    network.command(plc, |homes, _| homes.say(InterfaceId(0), talker::ETHER_TYPES[1], mac(9)));
    while network.next_event(at(MS)).is_some() {}
    network.command(bridged, |homes, _| homes.say(InterfaceId(1), talker::ETHER_TYPES[0], mac(0)));
    network.command(bridged, |homes, _| homes.say(InterfaceId(0), talker::ETHER_TYPES[0], mac(1)));
    while network.next_event(at(MS * 2)).is_some() {}
    assert_eq!(network.machine(bridged).unwrap().heard, [InterfaceId(1)]);
    assert_eq!(network.machine(plc).unwrap().heard, [InterfaceId(0)]);
}

#[test]
#[should_panic = "time does not move: the hasty one asks at 0.002"]
fn a_machine_whose_timeout_never_moves_ends_the_run_with_its_name() {
    let mut network = Network::new(1);
    network.add_node("the patient one", Talker::ticking(MS), Clock::default());
    network.add_node("the hasty one", Talker::stuck_at(at(MS * 2)), Clock::default());
    run(&mut network, MS * 10);
}

#[test]
#[should_panic = "time does not move: station"]
fn two_that_answer_each_other_without_any_delay_end_the_run() {
    let (mut network, nodes) = star(2, 1, SwitchConfig::IDEAL, Duration::ZERO);
    for node in &nodes {
        network.command(*node, |talker, _| talker.answers_all = true);
    }
    network.command(nodes[0], |talker, _| talker.say_to(Mac([0xFF; 6]), b"x"));
    run(&mut network, MS);
}

#[test]
#[should_panic = "time does not move: the talkative one"]
fn a_machine_that_never_stops_sending_ends_the_run() {
    let mut network = Network::new(1);
    let mut machine = Talker::default();
    machine.is_endless = true;
    network.add_node("the talkative one", machine, Clock::default());
    run(&mut network, MS);
}
