use super::*;
use crate::{Instant, Machine as _};

const PLC: Mac = Mac([2, 0, 0, 0, 0, 0x0A]);
const ROBOT: Mac = Mac([2, 0, 0, 0, 0, 0x0B]);
const STRANGER: Mac = Mac([2, 0, 0, 0, 0, 0x0C]);
const PLC_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);

/// Question and answer of two Linux 6 kernels on a veth pair, as tshark captured them.
const ASKED: &[u8] =
    b"\xFF\xFF\xFF\xFF\xFF\xFF\x02\0\0\0\0\x0A\x08\x06\0\x01\x08\0\x06\x04\0\x01\x02\0\0\0\0\x0A\xC0\xA8\
\x40\x01\0\0\0\0\0\0\xC0\xA8\x40\x02";
const ANSWERED: &[u8] =
    b"\x02\0\0\0\0\x0A\x02\0\0\0\0\x0B\x08\x06\0\x01\x08\0\x06\x04\0\x02\x02\0\0\0\0\x0B\xC0\xA8\
\x40\x02\x02\0\0\0\0\x0A\xC0\xA8\x40\x01";

fn frame(packet: ArpPacket) -> Vec<u8> {
    let mut buf = [0xEE; 100];
    let len = packet.emit_frame(&mut buf).unwrap();
    buf[..len].to_vec()
}

#[test]
fn question_and_answer_have_the_bytes_of_the_linux_kernel_and_padding() {
    let question = ArpPacket::question(PLC, PLC_ADDRESS, ADDRESS);
    for (packet, captured) in [(question, ASKED), (question.answer(ROBOT), ANSWERED)] {
        let ours = frame(packet);
        assert_eq!((&ours[..42], &ours[42..]), (captured, &[0; 18][..]));
        assert_eq!(ArpPacket::from_frame(captured), Some(Ok(packet)));
    }
}

#[test]
fn tshark_reads_the_packets_as_what_they_are() {
    let probe = ArpPacket::probe(PLC, ADDRESS);
    let announcement = ArpPacket::announcement(ROBOT, ADDRESS);
    let frames = [probe, announcement, probe.answer(ROBOT)].map(frame);
    let fields = ["arp.opcode", "arp.isprobe", "arp.isannouncement", "arp.src.proto_ipv4", "_ws.malformed"];
    let read = dissector::read(&frames, fields);
    let [yes, no] = ["1", "0"].map(|bit| [bit, if bit == "1" { "True" } else { "False" }]);
    assert_eq!(read.len(), 3);
    for (index, (operation, probe, announcement, sender)) in
        [("1", yes, no, "0.0.0.0"), ("1", no, yes, "192.168.64.2"), ("2", no, no, "192.168.64.2")]
            .into_iter()
            .enumerate()
    {
        let row = &read[index];
        assert_eq!((row[0].as_str(), row[3].as_str(), row[4].as_str()), (operation, sender, ""), "{row:?}");
        let is = |field: &str, wanted: [&str; 2]| wanted.contains(&field) || field.is_empty() && wanted == no;
        assert!(is(&row[1], probe) && is(&row[2], announcement), "{row:?}");
    }
}

#[test]
fn cut_packets_and_those_of_other_networks_are_refused_without_a_panic() {
    let payload = &ANSWERED[14..];
    for len in 0..payload.len() {
        assert!(matches!(ArpPacket::parse(&payload[..len]), Err(ArpError::Truncated(_))), "{len}");
    }
    let with = |at: usize, byte: u8| {
        let mut packet = payload.to_vec();
        packet[at] = byte;
        ArpPacket::parse(&packet)
    };
    assert_eq!(with(1, 6), Err(ArpError::OtherNetwork { hardware: 6, protocol: 0x0800 }));
    assert_eq!(with(3, 1), Err(ArpError::OtherNetwork { hardware: 1, protocol: 0x0801 }));
    assert_eq!(with(4, 8), Err(ArpError::Lengths { hardware: 8, protocol: 4 }));
    assert_eq!(with(5, 16), Err(ArpError::Lengths { hardware: 6, protocol: 16 }));
    assert!(matches!(with(8, 3), Err(ArpError::Sender(_))), "a group address");
    assert_eq!(with(7, 9).map(|packet| packet.operation), Ok(Operation::Unknown(9)));
    assert_eq!(ArpPacket::from_frame(&[0; 60]), None);
}

/// Runs a claim to `until` and returns when it sent which packets.
fn run(claim: &mut AddressClaim, until: Instant) -> Vec<(u64, ArpPacket)> {
    let mut sent = Vec::new();
    let mut buf = [0; 100];
    let mut now = Instant::ZERO;
    loop {
        while let Some(transmit) = claim.poll_transmit(now, &mut buf) {
            let packet = ArpPacket::from_frame(&buf[..transmit.len]).unwrap().unwrap();
            sent.push((now.as_nanos() / 1_000_000, packet));
        }
        match claim.poll_timeout().filter(|due| *due <= until) {
            Some(due) => now = now.max(due),
            None => return sent,
        }
        claim.handle_timeout(now);
    }
}

