use super::*;
use crate::captured;
use crate::samples;
use machine::ethernet::Mac;

/// The Siemens CPU 1515-2 PN V2.9.4 and the p-net device of the captures (test data of crate `pnio` 0.1.0).
const SIEMENS: Mac = Mac([0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3C]);
const P_NET: Mac = Mac([0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8]);

fn alarms() -> Alarms {
    Alarms::new(Route::Ethernet { source: SIEMENS, destination: P_NET }, (0, 0))
}

fn receive(alarms: &mut Alarms, now: Instant, text: &str) -> Outcome {
    let frame = captured::frame(text);
    let (_, payload) = EthernetHeader::parse(&frame).unwrap();
    alarms.handle(now, u16::from_be_bytes([payload[0], payload[1]]), &payload[2..])
}

fn sent(alarms: &mut Alarms, now: Instant) -> Option<Vec<u8>> {
    let mut buf = [0; 128];
    let len = alarms.poll_transmit(now, &mut buf)?.len;
    Some(buf[..len].to_vec())
}

#[test]
fn a_process_alarm_is_acknowledged_in_the_bytes_of_the_siemens_controller() {
    let mut alarms = alarms();
    let now = Instant::ZERO;
    assert_eq!(receive(&mut alarms, now, captured::ALARM_PROCESS_NOTIF), Outcome::Handled);
    assert_eq!(sent(&mut alarms, now), Some(captured::frame(captured::ALARM_ACK_RTA_HIGH_CPU)));
    assert_eq!(sent(&mut alarms, now), Some(captured::frame(captured::ALARM_ACK_HIGH_CPU)));
    assert_eq!(sent(&mut alarms, now), None);
    assert_eq!(receive(&mut alarms, now, captured::ALARM_ACK_RTA_HIGH_DEV), Outcome::Handled);
    assert_eq!(alarms.poll_timeout(), None);
}

#[test]
fn a_series_of_diagnosis_alarms_keeps_its_numbers_in_step() {
    let mut alarms = alarms();
    let now = Instant::ZERO;
    assert_eq!(receive(&mut alarms, now, captured::ALARM_DIAG_NOTIF), Outcome::Handled);
    assert_eq!(sent(&mut alarms, now), Some(captured::frame(captured::ALARM_ACK_RTA_LOW_CPU)));
    assert_eq!(sent(&mut alarms, now), Some(captured::frame(captured::ALARM_DIAG_ACK_CPU)));
    // The next notification acknowledges the AlarmAck by its AckSeqNum.
    for text in [captured::ALARM_DIAG_UPDATE_APPEARS, captured::ALARM_DIAG_UPDATE_OTHERS_REMAIN] {
        assert_eq!(receive(&mut alarms, now, text), Outcome::Handled);
        assert!(sent(&mut alarms, now).is_some() && sent(&mut alarms, now).is_some());
    }
    assert_eq!((alarms.low.last_received, alarms.low.last_sent), (1, 1));
}

#[test]
fn a_repeated_alarm_gets_its_ack_again_and_an_unanswered_alarm_ack_ends_in_giving_up() {
    let mut alarms = alarms();
    let mut now = Instant::ZERO;
    receive(&mut alarms, now, captured::ALARM_PROCESS_NOTIF);
    let (ack, data) = (sent(&mut alarms, now), sent(&mut alarms, now));
    assert_eq!(receive(&mut alarms, now, captured::ALARM_PROCESS_NOTIF), Outcome::Handled);
    assert!(ack.is_some() && sent(&mut alarms, now).is_some());
    assert_eq!(sent(&mut alarms, now), None, "the AlarmAck waits for its time");
    for _ in 0..RETRIES {
        now = alarms.poll_timeout().unwrap();
        assert!(!alarms.handle_timeout(now));
        assert_eq!(sent(&mut alarms, now), data);
    }
    assert!(alarms.handle_timeout(alarms.poll_timeout().unwrap()));
}

#[test]
fn an_error_pdu_ends_the_ar_and_says_why() {
    let outcome = receive(&mut alarms(), Instant::ZERO, captured::ALARM_ERR_RTA_DEV);
    assert_eq!(outcome, Outcome::Aborted(Status::new(0xCF, 0x81, 0xFD, 0x00)));
    let mut other = Alarms::new(Route::Ethernet { source: SIEMENS, destination: P_NET }, (7, 0));
    assert_eq!(receive(&mut other, Instant::ZERO, captured::ALARM_ERR_RTA_DEV), Outcome::Foreign);
}

#[test]
fn a_parting_is_an_error_pdu_of_low_priority() {
    let status = Status::new(0xCF, 0x81, 0xFD, 0x05);
    let mut buf = [0xFF; 128];
    let transmit = alarms().final_error(status).emit(&mut buf).unwrap();
    assert_eq!(transmit.len, 64);
    let expected = captured::frame(captured::ALARM_ERR_RTA_CPU_REMOVED);
    assert_eq!(buf[..35], expected[..35]);
    assert_eq!(buf[35], 0x05);
}

