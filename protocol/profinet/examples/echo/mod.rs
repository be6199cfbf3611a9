//! The device of the examples: it sends its eight bytes of outputs back as its inputs.

use profinet::description::{Description, INTERFACE_SUBSLOT, Identity, Module, PORT_SUBSLOT, Submodule};

/// Where its data is: slot and subslot.
pub(crate) const PLACE: (u16, u16) = (1, 1);

/// Bytes of data each way.
pub(crate) const LEN: u16 = 8;

/// A device access point in slot 0, and a module with eight bytes each way in slot 1.
pub(crate) const DEVICE: Description = Description {
    // A product needs a VendorID from PI; 0xFFFF belongs to nobody.
    identity: Identity { vendor: 0xFFFF, device: 0x00EC },
    station_type: "echo",
    order_id: "echo-8",
    serial_number: "1",
    hardware_revision: 1,
    software_revision: [0, 1, 0],
    min_device_interval: 32,
    modules: &[
        Module {
            slot: 0,
            ident: 1,
            submodules: &[
                Submodule { subslot: 1, ident: 1, input_len: 0, output_len: 0, parameters: &[] },
                Submodule {
                    subslot: INTERFACE_SUBSLOT,
                    ident: 2,
                    input_len: 0,
                    output_len: 0,
                    parameters: &[],
                },
                Submodule { subslot: PORT_SUBSLOT, ident: 3, input_len: 0, output_len: 0, parameters: &[] },
            ],
        },
        Module {
            slot: PLACE.0,
            ident: 8,
            submodules: &[Submodule {
                subslot: PLACE.1,
                ident: 8,
                input_len: LEN,
                output_len: LEN,
                parameters: &[],
            }],
        },
    ],
};
