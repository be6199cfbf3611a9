//! Network connection parameters and the transport byte (volume 1, 3-5.5.1).
//!
//! ```text
//! Forward_Open, u16                        Large_Forward_Open, u32
//! 15      redundant owner                  31
//! 13..15  type: null, multicast, p2p       29..31
//! 10..12  priority: low, high, scheduled,  26..28
//!         urgent
//! 9       variable size                    25
//! 0..9    connection size in bytes         0..16
//!
//! transport  7 target is server · 4..7 trigger: cyclic, change of state, application · 0..4 class
//! ```

/// Type of the data's transport in one direction.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ConnectionType {
    /// There is no data in this direction.
    Null,
    /// One sender, many receivers.
    Multicast,
    /// One sender, one receiver.
    PointToPoint,
    /// A reserved code.
    Reserved,
}

/// Priority of data; the QoS object has a DSCP for each.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Priority {
    /// Low.
    Low,
    /// High.
    High,
    /// Scheduled: cyclic I/O.
    Scheduled,
    /// Urgent: motion.
    Urgent,
}

/// The parameters of one direction.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Parameters {
    /// Whether several owners send in this direction.
    pub redundant_owner: bool,
    /// Type of the data's transport.
    pub kind: ConnectionType,
    /// Priority of the data.
    pub priority: Priority,
    /// Whether its size may vary.
    pub variable: bool,
    /// Connection size in bytes: sequence count, run/idle header and data.
    pub size: u16,
}

impl Parameters {
    /// The largest size that the 9 bits of a plain Forward_Open hold, in bytes.
    pub const MAX_PLAIN_SIZE: u16 = 511;

    /// Parses the field of a plain Forward_Open.
    #[must_use]
    pub const fn from_plain(field: u16) -> Self {
        Self::from_flags(field >> 9, field & 0x1FF)
    }

    /// Parses the field of a Large_Forward_Open.
    #[must_use]
    pub const fn from_large(field: u32) -> Self {
        Self::from_flags((field >> 25) as u16, field as u16)
    }

    /// Returns the field of a plain Forward_Open; the size must fit.
    #[must_use]
    pub const fn to_plain(self) -> u16 {
        self.flags() << 9 | self.size & 0x1FF
    }

    /// Returns the field of a Large_Forward_Open.
    #[must_use]
    pub const fn to_large(self) -> u32 {
        (self.flags() as u32) << 25 | self.size as u32
    }

    /// Parses the flags above the size, which are the same in both fields: variable in bit 0, priority 1..3, type
    /// 4..6, owner 6.
    const fn from_flags(flags: u16, size: u16) -> Self {
        Self {
            redundant_owner: flags & 1 << 6 != 0,
            kind: match flags >> 4 & 3 {
                0 => ConnectionType::Null,
                1 => ConnectionType::Multicast,
                2 => ConnectionType::PointToPoint,
                _ => ConnectionType::Reserved,
            },
            priority: match flags >> 1 & 3 {
                0 => Priority::Low,
                1 => Priority::High,
                2 => Priority::Scheduled,
                _ => Priority::Urgent,
            },
            variable: flags & 1 != 0,
            size,
        }
    }

    const fn flags(self) -> u16 {
        let kind = match self.kind {
            ConnectionType::Null => 0,
            ConnectionType::Multicast => 1,
            ConnectionType::PointToPoint => 2,
            ConnectionType::Reserved => 3,
        };
        let priority = match self.priority {
            Priority::Low => 0,
            Priority::High => 1,
            Priority::Scheduled => 2,
            Priority::Urgent => 3,
        };
        (self.redundant_owner as u16) << 6 | kind << 4 | priority << 1 | self.variable as u16
    }
}

/// The event that makes the target produce.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Trigger {
    /// Time: once every packet interval.
    Cyclic,
    /// A change of the data, and time.
    ChangeOfState,
    /// The application, and time.
    Application,
    /// A reserved code.
    Reserved,
}

/// The transport class and trigger byte.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Transport(pub u8);

impl Transport {
    /// Class 1, cyclic, the target as client: I/O.
    pub const CYCLIC: Self = Self(0x01);
    /// Class 3, application, the target as server: explicit messages.
    pub const EXPLICIT: Self = Self(0xA3);

    /// Returns the transport class.
    #[must_use]
    pub const fn class(self) -> u8 {
        self.0 & 0x0F
    }

    /// Returns whether the target is the server.
    #[must_use]
    pub const fn is_server(self) -> bool {
        self.0 & 0x80 != 0
    }

    /// Returns the event that makes the target produce.
    #[must_use]
    pub const fn trigger(self) -> Trigger {
        match self.0 >> 4 & 7 {
            0 => Trigger::Cyclic,
            1 => Trigger::ChangeOfState,
            2 => Trigger::Application,
            _ => Trigger::Reserved,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_usual_io_parameters_are_parsed_correctly() {
        // 0x4906: point to point, scheduled, fixed, 262 bytes: what a scanner asks of 256 bytes O→T.
        let parameters = Parameters::from_plain(0x4906);
        assert_eq!(
            parameters,
            Parameters {
                redundant_owner: false,
                kind: ConnectionType::PointToPoint,
                priority: Priority::Scheduled,
                variable: false,
                size: 262
            }
        );
        assert_eq!(parameters.to_large(), 0x4800_0106);
    }

    proptest! {
        #[test]
        fn every_field_is_written_as_it_was_parsed(plain: u16, large: u32) {
            prop_assert_eq!(Parameters::from_plain(plain & !0x1000).to_plain(), plain & !0x1000);
            let large = large & 0xEE00_FFFF;
            prop_assert_eq!(Parameters::from_large(large).to_large(), large);
        }
    }
}