/// Gives it a PDU of low priority with this number and with the one that it acknowledges: an alarm, or only an acknowledgement.
fn low(
    alarms: &mut Alarms,
    now: Instant,
    pdu_type: PduType,
    (send_sequence, ack_sequence): (u16, u16),
) -> Outcome {
    let flags = Rta::WINDOW_1_TACK;
    let rta = Rta { destination: 0, source: 0, pdu_type, flags, send_sequence, ack_sequence };
    let notification = Alarm::Notification(samples::DIAGNOSIS);
    let mut buf = [0; 128];
    let mut writer = Writer::<BigEndian>::new(&mut buf);
    rta.emit(&mut writer, |w| {
        if pdu_type == PduType::Data {
            notification.emit(w);
        }
    });
    alarms.handle(now, FRAME_ID_LOW, &buf)
}

/// Returns the types of all PDUs that it sends now.
fn types_sent(alarms: &mut Alarms, now: Instant) -> Vec<PduType> {
    let frames = core::iter::from_fn(|| sent(alarms, now));
    frames.map(|frame| Rta::parse(&frame[20..]).unwrap().0.pdu_type).collect()
}

#[test]
fn an_alarm_with_the_number_after_the_next_one_or_before_the_last_alarm_ack_has_arrived_waits() {
    let (mut alarms, now) = (alarms(), Instant::ZERO);
    assert_eq!(low(&mut alarms, now, PduType::Data, (0, 0xFFFE)), Outcome::Foreign, "0xFFFF comes first");
    assert_eq!(types_sent(&mut alarms, now), []);
    assert_eq!(low(&mut alarms, now, PduType::Data, (0xFFFF, 0xFFFE)), Outcome::Handled);
    assert_eq!(types_sent(&mut alarms, now), [PduType::Ack, PduType::Data]);
    assert_eq!(low(&mut alarms, now, PduType::Data, (0, 0xFFFE)), Outcome::Foreign, "it has no AlarmAck");
    assert_eq!(types_sent(&mut alarms, now), []);
    assert_eq!(low(&mut alarms, now, PduType::Data, (0, 0xFFFF)), Outcome::Handled);
    assert_eq!(types_sent(&mut alarms, now), [PduType::Ack, PduType::Data]);
}

#[test]
fn only_an_acknowledgement_with_the_number_of_an_alarm_ack_that_was_sent_counts() {
    let (mut alarms, now) = (alarms(), Instant::ZERO);
    let ack = |alarms: &mut Alarms, number| low(alarms, now, PduType::Ack, (0xFFFF, number));
    assert_eq!(ack(&mut alarms, 0xFFFE), Outcome::Foreign, "nothing was sent");
    assert_eq!(low(&mut alarms, now, PduType::Data, (0xFFFF, 0xFFFE)), Outcome::Handled);
    assert_eq!(ack(&mut alarms, 0xFFFF), Outcome::Foreign, "the AlarmAck is not sent yet");
    assert_eq!(types_sent(&mut alarms, now), [PduType::Ack, PduType::Data]);
    for other in [0xFFFE, 0, 1] {
        assert_eq!(ack(&mut alarms, other), Outcome::Foreign);
        assert!(!alarms.are_acknowledged(), "by 0x{other:04X}");
    }
    assert_eq!(ack(&mut alarms, 0xFFFF), Outcome::Handled);
    assert!(alarms.are_acknowledged());
    assert_eq!(ack(&mut alarms, 0xFFFF), Outcome::Foreign, "a second time");
}

#[test]
fn an_alarm_ack_is_repeated_100_ms_after_it_was_sent_and_not_before() {
    let mut alarms = alarms();
    let mut now = Instant::from_millis(1_000);
    let after = |now: Instant, millis| Some(now + Duration::from_millis(millis));
    assert_eq!(low(&mut alarms, now, PduType::Data, (0xFFFF, 0xFFFE)), Outcome::Handled);
    assert_eq!(alarms.poll_timeout(), after(now, 100));
    now += Duration::from_millis(20);
    assert_eq!(types_sent(&mut alarms, now), [PduType::Ack, PduType::Data]);
    for _ in 0..RETRIES {
        assert_eq!(alarms.poll_timeout(), after(now, 100));
        assert!(!alarms.handle_timeout(now + Duration::from_millis(99)));
        assert_eq!(types_sent(&mut alarms, now), [], "too early");
        now += Duration::from_millis(100);
        assert!(!alarms.handle_timeout(now));
        assert_eq!(alarms.poll_timeout(), after(now, 100), "even if it is not sent at once");
        now += Duration::from_millis(30);
        assert_eq!(types_sent(&mut alarms, now), [PduType::Data]);
    }
}
