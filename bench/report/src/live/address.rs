//! The address at which the live view is served.

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};
use std::str::FromStr;

/// Address without an argument of `--live`.
pub const DEFAULT: &str = "127.0.0.1:8642";

/// An address of this machine's loopback interface.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct LiveAddress(SocketAddr);

impl LiveAddress {
    /// Returns the address of the socket.
    #[must_use]
    pub const fn socket(self) -> SocketAddr {
        self.0
    }
}

impl fmt::Display for LiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Invalid `--live` address.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum AddressError {
    /// It has another form.
    #[error("`{text}` is not ADDRESS:PORT; for example {DEFAULT}, or localhost:8080")]
    Form {
        /// What was given.
        text: String,
    },
    /// Others could reach it.
    #[error(
        "{address} is not a loopback address, and the live view has no password: take 127.0.0.1:{port}, and from another \
         machine `ssh -L {port}:127.0.0.1:{port} HOST`",
        port = address.port()
    )]
    NotLoopback {
        /// What was given.
        address: SocketAddr,
    },
}

impl FromStr for LiveAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let form = || AddressError::Form { text: text.to_owned() };
        let address = match text.strip_prefix("localhost:") {
            Some(port) => SocketAddr::from((Ipv4Addr::LOCALHOST, port.parse().map_err(|_| form())?)),
            None => text.parse().map_err(|_| form())?,
        };
        if address.ip().is_loopback() {
            Ok(Self(address))
        } else {
            Err(AddressError::NotLoopback { address })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_addresses_that_no_other_machine_reaches_are_taken() {
        for (text, socket) in [
            (DEFAULT, DEFAULT),
            ("localhost:80", "127.0.0.1:80"),
            ("[::1]:9", "[::1]:9"),
            ("127.0.0.1:0", "127.0.0.1:0"),
        ] {
            assert_eq!(text.parse::<LiveAddress>().unwrap().socket(), socket.parse().unwrap());
        }
        for text in ["0.0.0.0:80", "192.168.0.7:80", "[::]:80"] {
            let error = text.parse::<LiveAddress>().unwrap_err().to_string();
            assert!(error.contains("take 127.0.0.1:80") && error.contains("ssh -L 80:"), "{error}");
        }
        for text in ["127.0.0.1", "8080", "localhost", "localhost:seven", ""] {
            assert!(matches!(text.parse::<LiveAddress>(), Err(AddressError::Form { .. })), "{text}");
        }
    }
}
