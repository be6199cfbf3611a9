//! Why no station of a bus is changed.

use std::net::Ipv4Addr;

/// Reason why no station is changed.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub(crate) enum StationError {
    /// No station is meant.
    #[error("no station is `{0}`; stations that answer: {1}")]
    None(String, String),
    /// Several stations are meant.
    #[error("{0} stations are `{1}`: {2}; give the MAC address of one with --at")]
    Several(usize, String, String),
    /// The name is not one of a station.
    #[error(
        "`{0}` is not a station name: allowed are lower-case letters, digits and hyphens, in parts of up to 63 characters separated by \
         dots, 240 in all"
    )]
    Name(String),
    /// Another station has the name or the address.
    #[error("station {1} already has {0}; rename it or choose another one")]
    Taken(String, String),
    /// Several adapters have the address.
    #[error("{0} devices have this address: {1}; switch all but one off")]
    SharedAddress(usize, String),
    /// An option is for the other bus.
    #[error("{0}")]
    OtherBus(&'static str),
    /// The address is none of a station.
    #[error("{0} is not an address of a station: choose one of the subnet")]
    Address(Ipv4Addr),
    /// Nobody agreed.
    #[error("nothing was changed: nobody said yes; give --yes to change without a question")]
    NotAgreed,
}

/// Returns true for an error that the user corrects on the command line.
pub(crate) fn is_usage(error: &anyhow::Error) -> bool {
    error.is::<StationError>()
}