#[test]
fn an_address_that_nobody_answers_for_is_free_after_three_probes_20_ms_apart() {
    let mut claim = AddressClaim::new(ROBOT);
    claim.probe(Instant::ZERO, ADDRESS);
    let probe = ArpPacket::probe(ROBOT, ADDRESS);
    assert_eq!(run(&mut claim, Instant::from_millis(59)), [(0, probe), (20, probe), (40, probe)]);
    assert_eq!(claim.poll_event(), None);
    claim.handle_timeout(Instant::from_millis(60));
    assert_eq!((claim.poll_event(), claim.poll_timeout()), (Some(ClaimEvent::Free(ADDRESS)), None));
}

#[test]
fn an_address_that_another_station_has_or_probes_is_taken() {
    let answer = ArpPacket::probe(ROBOT, ADDRESS).answer(STRANGER);
    let announcement = ArpPacket::announcement(STRANGER, ADDRESS);
    let probe = ArpPacket::probe(STRANGER, ADDRESS);
    let asked_from = ArpPacket::question(STRANGER, ADDRESS, PLC_ADDRESS);
    for packet in [answer, announcement, probe, asked_from] {
        let mut claim = AddressClaim::new(ROBOT);
        claim.probe(Instant::ZERO, ADDRESS);
        claim.handle(Instant::ZERO, &packet);
        let conflict = AddressConflict { address: ADDRESS, mac: STRANGER };
        assert_eq!(claim.poll_event(), Some(ClaimEvent::Taken(conflict)), "{packet:?}");
        assert_eq!((run(&mut claim, Instant::from_millis(100)), claim.poll_event()), (vec![], None));
    }
}

#[test]
fn its_own_packets_and_questions_for_its_address_are_not_conflicts() {
    let own = ArpPacket::announcement(ROBOT, ADDRESS);
    let question = ArpPacket::question(PLC, PLC_ADDRESS, ADDRESS);
    let own_probe = ArpPacket::probe(ROBOT, ADDRESS);
    let other_address = ArpPacket::announcement(STRANGER, PLC_ADDRESS);
    for packet in [own, question, own_probe, other_address] {
        let (mut probing, mut using) = (AddressClaim::new(ROBOT), AddressClaim::new(ROBOT));
        probing.probe(Instant::ZERO, ADDRESS);
        using.claim(Instant::ZERO, ADDRESS);
        for claim in [&mut probing, &mut using] {
            claim.handle(Instant::ZERO, &packet);
            assert_eq!(claim.poll_event(), None, "{packet:?}");
        }
    }
    // Whoever uses an address answers a probe for it; that is no conflict for its user.
    let mut using = AddressClaim::new(ROBOT);
    using.claim(Instant::ZERO, ADDRESS);
    using.handle(Instant::ZERO, &ArpPacket::probe(STRANGER, ADDRESS));
    assert_eq!(using.poll_event(), None);
}

#[test]
fn an_address_in_use_is_announced_twice_and_defended_once_in_10_s_whatever_comes() {
    let mut claim = AddressClaim::new(ROBOT);
    claim.claim(Instant::ZERO, ADDRESS);
    let announcement = ArpPacket::announcement(ROBOT, ADDRESS);
    assert_eq!(run(&mut claim, Instant::from_millis(1_000)), [(0, announcement), (20, announcement)]);
    let (mut defences, mut reports) = (0, 0);
    let mut buf = [0; 100];
    for ms in (0..30_000).step_by(10) {
        let now = Instant::from_millis(ms);
        claim.handle(now, &ArpPacket::announcement(STRANGER, ADDRESS));
        while claim.poll_transmit(now, &mut buf).is_some() {
            defences += 1;
        }
        reports += u32::from(claim.poll_event().is_some());
        claim.handle_timeout(now);
    }
    assert_eq!((defences, reports), (3, 3));
    assert_eq!(claim.address(), Some(ADDRESS));
    let other = AddressConflict { address: ADDRESS, mac: PLC };
    claim.handle(Instant::from_millis(29_999), &ArpPacket::announcement(PLC, ADDRESS));
    assert_eq!(claim.poll_event(), Some(ClaimEvent::Conflict(other)), "each station is named");
}

#[test]
fn every_station_with_an_address_is_found_and_named_once() {
    let mut holders = Holders::new(PLC);
    holders.ask(Instant::ZERO, PLC_ADDRESS, ADDRESS);
    let mut buf = [0; 100];
    assert!(holders.poll_transmit(Instant::ZERO, &mut buf).is_some());
    let question = ArpPacket::from_frame(&buf).unwrap().unwrap();
    assert_eq!(question, ArpPacket::question(PLC, PLC_ADDRESS, ADDRESS));
    assert!(!holders.handle(&question));
    for mac in [ROBOT, STRANGER, ROBOT] {
        assert!(holders.handle(&question.answer(mac)));
    }
    assert_eq!(holders.found().collect::<Vec<_>>(), [ROBOT, STRANGER]);
    assert_eq!((holders.other_than(Some(ROBOT)), holders.other_than(None)), (Some(STRANGER), Some(ROBOT)));
    for number in 0..200 {
        holders.handle(&question.answer(Mac([2, 0, 0, 0, 1, number])));
    }
    assert_eq!(holders.found().count(), MOST_HOLDERS);
    holders.stop();
    assert!(!holders.handle(&question.answer(ROBOT)));
}
