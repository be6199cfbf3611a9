//! A simple MainDevice, which sends one datagram in each frame: for what ethercrab does not send.

use ethercat_subdevice::{DeviceId, Event, Segment};
use machine::{Duration, Instant, Machine, Port, Source};

pub const APRD: u8 = 1;
pub const APWR: u8 = 2;
pub const FPRD: u8 = 4;
pub const FPWR: u8 = 5;
pub const FPRW: u8 = 6;
pub const BRD: u8 = 7;
pub const BWR: u8 = 8;
pub const BRW: u8 = 9;
pub const LRD: u8 = 10;
pub const LWR: u8 = 11;
pub const LRW: u8 = 12;
pub const ARMW: u8 = 13;
pub const FRMW: u8 = 14;

/// Station address that [`RawMainDevice::start`] gives to the first device; the next ones follow.
pub const FIRST: u16 = 0x1000;

pub struct RawMainDevice {
    pub segment: Segment,
    pub now: Instant,
    counter: u8,
    /// Length in bytes of the first device's mailboxes.
    mailbox: u16,
    pub events: Vec<(DeviceId, Event)>,
}

impl RawMainDevice {
    pub fn new(segment: Segment) -> Self {
        Self { segment, now: Instant::ZERO, counter: 0, mailbox: 128, events: Vec::new() }
    }

    /// Sends a frame; returns the one that comes back.
    pub fn send(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        self.segment.handle_frame(self.now, Source { port: Port::Ethernet, peer: None }, frame);
        let mut buf = vec![0; 4096];
        // If the cable delays the frame, the reply comes at the next deadline.
        let mut sent = None;
        for _ in 0..2 {
            sent = self.segment.poll_transmit(self.now, &mut buf);
            let Some(due) = self.segment.poll_timeout().filter(|_| sent.is_none()) else { break };
            self.now = self.now.max(due);
            self.segment.handle_timeout(self.now);
        }
        while let Some(event) = self.segment.poll_event() {
            self.events.push(event);
        }
        sent.map(|transmit| buf[..transmit.len].to_vec())
    }

    /// Sends a datagram. Returns its address, data and working counter when it is back.
    pub fn exchange_at(&mut self, command: u8, address: u32, data: &[u8]) -> Option<(u32, Vec<u8>, u16)> {
        let reply = self.send(&frame(command, address, data))?;
        let end = 26 + data.len();
        Some((
            u32::from_le_bytes(reply[18..22].try_into().unwrap()),
            reply[26..end].to_vec(),
            u16::from_le_bytes(reply[end..end + 2].try_into().unwrap()),
        ))
    }

    pub fn exchange(&mut self, command: u8, position: u16, offset: u16, data: &[u8]) -> (Vec<u8>, u16) {
        let address = u32::from(position) | u32::from(offset) << 16;
        let (_, data, working_counter) = self.exchange_at(command, address, data).expect("a reply");
        (data, working_counter)
    }

    pub fn read(&mut self, offset: u16, len: usize) -> (Vec<u8>, u16) {
        self.exchange(FPRD, FIRST, offset, &vec![0; len])
    }

    pub fn write(&mut self, offset: u16, data: &[u8]) -> u16 {
        self.exchange(FPWR, FIRST, offset, data).1
    }

    pub fn wait(&mut self, time: Duration) {
        let end = self.now + time;
        while let Some(due) = self.segment.poll_timeout().filter(|due| *due <= end) {
            self.now = self.now.max(due);
            self.segment.handle_timeout(self.now);
        }
        self.now = end;
        while let Some(event) = self.segment.poll_event() {
            self.events.push(event);
        }
    }

    /// Gives all devices their addresses, and brings the first, with mailboxes of 128 bytes, to PRE-OP.
    pub fn start(segment: Segment) -> Self {
        Self::start_with(segment, 128)
    }

