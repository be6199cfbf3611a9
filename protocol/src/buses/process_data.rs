//! EtherCAT: the image is the process data of one SubDevice in its direction.

use alloc::vec;
use alloc::vec::Vec;
use core::fmt;

use ethercat_subdevice::description::process_data_len;
use ethercat_subdevice::{
    AlState, AlStatusCode, DataError, DeviceConfig, DeviceId, Event, Segment, SegmentEnd,
};
use machine::{
    Counters, Down, DownCause, Instant, LinkEvent, Machine, Pending, PortRequest, Source, Transmit,
};

use crate::fieldbus::Fieldbus;
use crate::image::{IMAGE_LEN, Image, Order};

/// The SubDevice of a robot. Its connection is up while it is in OP and the MainDevice has written outputs.
#[derive(Debug)]
pub struct EthercatSubDevice {
    segment: Segment,
    device: DeviceId,
    up: bool,
    /// Whether this side ended the connection.
    left: bool,
    counters: Counters,
    /// Inputs as they are sent: the image, and zeros beyond it.
    inputs: Vec<u8>,
}

impl EthercatSubDevice {
    /// Creates a SubDevice that is described by [`ETHERCAT_ROBOT`](crate::stations::ETHERCAT_ROBOT), or by another
    /// description with at least an image each way.
    #[must_use]
    pub fn new(config: &DeviceConfig) -> Self {
        let mut segment = Segment::new();
        let inputs = vec![0; process_data_len(config.description.inputs).into()];
        let device = segment.add(config);
        Self { segment, device, up: false, left: false, counters: Counters::default(), inputs }
    }

    /// Connects its port 1 to the next SubDevice of the line, as [`Segment::lead_on`].
    pub fn lead_on(&mut self) {
        self.segment.lead_on();
    }

    /// Sets whether there is a link at its port 1, as [`Segment::set_onward_link`].
    pub fn set_onward_link(&mut self, is_up: bool) {
        self.segment.set_onward_link(is_up);
    }

    /// Handles a frame that the next SubDevices of the line sent back.
    pub fn handle_returned(&mut self, now: Instant, frame: &[u8]) {
        self.segment.handle_returned(now, frame);
    }

    /// Writes the next frame to send into `buf`, and returns the port by which it leaves: for an owner with a cable at each.
    pub fn poll_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<(SegmentEnd, Transmit)> {
        let (end, transmit) = self.segment.poll_frame(now, buf)?;
        // A frame that goes on to the next SubDevice comes back and is sent then.
        self.counters.sent += u64::from(self.up && end == SegmentEnd::Upstream);
        Some((end, transmit))
    }

    /// Returns the state of the SubDevice, and the error that it indicates.
    #[must_use]
    pub fn state(&self) -> (AlState, AlStatusCode) {
        self.segment.state(self.device).unwrap_or((AlState::Init, AlStatusCode::NO_ERROR))
    }

    /// Returns what a change of the state means for the connection, if anything.
    fn link_event(&mut self, state: AlState, code: AlStatusCode) -> Option<LinkEvent> {
        let is_up = state == AlState::Op;
        if core::mem::replace(&mut self.up, is_up) == is_up {
            return None;
        }
        if is_up {
            return Some(LinkEvent::Up);
        }
        let (cause, text) = match code {
            _ if self.left => (DownCause::ClosedHere, ""),
            AlStatusCode::WATCHDOG => (DownCause::Watchdog, code.text()),
            AlStatusCode::NO_ERROR => (DownCause::ClosedByPeer, "the MainDevice requested a state below OP"),
            _ => (DownCause::ClosedByPeer, code.text()),
        };
        Some(LinkEvent::Down(Down { cause, code: code.0.into(), text }))
    }
}

impl Machine for EthercatSubDevice {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.segment.handle_frame(now, from, frame);
        self.counters.received += u64::from(self.up);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.segment.handle_timeout(now);
    }

    fn pending(&self, now: Instant) -> Pending {
        self.segment.pending(now)
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let transmit = self.segment.poll_transmit(now, buf)?;
        self.counters.sent += u64::from(self.up);
        Some(transmit)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        while let Some((_, event)) = self.segment.poll_event() {
            if let Event::StateChanged { state, code } = event
                && let Some(event) = self.link_event(state, code)
            {
                return Some(event);
            }
        }
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.segment.poll_timeout()
    }
}

impl Fieldbus for EthercatSubDevice {
    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    /// The process data may be longer than the image.
    fn set_output(&mut self, image: &Image) {
        if let Some(place) = self.inputs.first_chunk_mut() {
            *place = *image;
        }
        // While a MainDevice assigns PDOs the device has other process data, or none. The next image is set once it is done.
        let taken = self.segment.set_inputs(self.device, &self.inputs);
        debug_assert!(!matches!(taken, Err(DataError::NoDevice(_))), "the segment has the device");
    }

    fn input(&self) -> Option<Image> {
        self.segment.outputs(self.device)?.first_chunk::<IMAGE_LEN>().copied()
    }

    /// A SubDevice cannot end a connection. It falls to SAFE-OP and says that there is an error.
    fn disconnect(&mut self, _now: Instant) {
        self.left = true;
        self.segment.fail(self.device, AlStatusCode::UNSPECIFIED_ERROR);
    }

    /// Writes the state that the MainDevice requested and the device reached, and its error.
    fn write_request(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let (state, code) = self.state();
        if state == AlState::Init && code == AlStatusCode::NO_ERROR {
            return Ok(());
        }
        write!(words, "a MainDevice led this SubDevice to {state}")?;
        if code == AlStatusCode::NO_ERROR { Ok(()) } else { write!(words, "; AL status code {code}") }
    }

    fn counters(&self) -> Counters {
        Counters { foreign: self.segment.counters().foreign, ..self.counters }
    }
}
