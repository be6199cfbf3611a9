//! The behaviour of IO-Controller and IO-Device: each alone against scripted peers, and both on one cable.
#![expect(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic,
    clippy::unwrap_used,
    reason = "helpers of tests may fail as loudly as tests"
)]

#[expect(dead_code, reason = "the tests of the codecs use the others")]
#[path = "../../src/captured.rs"]
mod captured;
mod controller;
mod device;
mod loss;
mod many_devices;
mod network;
mod one_way;
mod pair;
mod records;
mod samples;
mod search;
mod stations;
mod tshark;
mod two_devices;

/// Returns whether a frame is an announcement to the neighbour. Those come by the clock, whatever a test does, so most tests
/// leave them out.
fn is_lldp(port: machine::Port, frame: &[u8]) -> bool {
    port == machine::Port::Ethernet && frame.get(12..14) == Some(&profinet::lldp::ETHER_TYPE.to_be_bytes())
}

/// Returns whether a frame is ARP, which the tests of the steps leave out.
fn is_arp(port: machine::Port, frame: &[u8]) -> bool {
    port == machine::Port::Ethernet && machine::arp::ArpPacket::from_frame(frame).is_some()
}
