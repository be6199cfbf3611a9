//! No bytes make a segment panic, and its working counters are always right.

use ethercat_subdevice::{AlState, DeviceConfig, DeviceId, Segment};
use machine::Duration;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::devices::{BRIDGE, SIMPLE};
use crate::raw_main_device::{FIRST, FPRD, FPWR, LRD, LWR, RawMainDevice, frame};

/// A datagram: command, address and data.
type Sent = (u8, u32, Vec<u8>);

fn two_bridges() -> RawMainDevice {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig { alias: 0x1001, ..DeviceConfig::new(&BRIDGE) });
    segment.add(&DeviceConfig::new(&BRIDGE));
    segment.add(&DeviceConfig::new(&SIMPLE));
    RawMainDevice::start(segment)
}

/// Generates addresses where something is: registers, buffers, mailboxes, and mapped logical addresses.
fn address() -> impl Strategy<Value = u32> {
    let position =
        prop_oneof![Just(0_u32), Just(0xFFFF), Just(0x1000), Just(0x1001), any::<u16>().prop_map(u32::from)];
    let offset = prop_oneof![
        4 => 0_u32..0x1000,
        2 => prop_oneof![Just(0x0120_u32), Just(0x0500), Just(0x0600), Just(0x0800), Just(0x0810), Just(0x0900), Just(0x0981)],
        3 => prop_oneof![Just(0x1000_u32), Just(0x1080), Just(0x1100), Just(0x1400)],
        2 => 0x1000_u32..0x3100,
        1 => any::<u16>().prop_map(u32::from),
    ];
    prop_oneof![
        6 => (position, offset).prop_map(|(position, offset)| position | offset << 16),
        1 => 0_u32..0x200,
        1 => any::<u32>(),
    ]
}

fn sent() -> impl Strategy<Value = Sent> {
    let data = prop_oneof![
        vec(any::<u8>(), 0..20),
        vec(any::<u8>(), 0..300),
        Just(vec![1; 128]),
        Just(vec![0; 256])
    ];
    (0_u8..17, address(), data)
}

