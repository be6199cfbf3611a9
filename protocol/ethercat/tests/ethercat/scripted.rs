//! ethercrab's MainDevice as a machine: its futures are polled with the time of the driver, its frames handed over inline.

use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use ethercrab::{PduRx, PduTx};
use machine::{Instant, Machine, Port, PortRequest, Source, Transmit};

use crate::time;

/// A MainDevice that follows a script, and the frames of both.
pub struct Scripted<'a, T> {
    script: Option<Pin<Box<dyn Future<Output = T> + 'a>>>,
    tx: PduTx<'a>,
    rx: PduRx<'a>,
    wake: Option<Instant>,
    result: Option<T>,
    /// Frames that ethercrab could not use.
    pub refused: usize,
}

impl<'a, T> Scripted<'a, T> {
    /// Creates a machine and runs the script to where it waits first.
    pub fn start(
        script: Pin<Box<dyn Future<Output = T> + 'a>>,
        tx: PduTx<'a>,
        rx: PduRx<'a>,
        now: Instant,
    ) -> Self {
        let mut scripted = Self { script: Some(script), tx, rx, wake: None, result: None, refused: 0 };
        scripted.poll(now);
        scripted
    }

    fn poll(&mut self, now: Instant) {
        let Some(script) = &mut self.script else { return };
        let mut context = Context::from_waker(Waker::noop());
        let (poll, wake) = time::at(now, || script.as_mut().poll(&mut context));
        self.wake = wake;
        if let Poll::Ready(result) = poll {
            (self.script, self.wake, self.result) = (None, None, Some(result));
        }
    }
}

impl<T> Machine for Scripted<'_, T> {
    type Event = T;

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Ethernet { ether_type: ethercat_subdevice::ETHER_TYPE, groups: &[] }]
    }

    fn handle_frame(&mut self, now: Instant, _from: Source, frame: &[u8]) {
        // A late or a double frame is an error to it; the rest goes on.
        self.refused += usize::from(self.rx.receive_frame(frame).is_err());
        self.poll(now);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.poll(now);
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let frame = self.tx.next_sendable_frame()?;
        let mut len = 0;
        let sent = frame.send_blocking(|bytes| {
            buf[..bytes.len()].copy_from_slice(bytes);
            len = bytes.len();
            Ok(len)
        });
        sent.ok().map(|_| Transmit { port: Port::Ethernet, to: None, len })
    }

    fn poll_event(&mut self) -> Option<T> {
        self.result.take()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.wake
    }
}
