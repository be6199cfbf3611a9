//! SDOs: by ethercrab, and by single datagrams where ethercrab has no such transfer.

use ethercat_maindevice::time;
use ethercat_subdevice::description::{Access, DataType, Description, Entry, Object, ObjectCode};
use ethercat_subdevice::{DeviceConfig, DeviceId, Emergency, Event, Segment};
use ethercrab::error::{Error, MailboxError};

use crate::devices::{BRIDGE, LONG_TEXT, SENSOR, TINY};
use crate::main_device::Stand;
use crate::raw_main_device::RawMainDevice;

const BRIDGE_ID: DeviceId = DeviceId(0);

fn bridge() -> Segment {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig { serial_number: 0x1234_5678, ..DeviceConfig::new(&BRIDGE) });
    segment
}

/// Returns an SDO request: command, index, subindex, and four bytes.
fn request(command: u8, index: u16, subindex: u8, data: u32) -> Vec<u8> {
    let mut request = vec![command];
    request.extend(index.to_le_bytes());
    request.push(subindex);
    request.extend(data.to_le_bytes());
    request
}

/// Returns the code of an abort.
fn abort(answer: &[u8]) -> u32 {
    assert_eq!(answer[0], 0x80, "{answer:02X?}");
    u32::from_le_bytes(answer[4..8].try_into().unwrap())
}

#[test]
fn ethercrab_reads_values_that_fit_a_mailbox_and_writes_expedited_ones() {
    let ended = Stand::new(&mut bridge()).run(async |main| {
        let group = main.init_single_group::<4, 512>(time::now_ns).await?;
        let device = group.subdevice(main, 0)?;
        assert_eq!(device.sdo_read::<u32>(0x1018, 4).await?, 0x1234_5678);
        assert_eq!(device.sdo_read::<[u8; 6]>(0x1008, 0).await?, *b"BRIDGE");
        assert_eq!(device.sdo_read::<[u8; 8]>(0x8000, 4).await?, [0; 8]);
        device.sdo_write(0x8000, 1, 0xBEEF_u16).await?;
        assert_eq!(device.sdo_read::<u16>(0x8000, 1).await?, 0xBEEF);
        let refused = device.sdo_write(0x1018, 1, 1_u32).await;
        assert!(matches!(refused, Err(Error::Mailbox(MailboxError::Aborted { .. }))), "{refused:?}");
        assert_eq!(device.sdo_read_array::<u16, 4>(0x1C12).await?.as_slice(), [0x1600]);
        Ok::<_, Error>(())
    });
    assert_eq!(ended.result, Some(Ok(())), "ended at {:?}", ended.at);
    let written = Event::ObjectWritten { index: 0x8000, subindex: 1 };
    assert!(ended.events.iter().any(|(_, id, event)| (*id, *event) == (BRIDGE_ID, written)));
}

/// A number that is -1 or 3.
static CHOICE: Description = Description {
    objects: &[Object {
        index: 0x8000,
        name: "Choice",
        code: ObjectCode::Variable,
        entries: &[Entry {
            subindex: 0,
            name: "Choice",
            data_type: DataType::Integer16,
            access: Access::WriteOneOf(&[-1, 3]),
            capacity: 2,
            default: &[3, 0],
        }],
    }],
    ..BRIDGE
};

#[test]
fn a_number_that_an_entry_cannot_have_is_refused_as_out_of_its_range() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&CHOICE));
    let mut main_device = RawMainDevice::start(segment);
    for refused in [0, 4, 0x0103, 0xFFFE] {
        assert_eq!(abort(&main_device.sdo(&request(0x2B, 0x8000, 0, refused))), 0x0609_0030, "{refused}");
    }
    assert_eq!(main_device.sdo(&request(0x2B, 0x8000, 0, 0xFFFF)), request(0x60, 0x8000, 0, 0));
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8000, 0), Some(&[0xFF, 0xFF][..]));
}

