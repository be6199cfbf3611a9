//! FoE: a file is written and read back.

use ethercat_subdevice::{AlStatusCode, DeviceConfig, DeviceId, Event, Segment};

use crate::devices::{BRIDGE, PLAIN};
use crate::raw_main_device::{APWR, FIRST, RawMainDevice};

/// Data in one packet: a mailbox of 128 bytes without both headers.
const PACKET: usize = 128 - 6 - 6;

fn foe(
    main_device: &mut RawMainDevice,
    operation: u8,
    number: u32,
    rest: &[u8],
) -> Option<(u8, u32, Vec<u8>)> {
    let mut body = vec![operation, 0];
    body.extend(number.to_le_bytes());
    body.extend(rest);
    assert_eq!(main_device.post(4, &body), 1);
    let (protocol, _, answer) = main_device.fetch()?;
    assert_eq!(protocol, 4);
    Some((answer[0], u32::from_le_bytes(answer[2..6].try_into().unwrap()), answer[6..].to_vec()))
}

fn started() -> RawMainDevice {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    RawMainDevice::start(segment)
}

#[test]
fn a_file_of_any_length_is_written_in_packets_and_read_back() {
    for len in [0, 1, PACKET - 1, PACKET, PACKET + 1, 3 * PACKET, 1000] {
        let mut main_device = started();
        let file: Vec<u8> = (0..len).map(|at| at as u8).collect();
        assert_eq!(foe(&mut main_device, 2, 0, b"robot.toml"), Some((4, 0, vec![])));
        let mut sent = 0;
        for number in 1.. {
            let data = &file[sent..len.min(sent + PACKET)];
            assert_eq!(foe(&mut main_device, 3, number, data), Some((4, number, vec![])), "{len} bytes");
            sent += data.len();
            if data.len() < PACKET {
                break;
            }
        }
        assert_eq!(main_device.segment.file(DeviceId(0)), Some((&b"robot.toml"[..], &file[..])));
        assert!(main_device.events.contains(&(DeviceId(0), Event::FileWritten { len })));

        let mut read = Vec::new();
        let mut answer = foe(&mut main_device, 1, 0, b"robot.toml");
        for number in 1.. {
            let Some((3, packet, data)) = answer else { panic!("{answer:?}") };
            assert_eq!(packet, number);
            read.extend(&data);
            answer = foe(&mut main_device, 4, number, &[]);
            if data.len() < PACKET {
                break;
            }
        }
        assert_eq!((read, answer), (file, None));
    }
}

#[test]
fn in_boot_the_mailbox_is_for_files_alone() {
    let mut main_device = started();
    main_device.request_state(3);
    assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_STATE_CHANGE.0), "from INIT only");
    main_device.request_state(0x11);
    main_device.request_state(3);
    assert_eq!(main_device.al_status(), (0x03, 0));
    assert_eq!(foe(&mut main_device, 2, 0, b"firmware.bin"), Some((4, 0, vec![])));
    assert_eq!(foe(&mut main_device, 3, 1, &[7; 10]), Some((4, 1, vec![])));
    assert_eq!(main_device.segment.file(DeviceId(0)), Some((&b"firmware.bin"[..], &[7; 10][..])));
    assert_eq!(main_device.post(3, &[0, 0x20, 0x40, 0, 0x10, 0, 0, 0, 0, 0]), 1);
    assert_eq!(main_device.fetch().unwrap().2, [1, 0, 2, 0], "an unsupported protocol");
    main_device.request_state(2);
    assert_eq!(main_device.al_status(), (0x13, AlStatusCode::INVALID_STATE_CHANGE.0));

    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&PLAIN));
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.request_state(3);
    assert_eq!(main_device.al_status(), (0x11, AlStatusCode::BOOT_NOT_SUPPORTED.0));
}

#[test]
fn a_file_that_is_not_there_a_wrong_packet_and_too_much_data_are_errors() {
    let mut main_device = started();
    assert_eq!(foe(&mut main_device, 1, 0, b"nothing"), Some((5, 0x8001, vec![])));
    foe(&mut main_device, 2, 0, b"file");
    assert_eq!(foe(&mut main_device, 3, 2, &[0; PACKET]), Some((5, 0x8005, vec![])));
    assert_eq!(
        foe(&mut main_device, 3, 1, &[0; PACKET]),
        Some((5, 0x8004, vec![])),
        "the transfer has ended"
    );
    foe(&mut main_device, 2, 0, b"file");
    for number in 1..=8 {
        assert_eq!(foe(&mut main_device, 3, number, &[0; PACKET]), Some((4, number, vec![])));
    }
    assert_eq!(foe(&mut main_device, 3, 9, &[0; PACKET]), Some((5, 0x8003, vec![])));
    assert_eq!(main_device.segment.file(DeviceId(0)), None, "a file is there once it is whole");
    foe(&mut main_device, 2, 0, b"file");
    foe(&mut main_device, 3, 1, &[1; 5]);
    assert_eq!(foe(&mut main_device, 1, 0, b"file"), Some((3, 1, vec![1; 5])));
    assert_eq!(foe(&mut main_device, 4, 2, &[]), Some((5, 0x8005, vec![])), "not the packet that was sent");
}

const ILLEGAL: u32 = 0x8004;

#[test]
fn a_name_of_a_file_has_1_to_64_bytes() {
    for (len, refused) in [(0, true), (1, false), (63, false), (64, false), (65, true)] {
        let (operation, code, _) = foe(&mut started(), 2, 0, &vec![b'n'; len]).unwrap();
        assert_eq!((operation, code), if refused { (5, ILLEGAL) } else { (4, 0) }, "{len}");
    }
}

#[test]
fn a_file_is_read_by_its_own_name_alone() {
    const NOT_FOUND: u32 = 0x8001;
    let mut main_device = started();
    assert_eq!(foe(&mut main_device, 1, 0, b"").unwrap().1, NOT_FOUND, "no file has an empty name");
    foe(&mut main_device, 2, 0, b"robot.toml").unwrap();
    foe(&mut main_device, 3, 1, b"data").unwrap();
    for name in [&b""[..], b"robot", b"robot.tomls", b"other.toml"] {
        assert_eq!(
            foe(&mut main_device, 1, 0, name).map(|(kind, code, _)| (kind, code)),
            Some((5, NOT_FOUND))
        );
    }
    assert_eq!(foe(&mut main_device, 1, 0, b"robot.toml"), Some((3, 1, b"data".to_vec())));
}

#[test]
fn an_error_of_the_main_device_ends_the_transfer_and_has_no_answer() {
    let mut main_device = started();
    foe(&mut main_device, 2, 0, b"robot.toml").unwrap();
    assert_eq!(foe(&mut main_device, 5, 0x8000, b""), None);
    assert_eq!(foe(&mut main_device, 3, 1, b"data").map(|(kind, code, _)| (kind, code)), Some((5, ILLEGAL)));
    assert_eq!(main_device.segment.file(DeviceId(0)), None);
}
