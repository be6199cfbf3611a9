//! Finds the device by its name and sets its address, by DCP.

use alloc::boxed::Box;

use super::Refusal;
use crate::ETHER_TYPE;
use crate::dcp::{
    self, Block, BlockError, Code, Content, IDENTIFY_MULTICAST, IpSuite, Pdu, Service, Station,
};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant};

/// Pause between repetitions of a request that was not answered.
const REPEAT_AFTER: Duration = Duration::from_millis(200);
/// Set requests to one station before the search starts again.
const SET_ATTEMPTS: u8 = 5;

const WRONG_IDENTITY: &str = "the station of this name is another device than described (the status is its \
     VendorID and DeviceID): check the name and the description";
const NAME_TWICE: &str =
    "two stations answer to the device's name: give one of them another name, by DCP or its own tool";
const ADDRESS_REFUSED: &str = "the device refused the IP address that was set by DCP (the status is its BlockError): \
     look whether another controller or DHCP holds its address";

/// Device to find, and the address to give it.
#[derive(Debug)]
pub(super) struct WantedStation {
    pub(super) own_mac: Mac,
    pub(super) name: Box<[u8]>,
    /// VendorID and DeviceID.
    pub(super) identity: (u16, u16),
    /// MAC address, if it is known.
    pub(super) mac: Option<Mac>,
    pub(super) address: IpSuite,
}

/// Result of a DCP answer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Progress {
    /// Nothing yet.
    Pending,
    /// It does not belong to this search.
    Foreign,
    /// The station is there and has its address.
    Found(Mac),
    /// The station is there but cannot be used.
    Refused(Refusal),
}

/// Searches for the device until it is found and has its address.
#[derive(Debug)]
pub(super) struct Discovery {
    wanted: WantedStation,
    xid: u32,
    device: Option<Mac>,
    /// DeviceInstance of the station, if it reports one.
    instance: Option<u16>,
    /// Whether the station reports that another one has its address.
    has_conflict: bool,
    step: Step,
    send: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    Idle,
    Identify { repeat_at: Instant },
    SetAddress { repeat_at: Instant, attempt: u8 },
}

impl Discovery {
    pub(super) const fn new(wanted: WantedStation) -> Self {
        Self {
            wanted,
            xid: 0,
            device: None,
            instance: None,
            has_conflict: false,
            step: Step::Idle,
            send: false,
        }
    }

    /// Starts to search. `xid` must not have been used lately, so that old answers are not accepted for new ones.
    pub(super) fn begin(&mut self, now: Instant, xid: u32) {
        self.xid = xid;
        self.device = None;
        self.instance = None;
        self.has_conflict = false;
        self.step = Step::Identify { repeat_at: now + REPEAT_AFTER };
        self.send = true;
    }

    /// Returns the first station that answered to the name.
    pub(super) const fn device(&self) -> Option<Mac> {
        self.device
    }

    /// Returns whether the station reported that another one has its address.
    pub(super) const fn has_conflict(&self) -> bool {
        self.has_conflict
    }

    /// Returns the instance that the station reports of itself.
    pub(super) const fn instance(&self) -> Option<u16> {
        self.instance
    }

    /// Returns whether a station answered to the name.
    pub(super) const fn has_found(&self) -> bool {
        self.device.is_some()
    }

    /// Stops the search.
    pub(super) const fn stop(&mut self) {
        self.step = Step::Idle;
        self.send = false;
    }

    pub(super) fn handle(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        if self.wanted.mac.is_some_and(|mac| mac != from) {
            return Progress::Foreign;
        }
        match pdu.service {
            Service::IdentifyResponse if pdu.xid == self.xid => self.identified(now, from, pdu),
            Service::SetResponse if pdu.xid == self.xid.wrapping_add(1) => self.address_set(from, pdu),
            _ => Progress::Foreign,
        }
    }

    /// Returns whether a Hello is that of the device: it has come up, and can be searched for.
    pub(super) fn is_hello(&self, from: Mac, pdu: &Pdu<'_>) -> bool {
        let is_named = |station: Station<'_>| station.name.eq_ignore_ascii_case(&self.wanted.name);
        pdu.service == Service::Hello
            && self.wanted.mac.is_none_or(|mac| mac == from)
            && Station::from_pdu(pdu).is_ok_and(is_named)
    }

