//! The mailbox between the chip and the application: lengths that the MainDevice chooses, messages that were lost, and
//! messages in INIT.

use ethercat_subdevice::{DeviceConfig, DeviceId, Emergency, Segment};

use machine::Duration;

use crate::devices::{BRIDGE, LONG_TEXT, SMART};
use crate::raw_main_device::{APWR, FIRST, RawMainDevice};

const BRIDGE_ID: DeviceId = DeviceId(0);

fn bridge() -> Segment {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    segment
}

/// Returns a request for an upload of subindex 0.
fn upload(index: u16) -> [u8; 10] {
    let [low, high] = index.to_le_bytes();
    [0, 0x20, 0x40, low, high, 0, 0, 0, 0, 0]
}

#[test]
fn mailboxes_shorter_than_the_eeprom_says_carry_shorter_messages() {
    let mut main_device = RawMainDevice::start_with(bridge(), 64);
    let first = main_device.coe(2, &upload(0x8001)[2..]);
    // A mailbox of 64 bytes without the headers of mailbox, CoE and SDO has room for 48.
    assert_eq!((first.len(), &first[2..10]), (58, &[0x41, 0x01, 0x80, 0, 44, 1, 0, 0][..]));
    let mut text = first[10..].to_vec();
    for toggle in [0x00, 0x10].into_iter().cycle() {
        let segment = main_device.sdo(&[0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]);
        assert!(segment.len() <= 64 - 6 - 2);
        text.extend(&segment[1..]);
        if segment[0] & 1 != 0 {
            break;
        }
    }
    assert_eq!(text, LONG_TEXT);
    // The whole list of 17 objects fits one message.
    let list = main_device.coe(8, &[1, 0, 0, 0, 1, 0]);
    assert_eq!((list[2], list.len()), (2, 8 + 17 * 2));
}

/// Returns a bridge in PRE-OP whose mailboxes have these lengths: from the MainDevice, and to it.
fn with_mailboxes(receive: u8, send: u8) -> RawMainDevice {
    let mut main_device = RawMainDevice::new(bridge());
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.write(0x0800, &[0x00, 0x10, receive, 0, 0x26, 0, 1, 0]);
    main_device.write(0x0808, &[0x80, 0x10, send, 0, 0x22, 0, 1, 0]);
    main_device.request_state(2);
    assert_eq!(main_device.al_status(), (0x02, 0));
    main_device
}

/// Sends an FoE message to a mailbox of so many bytes.
fn post_foe(main_device: &mut RawMainDevice, counter: u8, mailbox: usize, body: &[u8]) {
    let mut message = (body.len() as u16).to_le_bytes().to_vec();
    message.extend([0, 0, 0, 4 | counter << 4]);
    message.extend(body);
    message.resize(mailbox, 0);
    assert_eq!(main_device.write(0x1000, &message), 1);
}

#[test]
fn packets_of_a_file_are_as_long_as_the_mailbox_of_their_own_direction() {
    for (receive, send) in [(64, 128), (128, 64)] {
        let mut main_device = with_mailboxes(receive, send);
        let (mailbox, packet) = (usize::from(receive), usize::from(receive) - 12);
        let file: Vec<u8> = (0..packet + 5).map(|at| at as u8).collect();
        let answer =
            |main_device: &mut RawMainDevice| main_device.read(0x1080, send.into()).0[6..12].to_vec();
        post_foe(&mut main_device, 1, mailbox, &[&[2, 0, 0, 0, 0, 0][..], b"file"].concat());
        assert_eq!(answer(&mut main_device), [4, 0, 0, 0, 0, 0]);
        post_foe(&mut main_device, 2, mailbox, &[&[3, 0, 1, 0, 0, 0][..], &file[..packet]].concat());
        assert_eq!(answer(&mut main_device), [4, 0, 1, 0, 0, 0]);
        assert_eq!(main_device.segment.file(BRIDGE_ID), None, "a full packet is not the last one");
        post_foe(&mut main_device, 3, mailbox, &[&[3, 0, 2, 0, 0, 0][..], &file[packet..]].concat());
        assert_eq!(answer(&mut main_device), [4, 0, 2, 0, 0, 0]);
        assert_eq!(main_device.segment.file(BRIDGE_ID), Some((&b"file"[..], &file[..])));
    }
}

/// Changes the bit by which the MainDevice asks for the last message once more, and waits for the confirmation.
fn ask_again(main_device: &mut RawMainDevice, bit: u8) {
    assert_eq!(main_device.write(0x080E, &[1 | bit << 1]), 1);
    assert_eq!(main_device.read(0x080F, 1).0, [bit << 1]);
}