#[test]
fn a_normal_download_and_a_segmented_one_store_the_same_as_an_expedited_one() {
    let mut main_device = RawMainDevice::start(bridge());
    assert_eq!(main_device.sdo(&request(0x2B, 0x8000, 1, 0x1234)), request(0x60, 0x8000, 1, 0));
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8000, 1), Some(&[0x34, 0x12][..]));
    // Eight bytes do not fit an expedited one.
    let mut normal = request(0x21, 0x8000, 4, 8);
    normal.extend([1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(main_device.sdo(&normal), request(0x60, 0x8000, 4, 0));
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8000, 4), Some(&[1, 2, 3, 4, 5, 6, 7, 8][..]));
    // 200 bytes do not fit a mailbox: 112, then 85, then 3 of 7.
    let text: Vec<u8> = (0..200).collect();
    let mut first = request(0x21, 0x8001, 0, 200);
    first.extend(&text[..112]);
    assert_eq!(main_device.sdo(&first), request(0x60, 0x8001, 0, 0));
    let mut second = vec![0x00];
    second.extend(&text[112..197]);
    assert_eq!(main_device.sdo(&second), [0x20, 0, 0, 0, 0, 0, 0, 0]);
    let third = [0x10 | 4 << 1 | 0x01, 197, 198, 199, 0, 0, 0, 0];
    assert_eq!(main_device.sdo(&third), [0x30, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8001, 0), Some(&text[..]));
}

/// Writes a text as a MainDevice does whose messages fill the mailbox.
fn download(main_device: &mut RawMainDevice, text: &[u8], mailbox: usize) {
    let (first, mut rest) = text.split_at(text.len().min(mailbox - 16));
    let mut start = request(0x21, 0x8001, 0, text.len() as u32);
    start.extend(first);
    assert_eq!(main_device.sdo(&start), request(0x60, 0x8001, 0, 0), "{} bytes", text.len());
    let mut toggle = 0x00;
    while !rest.is_empty() {
        let (now, behind) = rest.split_at(rest.len().min(mailbox - 9));
        let unused = 7_usize.saturating_sub(now.len());
        let last = u8::from(behind.is_empty());
        let mut segment = vec![toggle | (unused as u8) << 1 | last];
        segment.extend(now);
        segment.resize(segment.len() + unused, 0xEE);
        assert_eq!(main_device.sdo(&segment), [0x20 | toggle, 0, 0, 0, 0, 0, 0, 0], "{} bytes", text.len());
        (rest, toggle) = (behind, toggle ^ 0x10);
    }
}

fn upload(main_device: &mut RawMainDevice) -> Vec<u8> {
    let answer = main_device.sdo(&request(0x40, 0x8001, 0, 0));
    if answer[0] & 2 != 0 {
        return answer[4..8 - usize::from(answer[0] >> 2 & 3)].to_vec();
    }
    let len = u32::from_le_bytes(answer[4..8].try_into().unwrap()) as usize;
    let mut text = answer[8..].to_vec();
    let mut toggle = 0x00;
    while text.len() < len {
        let segment = main_device.sdo(&[0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]);
        let unused = if segment.len() == 8 { usize::from(segment[0] >> 1 & 7) } else { 0 };
        text.extend(&segment[1..segment.len() - unused]);
        assert_eq!((segment[0] & 0x10, segment[0] & 1 != 0), (toggle, text.len() == len), "{len} bytes");
        toggle ^= 0x10;
    }
    assert_eq!(text.len(), len);
    text
}

#[test]
fn a_text_of_every_length_goes_both_ways_through_mailboxes_of_any_length() {
    for mailbox in [32, 33, 40, 64, 127, 128] {
        let mut main_device = RawMainDevice::start_with(bridge(), mailbox);
        for len in 0..=400_usize {
            let text: Vec<u8> = (0..len).map(|at| (at * 7 + len) as u8).collect();
            download(&mut main_device, &text, usize::from(mailbox));
            assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8001, 0), Some(&text[..]), "{mailbox}: {len}");
            assert_eq!(upload(&mut main_device), text, "{mailbox}: {len}");
        }
    }
}

#[test]
fn a_segmented_upload_gives_the_whole_text_and_refuses_a_toggle_bit_that_does_not_change() {
    let mut main_device = RawMainDevice::start(bridge());
    let first = main_device.sdo(&request(0x40, 0x8001, 0, 0));
    assert_eq!(first[..8], request(0x41, 0x8001, 0, 300)[..]);
    let mut text = first[8..].to_vec();
    for toggle in [0x00, 0x10] {
        let segment = main_device.sdo(&[0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(segment[0] & 0x10, toggle);
        text.extend(&segment[1..]);
    }
    assert_eq!(text, LONG_TEXT);
    main_device.sdo(&request(0x40, 0x8001, 0, 0));
    assert_eq!(abort(&main_device.sdo(&[0x70, 0, 0, 0, 0, 0, 0, 0])), 0x0503_0000);
    // The transfer has ended with that.
    assert_eq!(abort(&main_device.sdo(&[0x60, 0, 0, 0, 0, 0, 0, 0])), 0x0504_0001);
}

#[test]
fn a_segmented_download_wants_the_toggle_bit_to_change_and_the_length_that_was_named() {
    let mut main_device = RawMainDevice::start(bridge());
    let mut first = request(0x21, 0x8001, 0, 200);
    first.extend([0; 112]);
    main_device.sdo(&first);
    assert_eq!(abort(&main_device.sdo(&[&[0x10][..], &[0; 85]].concat())), 0x0503_0000);
    main_device.sdo(&first);
    main_device.sdo(&[&[0x00][..], &[0; 85]].concat());
    assert_eq!(
        abort(&main_device.sdo(&[0x10 | 5 << 1 | 0x01, 0, 0, 0, 0, 0, 0, 0])),
        0x0607_0010,
        "one byte too few"
    );
    main_device.sdo(&first);
    assert_eq!(abort(&main_device.sdo(&[&[0x01][..], &[0; 112]].concat())), 0x0607_0012, "too many");
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8001, 0), Some(&LONG_TEXT[..]));
}

