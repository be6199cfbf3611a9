//! The stations that the nodes accept as each other, where a setup lists them.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use serde::de::{Deserializer, Error};
use serde::ser::Serializer;
use serde::{Deserialize, Serialize};

/// A station, by whatever is known of it.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// IPv4 address.
    pub address: Option<Ipv4Addr>,
    /// MAC address; PROFINET only.
    #[serde(default, with = "as_text", skip_serializing_if = "Option::is_none")]
    #[cfg_attr(test, schemars(with = "Option<String>"))]
    pub mac: Option<Mac>,
    /// Serial number; EtherNet/IP only.
    pub serial_number: Option<u32>,
}

impl From<Peer> for machine::Peer {
    fn from(Peer { address, mac, serial_number }: Peer) -> Self {
        Self { address, mac, serial_number }
    }
}

/// A MAC address as text.
mod as_text {
    use super::{Deserialize, Deserializer, Error, Mac, Serializer};

    #[expect(clippy::ref_option, reason = "the signature that serde calls")]
    pub(super) fn serialize<S: Serializer>(mac: &Option<Mac>, serializer: S) -> Result<S::Ok, S::Error> {
        match mac {
            Some(mac) => serializer.collect_str(mac),
            None => serializer.serialize_none(),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Mac>, D::Error> {
        let text = Option::<String>::deserialize(deserializer)?;
        text.map(|text| text.parse().map_err(D::Error::custom)).transpose()
    }
}
