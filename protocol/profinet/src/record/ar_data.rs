//! ARData: the ARs of the device, as an engineering system lists them.
//!
//! ```text
//! NumberOfARs u16 · each:
//!   ARUUID 16 · CMInitiatorObjectUUID 16 · ParameterServerObjectUUID 16 · ARProperties u32 · ARType u16
//!   AlarmCRType u16 · LocalAlarmReference u16 · RemoteAlarmReference u16
//!   CMInitiatorUDPRTPort u16 · CMResponderUDPRTPort u16
//!   StationNameLength u16 · CMInitiatorStationName · padding · the same of the ParameterServer
//!   NumberOfIOCRs u16 · padding 2 · each:
//!     IOCRProperties u32 · IOCRType u16 · FrameID u16 · CycleCounter u16 · DataStatus u8 · TransferStatus u8
//!   NumberOfAPIs u16 · padding 2 · each: API u32
//!   NumberOfARDATAInfo u16 (0) · padding 2
//! ```
//!
//! This is version 1.1. Padding is counted from the start of the block.

use crate::Uuid;
use crate::block::{self, BlockType, BlockWriter};
use crate::connect::{API, ArProperties, IocrType, RtClass};
use crate::rt::DataStatus;

/// BlockVersionLow of this layout.
const VERSION_LOW: u8 = 1;

/// One AR. Its parameters come from the controller itself, and not from a parameter server.
#[derive(Clone, Copy, Debug)]
pub struct ArData<'a> {
    /// ARUUID.
    pub uuid: Uuid,
    /// ARType.
    pub ar_type: u16,
    /// ARProperties.
    pub properties: ArProperties,
    /// CMInitiatorObjectUUID.
    pub initiator_object: Uuid,
    /// CMInitiatorStationName.
    pub initiator_name: &'a [u8],
    /// UDP ports of cyclic data: of the controller, and of the device.
    pub rt_ports: (u16, u16),
    /// LocalAlarmReference of the device, and of the controller.
    pub alarm_references: (u16, u16),
    /// Its cyclic connections.
    pub iocrs: [IocrData; 2],
}

/// One cyclic connection, with the status of its last frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct IocrData {
    /// IOCRType.
    pub iocr_type: IocrType,
    /// RTClass, bits 0 to 3 of IOCRProperties.
    pub rt_class: RtClass,
    /// FrameID.
    pub frame_id: u16,
    /// CycleCounter; 0 before the first frame.
    pub cycle_counter: u16,
    /// DataStatus; 0 before the first frame.
    pub data_status: DataStatus,
}

/// Writes the block of these ARs.
pub fn emit_ar_data(ars: &[ArData<'_>], writer: &mut BlockWriter<'_>) {
    let start = writer.len();
    block::write_version(writer, BlockType::ArData, VERSION_LOW, |w| {
        w.u16(u16::try_from(ars.len()).unwrap_or(u16::MAX));
        ars.iter().for_each(|ar| ar.emit(start, w));
    });
}

impl ArData<'_> {
    fn emit(&self, start: usize, w: &mut BlockWriter<'_>) {
        let align = |w: &mut BlockWriter<'_>| w.pad_to(start + (w.len() - start).next_multiple_of(4));
        self.uuid.write(w);
        self.initiator_object.write(w);
        Uuid::NIL.write(w);
        w.u32(self.properties.0);
        w.u16(self.ar_type);
        // The only AlarmCRType.
        w.u16(1);
        w.u16(self.alarm_references.0);
        w.u16(self.alarm_references.1);
        w.u16(self.rt_ports.0);
        w.u16(self.rt_ports.1);
        w.u16(u16::try_from(self.initiator_name.len()).unwrap_or(u16::MAX));
        w.bytes(self.initiator_name);
        align(w);
        w.u16(0);
        align(w);
        w.u16(self.iocrs.len() as u16);
        align(w);
        for iocr in &self.iocrs {
            w.u32(u8::from(iocr.rt_class).into());
            w.u16(iocr.iocr_type.into());
            w.u16(iocr.frame_id);
            w.u16(iocr.cycle_counter);
            w.bytes(&[iocr.data_status.0, 0]);
        }
        w.u16(1);
        align(w);
        w.u32(API);
        w.u16(0);
        align(w);
    }
}