#[test]
fn an_entry_that_is_written_in_pre_op_is_refused_above() {
    let mut main_device = RawMainDevice::start(bridge());
    assert_eq!(main_device.sdo(&request(0x2F, 0x8000, 2, 7)), request(0x60, 0x8000, 2, 0));
    main_device.operate();
    assert_eq!(abort(&main_device.sdo(&request(0x2F, 0x8000, 2, 8))), 0x0800_0022);
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8000, 2), Some(&[7][..]));
}

#[test]
fn a_list_of_objects_that_does_not_fit_a_mailbox_comes_whole_in_fragments() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&TINY));
    let mut main_device = RawMainDevice::start_with(segment, 32);
    let first = main_device.coe(8, &[1, 0, 0, 0, 1, 0]);
    assert_eq!(first[2..8], [0x82, 0, 1, 0, 1, 0], "more follow, one fragment, all objects");
    let (_, _, second) = main_device.fetch().unwrap();
    assert_eq!(second[2..6], [0x02, 0, 0, 0]);
    assert_eq!((first.len(), second.len()), (26, 14), "the first is full");
    let list = [&first[8..], &second[6..]].concat();
    let indices: Vec<u16> = list.chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    assert_eq!(
        indices,
        [
            0x1000, 0x1001, 0x1008, 0x1009, 0x100A, 0x1018, 0x1600, 0x1A00, 0x1C00, 0x1C12, 0x1C13, 0x6000,
            0x7000
        ]
    );
    assert_eq!(main_device.fetch(), None);
}

