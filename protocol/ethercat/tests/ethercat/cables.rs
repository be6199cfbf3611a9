//! Lines and trees, cut and mended cables, devices without power.

use embassy_time::Timer;
use ethercat_maindevice::time;
use ethercat_subdevice::{AlState, DeviceConfig, DeviceId, Segment, SegmentEnd};
use ethercrab::MainDevice;
use ethercrab::error::Error;
use machine::{Duration, Instant, Machine as _, Port, Source, Transmit};

use crate::devices::{BRIDGE, SIMPLE};
use crate::main_device::Stand;
use crate::raw_main_device::{APRD, APWR, BRD, RawMainDevice, frame};

const USER_RAM: u16 = 0x0F80;

fn line(devices: usize) -> Segment {
    let mut segment = Segment::new();
    for _ in 0..devices {
        segment.add(&DeviceConfig::new(&SIMPLE));
    }
    segment
}

/// Returns how many devices a frame passes.
fn count(main_device: &mut RawMainDevice) -> u16 {
    main_device.exchange(BRD, 0, 0, &[0]).1
}

fn dl_status(main_device: &mut RawMainDevice, position: u16) -> u16 {
    let (status, _) = main_device.exchange(APRD, 0_u16.wrapping_sub(position), 0x0110, &[0; 2]);
    u16::from_le_bytes([status[0], status[1]])
}

#[test]
fn each_cut_leaves_the_devices_before_it_and_mending_brings_the_others_back() {
    for cut in 1..4 {
        let mut main_device = RawMainDevice::new(line(4));
        assert_eq!(count(&mut main_device), 4);
        assert_eq!(
            dl_status(&mut main_device, cut - 1),
            0x5A33,
            "links at ports 0 and 1, loops closed at 2 and 3"
        );
        main_device.segment.set_cut(DeviceId(usize::from(cut)), true);
        assert_eq!(count(&mut main_device), cut);
        assert_eq!(dl_status(&mut main_device, cut - 1), 0x5613, "the loop at port 1 is closed, too");
        let (lost, _) = main_device.exchange(APRD, 1_u16.wrapping_sub(cut), 0x0310, &[0; 4]);
        assert_eq!(lost, [0, 1, 0, 0], "lost links of the device before the cut");
        main_device.segment.set_cut(DeviceId(usize::from(cut)), false);
        assert_eq!(count(&mut main_device), 4);
        assert_eq!(dl_status(&mut main_device, cut - 1), 0x5A33);
    }
}

#[test]
fn a_frame_leaves_a_segment_that_leads_on_after_its_last_device_which_shows_the_link() {
    let mut segment = line(2);
    segment.lead_on();
    let mut main_device = RawMainDevice::new(segment);
    assert_eq!(count(&mut main_device), 2);
    assert_eq!(dl_status(&mut main_device, 1), 0x5A33, "links at ports 0 and 1 of the last device");
    main_device.segment.set_cut(DeviceId(1), true);
    main_device.segment.set_cut(DeviceId(1), false);
    assert_eq!(dl_status(&mut main_device, 1), 0x5A33, "also after a cut");
}

/// Sends a frame through two segments with a cable between them, as two processes carry it, and returns it when it is back.
fn send_through(segments: &mut [Segment; 2], sent: &[u8]) -> Option<Vec<u8>> {
    let (now, mut buf) = (Instant::ZERO, vec![0; 2048]);
    let [first, second] = segments;
    let from = Source { port: Port::Ethernet, peer: None };
    first.handle_frame(now, from, sent);
    let (end, Transmit { len, .. }) = first.poll_frame(now, &mut buf)?;
    if end == SegmentEnd::Onward {
        second.handle_frame(now, from, &buf[..len]);
        let (end, Transmit { len, .. }) = second.poll_frame(now, &mut buf)?;
        assert_eq!(end, SegmentEnd::Upstream, "the second one ends the line");
        let frame = buf[..len].to_vec();
        first.handle_returned(now, &frame);
        let (end, transmit) = first.poll_frame(now, &mut buf)?;
        assert_eq!((end, transmit.len), (SegmentEnd::Upstream, len));
    }
    Some(buf[..len].to_vec())
}

