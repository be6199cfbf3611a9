//! Whether another MainDevice has the devices, before this one changes anything: it reads states and listens.
//!
//! Devices in INIT belong to nobody. All others were brought there by a MainDevice. If that one ended, no frame of it
//! comes, and the devices leave OP when their watchdogs expire; if it runs, its frames are heard, or the watchdogs do not
//! expire.

use ethercrab::error::Error;
use ethercrab::{Command, MainDevice};
use machine::ethernet::Mac;
use machine::{Duration, Instant};

use crate::config::MAX_DEVICES;
use crate::frames::FRAMES;
use crate::problem::Problem;
use crate::slot::Slot;
use crate::time;

/// Time to listen for another MainDevice. Those that exchange process data send every few milliseconds; those that bring
/// devices up, as this one, at least every 50 ms.
const LISTEN: Duration = Duration::from_millis(100);

/// Time to go on listening after a frame that alone proves nothing.
const AFTER_A_FRAME: Duration = Duration::from_secs(1);

/// Longest watchdog that is waited for: with its usual divider it has 65535 steps of 100 µs.
const LONGEST_WATCHDOG: Duration = Duration::from_secs(7);

/// Time that a device may take to leave OP after its watchdog has expired.
const TO_LEAVE_OP: Duration = Duration::from_millis(20);

/// Replies to earlier frames of this MainDevice that may still come.
const LATE_REPLIES: u64 = 8;

/// Time without a frame of another MainDevice after which this one tries again, and how often it doubles: two that stop
/// each other must not do so for ever.
const QUIET: Duration = Duration::from_secs(1);
const DOUBLINGS: u32 = 5;

/// Time of driving after which a disturbance is the first one again.
const SETTLED: Duration = Duration::from_secs(60);

/// Registers (ETG.1000.4): station address, AL status, watchdog divider, watchdog time, sync managers.
const STATION_ADDRESS: u16 = 0x0010;
const AL_STATUS: u16 = 0x0130;
const WATCHDOG_DIVIDER: u16 = 0x0400;
const WATCHDOG_TIME: u16 = 0x0420;
const SYNC_MANAGERS: u16 = 0x0800;

/// AL states, in the low four bits of the AL status.
const STATE: u8 = 0x0F;
const INIT: u8 = 1;
const OP: u8 = 8;

/// How long this MainDevice stays silent after another one was heard.
#[derive(Debug)]
pub(crate) struct Quiet {
    /// State of a generator of random numbers, which differ from those of other MainDevices.
    random: u64,
    /// How often this MainDevice was disturbed while it sent.
    disturbances: u32,
}

impl Quiet {
    pub(crate) fn new(Mac(mac): Mac, start: Instant) -> Self {
        let seed = mac.iter().fold(start.as_nanos(), |seed, byte| seed.rotate_left(8) ^ u64::from(*byte));
        Self { random: seed, disturbances: 0 }
    }

