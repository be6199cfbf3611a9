//! The stacks' endpoints as [`Fieldbus`]: the image is the process data.

use core::fmt;

use ethernet_ip::{Adapter, Scanner};
use machine::Instant;
use machine::wire::{BigEndian, LittleEndian};
use profinet::{Controller, Device};

use crate::fieldbus::{Counters, Fieldbus};
use crate::image::Image;

impl Fieldbus for Controller {
    type Order = BigEndian;

    fn set_output(&mut self, image: &Image) {
        self.set_output(image);
    }

    fn input(&self) -> Option<&Image> {
        self.input()
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn counters(&self) -> Counters {
        self.counters()
    }
}

impl Fieldbus for Device {
    type Order = BigEndian;

    fn set_output(&mut self, image: &Image) {
        self.set_output(image);
    }

    fn input(&self) -> Option<&Image> {
        self.input()
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn counters(&self) -> Counters {
        self.counters()
    }

    fn address_set(&mut self, now: Instant, done: bool) {
        self.address_set(now, done);
    }
}

impl Fieldbus for Scanner {
    type Order = LittleEndian;

    fn set_output(&mut self, image: &Image) {
        self.set_output(image);
    }

    fn input(&self) -> Option<&Image> {
        self.input()
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.explain(words)
    }

    fn counters(&self) -> Counters {
        self.counters()
    }
}

impl Fieldbus for Adapter {
    type Order = LittleEndian;

    fn set_output(&mut self, image: &Image) {
        self.set_output(image);
    }

    fn input(&self) -> Option<&Image> {
        self.input()
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn counters(&self) -> Counters {
        self.counters()
    }
}
