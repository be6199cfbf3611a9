//! Alarms of the device on their way to the controller: one at a time for each priority, repeated until it is received, and
//! followed by the next one when the controller's application has acknowledged it (IEC 61158-6-10, APMS and ALPMI).

use crate::alarm::{Acknowledgement, AlarmHead, Notification, Priority};
use machine::{Duration, Instant};

/// Longest items of an alarm in bytes: two channels with their extended diagnosis.
pub(super) const LONGEST_ITEMS: usize = 40;

/// Largest number of alarms that wait.
const CAPACITY: usize = 8;

/// Bits of AlarmSpecifier that have the sequence number.
const SEQUENCE: u16 = 0x07FF;

/// Reason why an alarm cannot be sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum AlarmError {
    /// Nobody would receive it.
    #[error("no controller exchanges data with the device; connect one first")]
    NoController,
    /// The queue is full.
    #[error("{CAPACITY} alarms wait for the controller; wait for its acknowledgement")]
    Full,
    /// Its items are too long.
    #[error("{0} bytes of items: must be at most {LONGEST_ITEMS}")]
    TooLong(usize),
}

/// An alarm with its items.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct WaitingAlarm {
    priority: Priority,
    head: AlarmHead,
    idents: (u32, u32),
    specifier: u16,
    items: [u8; LONGEST_ITEMS],
    len: usize,
    state: Delivery,
}

/// Progress of an alarm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Delivery {
    /// It is to be sent, for the first time or again.
    Due { is_repeated: bool, repetitions: u16 },
    /// It was sent, and is repeated at this instant.
    Sent { repeat: Instant, repetitions: u16 },
    /// The controller has it; its application has not acknowledged it.
    Received,
}

/// An alarm that is to be sent now.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outgoing {
    pub(super) alarm: WaitingAlarm,
    pub(super) is_repeated: bool,
}

/// All alarms that wait, the oldest first.
#[derive(Clone, Copy, Debug)]
pub(super) struct OutgoingAlarms {
    waiting: [Option<WaitingAlarm>; CAPACITY],
    timeout: Duration,
    retries: u16,
    sequence: u16,
}

impl WaitingAlarm {
    pub(super) fn notification(&self) -> Notification<'_> {
        Notification {
            priority: self.priority,
            head: self.head,
            module_ident: self.idents.0,
            submodule_ident: self.idents.1,
            specifier: self.specifier,
            items: self.items.get(..self.len).unwrap_or_default(),
        }
    }
}

impl OutgoingAlarms {
    /// Creates an empty queue: an alarm is repeated after `timeout`, `retries` times.
    pub(super) const fn new(timeout: Duration, retries: u16) -> Self {
        Self { waiting: [None; CAPACITY], timeout, retries, sequence: 0 }
    }

    pub(super) fn raise(&mut self, alarm: &Notification<'_>) -> Result<(), AlarmError> {
        let mut items = [0; LONGEST_ITEMS];
        let len = alarm.items.len();
        items.get_mut(..len).ok_or(AlarmError::TooLong(len))?.copy_from_slice(alarm.items);
        let place = self.waiting.iter_mut().find(|place| place.is_none()).ok_or(AlarmError::Full)?;
        let specifier = alarm.specifier & !SEQUENCE | self.sequence & SEQUENCE;
        self.sequence = self.sequence.wrapping_add(1);
        *place = Some(WaitingAlarm {
            priority: alarm.priority,
            head: alarm.head,
            idents: (alarm.module_ident, alarm.submodule_ident),
            specifier,
            items,
            len,
            state: Delivery::Due { is_repeated: false, repetitions: 0 },
        });
        Ok(())
    }

    /// Returns the oldest alarm of a priority: no other one is sent before it is acknowledged.
    fn first(&mut self, priority: Priority) -> Option<&mut WaitingAlarm> {
        self.waiting.iter_mut().flatten().find(|alarm| alarm.priority == priority)
    }

    pub(super) fn has_to_send(&mut self) -> bool {
        [Priority::High, Priority::Low].into_iter().any(|priority| {
            self.first(priority).is_some_and(|alarm| matches!(alarm.state, Delivery::Due { .. }))
        })
    }

    /// Returns the alarm of a priority that is to be sent now, and counts it as sent.
    pub(super) fn next(&mut self, now: Instant, priority: Priority) -> Option<Outgoing> {
        let timeout = self.timeout;
        let alarm = self.first(priority)?;
        let Delivery::Due { is_repeated, repetitions } = alarm.state else { return None };
        alarm.state = Delivery::Sent { repeat: now + timeout, repetitions };
        Some(Outgoing { alarm: *alarm, is_repeated })
    }

    /// Handles that the controller has received the last PDU of a priority.
    pub(super) fn received(&mut self, priority: Priority) {
        if let Some(alarm) = self.first(priority).filter(|alarm| matches!(alarm.state, Delivery::Sent { .. }))
        {
            alarm.state = Delivery::Received;
        }
    }