    /// Brings a segment up like [`start`](Self::start), with mailboxes of another length, up to 128 bytes.
    pub fn start_with(segment: Segment, mailbox: u16) -> Self {
        let mut main_device = Self { mailbox, ..Self::new(segment) };
        let [low, high] = mailbox.to_le_bytes();
        for position in 0..main_device.segment.len() as u16 {
            let address = (FIRST + position).to_le_bytes();
            assert_eq!(main_device.exchange(APWR, 0_u16.wrapping_sub(position), 0x0010, &address).1, 1);
        }
        assert_eq!(main_device.write(0x0800, &[0x00, 0x10, low, high, 0x26, 0, 1, 0]), 1);
        assert_eq!(main_device.write(0x0808, &[0x80, 0x10, low, high, 0x22, 0, 1, 0]), 1);
        main_device.request_state(2);
        assert_eq!(main_device.al_status(), (0x02, 0));
        main_device
    }

    /// Brings the first device, a bridge in PRE-OP, to OP.
    pub fn operate(&mut self) {
        assert_eq!(self.write(0x0810, &[0x00, 0x11, 0x00, 0x01, 0x64, 0, 1, 0]), 1);
        assert_eq!(self.write(0x0818, &[0x00, 0x14, 0x00, 0x01, 0x20, 0, 1, 0]), 1);
        self.request_state(4);
        self.request_state(8);
        assert_eq!(self.al_status(), (0x08, 0));
    }

    pub fn request_state(&mut self, state: u8) {
        assert_eq!(self.write(0x0120, &[state, 0]), 1);
    }

    /// Returns AL status and AL status code.
    pub fn al_status(&mut self) -> (u8, u16) {
        let (status, _) = self.read(0x0130, 6);
        (status[0], u16::from_le_bytes([status[4], status[5]]))
    }

    /// Puts a message into the first device's mailbox. Returns the working counter.
    pub fn post(&mut self, protocol: u8, body: &[u8]) -> u16 {
        self.counter = self.counter % 7 + 1;
        self.post_as(self.counter, protocol, body)
    }

    pub fn post_as(&mut self, counter: u8, protocol: u8, body: &[u8]) -> u16 {
        let mut message = (body.len() as u16).to_le_bytes().to_vec();
        message.extend([0, 0, 0, protocol | counter << 4]);
        message.extend(body);
        message.resize(usize::from(self.mailbox), 0);
        self.write(0x1000, &message)
    }

    /// Fetches a message: protocol, counter and body; `None` if the mailbox is empty.
    pub fn fetch(&mut self) -> Option<(u8, u8, Vec<u8>)> {
        let (message, working_counter) = self.read(0x1080, usize::from(self.mailbox));
        if working_counter == 0 {
            return None;
        }
        let len = usize::from(u16::from_le_bytes([message[0], message[1]]));
        Some((message[5] & 0x0F, message[5] >> 4, message[6..6 + len].to_vec()))
    }

    /// Sends a CoE message and returns the answer.
    pub fn coe(&mut self, service: u8, body: &[u8]) -> Vec<u8> {
        let mut message = vec![0, service << 4];
        message.extend(body);
        assert_eq!(self.post(3, &message), 1);
        let (protocol, _, answer) = self.fetch().expect("an answer");
        assert_eq!(protocol, 3);
        answer
    }

    pub fn sdo(&mut self, body: &[u8]) -> Vec<u8> {
        self.coe(2, body)[2..].to_vec()
    }
}

/// Returns a frame with one datagram.
pub fn frame(command: u8, address: u32, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xFF; 6];
    frame.extend([0x10; 6]);
    frame.extend([0x88, 0xA4]);
    frame.extend((0x1000 | (12 + data.len()) as u16).to_le_bytes());
    frame.extend([command, 0]);
    frame.extend(address.to_le_bytes());
    frame.extend((data.len() as u16).to_le_bytes());
    frame.extend([0, 0]);
    frame.extend(data);
    frame.extend([0, 0]);
    frame.resize(frame.len().max(60), 0);
    frame
}