    fn identified(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> Progress {
        let Ok(station) = Station::from_pdu(pdu) else { return Progress::Foreign };
        if !station.name.eq_ignore_ascii_case(&self.wanted.name) {
            return Progress::Foreign;
        }
        match self.device {
            Some(device) if device == from => return Progress::Pending,
            Some(_) => return self.refuse(0, NAME_TWICE),
            None => self.device = Some(from),
        }
        for block in pdu.blocks().flatten() {
            match block.content {
                Content::DeviceInstance(instance) => self.instance = Some(instance),
                Content::Ip(_) => self.has_conflict = block.qualifier & Block::ADDRESS_CONFLICT != 0,
                _ => {}
            }
        }
        if let Some((vendor, device)) = station.identity.filter(|found| *found != self.wanted.identity) {
            return self.refuse(u32::from(vendor) << 16 | u32::from(device), WRONG_IDENTITY);
        }
        let IpSuite { address, mask, .. } = self.wanted.address;
        let has_address = station.ip.is_some_and(|has| has.address == address && has.mask == mask);
        // A station does not use an address that another one has. If that one is gone, a new Set makes it look again.
        if has_address && !self.has_conflict {
            self.stop();
            return Progress::Found(from);
        }
        self.step = Step::SetAddress { repeat_at: now + REPEAT_AFTER, attempt: 1 };
        self.send = true;
        Progress::Pending
    }

    fn address_set(&mut self, from: Mac, pdu: &Pdu<'_>) -> Progress {
        if self.device != Some(from) || !matches!(self.step, Step::SetAddress { .. }) {
            return Progress::Foreign;
        }
        let result = pdu.blocks().find_map(|block| match block.ok()?.content {
            Content::Response { code: Code::IP, error } => Some(error),
            _ => None,
        });
        match result {
            Some(BlockError::None) => {
                self.stop();
                Progress::Found(from)
            }
            Some(error) => self.refuse(u32::from(u8::from(error)), ADDRESS_REFUSED),
            None => Progress::Foreign,
        }
    }

    const fn refuse(&mut self, code: u32, text: &'static str) -> Progress {
        self.stop();
        Progress::Refused(Refusal { code, text })
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        match self.step {
            Step::Identify { repeat_at } if now >= repeat_at => {
                self.step = Step::Identify { repeat_at: now + REPEAT_AFTER };
                self.send = true;
            }
            Step::SetAddress { repeat_at, attempt } if now >= repeat_at => {
                if attempt < SET_ATTEMPTS {
                    self.step = Step::SetAddress { repeat_at: now + REPEAT_AFTER, attempt: attempt + 1 };
                    self.send = true;
                } else {
                    self.begin(now, self.xid.wrapping_add(2));
                }
            }
            _ => {}
        }
    }

    pub(super) fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<usize> {
        if !core::mem::take(&mut self.send) {
            return None;
        }
        let header = |destination| EthernetHeader {
            destination,
            source: self.wanted.own_mac,
            tag: None,
            ether_type: ETHER_TYPE,
        };
        match (self.step, self.device) {
            (Step::Identify { .. }, _) => header(IDENTIFY_MULTICAST).emit(buf, |writer| {
                let name = Content::NameOfStation(&self.wanted.name);
                dcp::emit(writer, Service::IdentifyRequest, self.xid, 1, [name.into()]);
            }),
            (Step::SetAddress { .. }, Some(device)) => header(device).emit(buf, |writer| {
                let address = Content::Ip(self.wanted.address);
                dcp::emit(writer, Service::SetRequest, self.xid.wrapping_add(1), 0, [address.into()]);
            }),
            _ => return None,
        }
        .ok()
    }

    pub(super) const fn poll_timeout(&self) -> Option<Instant> {
        match self.step {
            Step::Idle => None,
            Step::Identify { repeat_at } | Step::SetAddress { repeat_at, .. } => Some(repeat_at),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::net::Ipv4Addr;
    use machine::wire::Writer;

    const OWN: Mac = Mac([2, 0, 0, 0, 0, 1]);
    const DEVICE: Mac = Mac([2, 0, 0, 0, 0, 2]);
    const ADDRESS: IpSuite = IpSuite {
        address: Ipv4Addr::new(192, 168, 64, 2),
        mask: Ipv4Addr::new(255, 255, 255, 0),
        gateway: Ipv4Addr::new(192, 168, 64, 2),
    };
    const NO_ADDRESS: IpSuite = IpSuite {
        address: Ipv4Addr::UNSPECIFIED,
        mask: Ipv4Addr::UNSPECIFIED,
        gateway: Ipv4Addr::UNSPECIFIED,
    };

    fn looking() -> Discovery {
        let name = Box::from(&b"robot"[..]);
        let mut discovery = Discovery::new(WantedStation {
            own_mac: OWN,
            name,
            identity: (0x0493, 2),
            mac: None,
            address: ADDRESS,
        });
        discovery.begin(Instant::ZERO, 100);
        discovery
    }

    fn sent(discovery: &mut Discovery) -> Option<(Mac, Service, u32)> {
        let mut buf = [0; 128];
        let len = discovery.poll_transmit(&mut buf)?;
        let (header, payload) = EthernetHeader::parse(&buf[..len]).unwrap();
        let pdu = Pdu::parse(payload).unwrap();
        Some((header.destination, pdu.service, pdu.xid))
    }

    fn answer(
        discovery: &mut Discovery,
        from: Mac,
        service: Service,
        xid: u32,
        blocks: &[Block<'_>],
    ) -> Progress {
        let mut buf = [0; 256];
        let mut writer = Writer::new(&mut buf);
        dcp::emit(&mut writer, service, xid, 0, blocks.iter().copied());
        discovery.handle(Instant::ZERO, from, &Pdu::parse(&buf).unwrap())
    }

    fn robot(device: u16, address: IpSuite) -> [Block<'static>; 3] {
        [
            Content::NameOfStation(b"robot").into(),
            Content::DeviceId { vendor: 0x0493, device }.into(),
            Content::Ip(address).into(),
        ]
    }

    #[test]
    fn a_station_that_has_its_address_is_found_at_once() {
        let mut discovery = looking();
        assert_eq!(sent(&mut discovery), Some((IDENTIFY_MULTICAST, Service::IdentifyRequest, 100)));
        let blocks = robot(2, ADDRESS);
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
        assert_eq!(progress, Progress::Found(DEVICE));
        assert_eq!(discovery.poll_timeout(), None);
    }

    #[test]
    fn a_station_without_its_address_gets_it() {
        let mut discovery = looking();
        let _ = sent(&mut discovery);
        let blocks = robot(2, NO_ADDRESS);
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
        assert_eq!(progress, Progress::Pending);
        assert_eq!(sent(&mut discovery), Some((DEVICE, Service::SetRequest, 101)));
        let set = |error| [Content::Response { code: Code::IP, error }.into()];
        let foreign = answer(&mut discovery, OWN, Service::SetResponse, 101, &set(BlockError::None));
        assert_eq!(foreign, Progress::Foreign);
        let progress = answer(&mut discovery, DEVICE, Service::SetResponse, 101, &set(BlockError::None));
        assert_eq!(progress, Progress::Found(DEVICE));
    }

    #[test]
    fn a_station_that_refuses_its_address_is_reported_with_its_reason() {
        let mut discovery = looking();
        answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
        let refused = [Content::Response { code: Code::IP, error: BlockError::InOperation }.into()];
        let progress = answer(&mut discovery, DEVICE, Service::SetResponse, 101, &refused);
        assert_eq!(progress, Progress::Refused(Refusal { code: 6, text: ADDRESS_REFUSED }));
    }

    #[test]
    fn a_station_whose_address_another_one_has_gets_it_again_and_the_conflict_is_known() {
        for (conflict, info) in [(false, 0x0001), (false, 0x0002), (true, 0x0081), (true, 0x0082)] {
            let mut discovery = looking();
            let _ = sent(&mut discovery);
            let mut blocks = robot(2, ADDRESS);
            blocks[2].qualifier = info;
            let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
            let expected = if conflict { Progress::Pending } else { Progress::Found(DEVICE) };
            assert_eq!((progress, discovery.has_conflict()), (expected, conflict), "0x{info:04X}");
            if conflict {
                assert_eq!(sent(&mut discovery), Some((DEVICE, Service::SetRequest, 101)));
            }
        }
    }

    #[test]
    fn a_block_of_another_length_does_not_hide_the_station() {
        let mut discovery = looking();
        let mut buf = [0; 256];
        let odd = Content::Unknown(Code::DEVICE_INSTANCE, &[1]);
        let [name, id, ip] = robot(2, ADDRESS);
        dcp::emit(&mut Writer::new(&mut buf), Service::IdentifyResponse, 100, 0, [odd.into(), name, id, ip]);
        let progress = discovery.handle(Instant::ZERO, DEVICE, &Pdu::parse(&buf).unwrap());
        assert_eq!(progress, Progress::Found(DEVICE));
    }

    #[test]
    fn another_device_and_a_name_that_is_given_twice_are_told_apart() {
        let mut discovery = looking();
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(3, ADDRESS));
        assert_eq!(progress, Progress::Refused(Refusal { code: 0x0493_0003, text: WRONG_IDENTITY }));

        let mut discovery = looking();
        answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, ADDRESS));
        let progress = answer(&mut discovery, OWN, Service::IdentifyResponse, 100, &robot(2, ADDRESS));
        assert_eq!(progress, Progress::Refused(Refusal { code: 0, text: NAME_TWICE }));
    }

    #[test]
    fn a_station_that_does_not_answer_a_set_is_looked_for_again() {
        let mut discovery = looking();
        answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
        let mut services = Vec::new();
        for _ in 0..6 {
            services.extend(sent(&mut discovery).map(|(_, service, xid)| (service, xid)));
            let at = discovery.poll_timeout().unwrap();
            discovery.handle_timeout(at);
        }
        let set = (Service::SetRequest, 101);
        let again = (Service::IdentifyRequest, 102);
        assert_eq!(services, [set, set, set, set, set, again]);
    }
}
