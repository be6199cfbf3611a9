//! When a multicast T→O ends, by the application type of those who take part (volume 1, 3-6.4).

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::connection::{ConnectionType, OpenReply, OpenRequest};
use ethernet_ip::{ConnectionConfig, IO_PORT, class1};
use machine::{Duration, Instant, Machine, Port, Source};

use crate::cell::{PLC, ROBOT, up, wanted};
use crate::client::{
    Client, INPUT_ONLY_PATH, LISTEN_ONLY_PATH, Rig, close_message, heartbeat, owner, parameters,
};

const OTHER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 7);

/// Makes the T→O data of a request a multicast. Its heartbeat may be missing for half a second.
fn shared(request: OpenRequest<'static>) -> OpenRequest<'static> {
    OpenRequest { t_o: parameters(ConnectionType::Multicast, 258), ..request }
}

/// An owner whose frames come every millisecond or are missed after 16 ms, and those that joined its multicast.
struct Joined {
    rig: Rig,
    owner: Client,
    opened: OpenReply,
    next: u32,
    others: Vec<OpenReply>,
}

impl Joined {
    fn new(others: &[&'static [u8]]) -> Self {
        let mut rig = Rig::new();
        let (owner_client, viewer) = (rig.client(), rig.client_from(OTHER));
        let opened = rig.open(owner_client, &shared(owner(1)));
        let join = |(serial, path): (u16, &&'static [u8])| {
            rig.open(viewer, &OpenRequest { multiplier: 7, ..shared(heartbeat(serial, path)) })
        };
        let others: Vec<_> = (2..).zip(others).map(join).collect();
        assert!(others.iter().all(|other| other.t_o_id == opened.t_o_id), "one multicast");
        let mut joined = Self { rig, owner: owner_client, opened, next: 1, others };
        joined.run(10);
        joined
    }

    /// All send for some milliseconds.
    fn run(&mut self, millis: u32) {
        for _ in 0..millis {
            self.rig.io(PLC, self.opened.o_t_id, self.next, Some(true), &[1; 256]);
            self.others_send(1);
        }
    }

    /// The owner is silent for some milliseconds, and the others send.
    fn others_send(&mut self, millis: u32) {
        for _ in 0..millis {
            for other in &self.others {
                self.rig.io(OTHER, other.o_t_id, self.next, None, &[]);
            }
            self.next += 1;
            self.rig.advance(Duration::from_millis(1));
        }
    }

    fn close_owner(&mut self) {
        let answer = self.rig.request(self.owner, &close_message(owner(1).triad, &[]));
        assert_eq!(answer.status().0, 0);
    }

    /// Returns the number of frames of the multicast in the next 10 ms, while the others send.
    fn frames(&mut self) -> usize {
        let start: Instant = self.rig.now;
        self.others_send(10);
        let group = SocketAddrV4::new(Ipv4Addr::new(239, 192, 1, 32), IO_PORT);
        let id = self.opened.t_o_id.to_le_bytes();
        let is_its = |at: &Instant, to: &SocketAddrV4, frame: &[u8]| {
            *at >= start && *to == group && frame[6..10] == id
        };
        self.rig.datagrams.iter().filter(|(at, _, to, frame)| is_its(at, to, frame)).count()
    }
}

#[test]
fn who_only_reads_keeps_the_multicast_when_the_owner_closes_its_connection() {
    let mut joined = Joined::new(&[LISTEN_ONLY_PATH, INPUT_ONLY_PATH]);
    joined.close_owner();
    assert_eq!((joined.frames(), joined.rig.adapter.connections().0), (10, 2));
}

#[test]
fn who_only_listens_loses_the_multicast_when_the_owner_closes_its_connection() {
    let mut joined = Joined::new(&[LISTEN_ONLY_PATH, LISTEN_ONLY_PATH]);
    joined.close_owner();
    assert_eq!((joined.frames(), joined.rig.adapter.connections().0), (0, 0));
}

#[test]
fn the_multicast_of_an_owner_that_timed_out_ends_for_all_because_its_silence_tells_the_owner() {
    let mut joined = Joined::new(&[LISTEN_ONLY_PATH, INPUT_ONLY_PATH]);
    joined.others_send(20);
    assert_eq!((joined.frames(), joined.rig.adapter.connections().0), (0, 0));
}

#[test]
fn a_multicast_goes_on_when_one_who_only_reads_times_out() {
    let mut joined = Joined::new(&[INPUT_ONLY_PATH, LISTEN_ONLY_PATH]);
    let viewer = joined.others.remove(0);
    joined.run(600);
    joined.rig.datagrams.clear();
    assert_eq!((joined.frames(), joined.rig.adapter.connections().0), (10, 2));
    assert_eq!(viewer.t_o_id, joined.opened.t_o_id);
}

#[test]
fn what_one_host_gets_alone_goes_on_when_the_owner_of_a_multicast_times_out() {
    let mut joined = Joined::new(&[]);
    let viewer = joined.rig.client_from(OTHER);
    let alone = joined.rig.open(viewer, &heartbeat(5, INPUT_ONLY_PATH));
    joined.others.push(alone);
    joined.others_send(20);
    joined.rig.datagrams.clear();
    assert_eq!((joined.frames(), joined.rig.adapter.connections().0), (0, 1));
    assert_eq!(joined.rig.datagrams.len(), 10, "to this host");
}

#[test]
fn frames_in_a_group_are_told_apart_by_connection_number_and_sender() {
    let mut bus = up(ConnectionConfig { multicast: true, ..wanted() });
    // The adapter's first numbers: the multicast's, and that of the O→T data.
    const NUMBER: u32 = 0x0100_0001;
    let mut receive = |from, number| {
        let mut frame = [0; 512];
        let len = class1::emit(&mut frame, (number, 60, 60), None, &[9; 256]).unwrap();
        let source = Source { port: Port::Udp(IO_PORT), peer: Some(SocketAddrV4::new(from, IO_PORT)) };
        bus.command_a(|scanner, now| scanner.handle_frame(now, source, &frame[..len]));
        (bus.a().counters().foreign, bus.a().input().map(|input| input[0]))
    };
    assert_eq!(receive(OTHER, NUMBER), (1, Some(0)), "another adapter that has the same group and number");
    assert_eq!(receive(ROBOT, NUMBER + 8), (2, Some(0)), "another multicast of this adapter");
    assert_eq!(receive(ROBOT, NUMBER), (2, Some(9)));
}