#[test]
fn a_frame_passes_the_devices_of_two_segments_in_line_and_each_device_changes_it_once() {
    let mut segments = [line(2), line(3)];
    segments[0].lead_on();
    for datagram in [frame(BRD, 0, &[0]), frame(APRD, 4_u32.wrapping_neg() & 0xFFFF, &[0])] {
        let back = send_through(&mut segments, &datagram).unwrap();
        let working_counter = u16::from_le_bytes([back[27], back[28]]);
        let (addressed, position) = if datagram[16] == BRD { (5, 5) } else { (1, 1) };
        assert_eq!(working_counter, addressed);
        assert_eq!(u16::from_le_bytes([back[18], back[19]]), position, "each device adds one");
    }
    assert_eq!(segments.map(|segment| segment.counters().passed), [2, 2]);
}

#[test]
fn the_loop_closes_where_the_cable_to_the_next_segment_has_no_link_and_opens_again() {
    let mut segments = [line(2), line(3)];
    segments[0].set_onward_link(false);
    let count = |segments: &mut [Segment; 2]| {
        let back = send_through(segments, &frame(BRD, 0, &[0])).unwrap();
        u16::from_le_bytes([back[27], back[28]])
    };
    assert_eq!(count(&mut segments), 2);
    segments[0].set_onward_link(true);
    assert_eq!(count(&mut segments), 5);
    segments[0].set_onward_link(false);
    assert_eq!(count(&mut segments), 2);
    let [first, _] = segments;
    let mut main_device = RawMainDevice::new(first);
    assert_eq!(dl_status(&mut main_device, 1), 0x5613, "no link at port 1, and its loop closed");
    let (lost, _) = main_device.exchange(APRD, 0xFFFF, 0x0310, &[0; 4]);
    assert_eq!(lost, [0, 1, 0, 0], "lost links");
    // What comes in at the closed port goes nowhere.
    let before = main_device.segment.counters().lost;
    main_device.segment.handle_returned(Instant::ZERO, &frame(BRD, 0, &[0]));
    assert_eq!(main_device.segment.counters().lost, before + 1);
    assert_eq!(main_device.segment.poll_frame(Instant::ZERO, &mut [0; 2048]), None);
}

#[test]
fn a_cut_of_the_first_cable_loses_every_frame() {
    let mut main_device = RawMainDevice::new(line(2));
    main_device.segment.set_cut(DeviceId(0), true);
    assert_eq!(main_device.send(&frame(BRD, 0, &[0])), None);
    assert_eq!(main_device.segment.counters().lost, 1);
    main_device.segment.set_cut(DeviceId(0), false);
    assert_eq!(count(&mut main_device), 2);
}

#[test]
fn a_device_that_lost_power_comes_back_in_init_without_an_address_and_takes_those_behind_it_along() {
    let mut main_device = RawMainDevice::new(line(3));
    for position in 0..3_u16 {
        main_device.exchange(APWR, 0_u16.wrapping_sub(position), 0x0010, &(0x1000 + position).to_le_bytes());
    }
    main_device.exchange(APWR, 0xFFFF, 0x0120, &[2, 0]);
    assert_eq!(main_device.segment.state(DeviceId(1)).unwrap().0, AlState::PreOp);
    main_device.segment.set_power(main_device.now, DeviceId(1), false);
    assert_eq!(count(&mut main_device), 1);
    assert_eq!(main_device.segment.state(DeviceId(1)).unwrap().0, AlState::Init);
    main_device.segment.set_power(main_device.now, DeviceId(1), true);
    assert_eq!(count(&mut main_device), 3);
    let addresses: Vec<_> = (0..3_u16)
        .map(|position| main_device.exchange(APRD, 0_u16.wrapping_sub(position), 0x0010, &[0; 2]).0)
        .collect();
    assert_eq!(addresses, [[0x00, 0x10], [0, 0], [0x02, 0x10]]);
    assert_eq!(main_device.segment.state(DeviceId(1)).unwrap().0, AlState::Init);
}

