//! A MainDevice whose SubDevice answers anything by its mailbox (CoE): SDOs, segments, aborts, emergencies.

use ethercat_maindevice::{Config, ExpectedDevice, LONGEST_OBJECT, MainDevice, SdoRequest, SubDeviceId};
use ethercat_subdevice::{DeviceConfig, Segment};
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, LinkEvent, Machine as _, Port, Source};
use virtual_time::hostile::{Choices as _, Script};

use crate::ethercat::{devices, exchange};

/// Start and length of the mailbox to the MainDevice, as the segment places them, and the register with its state.
const MAILBOX: (u16, u16) = (0x1080, 128);
const STATUS: u16 = 0x080D;
const FULL: u8 = 0x08;

/// Read from a configured address (ETG.1000.4, commands).
const FPRD: u8 = 4;

/// Objects that are accessed: index, subindex, complete access, and bytes to write.
const ACCESSES: [(u16, u8, bool, Option<usize>); 5] = [
    (0x1018, 1, false, None),
    (0x8000, 0, true, None),
    (0x8001, 0, false, None),
    (0x8000, 1, false, Some(2)),
    (0x8001, 0, false, Some(400)),
];

/// Accesses of one input.
const MOST_ACCESSES: usize = 4;

/// Emergencies that a MainDevice keeps.
const MOST_EMERGENCIES: usize = 16;

/// A MainDevice and its SubDevice.
struct MailboxRig {
    main: MainDevice,
    segment: Segment,
    now: Instant,
    is_up: bool,
    buf: Vec<u8>,
    /// Index and subindex of the object that is accessed.
    object: (u16, u8),
}

/// Answers accesses to objects.
pub(crate) fn mailbox(data: &[u8]) {
    let mut script = Script::new(data);
    let mut rig = MailboxRig::new();
    let id = SubDeviceId(0);
    rig.run(None, Instant::from_millis(3_000), |rig| rig.is_up);
    assert!(rig.is_up, "the device does not come to OP");
    for _ in 0..MOST_ACCESSES {
        if script.is_over() {
            break;
        }
        let (index, subindex, is_complete, written) = ACCESSES[script.below(ACCESSES.len())];
        let data = written.map(|len| vec![7; len]);
        let answer = rig.access(Some(&mut script), SdoRequest { index, subindex, is_complete, data });
        match answer {
            Ok(read) => assert!(read.len() <= LONGEST_OBJECT, "{} bytes", read.len()),
            Err(reason) => assert!(!reason.is_empty()),
        }
        let emergencies = std::iter::from_fn(|| rig.main.poll_emergency(id)).count();
        assert!(emergencies <= MOST_EMERGENCIES, "{emergencies} emergencies are kept");
    }
    // The device itself is well: the next access succeeds.
    let (index, subindex) = (0x1018, 1);
    let request = || SdoRequest { index, subindex, is_complete: false, data: None };
    let vendor = devices::BRIDGE.vendor_id.to_le_bytes().to_vec();
    assert_eq!(rig.access(None, request()), Ok(vendor));
    assert!(rig.is_up, "answers by the mailbox ended the connection");
}

impl MailboxRig {
    fn new() -> Self {
        let device = &devices::BRIDGE;
        let mut segment = Segment::new();
        segment.add(&DeviceConfig::new(device));
        let expected = ExpectedDevice {
            vendor: device.vendor_id,
            product: device.product_code,
            revision: None,
            output_bytes: 256,
            input_bytes: 256,
        };
        let config = Config {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            devices: vec![expected],
            cycle: Duration::from_millis(4),
            watchdog: Duration::from_millis(100),
        };
        let mut main = match MainDevice::new(config, Instant::ZERO) {
            Ok(main) => main,
            Err(error) => panic!("{error}"),
        };
        main.set_mailbox(SubDeviceId(0), MAILBOX.0, MAILBOX.1);
        let buf = vec![0; FRAME_CAPACITY];
        Self { main, segment, now: Instant::ZERO, is_up: false, buf, object: (0, 0) }
    }

