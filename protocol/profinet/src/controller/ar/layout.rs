//! Layout of the C_SDUs: where the data, provider and consumer status of every submodule are.
//!
//! ```text
//! input   by slot and subslot:   data, IOPS of its input · IOCS of its output
//! output  by slot and subslot:   IOCS of its input · data, IOPS of its output
//! ```
//!
//! A submodule without I/O counts as an input of no bytes. This is the order in which a Siemens controller packs its
//! frames; the device learns every offset from the IOCRs and needs no convention.

use alloc::vec::Vec;
use core::ops::Range;

use crate::connect::{ExpectedModule, Object};
use crate::provided::Provided;
use crate::rt::{IoxStatus, MAX_C_SDU_LEN, Transport};

/// One direction.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Direction {
    /// Data with IOPS, for the IOCR.
    pub(super) objects: Vec<Object>,
    /// IOCS, for the IOCR.
    pub(super) consumer_statuses: Vec<Object>,
    /// Length in bytes of the C_SDU, padding included.
    pub(super) c_sdu_len: u16,
    /// Where the data are; the byte behind each is its IOPS.
    data: Vec<Range<usize>>,
    /// The same of the submodules that have data, with slot and subslot: these are read in each cycle.
    read: Vec<((u16, u16), Range<usize>)>,
    end: usize,
}

/// Both directions.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Layout {
    /// Device to controller.
    pub(super) input: Direction,
    /// Controller to device.
    pub(super) output: Direction,
}

impl Layout {
    /// Creates the layout for these modules, or the length in bytes of the C_SDU that would be too long.
    pub(super) fn new(modules: &[ExpectedModule], transport: Transport) -> Result<Self, usize> {
        let mut layout = Self { input: Direction::default(), output: Direction::default() };
        let submodules = modules
            .iter()
            .flat_map(|module| module.submodules.iter().map(|submodule| (module.slot, submodule)));
        for (slot, submodule) in submodules {
            let place = (slot, submodule.subslot);
            if let Some(len) = submodule.input_len {
                layout.input.push_data(place, len);
                layout.output.push_consumer_status(place);
            }
            if let Some(len) = submodule.output_len {
                layout.output.push_data(place, len);
                layout.input.push_consumer_status(place);
            }
        }
        for direction in [&mut layout.input, &mut layout.output] {
            let len = direction.end.max(transport.min_c_sdu_len());
            direction.c_sdu_len = u16::try_from(len).ok().filter(|_| len <= MAX_C_SDU_LEN).ok_or(len)?;
        }
        Ok(layout)
    }
}

impl Direction {
    fn push_data(&mut self, place: (u16, u16), len: u16) {
        self.objects.push(self.object(place));
        let end = self.end + usize::from(len);
        self.data.push(self.end..end);
        if len > 0 {
            self.read.push((place, self.end..end));
        }
        self.end = end + 1;
    }

    fn push_consumer_status(&mut self, place: (u16, u16)) {
        self.consumer_statuses.push(self.object(place));
        self.end += 1;
    }

    fn object(&self, (slot, subslot): (u16, u16)) -> Object {
        // An offset above 65535 implies a C_SDU that is refused as too long.
        Object { slot, subslot, offset: u16::try_from(self.end).unwrap_or(u16::MAX) }
    }

    /// Writes the data of every submodule with their status. Data that were never set are zeros and bad.
    pub(super) fn write_data(&self, provided: &Provided, c_sdu: &mut [u8]) {
        for (object, range) in self.objects.iter().zip(&self.data) {
            let data = provided.get(object.slot, object.subslot);
            let status = match data {
                Some((_, true)) => IoxStatus::GOOD,
                _ => IoxStatus::BAD_BY_CONTROLLER,
            };
            if let (Some((data, _)), Some(place)) = (data, c_sdu.get_mut(range.clone()))
                && data.len() == place.len()
            {
                place.copy_from_slice(data);
            }
            if let Some(iops) = c_sdu.get_mut(range.end) {
                *iops = status.0;
            }
        }
    }

    /// Writes one consumer status for all submodules.
    pub(super) fn write_consumer_statuses(&self, status: IoxStatus, c_sdu: &mut [u8]) {
        for object in &self.consumer_statuses {
            if let Some(iocs) = c_sdu.get_mut(usize::from(object.offset)) {
                *iocs = status.0;
            }
        }
    }

