//! Setting name and address of a station, and flashing its lamp, as tools for commissioning do (IEC 61158-6-10, 4.3: DCP Set).

use alloc::vec::Vec;

use machine::ethernet::{EthernetHeader, Mac};
use machine::search::SearchEnded;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

use crate::dcp::{self, Block, BlockError, Code, Content, IpSuite, Pdu, Service};
use crate::tries::Tries;
use crate::{ETHER_TYPE, ETHERNET};

/// Time after which a request is repeated: a station answers a Set within a second.
const REPEAT_AFTER: Duration = Duration::from_secs(1);

/// Requests.
const TRIES: u32 = 3;

/// SignalValue: flash once, for three seconds.
const FLASH_ONCE: u16 = 0x0100;

/// BlockQualifier: store permanently.
const PERMANENT: u16 = 1;

/// Change of a station.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum StationChange {
    /// Its name; empty for none.
    Name(Vec<u8>),
    /// Its IP address, mask and gateway.
    Address(IpSuite),
    /// Its lamp flashes for three seconds.
    Flash,
}

/// Configuration of a setter.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct StationSetterConfig {
    /// The own MAC address.
    pub mac: Mac,
    /// MAC address of the station.
    pub station: Mac,
    /// Xid of the request. Choose one that was not used lately, so that old answers are not accepted.
    pub xid: u32,
    /// The change.
    pub change: StationChange,
    /// True if the station keeps it when it is switched off.
    pub is_permanent: bool,
}

/// Why a station was not changed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StationSetError {
    /// It did not answer.
    #[error("the station did not answer the DCP Set")]
    NoAnswer,
    /// It does not know DCP Set.
    #[error("the station does not support DCP Set")]
    NotSupported,
    /// It refused the option, with this error of the block.
    #[error("the station refuses it: {}", in_words(*.0))]
    Refused(BlockError),
    /// Its answer has no result for the option.
    #[error("the answer of the station has no result for what was set")]
    Malformed,
}

const fn in_words(error: BlockError) -> &'static str {
    match error {
        BlockError::None => "no error",
        BlockError::OptionNotSupported => "it does not have the option",
        BlockError::SuboptionNotSupported => "it does not have the suboption",
        BlockError::SuboptionNotSet => "the value is not allowed",
        BlockError::Resource => "it lacks resources",
        BlockError::NotPossible => "it is not possible here, as with a name or address set by a switch",
        BlockError::InOperation => "it exchanges data; end its connection first",
        BlockError::Unknown(_) => "error of an unknown number",
    }
}

/// Changes one station. It reports [`SearchEnded`] once there is a result.
#[derive(Debug)]
pub struct StationSetter {
    config: StationSetterConfig,
    tries: Tries,
    result: Option<Result<(), StationSetError>>,
    is_reported: bool,
}

impl StationSetter {
    /// Creates a setter that sends its first request at `start`.
    #[must_use]
    pub const fn new(config: StationSetterConfig, start: Instant) -> Self {
        let tries = Tries::new(TRIES, REPEAT_AFTER, start);
        Self { config, tries, result: None, is_reported: false }
    }

    /// Returns what the station answered; `None` before.
    #[must_use]
    pub const fn result(&self) -> Option<Result<(), StationSetError>> {
        self.result
    }

    fn block(&self) -> Block<'_> {
        let qualifier = if self.config.is_permanent { PERMANENT } else { 0 };
        match &self.config.change {
            StationChange::Name(name) => Block { qualifier, content: Content::NameOfStation(name) },
            StationChange::Address(suite) => Block { qualifier, content: Content::Ip(*suite) },
            StationChange::Flash => Content::Signal(FLASH_ONCE).into(),
        }
    }

    /// Returns what a PDU of the station says of the change; `None` if it is not the answer.
    fn answer_in(&self, payload: &[u8]) -> Option<Result<(), StationSetError>> {
        let pdu = Pdu::parse(payload).ok().filter(|pdu| pdu.xid == self.config.xid)?;
        match pdu.service {
            Service::NotSupported(..) => Some(Err(StationSetError::NotSupported)),
            Service::SetResponse => Some(result_of(&pdu, self.block().code())),
            _ => None,
        }
    }
}

