//! The registers: their addresses, what they hold at power-on, and which bits the MainDevice may write (Beckhoff,
//! ESC datasheet section II).

use alloc::boxed::Box;
use alloc::vec;

pub(crate) const PORT_DESCRIPTOR: u16 = 0x0007;
pub(crate) const STATION_ADDRESS: u16 = 0x0010;
pub(crate) const STATION_ALIAS: u16 = 0x0012;
pub(crate) const RESET: u16 = 0x0040;
pub(crate) const DL_CONTROL: u16 = 0x0100;
/// Byte of DL control: bit 0 lets the alias address the device.
pub(crate) const DL_ALIAS: u16 = 0x0103;
/// From the address that a command reads to the one that it writes.
pub(crate) const READ_WRITE_OFFSET: u16 = 0x0108;
pub(crate) const DL_STATUS: u16 = 0x0110;
pub(crate) const AL_CONTROL: u16 = 0x0120;
pub(crate) const AL_STATUS: u16 = 0x0130;
pub(crate) const AL_STATUS_CODE: u16 = 0x0134;
/// PDI control; its high byte and the next word are the configuration of the chip.
pub(crate) const PDI_CONTROL: u16 = 0x0140;
pub(crate) const PDI_CONFIGURATION: u16 = 0x0150;
pub(crate) const EVENT_MASK: u16 = 0x0200;
pub(crate) const EVENTS: u16 = 0x0210;
pub(crate) const ERROR_COUNTERS: u16 = 0x0300;
pub(crate) const PROCESSING_ERRORS: u16 = 0x030C;
pub(crate) const PDI_ERRORS: u16 = 0x030D;
pub(crate) const LOST_LINKS: u16 = 0x0310;
pub(crate) const WATCHDOG_DIVIDER: u16 = 0x0400;
pub(crate) const WATCHDOG_TIME: u16 = 0x0420;
pub(crate) const WATCHDOG_STATUS: u16 = 0x0440;
pub(crate) const WATCHDOG_COUNTER: u16 = 0x0442;
pub(crate) const SII_CONFIG: u16 = 0x0500;
pub(crate) const SII_CONTROL: u16 = 0x0502;
pub(crate) const SII_ADDRESS: u16 = 0x0504;
pub(crate) const SII_DATA: u16 = 0x0508;
pub(crate) const SII_END: u16 = 0x0510;
pub(crate) const FMMU: u16 = 0x0600;
pub(crate) const FMMU_LEN: u16 = 16;
pub(crate) const SYNC_MANAGER: u16 = 0x0800;
pub(crate) const SYNC_MANAGER_LEN: u16 = 8;
pub(crate) const RECEIVE_TIMES: u16 = 0x0900;
pub(crate) const SYSTEM_TIME: u16 = 0x0910;
pub(crate) const RECEIVE_TIME_UNIT: u16 = 0x0918;
pub(crate) const SYSTEM_TIME_OFFSET: u16 = 0x0920;
pub(crate) const SYSTEM_TIME_DELAY: u16 = 0x0928;
pub(crate) const SYSTEM_TIME_DIFFERENCE: u16 = 0x092C;
pub(crate) const SPEED_COUNTER_START: u16 = 0x0930;
pub(crate) const SPEED_COUNTER_DIFFERENCE: u16 = 0x0932;
/// Bit 0 gives the SYNC signals to the device's own side.
pub(crate) const CYCLIC_CONTROL: u16 = 0x0980;
pub(crate) const SYNC_ACTIVATION: u16 = 0x0981;
/// Length of SYNC pulses in 10 ns.
pub(crate) const PULSE_LENGTH: u16 = 0x0982;
pub(crate) const SYNC_START: u16 = 0x0990;
pub(crate) const NEXT_SYNC1: u16 = 0x0998;
pub(crate) const SYNC0_CYCLE: u16 = 0x09A0;
pub(crate) const SYNC1_CYCLE: u16 = 0x09A4;
pub(crate) const SYNC_END: u16 = 0x09A8;