    /// Handles the acknowledgement of the controller's application: the alarm is done, and the next one may go.
    pub(super) fn acknowledged(&mut self, acknowledgement: &Acknowledgement) {
        let is_it = |alarm: &WaitingAlarm| {
            alarm.priority == acknowledgement.priority
                && alarm.head == acknowledgement.head
                && alarm.specifier == acknowledgement.specifier
                && !matches!(alarm.state, Delivery::Due { is_repeated: false, .. })
        };
        if let Some(at) = self.waiting.iter().position(|place| place.as_ref().is_some_and(is_it)) {
            self.waiting.get_mut(at..).unwrap_or_default().rotate_left(1);
            if let Some(last) = self.waiting.last_mut() {
                *last = None;
            }
        }
    }

    /// Repeats what was not received in time. Returns false after the last repetition.
    pub(super) fn handle_timeout(&mut self, now: Instant) -> bool {
        let retries = self.retries;
        for alarm in self.waiting.iter_mut().flatten() {
            if let Delivery::Sent { repeat, repetitions } = alarm.state
                && repeat <= now
            {
                if repetitions >= retries {
                    return false;
                }
                alarm.state = Delivery::Due { is_repeated: true, repetitions: repetitions + 1 };
            }
        }
        true
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let repeats = self.waiting.iter().flatten().filter_map(|alarm| match alarm.state {
            Delivery::Sent { repeat, .. } => Some(repeat),
            _ => None,
        });
        repeats.min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::Status;

    const TIMEOUT: Duration = Duration::from_millis(100);

    fn alarm(slot: u16, priority: Priority) -> Notification<'static> {
        let head = AlarmHead { alarm_type: 1, api: 0, slot, subslot: 1 };
        Notification {
            priority,
            head,
            module_ident: 1,
            submodule_ident: 2,
            specifier: 0xA800,
            items: &[1, 2],
        }
    }

    fn acknowledge(alarms: &mut OutgoingAlarms, sent: &WaitingAlarm) {
        let Notification { priority, head, specifier, .. } = sent.notification();
        alarms.acknowledged(&Acknowledgement { priority, head, specifier, status: Status::OK });
    }

    #[test]
    fn the_next_alarm_of_a_priority_waits_for_the_acknowledgement_of_the_one_before() {
        let mut alarms = OutgoingAlarms::new(TIMEOUT, 3);
        alarms.raise(&alarm(1, Priority::Low)).unwrap();
        alarms.raise(&alarm(2, Priority::Low)).unwrap();
        alarms.raise(&alarm(3, Priority::High)).unwrap();
        let first = alarms.next(Instant::ZERO, Priority::Low).unwrap().alarm;
        assert_eq!((first.head.slot, first.specifier), (1, 0xA800));
        assert!(alarms.next(Instant::ZERO, Priority::Low).is_none());
        assert_eq!(alarms.next(Instant::ZERO, Priority::High).unwrap().alarm.head.slot, 3);
        alarms.received(Priority::Low);
        assert!(
            alarms.next(Instant::ZERO, Priority::Low).is_none(),
            "the application has not acknowledged it"
        );
        acknowledge(&mut alarms, &first);
        let second = alarms.next(Instant::ZERO, Priority::Low).unwrap().alarm;
        assert_eq!((second.head.slot, second.specifier), (2, 0xA801), "each alarm has a number of its own");
    }

    #[test]
    fn an_alarm_is_repeated_until_it_is_received_and_given_back_after_the_last_repetition() {
        let mut alarms = OutgoingAlarms::new(TIMEOUT, 3);
        alarms.raise(&alarm(1, Priority::Low)).unwrap();
        let mut now = Instant::ZERO;
        for repetition in 0..=3 {
            let sent = alarms.next(now, Priority::Low).unwrap();
            assert_eq!(sent.is_repeated, repetition > 0);
            assert!(alarms.handle_timeout(now), "not yet");
            now += TIMEOUT;
            assert_eq!(alarms.poll_timeout(), Some(now));
            assert_eq!(alarms.handle_timeout(now), repetition < 3);
        }
        let mut received = OutgoingAlarms::new(TIMEOUT, 3);
        received.raise(&alarm(1, Priority::Low)).unwrap();
        received.next(Instant::ZERO, Priority::Low).unwrap();
        received.received(Priority::Low);
        assert_eq!(received.poll_timeout(), None);
    }

    #[test]
    fn alarms_that_find_no_room_or_are_too_long_are_refused() {
        let mut alarms = OutgoingAlarms::new(TIMEOUT, 3);
        let long = [0; LONGEST_ITEMS + 1];
        let too_long = Notification { items: &long, ..alarm(1, Priority::Low) };
        assert_eq!(alarms.raise(&too_long), Err(AlarmError::TooLong(LONGEST_ITEMS + 1)));
        for _ in 0..CAPACITY {
            alarms.raise(&alarm(1, Priority::Low)).unwrap();
        }
        assert_eq!(alarms.raise(&alarm(1, Priority::Low)), Err(AlarmError::Full));
        let first = alarms.next(Instant::ZERO, Priority::Low).unwrap().alarm;
        acknowledge(&mut alarms, &first);
        alarms.raise(&alarm(1, Priority::Low)).unwrap();
    }
}
