//! What a frame on the cable is, by its first bytes: its name in a timeline.

use ethernet_ip::{ENCAPSULATION_PORT, IO_PORT};
use profinet::RPC_PORT;
use profinet::rt::UDP_PORT as RT_PORT;

const CYCLIC: &str = "cyclic data";

/// Returns the EtherType of a frame, behind its tag if it has one, and what follows.
pub(super) fn ether_type(frame: &[u8]) -> Option<(u16, &[u8])> {
    const TAG: u16 = 0x8100;
    let at = if u16_be(frame, 12)? == TAG { 16 } else { 12 };
    Some((u16_be(frame, at)?, frame.get(at + 2..)?))
}

/// Returns the name of a frame that carries no IP.
pub(super) fn of_ethernet(frame: &[u8]) -> &'static str {
    match ether_type(frame) {
        Some((0x0806, _)) => "ARP",
        Some((0x8892, payload)) => of_profinet(payload),
        Some((0x88A4, _)) => "EtherCAT",
        Some((0x88CC, _)) => "LLDP",
        _ => "Ethernet",
    }
}

/// Returns the name of a UDP datagram between these ports.
pub(super) fn of_udp(ports: [u16; 2], payload: &[u8]) -> &'static str {
    if ports.contains(&RT_PORT) {
        of_profinet(payload)
    } else if ports.contains(&IO_PORT) {
        CYCLIC
    } else if ports.contains(&ENCAPSULATION_PORT) {
        of_encapsulation(payload)
    } else if ports.contains(&RPC_PORT) || is_rpc(payload) {
        // An answer may come from a port of its own.
        of_rpc(payload)
    } else {
        "UDP"
    }
}

/// Returns the name of a TCP segment between these ports; without a payload it belongs to the connection.
pub(super) fn of_tcp(ports: [u16; 2], payload: &[u8]) -> &'static str {
    if ports.contains(&ENCAPSULATION_PORT) && !payload.is_empty() { of_encapsulation(payload) } else { "TCP" }
}

/// Names a PDU by its FrameID (IEC 61158-6-10, 4.2.2.7).
fn of_profinet(pdu: &[u8]) -> &'static str {
    match u16_be(pdu, 0) {
        Some(0x0100..=0xFBFF) => CYCLIC,
        Some(0xFC01) => "alarm, high priority",
        Some(0xFE01) => "alarm, low priority",
        Some(0xFEFC) => "DCP Hello",
        Some(0xFEFD) => "DCP Get or Set",
        Some(0xFEFE) => "DCP Identify request",
        Some(0xFEFF) => "DCP Identify response",
        _ => "PROFINET",
    }
}

/// Returns whether a datagram begins as one of DCE RPC, version 4: a known PDU type, the one data representation of text,
/// and a whole header.
fn is_rpc(datagram: &[u8]) -> bool {
    datagram.len() >= profinet::rpc::HEADER_LEN && matches!(datagram, [4, 0..=10, _, _, 0x00 | 0x10, ..])
}

/// Names a datagram of DCE RPC by its PDUType and OperationNumber (C706, chapter 12; IEC 61158-6-10, 4.10.3).
fn of_rpc(datagram: &[u8]) -> &'static str {
    let [_, pdu_type, _, _, representation, ..] = datagram else { return "RPC" };
    let big_endian = u16_be(datagram, 68);
    let operation = if representation & 0x10 != 0 { big_endian.map(u16::swap_bytes) } else { big_endian };
    match (pdu_type, operation) {
        (0, Some(0)) => "RPC Connect request",
        (0, Some(1)) => "RPC Release request",
        (0, Some(2 | 5)) => "RPC Read request",
        (0, Some(3)) => "RPC Write request",
        (0, Some(4)) => "RPC Control request",
        (2, Some(0)) => "RPC Connect response",
        (2, Some(1)) => "RPC Release response",
        (2, Some(2 | 5)) => "RPC Read response",
        (2, Some(3)) => "RPC Write response",
        (2, Some(4)) => "RPC Control response",
        (3 | 6, _) => "RPC refusal",
        _ => "RPC",
    }
}

/// Names a message by its encapsulation command (EtherNet/IP, volume 2, table 2-3.2).
fn of_encapsulation(message: &[u8]) -> &'static str {
    match u16_be(message, 0).map(u16::swap_bytes) {
        Some(0x04) => "ListServices",
        Some(0x63) => "ListIdentity",
        Some(0x64) => "ListInterfaces",
        Some(0x65) => "RegisterSession",
        Some(0x66) => "UnRegisterSession",
        Some(0x6F) => "SendRRData",
        Some(0x70) => "SendUnitData",
        _ => "EtherNet/IP",
    }
}

fn u16_be(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..at + 2)?.try_into().ok().map(u16::from_be_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_named_by_what_they_are() {
        let profinet = |tag: &[u8], pdu: &[u8]| [&[0; 12], tag, &[0x88, 0x92], pdu].concat();
        assert_eq!(of_ethernet(&profinet(&[], &[0xFE, 0xFE, 5, 0])), "DCP Identify request");
        assert_eq!(of_ethernet(&profinet(&[0x81, 0x00, 0xC0, 0x00], &[0x80, 0x00])), CYCLIC);
        assert_eq!(of_udp([RT_PORT, RT_PORT], &[0xC0, 0x00]), CYCLIC);
        assert_eq!(of_udp([RT_PORT, RT_PORT], &[0xFE, 0x01]), "alarm, low priority");
        assert_eq!(of_udp([IO_PORT, IO_PORT], &[2, 0]), CYCLIC);
        assert_eq!(of_tcp([50_000, ENCAPSULATION_PORT], &[0x6F, 0]), "SendRRData");
        assert_eq!(of_tcp([50_000, ENCAPSULATION_PORT], &[]), "TCP");
    }

    #[test]
    fn an_rpc_datagram_is_named_in_both_byte_orders_and_from_any_port() {
        let mut datagram = [0; 80];
        (datagram[0], datagram[69]) = (4, 3);
        assert_eq!(of_udp([50_000, RPC_PORT], &datagram), "RPC Write request");
        (datagram[1], datagram[4], datagram[68], datagram[69]) = (2, 0x10, 1, 0);
        assert_eq!(of_udp([50_000, 50_001], &datagram), "RPC Release response");
    }

    #[test]
    fn a_frame_that_is_cut_anywhere_has_a_name() {
        for length in 0..80 {
            let bytes = vec![4; length];
            for ports in [[RT_PORT; 2], [RPC_PORT; 2], [IO_PORT; 2], [ENCAPSULATION_PORT; 2], [1, 2]] {
                assert!(!of_ethernet(&bytes).is_empty());
                assert!(!of_udp(ports, &bytes).is_empty() && !of_tcp(ports, &bytes).is_empty());
            }
        }
    }
}