#[test]
fn a_frame_passes_a_tree_in_the_order_of_ports_3_1_2() {
    let mut segment = Segment::new();
    let config = DeviceConfig::new(&SIMPLE);
    let fork = segment.add(&config);
    let at_1 = segment.add_at(&config, fork, 1).unwrap();
    segment.add_at(&config, fork, 2).unwrap();
    let at_3 = segment.add_at(&config, fork, 3).unwrap();
    segment.add_at(&config, at_1, 1).unwrap();
    assert_eq!(segment.add_at(&config, fork, 3), None, "taken");
    assert_eq!(segment.add_at(&config, fork, 0), None, "towards the MainDevice");
    let swapped = DeviceConfig { upstream_port: 2, ..config };
    assert_eq!(segment.add_at(&swapped, fork, 0), None, "towards the MainDevice");
    assert_eq!(segment.add_at(&config, fork, 4), None, "no such port");
    // Each device keeps the address of its position: the fork, then what is at ports 3, 1 and 2.
    let mut main_device = RawMainDevice::new(segment);
    for position in 0..5_u16 {
        main_device.exchange(APWR, 0_u16.wrapping_sub(position), 0x0010, &[position as u8, 0x10]);
    }
    main_device.segment.set_cut(at_3, true);
    assert_eq!(station_addresses(&mut main_device, 4), [0x1000, 0x1002, 0x1003, 0x1004]);
    main_device.segment.set_cut(at_3, false);
    main_device.segment.set_cut(at_1, true);
    assert_eq!(station_addresses(&mut main_device, 3), [0x1000, 0x1001, 0x1004]);
}

fn station_addresses(main_device: &mut RawMainDevice, devices: u16) -> Vec<u16> {
    assert_eq!(count(main_device), devices);
    (0..devices)
        .map(|position| main_device.exchange(APRD, 0_u16.wrapping_sub(position), 0x0010, &[0; 2]).0)
        .map(|address| u16::from_le_bytes([address[0], address[1]]))
        .collect()
}

#[test]
fn a_loop_that_is_closed_by_hand_ends_the_line_and_one_held_open_loses_frames_into_nothing() {
    let mut main_device = RawMainDevice::new(line(2));
    // Port 1 closed.
    main_device.exchange(APWR, 0, 0x0101, &[0b1100]);
    assert_eq!(count(&mut main_device), 1);
    main_device.exchange(APWR, 0, 0x0101, &[0]);
    assert_eq!(count(&mut main_device), 2);
    // Port 1 of the last device open, where no cable is: the frame that opens it does not come back itself, as it leaves
    // by then.
    assert_eq!(main_device.send(&frame(APWR, 0x0101_FFFF, &[0b1000])), None);
    assert_eq!(main_device.send(&frame(BRD, 0, &[0])), None);
}

#[test]
fn a_loop_with_automatic_closing_stays_closed_after_a_cut_until_it_is_set_again() {
    let mut main_device = RawMainDevice::new(line(2));
    main_device.exchange(APWR, 0, 0x0101, &[0b0100]);
    main_device.segment.set_cut(DeviceId(1), true);
    main_device.segment.set_cut(DeviceId(1), false);
    assert_eq!(count(&mut main_device), 1);
    assert_eq!(dl_status(&mut main_device, 0), 0x5E33, "port 1 has a link, and its loop is closed");
    assert_eq!(main_device.exchange(APRD, 0, 0x0310, &[0; 4]).0, [0, 1, 0, 0], "it was open before the cut");
    main_device.exchange(APWR, 0, 0x0103, &[1]);
    assert_eq!(count(&mut main_device), 1, "the alias is another part of the register");
    main_device.exchange(APWR, 0, 0x0101, &[0b0100]);
    assert_eq!(count(&mut main_device), 2);
}

