//! The 802.1Q tags that PROFINET frames carry (IEC 61158-6-10, 4.1).

use machine::ethernet::Tag;

/// Cyclic data and high alarms.
pub const RT: Tag = Tag::priority(6);
/// Low alarms.
pub const ALARM_LOW: Tag = Tag::priority(5);
