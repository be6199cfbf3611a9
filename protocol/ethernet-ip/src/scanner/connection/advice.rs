//! What a user can do about a refusal.

use crate::cip::{Extended as E, General as G};

const OTHER_KEY: &str = "give the key of the device that is there, or connect the device of the key";
const OTHER_PATH: &str = "name assemblies of the device's EDS file, each in its place";
const OTHER_SIZE: &str =
    "give the device's bytes of data for that direction; a difference of 4 is another real-time format";
const OTHER_ROUTE: &str = "correct the route, or leave it out where no bridge is between";
const OTHER_INTERVAL: &str = "ask for another packet interval";
const OTHER_TYPE: &str = "ask for what the device's EDS file has: T→O as multicast or to this scanner alone";
const LIKE_MULTICAST: &str =
    "ask for what the scanner asked for that got the multicast first, or for data to this scanner alone";
const NO_ROOM: &str = "end a connection of another scanner, or wait for its timeout";
const NOT_FOR_SCANNERS: &str = "look whether this is a device for cyclic connections of class 1";

/// Returns what to do about a refused connection; empty where the status says it all.
pub(super) const fn advice(general: G, extended: Option<E>) -> &'static str {
    match extended {
        Some(extended) => about_connection(extended),
        None => about_request(general),
    }
}

const fn about_connection(extended: E) -> &'static str {
    match extended {
        E::ConnectionInUse => "wait for the timeout of the earlier connection",
        E::TransportNotSupported
        | E::TransportClassNotSupported
        | E::TriggerNotSupported
        | E::DirectionNotSupported => NOT_FOR_SCANNERS,
        E::OwnershipConflict => "stop the other scanner, or wait for its timeout",
        E::ConnectionNotFound | E::ForwardClosePathMismatch => "wait for the timeout of the connection",
        E::InvalidConnectionSize | E::InvalidParameters | E::InvalidOtSize | E::InvalidToSize => OTHER_SIZE,
        E::NotConfigured => "configure the device with the tool of its maker, or start it again",
        E::RpiNotSupported | E::RpiNotAcceptable | E::RpiBelowInhibitTime | E::NoBandwidth => OTHER_INTERVAL,
        E::OutOfConnections | E::TargetOutOfConnections | E::NoBufferMemory | E::NoConsumedIdFilter => {
            NO_ROOM
        }
        E::VendorOrProductMismatch | E::DeviceTypeMismatch => OTHER_KEY,
        E::RevisionMismatch => "give the revision of the device that is there, or ask for a compatible one",
        E::InvalidApplicationPath
        | E::InvalidConfigurationPathCombination
        | E::InvalidConfigurationPath
        | E::InvalidConsumingPath
        | E::InvalidProducingPath
        | E::ConfigurationSymbolUnknown
        | E::ConsumingSymbolUnknown
        | E::ProducingSymbolUnknown
        | E::InconsistentPathCombination
        | E::NullForwardOpenNotSupported => OTHER_PATH,
        E::NonListenOnlyNotOpened => "start the scanner that owns the outputs first",
        E::InvalidOtFixVar
        | E::InvalidToFixVar
        | E::InvalidOtPriority
        | E::InvalidToPriority
        | E::InvalidOtType
        | E::InvalidToType
        | E::InvalidOtRedundantOwner => OTHER_TYPE,
        E::InvalidConfigurationSize => {
            "configure the device with the tool of its maker: this scanner sends no data for that"
        }
        E::InconsistentConsumeFormat | E::InconsistentProduceFormat | E::InvalidDataFormat => {
            "give the real-time format of the device's EDS file for each direction"
        }
        E::InvalidTimeoutMultiplier => "ask for another timeout multiplier",
        E::MismatchedToSize
        | E::MismatchedToFixVar
        | E::MismatchedToPriority
        | E::MismatchedTransportClass
        | E::MismatchedToTrigger
        | E::MismatchedToInhibit => LIKE_MULTICAST,
        E::ConnectionTimedOut
        | E::UnconnectedTimedOut
        | E::UnconnectedNoReply
        | E::UnconnectedParameter
        | E::UnconnectedTooLarge => {
            "look whether the device behind the bridge is on, and whether the route leads to it"
        }
        E::InvalidPort | E::InvalidLinkAddress | E::InvalidSegmentInPath | E::LinkAddressToSelf => {
            OTHER_ROUTE
        }
        E::NotConfiguredForScheduled | E::SchedulingNotSpecified => {
            "ask the bridge's tool to schedule the connection"
        }
        E::SecondaryUnavailable | E::RedundantMismatch => "look at the other half of the redundant device",
        E::RackConnectionOpen | E::ModuleConnectionOpen => {
            "end the connection to the rack or to the module, whichever is not wanted"
        }
        E::OffSubnetMulticast => "ask for data to this scanner alone, or put both into one subnet",
        E::Miscellaneous | E::Unknown(_) => "look the status up in the documentation of the device",
    }
}

const fn about_request(general: G) -> &'static str {
    match general {
        G::KeyFailure => OTHER_KEY,
        G::PrivilegeViolation => "let the device list this scanner among those that may connect",
        G::ResourceUnavailable | G::ReplyDataTooLarge => NO_ROOM,
        G::ServiceNotSupported => {
            "a device without Large_Forward_Open carries at most 505 bytes of data O→T (509 without a header) and 509 T→O"
        }
        G::PathSegmentError | G::PathDestinationUnknown | G::PathSizeInvalid => NOT_FOR_SCANNERS,
        G::DeviceStateConflict | G::ObjectStateConflict => {
            "look at the state of the device, and start it again"
        }
        _ => "look the status up in the documentation of the device",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_status_says_what_to_do_and_only_a_strange_one_sends_to_the_documentation() {
        let strange = about_connection(E::Unknown(0x0FFF));
        let known =
            (0..0x1000).map(E::from).filter(|status| !matches!(status, E::Unknown(_) | E::Miscellaneous));
        assert!(known.clone().count() > 50);
        for status in known {
            let words = advice(G::ConnectionFailure, Some(status));
            assert!(!words.is_empty() && words != strange, "{status:?}: {words}");
        }
        assert_eq!(advice(G::KeyFailure, None), OTHER_KEY);
        assert_eq!(advice(G::VendorSpecific, None), strange);
    }
}