#[test]
fn a_device_counts_the_link_towards_the_main_device_as_lost_by_a_cut_and_by_a_neighbour_without_power() {
    let mut main_device = RawMainDevice::new(line(2));
    let lost = |main_device: &mut RawMainDevice| main_device.exchange(APRD, 0xFFFF, 0x0310, &[0; 4]).0;
    main_device.segment.set_cut(DeviceId(1), true);
    main_device.segment.set_cut(DeviceId(1), false);
    assert_eq!(lost(&mut main_device), [1, 0, 0, 0]);
    main_device.segment.set_power(main_device.now, DeviceId(0), false);
    main_device.segment.set_power(main_device.now, DeviceId(0), true);
    assert_eq!(lost(&mut main_device), [2, 0, 0, 0]);
}

#[test]
fn no_frame_passes_a_cut_cable_although_the_loop_at_its_end_is_held_open() {
    let mut main_device = RawMainDevice::new(line(1));
    main_device.exchange(APWR, 0, 0x0101, &[0b10]);
    assert_eq!(count(&mut main_device), 1);
    main_device.segment.set_cut(DeviceId(0), true);
    assert_eq!(main_device.send(&frame(APWR, u32::from(USER_RAM) << 16, &[9])), None);
    main_device.segment.set_cut(DeviceId(0), false);
    assert_eq!(main_device.exchange(APRD, 0, USER_RAM, &[0]), (vec![0], 1), "nor has it been there");
}

#[test]
fn a_frame_that_finds_port_0_closed_behind_it_is_lost_instead_of_going_round_for_ever() {
    let mut main_device = RawMainDevice::new(line(2));
    assert_eq!(main_device.send(&frame(APWR, 0x0101_0000, &[0b0011])), None);
    assert_eq!(main_device.send(&frame(BRD, 0, &[0])), None);
}

#[test]
fn a_device_whose_loops_are_all_closed_can_be_reached_by_port_0() {
    let mut main_device = RawMainDevice::new(line(2));
    main_device.exchange(APWR, 0, 0x0101, &[0b1111_1111]);
    assert_eq!(count(&mut main_device), 1);
    assert_eq!(dl_status(&mut main_device, 0), 0x5F33, "all loops are closed");
    main_device.exchange(APWR, 0, 0x0101, &[0]);
    assert_eq!(count(&mut main_device), 2);
}

#[test]
fn a_frame_comes_back_after_every_cable_and_every_device_both_ways() {
    let mut segment = Segment::new();
    for (cable_delay, forwarding_delay) in [(1000, 100), (20, 30), (5, 7)] {
        segment.add(&DeviceConfig {
            cable_delay: Duration::from_nanos(cable_delay),
            forwarding_delay: Duration::from_nanos(forwarding_delay),
            ..DeviceConfig::new(&SIMPLE)
        });
    }
    let mut main_device = RawMainDevice::new(segment);
    count(&mut main_device);
    // The last device is passed once: it sends the frame back out of the port that it came from.
    assert_eq!(main_device.now, Instant::from_nanos(2 * (1000 + 20 + 5) + 2 * (100 + 30) + 7));
}

#[test]
fn chips_know_their_own_user_ram_only() {
    let mut main_device = RawMainDevice::new(line(2));
    main_device.exchange(APWR, 0xFFFF, USER_RAM, &[9]);
    assert_eq!(main_device.exchange(APRD, 0, USER_RAM, &[0]), (vec![0], 1));
    assert_eq!(main_device.exchange(APRD, 0xFFFF, USER_RAM, &[0]), (vec![9], 1));
}

/// A device whose cable towards the MainDevice is in this port.
fn entered_by(upstream_port: usize) -> DeviceConfig {
    DeviceConfig { upstream_port, ..DeviceConfig::new(&SIMPLE) }
}

#[test]
fn a_device_answers_by_whichever_port_the_cable_is_in_and_marks_frames_if_port_0_is_not_it() {
    for port in 0..4 {
        let mut segment = Segment::new();
        let id = segment.add(&entered_by(port));
        let mut main_device = RawMainDevice::new(segment);
        let reply = main_device.send(&frame(BRD, 0, &[0])).unwrap();
        assert_eq!(reply[23] & 0x40 != 0, port != 0, "port {port}: circulating");
        assert_eq!(reply[27..29], [1, 0], "port {port}: working counter");
        // Its link, and the closed loops of the other ports.
        let status = dl_status(&mut main_device, 0);
        assert_eq!(status >> 4 & 0x0F, 1 << port);
        assert_eq!((0..4).filter(|other| status >> (8 + 2 * other) & 1 == 0).collect::<Vec<_>>(), [port]);
        assert_ne!(main_device.exchange(APRD, 0, 0x0007, &[0]).0[0] & 0x03 << (2 * port), 0, "it is there");
        main_device.segment.set_cut(id, true);
        assert_eq!(main_device.send(&frame(BRD, 0, &[0])), None);
    }
}

