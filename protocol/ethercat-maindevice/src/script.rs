//! A future that uses ethercrab, as a machine.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use ethercrab::{MainDeviceConfig, PduRx, PduStorage, PduTx, Timeouts};
use machine::ethernet::Mac;
use machine::{Instant, Machine, Port, PortRequest, Source, Transmit};

use crate::frames::{self, FRAMES, Frames, IN_FLIGHT};
use crate::lend::lend;
use crate::{ETHER_TYPE, time};

/// Longest datagram of process data in bytes.
const DATA: usize = PduStorage::element_size(1486);

/// ethercrab's memory of the frames under way.
pub(crate) type Storage = PduStorage<IN_FLIGHT, DATA>;

/// Time from one read of a device to the next while something is awaited there: a state, the EEPROM, a mailbox.
const LOOK: core::time::Duration = core::time::Duration::from_millis(1);

/// Gives ethercrab a time between the reads by which it waits for a device. Its default is none: it then reads as fast as
/// frames come back, thousands of times a second, and for ever on a cable where frames take no time.
pub(crate) fn with_pauses(timeouts: Timeouts) -> Timeouts {
    let wait_loop_delay = match timeouts.wait_loop_delay {
        core::time::Duration::ZERO => LOOK,
        chosen => chosen,
    };
    Timeouts { wait_loop_delay, ..timeouts }
}

/// Runs `script` with a MainDevice of ethercrab whose frames are those of the machine that polls this future: a
/// [`Scripted`]. Where `timeouts` has no `wait_loop_delay`, it becomes 1 ms.
///
/// # Panics
///
/// Never: the memory of the frames is split once.
pub async fn with_main_device<T>(
    timeouts: Timeouts,
    config: MainDeviceConfig,
    script: impl AsyncFnOnce(&ethercrab::MainDevice<'_>) -> T,
) -> T {
    let storage = Storage::new();
    #[expect(clippy::expect_used, reason = "new memory was not split before")]
    let (tx, rx, pdu_loop) = storage.try_split().expect("new memory");
    let main_device = ethercrab::MainDevice::new(pdu_loop, with_pauses(timeouts), config);
    let script = pin!(script(&main_device));
    exchange(tx, rx, script).await
}

/// Set when ethercrab has frames to send. To look for frames takes longer than all other steps of a poll.
#[derive(Debug)]
struct HasFrames(AtomicBool);

impl Wake for HasFrames {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Polls `script`; before that, gives ethercrab the received frame, and after it, takes the frames to send.
pub(crate) async fn exchange<T>(
    mut tx: PduTx<'_>,
    mut rx: PduRx<'_>,
    mut script: Pin<&mut impl Future<Output = T>>,
) -> T {
    let has_frames = Arc::new(HasFrames(AtomicBool::new(false)));
    let waker = Waker::from(Arc::clone(&has_frames));
    poll_fn(|context| {
        // ethercrab removes the waker when it wakes it.
        tx.replace_waker(&waker);
        FRAMES.with_borrow_mut(|frames| frames.give(&mut rx));
        let result = script.as_mut().poll(context);
        if has_frames.0.swap(false, Ordering::Relaxed) {
            let all = FRAMES.with_borrow_mut(|frames| frames.take(&mut tx));
            has_frames.0.store(!all, Ordering::Relaxed);
        }
        result
    })
    .await
}

/// A future made by [`with_main_device`], as a machine. Its event is the future's result.
#[derive(Debug)]
pub struct Scripted<F: Future> {
    script: Option<Pin<Box<F>>>,
    frames: Frames,
    wake: Option<Instant>,
    result: Option<F::Output>,
}

impl<F: Future> Scripted<F> {
    /// Creates a machine that runs the script from `start` on.
    pub fn new(script: F, start: Instant) -> Self {
        Self { script: Some(Box::pin(script)), frames: Frames::new(None), wake: Some(start), result: None }
    }

    /// Sends from the address of this interface. Then frames of other MainDevices on the cable, even if they use ethercrab as
    /// well, are not taken for replies.
    #[must_use]
    pub fn on_interface(self, address: Mac) -> Self {
        Self { frames: Frames::new(Some(address)), ..self }
    }

    /// Returns how many received frames ethercrab could not use: late, duplicated and damaged ones.
    pub const fn refused(&self) -> u64 {
        self.frames.refused()
    }

    /// Returns how many frames of other MainDevices came.
    pub const fn foreign(&self) -> u64 {
        self.frames.foreign.heard()
    }

    /// Returns the next frame to send, which stays.
    pub(crate) fn next_frame(&self) -> Option<&[u8]> {
        self.frames.next()
    }

    /// Removes the next frame to send.
    pub(crate) const fn drop_frame(&mut self) {
        self.frames.drop_next();
    }

    /// Takes note of another MainDevice, for the next poll.
    pub(crate) const fn hear_other(&mut self, now: Instant, mac: Mac) {
        self.frames.foreign.found_by_others(now, mac);
    }

    /// Ends the script where it is.
    pub(crate) fn cancel(&mut self) {
        (self.script, self.wake) = (None, None);
    }

    pub(crate) fn poll(&mut self, now: Instant) {
        let Some(script) = &mut self.script else { return };
        let mut context = Context::from_waker(Waker::noop());
        let poll = || time::at(now, || script.as_mut().poll(&mut context));
        let (poll, wake) = lend(frames::PLACE, &mut self.frames, poll);
        self.wake = wake;
        if let Poll::Ready(result) = poll {
            self.cancel();
            self.result = Some(result);
        }
    }
}

impl<F: Future> Machine for Scripted<F> {
    type Event = F::Output;

    /// Other MainDevices may send to any address.
    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::AnyEthernet { ether_type: ETHER_TYPE }]
    }

    fn handle_frame(&mut self, now: Instant, _from: Source, frame: &[u8]) {
        self.frames.receive(now, frame);
        self.poll(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.poll(now);
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let len = self.frames.send(buf)?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }

    fn poll_event(&mut self) -> Option<F::Output> {
        self.result.take()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.wake
    }
}
