//! EtherNet/IP: scanner and adapter in virtual time, and the adapter against clients made by hand.

#![expect(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by a panic")]

mod address_conflicts;
mod cell;
mod class_3;
mod client;
mod configuration;
mod dissected;
mod exchange;
mod formats;
mod fuzz;
mod hostile;
mod limits;
mod link;
mod many_adapters;
mod multicast;
mod objects;
mod owners;
mod places;
mod refusals;
mod samples;
mod scanner_alone;
mod scanner_hostile;
mod search;
mod several_assemblies;
mod single_connection;
mod sizes;
mod strangers;
mod two_adapters;
