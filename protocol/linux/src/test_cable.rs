//! A cable of a test's own, in networks that vanish with it.

use machine::ethernet::Mac;

use crate::namespace::NetworkNamespace;
use crate::{Interface, packet_socket, veth};

/// For local experiments (IEEE 802, 9.2.3): no kernel says anything by this EtherType on its own.
pub(crate) const ETHERTYPE: u16 = 0x88B5;

/// Two ends, which are on.
pub(crate) struct TestCable {
    near: NetworkNamespace,
    far: NetworkNamespace,
}

impl TestCable {
    pub(crate) fn lay() -> Self {
        let new = || {
            NetworkNamespace::new()
                .expect("this test makes network namespaces: run it as root, or under `unshare -Ur`")
        };
        let cable = Self { near: new(), far: new() };
        veth::connect(&cable.near, "near0", &cable.far, "far0").unwrap();
        cable.near("near0", |near| near.set_up().unwrap());
        cable.far(|far| far.set_up().unwrap());
        cable
    }

    /// At the near end, whose interface is `near0`; `lo` is there too.
    pub(crate) fn near<T: Send>(&self, interface: &str, job: impl FnOnce(&Interface) -> T + Send) -> T {
        self.near.run(|| job(&Interface::open(interface).unwrap())).unwrap()
    }

    /// At the far end.
    pub(crate) fn far<T: Send>(&self, job: impl FnOnce(&Interface) -> T + Send) -> T {
        self.far.run(|| job(&Interface::open("far0").unwrap())).unwrap()
    }

    /// Sends numbered frames from the near end, each with `before_type` behind the addresses.
    pub(crate) fn send(&self, numbers: std::ops::Range<u32>, before_type: &[u8]) {
        self.near("near0", |interface| {
            let socket = packet_socket::open(interface, ETHERTYPE, |_| Ok(())).unwrap();
            for number in numbers {
                socket.send(&frame(interface.mac(), before_type, number)).unwrap();
            }
        });
    }
}

/// A frame of the least length, to everybody.
pub(crate) fn frame(source: Mac, before_type: &[u8], number: u32) -> Vec<u8> {
    let mut frame =
        [&[0xFF; 6], &source.0[..], before_type, &ETHERTYPE.to_be_bytes(), &number.to_be_bytes()].concat();
    frame.resize(60, 0);
    frame
}

/// The number in such a frame, none in another.
pub(crate) fn number(frame: &[u8]) -> Option<u32> {
    let rest = frame.get(12..)?.strip_prefix(&ETHERTYPE.to_be_bytes())?;
    rest.first_chunk().copied().map(u32::from_be_bytes)
}