    /// Returns the data of one submodule, if it has data and marks them as good.
    pub(super) fn data<'a>(&self, c_sdu: &'a [u8], slot: u16, subslot: u16) -> Option<&'a [u8]> {
        let mut all = self.all_data(c_sdu);
        all.find_map(|(place, data)| (place == (slot, subslot)).then_some(data)).flatten()
    }

    /// Returns the data of every submodule that has data, with slot and subslot; `None` for data that are marked as bad.
    pub(super) fn all_data<'a>(
        &self,
        c_sdu: &'a [u8],
    ) -> impl Iterator<Item = ((u16, u16), Option<&'a [u8]>)> {
        self.read.iter().map(move |(place, range)| {
            let good = c_sdu.get(range.end).is_some_and(|iops| IoxStatus(*iops).is_good());
            (*place, c_sdu.get(range.clone()).filter(|_| good))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captured;
    use crate::connect::{ConnectRequest, IocrType};
    use crate::provided::Provided;
    use crate::rpc::{ARGS_LEN, HEADER_LEN};
    use crate::rt::CyclicFrame;
    use machine::ethernet::EthernetHeader;

    /// Returns the Connect of a Siemens CPU 1515-2 PN V2.9.4.
    fn siemens() -> ConnectRequest {
        let datagram = captured::datagram(captured::CONNECT_REQ);
        ConnectRequest::parse(&datagram[HEADER_LEN + ARGS_LEN..]).unwrap()
    }

    #[test]
    fn for_the_same_modules_every_offset_is_that_of_the_siemens_controller() {
        let request = siemens();
        let layout = Layout::new(&request.expected, Transport::Rt1).unwrap();
        for (iocr_type, ours) in [(IocrType::Input, &layout.input), (IocrType::Output, &layout.output)] {
            let theirs = request.iocrs.iter().find(|iocr| iocr.iocr_type == iocr_type).unwrap();
            assert_eq!(ours.objects, theirs.objects, "{iocr_type:?}");
            assert_eq!(ours.consumer_statuses, theirs.consumer_statuses, "{iocr_type:?}");
            assert_eq!(ours.c_sdu_len, theirs.data_length, "{iocr_type:?}");
        }
    }

    /// Modules of the capture with outputs: slot and length in bytes.
    const OUTPUTS: [(u16, u16, u16); 3] = [(2, 1, 1), (3, 1, 1), (4, 1, 8)];

    #[test]
    fn outputs_are_packed_as_in_the_siemens_controllers_frame() {
        let layout = Layout::new(&siemens().expected, Transport::Rt1).unwrap();
        let frame = captured::frame(captured::ECHO_CPU_8001);
        let (_, payload) = EthernetHeader::parse(&frame).unwrap();
        let theirs = CyclicFrame::parse(payload, 40).unwrap().c_sdu;
        let mut provided = Provided::new(OUTPUTS.into_iter());
        provided.set(2, 1, &theirs[4..5]).unwrap();
        provided.set(3, 1, &theirs[7..8]).unwrap();
        provided.set(4, 1, &[0x12, 0x34, 0x56, 0x78, 0x3F, 0xC0, 0, 0]).unwrap();
        let mut ours = [0; 40];
        layout.output.write_data(&provided, &mut ours);
        layout.output.write_consumer_statuses(IoxStatus::GOOD, &mut ours);
        assert_eq!(ours, theirs);
    }

    #[test]
    fn inputs_are_taken_only_from_submodules_that_call_them_good() {
        let layout = Layout::new(&siemens().expected, Transport::Rt1).unwrap();
        let frame = captured::frame(captured::ECHO_DEV_8000);
        let (_, payload) = EthernetHeader::parse(&frame).unwrap();
        let mut c_sdu = CyclicFrame::parse(payload, 40).unwrap().c_sdu.to_vec();
        let echo = [0x12, 0xB4, 0x56, 0x78, 0x7F, 0x80, 0, 0];
        let all: Vec<_> = layout.input.all_data(&c_sdu).collect();
        let expected: [(_, Option<&[u8]>); 3] =
            [((1, 1), Some(&[0xA4])), ((3, 1), Some(&[0xA5])), ((4, 1), Some(&echo))];
        assert_eq!(all, expected);

        let iops_of_slot_4 = 0x11;
        c_sdu[iops_of_slot_4] = IoxStatus::BAD.0;
        assert_eq!(layout.input.data(&c_sdu, 4, 1), None);
        assert_eq!(layout.input.data(&c_sdu, 1, 1), Some(&[0xA4][..]));
        assert_eq!(layout.input.data(&c_sdu, 0, 1), None, "a submodule without data");
    }

    #[test]
    fn outputs_that_were_never_set_are_zero_and_bad() {
        let layout = Layout::new(&siemens().expected, Transport::Udp).unwrap();
        let mut provided = Provided::new(OUTPUTS.into_iter());
        provided.set(3, 1, &[7]).unwrap();
        let mut c_sdu = [0xFF; 40];
        layout.output.write_data(&provided, &mut c_sdu);
        assert_eq!(c_sdu[4..6], [0, IoxStatus::BAD_BY_CONTROLLER.0]);
        assert_eq!(c_sdu[7..9], [7, IoxStatus::GOOD.0]);
    }

    #[test]
    fn more_data_than_a_frame_holds_is_refused() {
        let mut modules = siemens().expected;
        modules[1].submodules[0].input_len = Some(1439);
        assert!(Layout::new(&modules, Transport::Udp).is_err());
    }
}