    /// Returns this time plus up to a half of it.
    fn longer(&mut self, time: Duration) -> Duration {
        // SplitMix64.
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.random;
        bits = (bits ^ bits >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        time + time / 2 * (bits >> 48) as u32 / (1 << 16)
    }

    /// Takes note that another MainDevice began to send, after this one had driven the devices for this time.
    pub(crate) fn disturbed(&mut self, driven: Duration) {
        self.disturbances = if driven < SETTLED { (self.disturbances + 1).min(DOUBLINGS) } else { 0 };
    }

    /// Waits until no other MainDevice was heard for some time.
    pub(crate) async fn wait(&mut self) {
        let quiet = self.longer(QUIET * (1 << self.disturbances));
        let start = time::now();
        loop {
            let last = FRAMES.with_borrow(|frames| frames.foreign.last());
            let until = last.map_or(start, |last| last.max(start)) + quiet;
            if time::now() >= until {
                break;
            }
            time::wait_until(until).await;
        }
        FRAMES.with_borrow_mut(|frames| frames.foreign.forget());
    }
}

/// Fails if another MainDevice drives the devices.
pub(crate) async fn survey(
    main: &MainDevice<'_>,
    slot: Option<Slot>,
    quiet: &mut Quiet,
) -> Result<(), Problem> {
    if let Some(slot) = slot
        && let Some(problem) = taken_by_another_slot(main, slot).await
    {
        return Err(problem);
    }
    // Broadcast: the states of all devices in one byte. If no frame comes back, bringing up reports that.
    let states = Command::brd(AL_STATUS).ignore_wkc().receive::<u8>(main).await.unwrap_or(0);
    let is_free = matches!(states & STATE, 0 | INIT);
    if is_free && FRAMES.with_borrow(|frames| frames.foreign.last().is_none()) {
        return Ok(());
    }
    let since = time::now();
    // Of two that start together, the one with the shorter time is heard by the other.
    listen(since + quiet.longer(LISTEN)).await?;
    let devices = if slot.is_some() { 1 } else { MAX_DEVICES as u16 };
    for position in 0..devices {
        match driven(main, position, since).await {
            Ok(None) => {}
            Ok(Some(problem)) => return Err(problem),
            // There are no more devices, or bringing up meets the same error and reports it.
            Err(_) => return Ok(()),
        }
    }
    Ok(())
}

/// Returns the problem if the device at the slot's place is driven as that of another slot: the devices changed places.
async fn taken_by_another_slot(main: &MainDevice<'_>, slot: Slot) -> Option<Problem> {
    let station = Command::aprd(0, STATION_ADDRESS).receive::<u16>(main).await.ok()?;
    let driven_as = slot.other_with_station(station)?;
    is_in_op(main, 0).await.ok()?.then_some(Problem::Renumbered { driven_as })
}

/// Listens until this instant, and after a suspicious frame longer.
async fn listen(until: Instant) -> Result<(), Problem> {
    let own_before = FRAMES.with_borrow(|frames| frames.own);
    loop {
        let (found, last, own) =
            FRAMES.with_borrow(|frames| (frames.foreign.found(), frames.foreign.last(), frames.own));
        if let Some(mac) = found {
            return Err(Problem::OtherMainDevice { mac });
        }
        if own - own_before > LATE_REPLIES {
            return Err(Problem::SameInterface);
        }
        let until = last.map_or(until, |last| until.max(last + AFTER_A_FRAME));
        if time::now() >= until {
            return Ok(());
        }
        time::wait_until(until).await;
    }
}

/// Returns the problem if a device stays in OP longer than its watchdog allows without a MainDevice.
async fn driven(main: &MainDevice<'_>, position: u16, since: Instant) -> Result<Option<Problem>, Error> {
    if !is_in_op(main, position).await? {
        return Ok(None);
    }
    let Some(watchdog) = watchdog(main, position).await? else { return Ok(None) };
    if let Err(problem) = listen(since + watchdog.min(LONGEST_WATCHDOG) + TO_LEAVE_OP).await {
        return Ok(Some(problem));
    }
    if !is_in_op(main, position).await? {
        return Ok(None);
    }
    let station = Command::aprd(position, STATION_ADDRESS).receive::<u16>(main).await?;
    Ok(Some(Problem::Driven { number: usize::from(position) + 1, station }))
}

async fn is_in_op(main: &MainDevice<'_>, position: u16) -> Result<bool, Error> {
    let status = Command::aprd(position, AL_STATUS).receive::<u8>(main).await?;
    Ok(status & STATE == OP)
}

/// Returns the time of a device's watchdog of process data; `None` if none runs: it has no outputs, or the time is 0.
async fn watchdog(main: &MainDevice<'_>, position: u16) -> Result<Option<Duration>, Error> {
    let managers = Command::aprd(position, SYNC_MANAGERS).receive::<[u8; 64]>(main).await?;
    let (managers, _) = managers.as_chunks::<8>();
    // It has a length. Control: not a mailbox, written by the MainDevice, triggers the watchdog. Activate: enabled.
    let has_watchdog = managers.iter().any(|[_, _, low, high, control, _, activate, _]| {
        (*low, *high) != (0, 0) && control & 0x4F == 0x44 && activate & 1 != 0
    });
    let divider = Command::aprd(position, WATCHDOG_DIVIDER).receive::<u16>(main).await?;
    let steps = Command::aprd(position, WATCHDOG_TIME).receive::<u16>(main).await?;
    // In periods of 25 MHz.
    let step = Duration::from_nanos((u64::from(divider) + 2) * 40);
    Ok((has_watchdog && steps > 0).then(|| step * u32::from(steps)))
}
