//! EtherNet/IP: scanner and adapter in virtual time, and the adapter against clients made by hand.

mod cell;
mod client;
mod exchange;
mod hostile;
mod objects;
mod refusals;
mod scanner_hostile;
