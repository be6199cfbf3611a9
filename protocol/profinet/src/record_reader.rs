//! Reading records of a device without a connection, as tools do: the service ReadImplicit (IEC 61158-6-10, 5.2.2).

use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use machine::search::SearchEnded;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

use crate::block::BlockReader;
use crate::description::Identity;
use crate::record::{self, ReadRequest, ReadResponse};
use crate::rpc::{
    DEVICE_INTERFACE, FRAGMENT_LEN, Header, INSTANCE, Kind, Operation, RequestArgs, ResponseArgs, object,
};
use crate::status::Status;
use crate::tries::Tries;
use crate::{RPC_PORT, Uuid};

/// Time after which a request is repeated. A device answers a Read within its cycle, or says that it works on it.
const REPEAT_AFTER: Duration = Duration::from_millis(500);

/// Requests for one record.
const TRIES: u32 = 4;

/// Longest record in bytes: its answer is one datagram, so that nothing has to be acknowledged.
const MOST: u32 = (FRAGMENT_LEN - crate::rpc::ARGS_LEN - record::HEADER_LEN) as u32;

/// Address of a record in a device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RecordPlace {
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
    /// Index of the record.
    pub index: u16,
}

/// Configuration of a reader.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RecordReaderConfig {
    /// IP address of the device.
    pub address: Ipv4Addr,
    /// Its VendorID and DeviceID.
    pub identity: Identity,
    /// The own UDP port.
    pub local_port: u16,
    /// Number of the activity, of which no other one may be the same.
    pub activity: Uuid,
    /// Records to read, in this order.
    pub records: Vec<RecordPlace>,
}

/// Why a record could not be read.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum RecordReadError {
    /// The device did not answer.
    #[error("no answer to the Read")]
    NoAnswer,
    /// The device rejected the call.
    #[error("the call was rejected: the device does not know ReadImplicit")]
    Rejected,
    /// The device refused the Read.
    #[error("refused with PNIOStatus 0x{:08X}", .0.0)]
    Refused(Status),
    /// The answer is not one of PROFINET, or longer than a datagram.
    #[error("the answer is malformed, or longer than one datagram")]
    Malformed,
}

/// Reads records one after the other. It reports [`SearchEnded`] after the last one.
#[derive(Debug)]
pub struct RecordReader {
    port: PortRequest,
    config: RecordReaderConfig,
    answers: Vec<Result<Vec<u8>, RecordReadError>>,
    tries: Tries,
    ended: bool,
}

impl RecordReader {
    /// Creates a reader that sends its first request at `start`.
    #[must_use]
    pub fn new(config: RecordReaderConfig, start: Instant) -> Self {
        let port = PortRequest::Udp(config.local_port);
        let tries = Tries::new(TRIES, REPEAT_AFTER, start);
        Self { port, config, answers: Vec::new(), tries, ended: false }
    }

    /// Returns the records in the order of the configuration, as far as they were read.
    pub fn answers(&self) -> &[Result<Vec<u8>, RecordReadError>] {
        &self.answers
    }

    /// Returns the record that is being read, and the number of its call.
    fn present(&self) -> Option<(RecordPlace, u32)> {
        let number = self.answers.len();
        Some((*self.config.records.get(number)?, u32::try_from(number).unwrap_or(u32::MAX)))
    }

    fn header(&self, sequence: u32) -> Header {
        let object = object(INSTANCE, self.config.identity);
        Header::request(Operation::ReadImplicit, object, DEVICE_INTERFACE, self.config.activity, sequence)
    }

    fn finish(&mut self, now: Instant, answer: Result<Vec<u8>, RecordReadError>) {
        self.answers.push(answer);
        self.tries.restart(now);
    }
}

/// Returns the record in an answer.
fn record_in(header: &Header, body: &[u8], place: RecordPlace) -> Result<Vec<u8>, RecordReadError> {
    if header.is_fragment() {
        return Err(RecordReadError::Malformed);
    }
    let ResponseArgs { status, blocks } =
        ResponseArgs::parse(header, body).map_err(|_| RecordReadError::Malformed)?;
    if status != Status::OK {
        return Err(RecordReadError::Refused(status));
    }
    let response =
        ReadResponse::parse(&mut BlockReader::new(blocks)).map_err(|_| RecordReadError::Malformed)?;
    if response.address.index != place.index {
        return Err(RecordReadError::Malformed);
    }
    Ok(response.record.into())
}