#[test]
fn a_repetition_before_the_first_message_puts_nothing_into_the_mailbox() {
    let mut main_device = RawMainDevice::start(bridge());
    ask_again(&mut main_device, 1);
    assert_eq!(main_device.fetch(), None);
    assert_eq!(main_device.coe(2, &upload(0x1000)[2..])[2], 0x43);
}

#[test]
fn a_repetition_gives_the_message_whose_reply_was_lost_and_then_the_one_that_followed_it() {
    let mut main_device = RawMainDevice::start(bridge());
    for code in 1..=3 {
        assert!(main_device.segment.raise(BRIDGE_ID, Emergency { code, ..Emergency::default() }));
    }
    let mut codes = Vec::new();
    // The frame with the first one is lost on its way back: the device has put the second one into the mailbox.
    main_device.fetch().unwrap();
    ask_again(&mut main_device, 1);
    // Asked for twice, it still comes once.
    ask_again(&mut main_device, 0);
    while let Some((_, counter, message)) = main_device.fetch() {
        codes.push((counter, message[2]));
    }
    assert_eq!(codes, [(1, 1), (2, 2), (3, 3)]);
    ask_again(&mut main_device, 1);
    assert_eq!(main_device.fetch().map(|(_, counter, _)| counter), Some(3));
    assert_eq!(main_device.fetch(), None);
    ask_again(&mut main_device, 0);
    assert_eq!(main_device.fetch().map(|(_, counter, _)| counter), Some(3), "as often as it is asked for");
}

#[test]
fn messages_without_a_counter_are_all_served() {
    let mut main_device = RawMainDevice::start(bridge());
    for _ in 0..3 {
        assert_eq!(main_device.post_as(0, 3, &upload(0x1000)), 1);
        assert!(main_device.fetch().is_some(), "0 is not the number of a message that came before");
    }
}

#[test]
fn a_device_without_files_does_not_know_their_protocol() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&SMART));
    let mut main_device = RawMainDevice::start(segment);
    assert_eq!(main_device.post(4, &[1, 0, 0, 0, 0, 0, b'f']), 1);
    assert_eq!(main_device.fetch(), Some((0, 1, vec![1, 0, 2, 0])), "unsupported protocol");
}

#[test]
fn the_time_that_an_application_takes_counts_from_the_message_and_not_from_later_frames() {
    let mut main_device = RawMainDevice::start(bridge());
    main_device.segment.set_answer_delay(BRIDGE_ID, Duration::from_millis(3));
    assert_eq!(main_device.post(3, &upload(0x1000)), 1);
    for _ in 0..2 {
        main_device.wait(Duration::from_millis(1));
        assert_eq!(main_device.fetch(), None);
    }
    main_device.wait(Duration::from_millis(1));
    assert!(main_device.fetch().is_some());
}

#[test]
fn a_message_from_before_init_is_not_repeated() {
    let mut main_device = RawMainDevice::start(bridge());
    main_device.coe(2, &upload(0x1000)[2..]);
    ask_again(&mut main_device, 1);
    main_device.fetch().unwrap();
    main_device.request_state(1);
    assert_eq!(main_device.read(0x080F, 1).0[0] & 2, 0, "nothing is confirmed");
    main_device.write(0x080E, &[1]);
    main_device.write(0x080E, &[3]);
    assert_eq!(main_device.read(0x080F, 1).0[0] & 2, 0, "nor is a request in INIT");
    main_device.request_state(2);
    assert_eq!(main_device.al_status(), (0x02, 0));
    assert_eq!(main_device.read(0x080F, 1).0, [2], "the bit is set still");
    assert_eq!(main_device.fetch(), None);
    ask_again(&mut main_device, 0);
    assert_eq!(main_device.fetch(), None);
}

#[test]
fn in_init_the_mailbox_takes_no_message_and_pre_op_begins_with_an_empty_one() {
    let mut main_device = RawMainDevice::start(bridge());
    assert_eq!(main_device.post(3, &upload(0x1000)), 1);
    main_device.request_state(1);
    assert_eq!(main_device.read(0x0807, 1).0, [1], "the device has closed it");
    assert_eq!(main_device.post(3, &upload(0x1000)), 0);
    assert_eq!(main_device.fetch(), None);
    main_device.request_state(2);
    assert_eq!((main_device.al_status(), main_device.read(0x0807, 1).0), ((0x02, 0), vec![0]));
    assert_eq!(main_device.fetch(), None);
    assert_eq!(main_device.coe(2, &upload(0x1000)[2..])[2], 0x43);
}