#[test]
fn a_complete_access_reads_all_entries_and_writes_those_that_may_be_written() {
    let mut main_device = RawMainDevice::start(bridge());
    let answer = main_device.sdo(&request(0x50, 0x8000, 0, 0));
    assert_eq!(answer[..8], request(0x51, 0x8000, 0, 17)[..]);
    let mut object = answer[8..].to_vec();
    assert_eq!(object, [4, 0, 7, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    object[2] = 99;
    let mut download = request(0x31, 0x8000, 0, 17);
    download.extend(&object);
    assert_eq!(main_device.sdo(&download), request(0x70, 0x8000, 0, 0));
    assert_eq!(main_device.segment.object(BRIDGE_ID, 0x8000, 1), Some(&[99, 0][..]));
    object[0] = 5; // the highest subindex cannot be written
    let mut download = request(0x31, 0x8000, 0, 17);
    download.extend(&object);
    assert_eq!(abort(&main_device.sdo(&download)), 0x0601_0002);
    assert_eq!(abort(&main_device.sdo(&request(0x50, 0x8001, 0, 0))), 0x0601_0004);
}

#[test]
fn what_may_not_be_done_is_aborted_with_its_code() {
    let mut main_device = RawMainDevice::start(bridge());
    for (asked, code) in [
        (request(0x40, 0x5000, 0, 0), 0x0602_0000),
        (request(0x40, 0x8000, 9, 0), 0x0609_0011),
        (request(0x40, 0x8000, 3, 0), 0x0601_0001),
        (request(0x2F, 0x1001, 0, 1), 0x0601_0002),
        (request(0x23, 0x8000, 1, 1), 0x0607_0012),
        (request(0x2F, 0x8000, 1, 1), 0x0607_0013),
        (request(0x21, 0x8001, 0, u32::MAX), 0x0607_0012),
        (request(0x2F, 0x7000, 1, 1), 0x0607_0013),
        (request(0x23, 0x6000, 1, 1), 0x0601_0002),
        (request(0xA0, 0x8000, 1, 0), 0x0504_0001),
        (request(0x60, 0x8000, 1, 0), 0x0504_0001),
    ] {
        assert_eq!(abort(&main_device.sdo(&asked)), code, "{asked:02X?}");
    }
}

#[test]
fn an_object_that_is_mapped_shows_the_process_data() {
    let mut segment = bridge();
    let mut inputs = [0; 256];
    inputs[4..8].copy_from_slice(&[1, 2, 3, 4]);
    segment.set_inputs(BRIDGE_ID, &inputs).unwrap();
    let mut main_device = RawMainDevice::start(segment);
    assert_eq!(main_device.sdo(&request(0x40, 0x6000, 2, 0)), request(0x43, 0x6000, 2, 0x0403_0201));
    assert_eq!(main_device.sdo(&request(0x40, 0x6000, 0, 0)), request(0x4F, 0x6000, 0, 64));
}

/// As drives need it: their mode of operation is written at startup, whether it is in process data or not.
#[test]
fn an_output_is_written_by_sdo_until_process_data_own_it_in_op() {
    let mut main_device = RawMainDevice::start(bridge());
    let write = request(0x23, 0x7000, 2, 0x0403_0201);
    assert_eq!(main_device.sdo(&write), request(0x60, 0x7000, 2, 0));
    let written = Event::ObjectWritten { index: 0x7000, subindex: 2 };
    assert!(main_device.events.contains(&(BRIDGE_ID, written)));
    let value = |main_device: &mut RawMainDevice, subindex: u8| {
        let answer = main_device.sdo(&request(0x40, 0x7000, subindex, 0));
        u32::from_le_bytes(answer[4..8].try_into().unwrap())
    };
    assert_eq!([1, 2, 3].map(|subindex| value(&mut main_device, subindex)), [0, 0x0403_0201, 0]);
    main_device.operate();
    assert_eq!(abort(&main_device.sdo(&request(0x23, 0x7000, 2, 5))), 0x0800_0022);
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), None, "it is no process data");
    main_device.write(0x1100, &[9; 256]);
    assert_eq!(value(&mut main_device, 2), 0x0909_0909);
    main_device.request_state(4);
    assert_eq!(main_device.sdo(&request(0x23, 0x7000, 64, 7)), request(0x60, 0x7000, 64, 0));
    assert_eq!([63, 64].map(|subindex| value(&mut main_device, subindex)), [0x0909_0909, 7]);
}

#[test]
fn the_information_service_lists_and_describes_the_objects() {
    let mut main_device = RawMainDevice::start(bridge());
    let lengths = main_device.coe(8, &[1, 0, 0, 0, 0, 0]);
    assert_eq!(lengths[2..8], [2, 0, 0, 0, 0, 0]);
    assert_eq!(lengths[8..], [17, 0, 1, 0, 1, 0, 0, 0, 0, 0]);
    let all = main_device.coe(8, &[1, 0, 0, 0, 1, 0]);
    assert_eq!(all[2..8], [2, 0, 0, 0, 1, 0]);
    let indices: Vec<u16> = all[8..].chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    assert_eq!(indices[..6], [0x1000, 0x1001, 0x1008, 0x1009, 0x100A, 0x1018]);
    assert_eq!((indices.len(), indices[16]), (17, 0x8001));
    let object = main_device.coe(8, &[3, 0, 0, 0, 0x00, 0x80]);
    assert_eq!(object[2..12], [4, 0, 0, 0, 0x00, 0x80, 0, 0, 4, 9]);
    assert_eq!(object[12..], *b"Settings");
    let entry = main_device.coe(8, &[5, 0, 0, 0, 0x00, 0x80, 1, 0]);
    assert_eq!(entry[2..16], [6, 0, 0, 0, 0x00, 0x80, 1, 0, 6, 0, 16, 0, 0x3F, 0]);
    assert_eq!(entry[16..], *b"Gain");
    let part = main_device.coe(8, &[5, 0, 0, 0, 0x00, 0x60, 7, 0]);
    assert_eq!(part[16..], *b"Input 7", "as ESI file and EEPROM have it");
    let error = main_device.coe(8, &[3, 0, 0, 0, 0x00, 0x50]);
    assert_eq!(error[2..], [7, 0, 0, 0, 0x00, 0x00, 0x02, 0x06]);
}

#[test]
fn entries_with_names_of_their_own_have_these_without_the_subindex() {
    static NAMED: Description = Description { numbers_names: false, ..BRIDGE };
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&NAMED));
    let part = RawMainDevice::start_with(segment, 128).coe(8, &[5, 0, 0, 0, 0x00, 0x60, 7, 0]);
    assert_eq!(part[16..], *b"Input");
}

