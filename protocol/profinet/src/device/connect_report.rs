//! The last Connect and the answer to it: who finds no connection can read here what the controller expects.

use alloc::vec::Vec;
use core::fmt;
use core::net::Ipv4Addr;

use super::Device;
use crate::connect::{
    ConnectRequest, ConnectResponse, DiffModule, ExpectedSubmodule, Iocr, IocrType, RtClass,
};
use crate::status::{Service, Violation};

/// A Connect, and how it was answered.
#[derive(Debug)]
pub(super) struct ConnectReport {
    from: Ipv4Addr,
    /// `None` where it could not be read.
    request: Option<ConnectRequest>,
    /// The modules that differ from the expected ones, or why the Connect was refused.
    answer: Result<Vec<DiffModule>, Violation>,
}

impl Device {
    /// Writes who sent the last Connect, which cycle and which modules it asked for, and why it was refused or which modules
    /// differ; nothing before the first one.
    pub fn write_request(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.core.last_connect.as_ref().map_or(Ok(()), |report| report.write(words))
    }
}

impl ConnectReport {
    pub(super) fn new(
        from: Ipv4Addr,
        request: Option<ConnectRequest>,
        result: &Result<ConnectResponse, Violation>,
    ) -> Self {
        let answer = result.as_ref().map(|response| response.diff.clone()).map_err(|violation| *violation);
        Self { from, request, answer }
    }

    fn write(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        write!(words, "{} ", self.from)?;
        if let Some(request) = &self.request {
            let name = request.ar.initiator_name.escape_ascii();
            write!(words, "({name}, {}) sent a Connect", request.ar.initiator_mac)?;
            let input = request.iocrs.iter().find(|iocr| iocr.iocr_type == IocrType::Input);
            input.map_or(Ok(()), |input| write_cycle(words, input))?;
            write_modules(words, request)?;
        } else {
            words.write_str("sent a Connect")?;
        }
        match &self.answer {
            Ok(diff) => diff.iter().try_for_each(|module| self.write_difference(words, module)),
            Err(violation) => {
                let status = violation.status(Service::Connect);
                write!(words, "; refused: {} (status 0x{:08X})", violation.text(), status.0)
            }
        }
    }

    /// Writes how a module of the device differs from the expected one.
    fn write_difference(&self, words: &mut dyn fmt::Write, real: &DiffModule) -> fmt::Result {
        let mut expected = self.request.iter().flat_map(|request| &request.expected);
        let Some(expected) = expected.find(|module| module.slot == real.slot) else { return Ok(()) };
        write!(words, "; slot {} expects module 0x{:08X}, ", real.slot, expected.ident)?;
        match real.ident {
            0 => return words.write_str("this device has none there"),
            ident => write!(words, "this device has 0x{ident:08X}")?,
        }
        real.submodules.iter().try_for_each(|submodule| {
            let wanted = expected.submodules.iter().find(|wanted| wanted.subslot == submodule.subslot);
            let wanted = wanted.map_or(0, |wanted| wanted.ident);
            let (subslot, ident) = (submodule.subslot, submodule.ident);
            write!(words, ", subslot 0x{subslot:04X} expects 0x{wanted:08X}, has 0x{ident:08X}")
        })
    }
}

fn write_cycle(words: &mut dyn fmt::Write, input: &Iocr) -> fmt::Result {
    let transport = if input.rt_class == RtClass::Udp { "udp" } else { "rt1" };
    let millis = input.cycle_time().period().as_secs_f64() * 1e3;
    write!(words, " over {transport}: a frame every {millis} ms, data hold {} cycles", input.data_hold_factor)
}

/// Writes the submodules with data that a Connect expects.
fn write_modules(words: &mut dyn fmt::Write, request: &ConnectRequest) -> fmt::Result {
    for module in &request.expected {
        for ExpectedSubmodule { subslot, input_len, output_len, .. } in &module.submodules {
            let [inputs, outputs] = [input_len, output_len].map(|len| len.unwrap_or(0));
            if (inputs, outputs) != (0, 0) {
                let slot = module.slot;
                write!(
                    words,
                    "; slot {slot} subslot {subslot}: {inputs} bytes of inputs, {outputs} of outputs"
                )?;
            }
        }
    }
    Ok(())
}
