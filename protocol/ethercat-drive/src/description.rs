//! The emulated drive as a SubDevice.

use ethercat_subdevice::Description;
use ethercat_subdevice::description::{Access, DataType, Entry, Mailbox, Object, ObjectCode, Pdo, PdoEntry};

/// Error register, an object of every device.
pub(crate) const ERROR_REGISTER: u16 = 0x1001;
/// Following error window in increments, object 0x6065.
pub(crate) const WINDOW: u16 = 0x6065;
/// Following error time-out in ms, object 0x6066.
pub(crate) const WINDOW_TIME: u16 = 0x6066;
/// Quick stop option code, object 0x605A.
pub(crate) const QUICK_STOP_OPTION: u16 = 0x605A;
/// Quick stop option codes that the drive has: disable, ramps, and the same ramps with a stay in quick stop active.
const QUICK_STOP_OPTIONS: [i64; 5] = [0, 1, 2, 5, 6];
/// Quick stop deceleration in increments/s², object 0x6085.
pub(crate) const QUICK_STOP_DECELERATION: u16 = 0x6085;

/// Max torque in ‰ of the rated torque, object 0x6072.
pub(crate) const MAX_TORQUE: u16 = 0x6072;

/// Interpolation time period, object 0x60C2: a number, and its power of ten of a second.
pub(crate) const INTERPOLATION_PERIOD: u16 = 0x60C2;
/// Numbers of an interpolation time period: all but 0.
#[expect(clippy::indexing_slicing, reason = "an index out of range would not compile")]
const PERIOD_NUMBERS: [i64; 255] = {
    let mut numbers = [0; 255];
    let mut at = 0;
    while at < numbers.len() {
        numbers[at] = at as i64 + 1;
        at += 1;
    }
    numbers
};
/// Powers of ten of an interpolation time period: from a microsecond to a second.
const PERIOD_POWERS: [i64; 7] = [-6, -5, -4, -3, -2, -1, 0];

/// Objects of process data.
pub(crate) const CONTROL_WORD: u16 = 0x6040;
pub(crate) const STATUS_WORD: u16 = 0x6041;
pub(crate) const ERROR_CODE: u16 = 0x603F;
pub(crate) const MODE: u16 = 0x6060;
pub(crate) const MODE_DISPLAY: u16 = 0x6061;
pub(crate) const POSITION_DEMAND: u16 = 0x6062;
pub(crate) const POSITION: u16 = 0x6064;
pub(crate) const VELOCITY: u16 = 0x606C;
pub(crate) const TORQUE: u16 = 0x6077;
pub(crate) const TARGET_POSITION: u16 = 0x607A;
pub(crate) const FOLLOWING_ERROR: u16 = 0x60F4;

/// Default of the following error window, in increments.
pub(crate) const DEFAULT_WINDOW: u32 = 10_000;
/// Default of the quick stop deceleration, in increments/s².
pub(crate) const DEFAULT_DECELERATION: u32 = 10_000_000;
/// Default of the following error time-out, in ms.
pub(crate) const DEFAULT_WINDOW_TIME: u16 = 10;
/// Default of the max torque, in ‰ of the rated torque.
pub(crate) const DEFAULT_TORQUE: u16 = 1_000;

const fn entry(index: u16, bits: u8, data_type: DataType, name: &'static str) -> PdoEntry {
    PdoEntry { index, subindex: 0, bits, data_type, name }
}

const GAP: PdoEntry = entry(0, 8, DataType::Unsigned8, "");

const fn variable(index: u16, name: &'static str, entries: &'static [Entry]) -> Object {
    Object { index, name, code: ObjectCode::Variable, entries }
}

const fn value(name: &'static str, data_type: DataType, access: Access, default: &'static [u8]) -> Entry {
    Entry { subindex: 0, name, data_type, access, capacity: default.len(), default }
}