    /// Accesses an object while the script answers.
    fn access(&mut self, script: Option<&mut Script>, request: SdoRequest) -> Result<Vec<u8>, String> {
        self.object = (request.index, request.subindex);
        let asked = self.main.request_sdo(SubDeviceId(0), request);
        asked.unwrap_or_else(|refusal| panic!("{refusal}"));
        let mut answer = None;
        // Each part of an access may take a second, and a script has parts for some.
        let until = self.now + Duration::from_secs(600);
        self.run(script, until, |rig| {
            answer = rig.main.take_sdo(SubDeviceId(0));
            answer.is_some()
        });
        answer.unwrap_or_else(|| panic!("an access without an end"))
    }

    /// Lets time pass until something has happened.
    fn run(
        &mut self,
        mut script: Option<&mut Script>,
        until: Instant,
        mut has_happened: impl FnMut(&mut Self) -> bool,
    ) {
        loop {
            let mut buf = std::mem::take(&mut self.buf);
            while let Some(sent) = self.main.poll_transmit(self.now, &mut buf) {
                let reply = exchange(&mut self.segment, &mut self.now, &buf[..sent.len]);
                let Some(mut reply) = reply else { continue };
                if let Some(script) = script.as_deref_mut().filter(|script| !script.is_over()) {
                    self.replace_mail(&mut reply, script);
                }
                self.main.handle_frame(self.now, Source { port: Port::Ethernet, peer: None }, &reply);
            }
            self.buf = buf;
            while let Some((_, event)) = self.main.poll_event() {
                match event {
                    LinkEvent::Up => self.is_up = true,
                    LinkEvent::Down(_) => self.is_up = false,
                    _ => {}
                }
            }
            if has_happened(self) {
                return;
            }
            let Some(due) = self.main.poll_timeout().filter(|due| *due <= until) else { return };
            self.now = self.now.max(due);
            self.main.handle_timeout(self.now);
        }
    }

    /// Puts the script's message where a reply has the content of the mailbox, which is always full.
    fn replace_mail(&self, reply: &mut [u8], script: &mut Script) {
        // Ethernet and EtherCAT head, then datagrams: command, index, address, offset, length, interrupt, data, working counter.
        let mut at = 16;
        while let Some(head) = reply.get(at..at + 10) {
            let (command, offset) = (head[0], u16::from_le_bytes([head[4], head[5]]));
            let length = u16::from_le_bytes([head[6], head[7]]);
            let (len, has_next) = (usize::from(length & 0x07FF), length & 0x8000 != 0);
            let Some(data) = reply.get_mut(at + 10..at + 12 + len) else { return };
            if (command, offset) == (FPRD, STATUS) {
                data[0] |= FULL;
            }
            if (command, offset) == (FPRD, MAILBOX.0) {
                let mail = mail(script, self.object);
                data.fill(0);
                let most = mail.len().min(len);
                data[..most].copy_from_slice(&mail[..most]);
                data[len] = 1;
            }
            if !has_next {
                return;
            }
            at += 12 + len;
        }
    }
}

/// Makes a message: bytes without an order, or a message of CoE about an object.
fn mail(script: &mut Script, (index, subindex): (u16, u8)) -> Vec<u8> {
    let kind = script.below(8);
    let len = script.below(128);
    if kind == 0 {
        return script.take(len);
    }
    let service: u16 = [3, 3, 2, 1, 8][script.below(5)];
    let mut body = (service << 12).to_le_bytes().to_vec();
    body.push(script.below(256) as u8);
    // An answer about the object, or data of a segment.
    if kind < 6 {
        body.extend(index.to_le_bytes());
        body.push(subindex);
    }
    body.extend(script.take(len));
    let length = if kind == 1 { script.below(65_536) } else { body.len() };
    let mut mail = (length as u16).to_le_bytes().to_vec();
    mail.extend([0, 0, 0, if kind == 2 { script.below(16) as u8 } else { 3 }]);
    mail.extend(body);
    mail
}
