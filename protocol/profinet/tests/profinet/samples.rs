//! The stations of the tests.

use profinet::alarm::{AlarmHead, Notification, Priority};
use profinet::block::BlockWriter;
use profinet::description::{Description, INTERFACE_SUBSLOT, Identity, Module, PORT_SUBSLOT, Submodule};

/// Bytes of data each way.
pub(crate) const LEN: usize = 256;

/// A device access point in slot 0, and a module with data both ways in slot 1.
pub(crate) const DEVICE: Description = Description {
    identity: Identity { vendor: 0xFFFF, device: 0x0001 },
    station_type: "sample device",
    order_id: "sample-device",
    serial_number: "1",
    hardware_revision: 1,
    software_revision: [0, 1, 0],
    min_device_interval: 32,
    modules: &[
        Module {
            slot: 0,
            ident: 1,
            submodules: &[
                submodule(1, 1, 0),
                submodule(INTERFACE_SUBSLOT, 0x8000, 0),
                submodule(PORT_SUBSLOT, 0x8001, 0),
            ],
        },
        Module { slot: 1, ident: 0x100, submodules: &[submodule(1, 0x101, LEN as u16)] },
    ],
};

/// A station without modules.
pub(crate) const CONTROLLER: Description = Description {
    identity: Identity { vendor: 0xFFFF, device: 0x0002 },
    station_type: "sample controller",
    order_id: "sample-controller",
    modules: &[],
    ..DEVICE
};

/// The sample device of p-net as it was configured when the captured frames were recorded: slots 1 to 4 have input,
/// output, both, and both data.
pub(crate) const P_NET: Description = Description {
    identity: Identity { vendor: 0x0493, device: 0x0002 },
    station_type: "P-Net Sample Application",
    order_id: "12345 Abcdefghijk",
    serial_number: "007",
    hardware_revision: 3,
    software_revision: [0, 2, 0],
    min_device_interval: 32,
    modules: &[
        Module {
            slot: 0,
            ident: 1,
            submodules: &[submodule(1, 1, 0), submodule(0x8000, 0x8000, 0), submodule(0x8001, 0x8001, 0)],
        },
        Module { slot: 1, ident: 0x30, submodules: &[Submodule { input_len: 1, ..submodule(1, 0x130, 0) }] },
        Module { slot: 2, ident: 0x31, submodules: &[Submodule { output_len: 1, ..submodule(1, 0x131, 0) }] },
        Module {
            slot: 3,
            ident: 0x32,
            submodules: &[Submodule { parameters: &[123, 124], ..submodule(1, 0x132, 1) }],
        },
        Module {
            slot: 4,
            ident: 0x40,
            submodules: &[Submodule { parameters: &[125], ..submodule(1, 0x140, 8) }],
        },
    ],
};

/// A diagnosis of the sample device's submodule with data.
pub(crate) const DIAGNOSIS: Notification<'_> = Notification {
    priority: Priority::Low,
    head: AlarmHead { alarm_type: 1, api: 0, slot: 1, subslot: 1 },
    module_ident: 0x100,
    submodule_ident: 0x101,
    specifier: 0,
    items: &[],
};

/// Returns the blocks that `emit` writes.
pub(crate) fn emitted(emit: impl FnOnce(&mut BlockWriter<'_>)) -> Vec<u8> {
    let mut buf = vec![0; 60_000];
    let mut writer = BlockWriter::new(&mut buf);
    emit(&mut writer);
    let len = writer.finish();
    assert!(len.is_ok(), "the blocks are longer than the buffer");
    buf.truncate(len.unwrap_or_default());
    buf
}

const fn submodule(subslot: u16, ident: u32, len: u16) -> Submodule {
    Submodule { subslot, ident, input_len: len, output_len: len, parameters: &[] }
}