/// A servo drive with cyclic synchronous position. Window, times, torque and quick stop can be set by SDO, and process data
/// can be mapped.
pub static DRIVE: Description = Description {
    // An emulated drive has no vendor, and the last number belongs to none.
    vendor_id: 0xFFFF_FFFF,
    product_code: 0x0000_0402,
    revision: 0x0001_0000,
    order_code: "skillbench-drive",
    name: "Emulated servo drive, CiA 402",
    // Profile 402, servo drive.
    group: "skillbench",
    device_type: 0x0002_0192,
    hardware_version: "1",
    software_version: "0.1.0",
    outputs: &[Pdo {
        index: 0x1600,
        name: "Set values",
        entries: &[
            entry(CONTROL_WORD, 16, DataType::Unsigned16, "Control word"),
            entry(TARGET_POSITION, 32, DataType::Integer32, "Target position"),
            entry(MODE, 8, DataType::Integer8, "Modes of operation"),
            GAP,
        ],
    }],
    inputs: &[Pdo {
        index: 0x1A00,
        name: "Actual values",
        entries: &[
            entry(STATUS_WORD, 16, DataType::Unsigned16, "Status word"),
            entry(POSITION, 32, DataType::Integer32, "Position actual value"),
            entry(FOLLOWING_ERROR, 32, DataType::Integer32, "Following error actual value"),
            entry(ERROR_CODE, 16, DataType::Unsigned16, "Error code"),
            entry(MODE_DISPLAY, 8, DataType::Integer8, "Modes of operation display"),
            GAP,
        ],
    }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[
        variable(
            QUICK_STOP_OPTION,
            "Quick stop option code",
            &[value(
                "Quick stop option code",
                DataType::Integer16,
                Access::WriteOneOf(&QUICK_STOP_OPTIONS),
                &2_i16.to_le_bytes(),
            )],
        ),
        variable(
            WINDOW,
            "Following error window",
            &[value(
                "Following error window",
                DataType::Unsigned32,
                Access::ReadWrite,
                &DEFAULT_WINDOW.to_le_bytes(),
            )],
        ),
        variable(
            WINDOW_TIME,
            "Following error time out",
            &[value(
                "Following error time out",
                DataType::Unsigned16,
                Access::ReadWrite,
                &DEFAULT_WINDOW_TIME.to_le_bytes(),
            )],
        ),
        variable(
            MAX_TORQUE,
            "Max torque",
            &[value("Max torque", DataType::Unsigned16, Access::ReadWrite, &DEFAULT_TORQUE.to_le_bytes())],
        ),
        variable(
            QUICK_STOP_DECELERATION,
            "Quick stop deceleration",
            &[value(
                "Quick stop deceleration",
                DataType::Unsigned32,
                Access::ReadWrite,
                &DEFAULT_DECELERATION.to_le_bytes(),
            )],
        ),
        Object {
            index: INTERPOLATION_PERIOD,
            name: "Interpolation time period",
            code: ObjectCode::Record,
            entries: &[
                Entry {
                    subindex: 0,
                    ..value("Highest subindex", DataType::Unsigned8, Access::ReadOnly, &[2])
                },
                Entry {
                    subindex: 1,
                    ..value(
                        "Interpolation time period value",
                        DataType::Unsigned8,
                        Access::WriteOneOf(&PERIOD_NUMBERS),
                        &[1],
                    )
                },
                Entry {
                    subindex: 2,
                    ..value(
                        "Interpolation time index",
                        DataType::Integer8,
                        Access::WriteOneOf(&PERIOD_POWERS),
                        &(-3_i8).to_le_bytes(),
                    )
                },
            ],
        },
        variable(
            0x6502,
            "Supported drive modes",
            // Bit 7: cyclic synchronous position.
            &[value(
                "Supported drive modes",
                DataType::Unsigned32,
                Access::ReadOnly,
                &0x80_u32.to_le_bytes(),
            )],
        ),
    ],
    // What masters map besides, also where they use cyclic synchronous position alone. Set values of other modes, and feed
    // forward, which a motor without load does not need, have no effect.
    optional_outputs: &[
        entry(0x60FF, 32, DataType::Integer32, "Target velocity"),
        entry(0x6071, 16, DataType::Integer16, "Target torque"),
        entry(0x60B1, 32, DataType::Integer32, "Velocity offset"),
        entry(0x60B2, 16, DataType::Integer16, "Torque offset"),
    ],
    optional_inputs: &[
        entry(POSITION_DEMAND, 32, DataType::Integer32, "Position demand value"),
        entry(VELOCITY, 32, DataType::Integer32, "Velocity actual value"),
        entry(TORQUE, 16, DataType::Integer16, "Torque actual value"),
    ],
    clock_modes: &[],
    numbers_names: true,
};