#[test]
fn an_assignment_has_the_same_type_whether_objects_are_assigned_or_not() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&SENSOR));
    let mut main_device = RawMainDevice::start_with(segment, 32);
    for (low, entries) in [(0x12, 0), (0x13, 1)] {
        let object = main_device.coe(8, &[3, 0, 0, 0, low, 0x1C]);
        assert_eq!(object[6..12], [low, 0x1C, 6, 0, entries, 8], "an array of words");
    }
}

#[test]
fn an_emergency_comes_before_the_answer_and_both_arrive() {
    let mut main_device = RawMainDevice::start(bridge());
    assert!(main_device.segment.raise(BRIDGE_ID, Emergency { code: 0x8611, register: 0x20, data: [1; 5] }));
    let body = [vec![0, 0x20], request(0x40, 0x1000, 0, 0)].concat();
    assert_eq!(main_device.post(3, &body), 1);
    let (_, first, emergency) = main_device.fetch().unwrap();
    assert_eq!(emergency, [0, 0x10, 0x11, 0x86, 0x20, 1, 1, 1, 1, 1]);
    let (_, second, answer) = main_device.fetch().unwrap();
    assert_eq!(answer[2..], request(0x43, 0x1000, 0, 0x1389));
    assert_eq!((first, second), (1, 2), "each message has the next counter");
    assert_eq!(main_device.fetch(), None);
}

#[test]
fn emergencies_wait_for_the_mailbox_and_need_one_that_runs() {
    let mut segment = bridge();
    assert!(!segment.raise(BRIDGE_ID, Emergency::default()), "the device is in INIT");
    let mut main_device = RawMainDevice::start(segment);
    // One is in the mailbox, another ready for it, and eight wait.
    let raised = (0..20).filter(|code| {
        main_device.segment.raise(BRIDGE_ID, Emergency { code: *code, ..Emergency::default() })
    });
    assert_eq!(raised.count(), 10);
    for code in 0..10_u8 {
        assert_eq!(main_device.fetch().unwrap().2[2], code);
    }
    assert_eq!(main_device.fetch(), None);
}

#[test]
fn a_message_that_comes_twice_is_served_once_and_a_lost_answer_is_repeated() {
    let mut main_device = RawMainDevice::start(bridge());
    let body = [vec![0, 0x20], request(0x2B, 0x8000, 1, 5)].concat();
    assert_eq!(main_device.post_as(3, 3, &body), 1);
    let (_, counter, answer) = main_device.fetch().unwrap();
    assert_eq!(main_device.post_as(3, 3, &body), 1);
    assert_eq!(main_device.fetch(), None);
    let writes = main_device.events.iter().filter(|(_, event)| matches!(event, Event::ObjectWritten { .. }));
    assert_eq!(writes.count(), 1);
    // The repeat request is bit 1 of the activation register; the acknowledgement follows in the PDI's control.
    main_device.write(0x080E, &[0x03]);
    assert_eq!(main_device.read(0x080F, 1).0, [0x02]);
    assert_eq!(main_device.fetch(), Some((3, counter, answer)));
    // The same bit once more is no request.
    main_device.write(0x080E, &[0x03]);
    assert_eq!(main_device.fetch(), None);
}

#[test]
fn a_full_mailbox_takes_no_message_and_an_empty_one_gives_none() {
    let mut main_device = RawMainDevice::start(bridge());
    let body = [vec![0, 0x20], request(0x40, 0x1000, 0, 0)].concat();
    // The first is answered at once, the answer to the second has no room, so the third stays in the mailbox.
    for working_counter in [1, 1, 1, 0] {
        assert_eq!(main_device.post(3, &body), working_counter);
    }
    for _ in 0..3 {
        assert!(main_device.fetch().is_some());
    }
    assert_eq!(main_device.fetch(), None);
    assert_eq!(main_device.post(3, &body), 1);
}

#[test]
fn other_protocols_and_short_messages_get_an_error_reply() {
    let mut main_device = RawMainDevice::start(bridge());
    for (protocol, body, detail) in
        [(2, vec![0; 4], 2), (3, vec![0], 6), (3, vec![0, 0x90], 4), (4, vec![1], 6)]
    {
        assert_eq!(main_device.post(protocol, &body), 1);
        let (answered, _, answer) = main_device.fetch().unwrap();
        assert_eq!((answered, answer), (0, vec![1, 0, detail, 0]), "{protocol} {body:?}");
    }
}