fn result_of(pdu: &Pdu<'_>, wanted: Code) -> Result<(), StationSetError> {
    let results = pdu.blocks().flatten().filter_map(|block| match block.content {
        Content::Response { code, error } if code == wanted => Some(error),
        _ => None,
    });
    match results.last() {
        Some(BlockError::None) => Ok(()),
        Some(error) => Err(StationSetError::Refused(error)),
        None => Err(StationSetError::Malformed),
    }
}

impl Machine for StationSetter {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        &[ETHERNET]
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        let Ok((header, payload)) = EthernetHeader::parse(frame) else { return };
        let is_answer = header.source == self.config.station
            && header.destination == self.config.mac
            && header.ether_type == ETHER_TYPE;
        if is_answer && self.tries.are_begun() && self.result.is_none() {
            self.result = self.answer_in(payload);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.result.is_none() && self.tries.handle_timeout(now) {
            self.result = Some(Err(StationSetError::NoAnswer));
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if !self.tries.take_request() {
            return None;
        }
        let header = EthernetHeader {
            destination: self.config.station,
            source: self.config.mac,
            tag: None,
            ether_type: ETHER_TYPE,
        };
        let len = header.emit(buf, |writer| {
            dcp::emit(writer, Service::SetRequest, self.config.xid, 0, [self.block()]);
        });
        Some(Transmit { port: Port::Ethernet, to: None, len: len.ok()? })
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        let is_now = self.result.is_some() && !self.is_reported;
        self.is_reported |= is_now;
        is_now.then_some(SearchEnded)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.result.is_none().then_some(self.tries.poll_timeout())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::DEVICE;
    use crate::{Device, DeviceConfig};
    use core::net::Ipv4Addr;

    const TOOL: Mac = Mac([2, 0, 0, 0, 0, 1]);
    const STATION: Mac = Mac([2, 0, 0, 0, 0, 2]);

    fn setter_of(change: StationChange) -> StationSetter {
        let config = StationSetterConfig { mac: TOOL, station: STATION, xid: 77, change, is_permanent: true };
        StationSetter::new(config, Instant::ZERO)
    }

    fn device() -> Device {
        let config = DeviceConfig {
            mac: STATION,
            station_name: b"old".to_vec(),
            permanent: Some(crate::Permanent::default()),
            address: None,
            mask: Ipv4Addr::new(255, 255, 255, 0),
            description: DEVICE,
            controllers: machine::Allowed::default(),
        };
        Device::new(config, Instant::ZERO)
    }

    /// Runs a setter until it ends; `answer` is what comes back for a frame.
    fn run(setter: &mut StationSetter, mut answer: impl FnMut(Instant, &[u8]) -> Vec<Vec<u8>>) -> u64 {
        let mut now = Instant::ZERO;
        let mut buf = [0; 1_500];
        while setter.poll_event().is_none() {
            now = setter.poll_timeout().unwrap().max(now);
            setter.handle_timeout(now);
            while let Some(sent) = setter.poll_transmit(now, &mut buf) {
                for frame in answer(now, &buf[..sent.len]) {
                    setter.handle_frame(now, Source { port: Port::Ethernet, peer: None }, &frame);
                }
            }
        }
        now.as_nanos() / 1_000_000
    }

    fn answers(device: &mut Device, now: Instant, frame: &[u8]) -> Vec<Vec<u8>> {
        device.handle_frame(now, Source { port: Port::Ethernet, peer: None }, frame);
        let mut buf = [0; 1_500];
        let sent =
            core::iter::from_fn(|| device.poll_transmit(now, &mut buf).map(|sent| buf[..sent.len].to_vec()));
        sent.collect()
    }

    #[test]
    fn a_station_gets_a_name_and_flashes() {
        let mut device = device();
        let mut setter = setter_of(StationChange::Name(b"valve-7".to_vec()));
        // Without storage the station would wait for its owner to store the name.
        setter.config.is_permanent = false;
        run(&mut setter, |now, frame| answers(&mut device, now, frame));
        assert_eq!(setter.result(), Some(Ok(())));
        assert_eq!(device.station_name(), b"valve-7");
        let mut setter = setter_of(StationChange::Flash);
        run(&mut setter, |now, frame| answers(&mut device, now, frame));
        assert_eq!(setter.result(), Some(Ok(())));
    }

    #[test]
    fn an_address_is_set_in_one_block_that_says_whether_it_is_kept() {
        let address = Ipv4Addr::new(192, 168, 64, 9);
        let suite = IpSuite { address, mask: Ipv4Addr::new(255, 255, 255, 0), gateway: address };
        for (is_permanent, qualifier) in [(true, 1), (false, 0)] {
            let mut setter = setter_of(StationChange::Address(suite));
            setter.config.is_permanent = is_permanent;
            let mut sent = Vec::new();
            run(&mut setter, |_, frame| {
                sent.push(frame.to_vec());
                Vec::new()
            });
            assert_eq!(sent.len(), 3, "repeated without an answer");
            let (header, payload) = EthernetHeader::parse(&sent[0]).unwrap();
            assert_eq!((header.destination, header.source), (STATION, TOOL));
            let pdu = Pdu::parse(payload).unwrap();
            let blocks: Vec<_> = pdu.blocks().map(Result::unwrap).collect();
            assert_eq!((pdu.service, pdu.xid), (Service::SetRequest, 77));
            assert_eq!(blocks, [Block { qualifier, content: Content::Ip(suite) }]);
        }
    }

    #[test]
    fn refusals_silence_and_answers_of_others_are_told_apart() {
        let mut device = device();
        let mut setter = setter_of(StationChange::Name(b"not a name".to_vec()));
        run(&mut setter, |now, frame| answers(&mut device, now, frame));
        assert_eq!(setter.result(), Some(Err(StationSetError::Refused(BlockError::SuboptionNotSet))));

        let mut setter = setter_of(StationChange::Flash);
        assert_eq!(run(&mut setter, |_, _| Vec::new()), 3_000);
        assert_eq!(setter.result(), Some(Err(StationSetError::NoAnswer)));

        // Of another station, of another request, and without a result for the option.
        let answer = |source, xid, code| {
            let mut buf = [0; 100];
            let header = EthernetHeader { destination: TOOL, source, tag: None, ether_type: ETHER_TYPE };
            let block = Content::Response { code, error: BlockError::None };
            let len = header
                .emit(&mut buf, |writer| dcp::emit(writer, Service::SetResponse, xid, 0, [block.into()]))
                .unwrap();
            buf[..len].to_vec()
        };
        let mut setter = setter_of(StationChange::Flash);
        let others = [answer(TOOL, 77, Code::SIGNAL), answer(STATION, 76, Code::SIGNAL)];
        run(&mut setter, |_, _| others.to_vec());
        assert_eq!(setter.result(), Some(Err(StationSetError::NoAnswer)));
        let mut setter = setter_of(StationChange::Flash);
        run(&mut setter, |_, _| vec![answer(STATION, 77, Code::IP)]);
        assert_eq!(setter.result(), Some(Err(StationSetError::Malformed)));
    }

    #[test]
    fn frames_cut_or_altered_anywhere_are_taken_without_a_panic() {
        let mut device = device();
        let mut good = Vec::new();
        let mut setter = setter_of(StationChange::Flash);
        run(&mut setter, |now, frame| {
            good = answers(&mut device, now, frame);
            good.clone()
        });
        let good = good.pop().unwrap();
        for place in 0..good.len() {
            for value in 0..=u8::MAX {
                let mut altered = good.clone();
                altered[place] = value;
                let mut setter = setter_of(StationChange::Flash);
                setter.handle_timeout(Instant::ZERO);
                let from = Source { port: Port::Ethernet, peer: None };
                setter.handle_frame(Instant::ZERO, from, &altered);
                setter.handle_frame(Instant::ZERO, from, &good[..place]);
            }
        }
    }
}
