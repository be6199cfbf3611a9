//! A cable for one test, in networks that disappear with it.

use machine::ethernet::Mac;

use crate::namespace::NetworkNamespace;
use crate::{Interface, packet_socket, veth};

/// For local experiments (IEEE 802, 9.2.3): no kernel sends this EtherType by itself.
pub(crate) const ETHERTYPE: u16 = 0x88B5;

/// Two ends, both up.
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

    /// Runs `job` at the near end, whose interface is `near0`; there is also `lo`.
    pub(crate) fn near<T: Send>(&self, interface: &str, job: impl FnOnce(&Interface) -> T + Send) -> T {
        self.near.run(|| job(&Interface::open(interface).unwrap())).unwrap()
    }

    /// Runs `job` at the far end.
    pub(crate) fn far<T: Send>(&self, job: impl FnOnce(&Interface) -> T + Send) -> T {
        self.far.run(|| job(&Interface::open("far0").unwrap())).unwrap()
    }

    /// Sends numbered frames from the near end, with `before_type` behind the addresses of each.
    pub(crate) fn send(&self, numbers: std::ops::Range<u32>, before_type: &[u8]) {
        self.near("near0", |interface| {
            let socket = packet_socket::open(interface, ETHERTYPE, |_| Ok(())).unwrap();
            for number in numbers {
                socket.send(&frame(interface.mac(), before_type, number)).unwrap();
            }
        });
    }
}

/// Builds a broadcast frame of minimum length.
pub(crate) fn frame(source: Mac, before_type: &[u8], number: u32) -> Vec<u8> {
    let mut frame =
        [&[0xFF; 6], &source.0[..], before_type, &ETHERTYPE.to_be_bytes(), &number.to_be_bytes()].concat();
    frame.resize(60, 0);
    frame
}

/// Returns the number in such a frame; `None` for other frames.
pub(crate) fn number(frame: &[u8]) -> Option<u32> {
    let rest = frame.get(12..)?.strip_prefix(&ETHERTYPE.to_be_bytes())?;
    rest.first_chunk().copied().map(u32::from_be_bytes)
}
