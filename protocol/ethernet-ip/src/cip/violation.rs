//! The violations that a request can contain, and the status of each: the only such table.

use super::super::Writer;
use super::intervals::AcceptableIntervals;
use super::status::{Extended as E, General as G};

/// What follows an extended status: what the device would take instead.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Extra {
    /// The device's size, in bytes, or in words where it is that of configuration data.
    Size(u16),
    /// The device's packet intervals.
    Intervals(AcceptableIntervals),
}

impl Extra {
    const fn words(&self) -> u8 {
        match self {
            Self::Size(_) => 1,
            Self::Intervals(_) => AcceptableIntervals::WORDS,
        }
    }
}

/// The status of a reply: a general status and, for the Connection Manager, an extended one with what follows it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Status {
    /// The general status.
    pub general: G,
    /// The extended status.
    pub extended: Option<E>,
    /// What follows the extended status.
    pub extra: Option<Extra>,
}

impl Status {
    /// Writes the general status, the number of additional words, and these words.
    pub fn emit(&self, writer: &mut Writer<'_>) {
        writer.u8(self.general.into());
        let extra_words = self.extra.as_ref().map_or(0, Extra::words);
        writer.u8(u8::from(self.extended.is_some()) + extra_words);
        if let Some(extended) = self.extended {
            writer.u16(extended.into());
        }
        match self.extra {
            Some(Extra::Size(size)) => writer.u16(size),
            Some(Extra::Intervals(intervals)) => intervals.emit(writer),
            None => {}
        }
    }
}