#[test]
fn a_device_whose_in_and_out_are_swapped_comes_after_those_behind_it() {
    let mut segment = Segment::new();
    segment.add(&entered_by(0));
    segment.add(&entered_by(1));
    segment.add(&entered_by(0));
    segment.add(&entered_by(0));
    let mut main_device = RawMainDevice::new(segment);
    assert_eq!(count(&mut main_device), 4);
    for position in 0..4_u16 {
        main_device.exchange(APWR, 0_u16.wrapping_sub(position), 0x0010, &[position as u8, 0x10]);
    }
    main_device.exchange(APWR, 0xFFFD, 0x0120, &[2, 0]);
    let states = [0, 1, 2, 3].map(|id| main_device.segment.state(DeviceId(id)).unwrap().0);
    assert_eq!(
        states,
        [AlState::Init, AlState::PreOp, AlState::Init, AlState::Init],
        "the last one is the swapped"
    );
    main_device.segment.set_cut(DeviceId(2), true);
    assert_eq!(station_addresses(&mut main_device, 2), [0x1000, 0x1003]);
}

#[test]
fn a_frame_that_passes_a_second_closed_port_0_is_destroyed() {
    let mut segment = Segment::new();
    let fork = segment.add(&entered_by(0));
    segment.add_at(&entered_by(1), fork, 1).unwrap();
    let mut main_device = RawMainDevice::new(segment);
    assert_eq!(count(&mut main_device), 2);
    let second = main_device.segment.add_at(&entered_by(3), fork, 2).unwrap();
    assert_eq!(main_device.send(&frame(BRD, 0, &[0])), None);
    assert_eq!(main_device.segment.counters().lost, 1);
    main_device.segment.set_cut(second, true);
    assert_eq!(count(&mut main_device), 2);
}

/// Three bridges in OP under ethercrab; the cable before the second one is cut for 300 ms and mended.
#[test]
fn after_a_cut_the_devices_behind_it_fall_back_and_come_to_op_again_without_a_restart() {
    let mut segment = Segment::new();
    for _ in 0..3 {
        segment.add(&DeviceConfig::new(&BRIDGE));
    }
    let cuts = [(500, true), (800, false)].map(|(at, cut)| (Instant::from_millis(at), cut));
    let stand = Stand::new(&mut segment);
    let script = async |main: &MainDevice<'_>| {
        let group = main.init_single_group::<4, 2048>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        let mut counted = Vec::new();
        while time::now_ns() < 2_000_000_000 {
            let cycle = group.tx_rx(main).await?;
            if counted.last() != Some(&cycle.working_counter) {
                counted.push(cycle.working_counter);
            }
            // Only devices that answer can report a state.
            for device in group.iter(main) {
                let Ok(status) = device.register_read::<[u8; 2]>(0x0130_u16).await else { continue };
                if status[0] == 0x14 {
                    device.register_write(0x0120_u16, 0x0014_u16).await?;
                } else if status[0] == 0x04 {
                    device.register_write(0x0120_u16, 0x0008_u16).await?;
                }
            }
            Timer::after_millis(1).await;
        }
        Ok::<_, Error>((counted, group.tx_rx(main).await?.all_op()))
    };
    let ended = stand.run_with(script, &cuts, |segment, _, cut| segment.set_cut(DeviceId(1), cut));
    // All three, where the third's outputs are in two frames and count twice; the first alone; with it the inputs of the
    // others, which indicate their watchdog; all three.
    assert_eq!(ended.result, Some(Ok((vec![11, 3, 5, 11], true))));
    assert!((0..3).all(|device| segment.state(DeviceId(device)).unwrap().0 == AlState::Op));
}