/// End of the registers, and start of the process data RAM.
pub(crate) const END: u16 = 0x1000;

/// Addresses of the digital outputs, which a sync manager may guard.
pub(crate) const DIGITAL_OUTPUTS: core::ops::Range<u16> = 0x0F00..0x0F10;

/// Numbers of FMMUs and sync managers, as the ET1100 has.
pub(crate) const UNITS: u8 = 8;

/// The registers of the chip: ranges, each with the bits that the MainDevice may write in each of its bytes.
struct Range(u16, u16, u8);

const READ: u8 = 0x00;
const WRITE: u8 = 0xFF;

/// Registers of every chip.
const COMMON: &[Range] = &[
    Range(0x0000, 0x000A, READ),
    Range(STATION_ADDRESS, 0x0012, WRITE),
    Range(STATION_ALIAS, 0x0014, READ),
    Range(RESET, 0x0041, WRITE),
    Range(DL_CONTROL, 0x0101, 0x03),
    Range(0x0101, 0x0102, WRITE),
    Range(0x0102, 0x0103, 0x0F),
    Range(DL_ALIAS, 0x0104, 0x01),
    Range(READ_WRITE_OFFSET, 0x010A, WRITE),
    Range(DL_STATUS, 0x0112, READ),
    Range(AL_CONTROL, 0x0122, WRITE),
    Range(AL_STATUS, 0x0132, READ),
    Range(AL_STATUS_CODE, 0x0136, READ),
    Range(PDI_CONTROL, 0x0144, READ),
    Range(PDI_CONFIGURATION, 0x0154, READ),
    Range(EVENT_MASK, 0x0202, WRITE),
    Range(0x0204, 0x0208, READ),
    Range(EVENTS, 0x0212, READ),
    Range(0x0220, 0x0224, READ),
    Range(ERROR_COUNTERS, 0x030E, WRITE),
    Range(0x030E, 0x0310, READ),
    Range(LOST_LINKS, 0x0314, WRITE),
    Range(WATCHDOG_DIVIDER, 0x0402, WRITE),
    Range(0x0410, 0x0412, WRITE),
    Range(WATCHDOG_TIME, 0x0422, WRITE),
    Range(WATCHDOG_STATUS, 0x0442, READ),
    Range(WATCHDOG_COUNTER, 0x0444, WRITE),
    Range(SII_CONFIG, 0x0501, 0x03),
    Range(0x0501, 0x0502, READ),
    Range(SII_CONTROL, 0x0503, 0x01),
    Range(0x0503, 0x0504, 0x07),
    Range(SII_ADDRESS, 0x050A, WRITE),
    // A write to the EEPROM has one word.
    Range(0x050A, 0x0510, READ),
    Range(0x0F80, END, WRITE),
];

/// Registers of the distributed clock.
const CLOCK: &[Range] = &[
    // A write to the first byte latches the times.
    Range(RECEIVE_TIMES, 0x0901, WRITE),
    Range(0x0901, 0x0910, READ),
    Range(SYSTEM_TIME, 0x0914, WRITE),
    Range(0x0914, 0x0918, READ),
    Range(RECEIVE_TIME_UNIT, 0x0920, READ),
    Range(SYSTEM_TIME_OFFSET, 0x092C, WRITE),
    Range(SYSTEM_TIME_DIFFERENCE, 0x0930, READ),
    Range(SPEED_COUNTER_START, 0x0931, WRITE),
    Range(0x0931, 0x0932, 0x7F),
    Range(SPEED_COUNTER_DIFFERENCE, 0x0934, READ),
    Range(0x0934, 0x0936, 0x0F),
    Range(CYCLIC_CONTROL, SYNC_ACTIVATION, 0x31),
    Range(SYNC_ACTIVATION, 0x0982, 0x07),
    Range(PULSE_LENGTH, 0x0984, READ),
    Range(0x098E, 0x0990, READ),
    Range(SYNC_START, 0x0998, WRITE),
    Range(NEXT_SYNC1, 0x09A0, READ),
    Range(SYNC0_CYCLE, 0x09A8, WRITE),
];

