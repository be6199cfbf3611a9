//! Parameters of the synchronisation of outputs and inputs, objects 0x1C32 and 0x1C33 (ETG.1020, synchronisation), of a device
//! with mailbox and clock.

use super::Dictionary;
use crate::description::{Access, DataType, Entry, Object, ObjectCode};
use crate::layout::Usage;

/// Outputs and inputs, by their sync managers 2 and 3.
const OUTPUTS: u16 = 0x1C32;
const INPUTS: u16 = 0x1C33;

/// Subindices.
const TYPE: u8 = 1;
const CYCLE: u8 = 2;
const SYNC0_CYCLE: u8 = 10;

/// Synchronisation types: without, with the sync manager of these data, with SYNC0, with the sync manager of the outputs.
const FREE_RUN: u16 = 0x00;
const OWN_SYNC_MANAGER: u16 = 0x01;
const SYNC0: u16 = 0x02;
const OUTPUT_SYNC_MANAGER: u16 = 0x22;

/// Supported types: free run, sync manager, SYNC0.
const SUPPORTED: u16 = 0b0111;

const fn entry(
    subindex: u8,
    name: &'static str,
    data_type: DataType,
    access: Access,
    default: &'static [u8],
) -> Entry {
    Entry { subindex, name, data_type, access, capacity: default.len(), default }
}

const TYPES: &[i64] = &[FREE_RUN as i64, OWN_SYNC_MANAGER as i64, SYNC0 as i64];
const INPUT_TYPES: &[i64] =
    &[FREE_RUN as i64, OWN_SYNC_MANAGER as i64, SYNC0 as i64, OUTPUT_SYNC_MANAGER as i64];

/// Returns the entries of a direction. The device needs no time for its data, and never misses an event.
const fn entries(types: &'static [i64]) -> [Entry; 14] {
    use Access::{ReadOnly, ReadWrite, WriteOneOf};
    use DataType::{Boolean, Unsigned8, Unsigned16, Unsigned32};
    const SHORT: &[u8] = &[0; 2];
    const LONG: &[u8] = &[0; 4];
    const DEFAULT_TYPE: &[u8] = &OWN_SYNC_MANAGER.to_le_bytes();
    const SUPPORTED_TYPES: &[u8] = &SUPPORTED.to_le_bytes();
    [
        entry(0, "Highest subindex", Unsigned8, ReadOnly, &[32]),
        entry(TYPE, "Synchronization type", Unsigned16, WriteOneOf(types), DEFAULT_TYPE),
        entry(CYCLE, "Cycle time", Unsigned32, ReadWrite, LONG),
        entry(3, "Shift time", Unsigned32, ReadOnly, LONG),
        entry(4, "Synchronization types supported", Unsigned16, ReadOnly, SUPPORTED_TYPES),
        entry(5, "Minimum cycle time", Unsigned32, ReadOnly, LONG),
        entry(6, "Calc and copy time", Unsigned32, ReadOnly, LONG),
        entry(8, "Get cycle time", Unsigned16, ReadWrite, SHORT),
        entry(9, "Delay time", Unsigned32, ReadOnly, LONG),
        entry(SYNC0_CYCLE, "Sync0 cycle time", Unsigned32, ReadWrite, LONG),
        entry(11, "SM event missed", Unsigned16, ReadOnly, SHORT),
        entry(12, "Cycle time too small", Unsigned16, ReadOnly, SHORT),
        entry(13, "Shift time too short", Unsigned16, ReadOnly, SHORT),
        entry(32, "Sync error", Boolean, ReadOnly, &[0]),
    ]
}

static OUTPUT_ENTRIES: [Entry; 14] = entries(TYPES);
static INPUT_ENTRIES: [Entry; 14] = entries(INPUT_TYPES);

impl Dictionary {
    /// Adds the parameters of the directions that the device has, unless its description has objects of its own for them.
    pub(super) fn add_synchronisation(&mut self) {
        let description = self.description();
        if !description.has_clocks() || description.mailbox.is_none() {
            return;
        }
        let directions = [
            (OUTPUTS, "SM output parameter", Usage::Outputs, &OUTPUT_ENTRIES),
            (INPUTS, "SM input parameter", Usage::Inputs, &INPUT_ENTRIES),
        ];
        for (index, name, usage, entries) in directions {
            let is_known = description.objects.iter().any(|object| object.index == index);
            if description.room(usage) > 0 && !is_known {
                self.add_described(&Object { index, name, code: ObjectCode::Record, entries });
            }
        }
    }

    /// Shows how process data are synchronised from SAFE-OP on: with SYNC0 of this period in nanoseconds, or without it. What
    /// else the MainDevice has chosen stays.
    pub(crate) fn set_synchronisation(&mut self, sync0_ns: Option<u64>) {
        for index in [OUTPUTS, INPUTS] {
            let chosen = self.get(index, TYPE).and_then(|value| value.first_chunk()).copied();
            let shown = match (sync0_ns, chosen.map(u16::from_le_bytes)) {
                (Some(_), _) => SYNC0,
                (None, Some(SYNC0)) => OWN_SYNC_MANAGER,
                (None, Some(other)) => other,
                (None, None) => continue,
            };
            // The objects may be those of the description, and of other lengths.
            let _ = self.store_value(index, TYPE, &shown.to_le_bytes());
            if let Some(period_ns) = sync0_ns {
                let period = u32::try_from(period_ns).unwrap_or(u32::MAX).to_le_bytes();
                let _ = self.store_value(index, CYCLE, &period);
                let _ = self.store_value(index, SYNC0_CYCLE, &period);
            }
        }
    }
}
