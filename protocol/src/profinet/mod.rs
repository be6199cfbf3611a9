//! PROFINET IO: an IO-Controller and an IO-Device, over Ethernet (RT_CLASS_1) and over UDP (RT_CLASS_UDP).

pub mod dcp;
pub mod ethernet;
pub mod rt;