macro_rules! violations {
    ($($(#[$doc:meta])* $name:ident $(($field:ident))? => $general:ident $($extended:ident)?,)*) => {
        /// A violation in a request.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Violation {
            $($(#[$doc])* $name $((violations!(@type $field)))?,)*
        }

        impl Violation {
            /// Returns the status of the reply to it.
            #[must_use]
            pub const fn status(self) -> Status {
                match self {
                    $(Self::$name $(($field))? => Status {
                        general: G::$general,
                        extended: violations!(@extended $($extended)?),
                        extra: violations!(@extra $($field $field)?),
                    },)*
                }
            }
        }
    };
    (@type size) => { u16 };
    (@type intervals) => { AcceptableIntervals };
    (@extended) => { None };
    (@extended $extended:ident) => { Some(E::$extended) };
    (@extra) => { None };
    (@extra size $field:ident) => { Some(Extra::Size($field)) };
    (@extra intervals $field:ident) => { Some(Extra::Intervals($field)) };
}

violations! {
    // Requests to any object.
    /// An unknown segment, or one that does not belong in a request to an object.
    PathSegment => PathSegmentError,
    /// The path ends before its last segment, or the request before its path.
    PathSize => PathSizeInvalid,
    /// There is no such class or instance.
    UnknownObject => PathDestinationUnknown,
    /// The class exists, but not the instance.
    UnknownInstance => ObjectDoesNotExist,
    /// The object does not support the service.
    UnknownService => ServiceNotSupported,
    /// The object does not have the attribute.
    UnknownAttribute => AttributeNotSupported,
    /// The attribute can only be read.
    NotSettable => AttributeNotSettable,
    /// The attribute can be set, but not to this value.
    BadAttributeValue => InvalidAttributeValue,
    /// A parameter of the service is out of range.
    BadParameter => InvalidParameter,
    /// The request ends before its data does.
    TooShort => NotEnoughData,
    /// The request continues behind its data.
    TooLong => TooMuchData,
    /// The reply does not fit.
    ReplyTooLarge => ReplyDataTooLarge,
    /// Services are nested too deeply.
    NestedTooDeep => ResourceUnavailable,
    /// A host requests to close a connection of another host.
    ForeignOriginator => PrivilegeViolation,
    /// The device is in use: it cannot be reset, and what the owner of its outputs depends on cannot be set.
    InUse => DeviceStateConflict,

    // Forward_Open: the triad and who owns what.
    /// The same connection serial number, vendor and originator as an open connection.
    DuplicateForwardOpen => ConnectionFailure ConnectionInUse,
    /// The originator is not one of those that may connect.
    OriginatorNotListed => PrivilegeViolation,
    /// The outputs have an owner.
    OutputsOwned => ConnectionFailure OwnershipConflict,
    /// There is no such connection to close or to change.
    ConnectionNotFound => ConnectionFailure ConnectionNotFound,
    /// The device accepts no connections any more.
    NotConfigured => ConnectionFailure NotConfigured,
    /// Every connection of the device is in use.
    OutOfConnections => ConnectionFailure OutOfConnections,
    /// Every connection of this kind is in use.
    TargetOutOfConnections => ConnectionFailure TargetOutOfConnections,
    /// A listen-only connection without a connection to listen to.
    NothingToListenTo => ConnectionFailure NonListenOnlyNotOpened,

    // Forward_Open: the electronic key.
    /// Vendor or product code of the key is not the device's.
    VendorOrProductMismatch => ConnectionFailure VendorOrProductMismatch,
    /// Device type of the key is not the device's.
    DeviceTypeMismatch => ConnectionFailure DeviceTypeMismatch,
    /// Revision of the key is not the device's.
    RevisionMismatch => ConnectionFailure RevisionMismatch,

    // Forward_Open: transport and timing.
    /// Neither class 1 nor class 3.
    TransportClassNotSupported => ConnectionFailure TransportClassNotSupported,
    /// A trigger that is reserved.
    TriggerNotSupported => ConnectionFailure TriggerNotSupported,
    /// Class 3 with the target as client.
    DirectionNotSupported => ConnectionFailure DirectionNotSupported,
    /// A packet interval of a class 3 connection that is 0 or too long.
    RpiNotSupported => ConnectionFailure RpiNotSupported,
    /// A packet interval that is too short or too long; the reply contains the limits.
    RpiNotAcceptable(intervals) => ConnectionFailure RpiNotAcceptable,
    /// A production inhibit time above the packet interval.
    RpiBelowInhibitTime => ConnectionFailure RpiBelowInhibitTime,
    /// A timeout multiplier above 7.
    TimeoutMultiplier => ConnectionFailure InvalidTimeoutMultiplier,

    // Forward_Open: network connection parameters.
    /// O→T of variable size.
    OtVariable => ConnectionFailure InvalidOtFixVar,
    /// T→O of variable size.
    ToVariable => ConnectionFailure InvalidToFixVar,
    /// O→T priority that the transport class does not have.
    OtPriority => ConnectionFailure InvalidOtPriority,
    /// T→O priority that the transport class does not have.
    ToPriority => ConnectionFailure InvalidToPriority,
    /// O→T is not point to point, and not null together with T→O.
    OtType => ConnectionFailure InvalidOtType,
    /// T→O of a reserved type, or null where O→T is not.
    ToType => ConnectionFailure InvalidToType,
    /// A redundant owner.
    OtRedundantOwner => ConnectionFailure InvalidOtRedundantOwner,
    /// O→T size that is not the assembly's; the reply contains the assembly's size.
    OtSize(size) => ConnectionFailure InvalidOtSize,
    /// T→O size that is not the assembly's; the reply contains the assembly's size.
    ToSize(size) => ConnectionFailure InvalidToSize,
    /// T→O size that is not that of the running multicast.
    MulticastSize => ConnectionFailure MismatchedToSize,
    /// T→O priority that is not that of the running multicast.
    MulticastPriority => ConnectionFailure MismatchedToPriority,
    /// Trigger that is not that of the running multicast.
    MulticastTrigger => ConnectionFailure MismatchedToTrigger,
    /// Inhibit time that is not that of the running multicast.
    MulticastInhibit => ConnectionFailure MismatchedToInhibit,
    /// A multicast for an originator behind a router.
    OffSubnetMulticast => ConnectionFailure OffSubnetMulticast,

    // Forward_Open and Forward_Close: the path.
    /// A class that has no connections.
    ApplicationPath => ConnectionFailure InvalidApplicationPath,
    /// Configuration data of another size than the configuration assembly's; the reply contains that size, in words.
    ConfigurationSize(size) => ConnectionFailure InvalidConfigurationSize,
    /// A configuration assembly that is not there.
    ConfigurationPath => ConnectionFailure InvalidConfigurationPath,
    /// An O→T assembly that is not there.
    ConsumingPath => ConnectionFailure InvalidConsumingPath,
    /// A T→O assembly that is not there.
    ProducingPath => ConnectionFailure InvalidProducingPath,
    /// Assemblies that exist, but not for this use.
    InconsistentPathCombination => ConnectionFailure InconsistentPathCombination,
    /// A null Forward_Open for what cannot be configured.
    NullForwardOpen => ConnectionFailure NullForwardOpenNotSupported,
    /// A port that the device does not have.
    InvalidPort => ConnectionFailure InvalidPort,
    /// An address that is not this device's.
    InvalidLinkAddress => ConnectionFailure InvalidLinkAddress,
    /// A segment that is not known, is cut off, or has no place in a connection path.
    InvalidSegmentInPath => ConnectionFailure InvalidSegmentInPath,
    /// Another path than the one that was opened.
    ForwardClosePath => ConnectionFailure ForwardClosePathMismatch,

    // Unconnected_Send.
    /// The route is correct, but no device answered in time.
    UnconnectedTimeout => ConnectionFailure UnconnectedTimedOut,
    /// The embedded message is empty or does not fit its size.
    UnconnectedParameter => ConnectionFailure UnconnectedParameter,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wire(violation: Violation) -> ([u8; 6], usize) {
        let mut buf = [0; 6];
        let mut writer = Writer::new(&mut buf);
        violation.status().emit(&mut writer);
        let len = writer.finish().unwrap();
        (buf, len)
    }

    #[test]
    fn a_violation_of_a_plain_request_carries_a_general_status_alone() {
        assert_eq!(wire(Violation::UnknownService), ([8, 0, 0, 0, 0, 0], 2));
    }

    #[test]
    fn a_refused_connection_carries_its_extended_status_and_the_size_that_would_do() {
        assert_eq!(wire(Violation::OutputsOwned), ([1, 1, 0x06, 0x01, 0, 0], 4));
        assert_eq!(wire(Violation::OtSize(262)), ([1, 2, 0x27, 0x01, 0x06, 0x01], 6));
    }
}