/// Which registers a chip has, and which of their bits the MainDevice may write.
#[derive(Debug)]
pub(crate) struct RegisterMap {
    /// For each address the bits that may be written, or `None` where there is no register.
    writable: Box<[Option<u8>]>,
}

impl RegisterMap {
    pub(crate) fn new(distributed_clocks: bool) -> Self {
        let mut writable = vec![None; usize::from(END)].into_boxed_slice();
        let mut add = |from: u16, to: u16, bits| {
            if let Some(registers) = writable.get_mut(usize::from(from)..usize::from(to)) {
                registers.fill(Some(bits));
            }
        };
        let clock = if distributed_clocks { CLOCK } else { &[] };
        for Range(from, to, bits) in COMMON.iter().chain(clock) {
            add(*from, *to, *bits);
        }
        for unit in 0..u16::from(UNITS) {
            let fmmu = FMMU + unit * FMMU_LEN;
            add(fmmu, fmmu + FMMU_LEN, READ);
            add(fmmu, fmmu + 6, WRITE);
            // Bits of the start and the end, and of the memory.
            add(fmmu + 6, fmmu + 8, 0x07);
            add(fmmu + 8, fmmu + 10, WRITE);
            add(fmmu + 10, fmmu + 11, 0x07);
            add(fmmu + 11, fmmu + 12, 0x03);
            add(fmmu + 12, fmmu + 13, 0x01);
            let sync_manager = SYNC_MANAGER + unit * SYNC_MANAGER_LEN;
            add(sync_manager, sync_manager + SYNC_MANAGER_LEN, WRITE);
            // Status, activation, and the PDI's control.
            add(sync_manager + 5, sync_manager + 6, READ);
            add(sync_manager + 6, sync_manager + 7, 0xC3);
            add(sync_manager + 7, sync_manager + 8, READ);
        }
        Self { writable }
    }

    /// Returns the bits that may be written at an address, `None` where there is no register.
    pub(crate) fn writable(&self, address: u16) -> Option<u8> {
        self.writable.get(usize::from(address)).copied().flatten()
    }
}

/// Size of the process data RAM in KiB.
pub(crate) const RAM_SIZE: u16 = 0x0006;

/// Values at power-on that are not zero: address and bytes.
pub(crate) const POWER_ON: &[(u16, &[u8])] = &[
    // Type ET1100, revision 0, build 2; FMMUs, sync managers.
    (0x0000, &[0x11, 0x00, 0x02, 0x00, UNITS, UNITS]),
    // Non-EtherCAT frames are destroyed; loops close and open by themselves.
    (DL_CONTROL, &[0x01, 0x00, 0x07, 0x00]),
    // AL event mask: everything but reserved bits.
    (0x0204, &[0x0F, 0xFF, 0xFF, 0x00]),
    // 100 us a tick, 100 ms for PDI and process data.
    (WATCHDOG_DIVIDER, &0x09C2_u16.to_le_bytes()),
    (0x0410, &1000_u16.to_le_bytes()),
    (WATCHDOG_TIME, &1000_u16.to_le_bytes()),
    (SPEED_COUNTER_START, &0x1000_u16.to_le_bytes()),
    (0x0934, &[4, 12]),
];

/// Returns the features at 0x0008, those of an ET1100: FMMUs map bits; low jitter of E-bus (bit 4), enhanced link detection of
/// E-bus and MII (5, 6), counters of FCS errors by port (7). With a clock (2), one of 64 bits (3). The ET1100 lacks the enhanced
/// activation of SYNC signals (8), and no command is missing (9, 10).
pub(crate) const fn features(distributed_clocks: bool) -> u16 {
    0x00F0 | if distributed_clocks { 0x0004 | 0x0008 } else { 0 }
}