impl Machine for RecordReader {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        core::slice::from_ref(&self.port)
    }

    /// Ignores datagrams of others, and answers to earlier calls.
    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        let Source { port: Port::Udp(port), peer: Some(peer) } = from else { return };
        if port != self.config.local_port || *peer.ip() != self.config.address {
            return;
        }
        let Some((place, sequence)) = self.present() else { return };
        let Ok((header, body)) = Header::parse(frame) else { return };
        if !header.is_same_call(&self.header(sequence)) || !self.tries.are_begun() {
            return;
        }
        match header.kind {
            Kind::Response => self.finish(now, record_in(&header, body, place)),
            Kind::Fault | Kind::Reject => self.finish(now, Err(RecordReadError::Rejected)),
            // It works on it.
            _ => {}
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.present().is_some() && self.tries.handle_timeout(now) {
            self.finish(now, Err(RecordReadError::NoAnswer));
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if !self.tries.take_request() {
            return None;
        }
        let (RecordPlace { slot, subslot, index }, sequence) = self.present()?;
        let number = u16::try_from(sequence).unwrap_or(u16::MAX);
        let address = record::Address { sequence: number, ar: Uuid::NIL, api: 0, slot, subslot, index };
        let request = ReadRequest { address, most: MOST, target_ar: Uuid::NIL };
        let mut body = [0; 2 * record::HEADER_LEN];
        let len = RequestArgs::emit(FRAGMENT_LEN as u32, &mut body, |writer| request.emit(writer)).ok()?;
        let len = self.header(sequence).emit(body.get(..len)?, buf).ok()?;
        let to = Some(SocketAddrV4::new(self.config.address, RPC_PORT));
        Some(Transmit { port: Port::Udp(self.config.local_port), to, len })
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        let is_now = self.present().is_none() && !self.ended;
        self.ended |= is_now;
        is_now.then_some(SearchEnded)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.present().map(|_| self.tries.poll_timeout())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Identification, index, parse_real_identification};
    use crate::samples::DEVICE;
    use crate::{Device, DeviceConfig};
    use alloc::vec;
    use machine::ethernet::Mac;

    const ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
    const TOOL: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 1), 50_000);

    fn reader(identity: Identity) -> RecordReader {
        let place = |slot, subslot, index| RecordPlace { slot, subslot, index };
        let records = vec![
            place(0, 0, index::REAL_IDENTIFICATION_API),
            place(0, 1, index::IDENTIFICATION_AND_MAINTENANCE_0),
            place(0, 1, 0x1234),
        ];
        let activity = Uuid([7; 16]);
        let config = RecordReaderConfig { address: ADDRESS, identity, local_port: 50_000, activity, records };
        RecordReader::new(config, Instant::ZERO)
    }

    /// Runs a reader until it ends; `answer` is what comes back for a datagram.
    fn run(reader: &mut RecordReader, mut answer: impl FnMut(Instant, &[u8]) -> Option<Vec<u8>>) -> Instant {
        let mut now = Instant::ZERO;
        let mut buf = [0; 1_500];
        while reader.poll_event().is_none() {
            now = reader.poll_timeout().unwrap().max(now);
            reader.handle_timeout(now);
            while let Some(sent) = reader.poll_transmit(now, &mut buf) {
                assert_eq!(sent.to, Some(SocketAddrV4::new(ADDRESS, RPC_PORT)));
                if let Some(frame) = answer(now, &buf[..sent.len]) {
                    let from =
                        Source { port: Port::Udp(50_000), peer: Some(SocketAddrV4::new(ADDRESS, RPC_PORT)) };
                    reader.handle_frame(now, from, &frame);
                }
            }
        }
        now
    }

    fn of_device(device: &mut Device, now: Instant, request: &[u8]) -> Option<Vec<u8>> {
        let mut buf = [0; 1_500];
        device.handle_frame(now, Source { port: Port::Udp(RPC_PORT), peer: Some(TOOL) }, request);
        let sent = core::iter::from_fn(|| {
            let sent = device.poll_transmit(now, &mut buf)?;
            Some((sent.to, buf[..sent.len].to_vec()))
        });
        sent.filter(|(to, _)| *to == Some(TOOL)).map(|(_, frame)| frame).last()
    }

    fn device() -> Device {
        let config = DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"robot".to_vec(),
            permanent: None,
            address: Some(ADDRESS),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            description: DEVICE,
            controllers: machine::Allowed::default(),
        };
        Device::new(config, Instant::ZERO)
    }

    #[test]
    fn a_device_is_asked_for_its_modules_and_its_version_without_a_connection() {
        let mut device = device();
        let mut reader = reader(DEVICE.identity);
        let mut count = 0;
        run(&mut reader, |now, request| {
            // The first request and the first answer get lost.
            count += 1;
            of_device(&mut device, now, request).filter(|_| count > 2)
        });
        let [modules, version, unknown] = reader.answers() else { panic!("{:?}", reader.answers()) };
        let modules = parse_real_identification(modules.as_ref().unwrap()).unwrap();
        assert_eq!(modules.len(), DEVICE.modules.len());
        let version = Identification::parse(version.as_ref().unwrap()).unwrap();
        assert_eq!(version.serial_number.trim_ascii(), DEVICE.serial_number.as_bytes());
        assert!(matches!(unknown, Err(RecordReadError::Refused(_))), "{unknown:?}");
    }

    #[test]
    fn a_device_that_is_silent_or_answers_with_anything_is_left_after_some_time() {
        let mut silent = reader(DEVICE.identity);
        let ended = run(&mut silent, |_, _| None);
        assert_eq!(silent.answers(), [const { Err(RecordReadError::NoAnswer) }; 3]);
        assert_eq!(ended, Instant::ZERO + REPEAT_AFTER.saturating_mul(3 * TRIES));
        let mut device = device();
        for cut in [0, 40, 79, 80, 100, 163] {
            let mut reader = reader(DEVICE.identity);
            run(&mut reader, |now, request| {
                let mut answer = of_device(&mut device, now, request)?;
                answer.truncate(cut);
                Some(answer)
            });
            assert!(reader.answers().iter().all(Result::is_err), "{cut}: {:?}", reader.answers());
        }
    }
}