/// Maps logical addresses 0 to 256 to the outputs, and the next 256 to the inputs, of the first device.
fn map(main_device: &mut RawMainDevice) {
    main_device.write(0x0600, &[0, 0, 0, 0, 0, 1, 0, 7, 0x00, 0x11, 0, 2, 1, 0, 0, 0]);
    main_device.write(0x0610, &[0, 1, 0, 0, 0, 1, 0, 7, 0x00, 0x14, 0, 1, 1, 0, 0, 0]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_are_passed_or_dropped(frames in vec(vec(any::<u8>(), 0..200), 1..10)) {
        let mut main_device = two_bridges();
        for bytes in &frames {
            main_device.send(bytes);
            let mut ethercat = frame(0, 0, &[]);
            ethercat.truncate(14);
            ethercat.extend(bytes);
            if let Some(reply) = main_device.send(&ethercat) {
                prop_assert_eq!(reply.len(), ethercat.len());
            }
        }
    }

    #[test]
    fn any_datagrams_come_back_with_a_count_that_the_devices_can_reach(all in vec(sent(), 1..40)) {
        let mut main_device = two_bridges();
        map(&mut main_device);
        for (command, address, data) in &all {
            // A line with a port that is held open loses what it is sent.
            let Some((_, _, counted)) = main_device.exchange_at(*command, *address, data) else { continue };
            prop_assert!(counted <= 9, "{counted}");
            main_device.wait(Duration::from_micros(137));
        }
    }

    /// A frame that did not count changed nothing: a segment that received it behaves like one that did not.
    #[test]
    fn what_did_not_count_changed_nothing(before in vec(sent(), 0..20), tried in sent(), after in vec(sent(), 1..20)) {
        let mut one = two_bridges();
        let mut other = two_bridges();
        for (command, address, data) in &before {
            one.exchange_at(*command, *address, data);
            other.exchange_at(*command, *address, data);
        }
        let (command, address, data) = &tried;
        if let Some((_, back, 0)) = one.exchange_at(*command, *address, data) {
            prop_assert_eq!(&back, data);
            for (command, address, data) in &after {
                prop_assert_eq!(
                    one.exchange_at(*command, *address, data),
                    other.exchange_at(*command, *address, data)
                );
            }
        }
    }

    /// What was counted as written can be read, and what was counted as read was there.
    #[test]
    fn process_data_that_counted_arrived(rounds in vec((any::<[u8; 8]>(), 0_usize..300, 0_u32..600), 1..20)) {
        let mut main_device = two_bridges();
        main_device.operate();
        map(&mut main_device);
        let mut inputs = [0; 256];
        for (seed, len, address) in rounds {
            let data: Vec<u8> = seed.iter().cycle().take(len).copied().collect();
            let before = main_device.segment.outputs(DeviceId(0)).map(<[u8]>::to_vec);
            let (_, _, written) = main_device.exchange_at(LWR, address, &data).unwrap();
            let outputs = main_device.segment.outputs(DeviceId(0)).map(<[u8]>::to_vec);
            // Only a whole image is handed over.
            if written == 0 {
                prop_assert_eq!(&outputs, &before);
            } else if address == 0 && len >= 256 {
                prop_assert_eq!(outputs.as_deref(), Some(&data[..256]));
            }
            inputs.copy_from_slice(&seed.repeat(32));
            main_device.segment.set_inputs(DeviceId(0), &inputs).unwrap();
            let (_, read, counted) = main_device.exchange_at(LRD, 256, &[0xEE; 256]).unwrap();
            prop_assert_eq!((&read[..], counted), (&inputs[..], 1));
        }
    }

    #[test]
    fn any_mail_leaves_a_mailbox_that_answers(mails in vec((0_u8..16, vec(any::<u8>(), 0..120), any::<bool>()), 1..30)) {
        let mut main_device = two_bridges();
        for (protocol, body, coe) in mails {
            let body = if coe { [vec![0, 0x20], body].concat() } else { body };
            main_device.post(if coe { 3 } else { protocol }, &body[..body.len().min(122)]);
            while main_device.fetch().is_some() {}
        }
        prop_assert_eq!(main_device.sdo(&[0x40, 0, 0x10, 0, 0, 0, 0, 0]), [0x43, 0, 0x10, 0, 0x89, 0x13, 0, 0]);
    }

    #[test]
    fn any_eeprom_leaves_a_device_that_can_be_read(at in 0_usize..512, bytes in vec(any::<u8>(), 1..64)) {
        let mut main_device = two_bridges();
        let eeprom = main_device.segment.eeprom_mut(DeviceId(0)).unwrap();
        eeprom.iter_mut().skip(at).zip(&bytes).for_each(|(to, from)| *to = *from);
        main_device.segment.set_power(main_device.now, DeviceId(0), false);
        main_device.segment.set_power(main_device.now, DeviceId(0), true);
        let loaded = main_device.exchange(1, 0, 0x0110, &[0]).0[0] & 1 != 0;
        let error = main_device.exchange(1, 0, 0x0503, &[0]).0[0] & 0x18;
        prop_assert_eq!(error, if loaded { 0 } else { 0x18 });
        main_device.exchange(2, 0, 0x0010, &FIRST.to_le_bytes());
        for word in 0..40_u32 {
            let mut command = vec![0, 1];
            command.extend(word.to_le_bytes());
            prop_assert_eq!(main_device.exchange(FPWR, FIRST, 0x0502, &command).1, 1);
            prop_assert_eq!(main_device.exchange(FPRD, FIRST, 0x0508, &[0; 8]).1, 1);
        }
        prop_assert_eq!(main_device.segment.state(DeviceId(0)).unwrap().0, AlState::Init);
    }
}
