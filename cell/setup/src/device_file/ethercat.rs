//! From the SubDevice of an ESI to `[bus.ethercat.device]`.

use device_files::{ChosenSubDevice, excerpt};

use super::{FileName, differs, hex, plain};
use crate::problem::Check;
use crate::{Ethercat, EthercatDevice};

const KEY: &str = "bus.ethercat.device";

/// Fills in the device, or compares it with that of the setup.
pub(super) fn fill(ethercat: &mut Ethercat, chosen: &ChosenSubDevice, file: &FileName) -> Check {
    let of_file = described(chosen);
    if let Some(own) = &ethercat.device {
        let kind = excerpt(&chosen.kind);
        let key = |key: &str| format!("{KEY}.{key}");
        differs(key("vendor"), (own.vendor, of_file.vendor), hex, "Vendor Id", file)?;
        let element = format!("Type `{kind}` ProductCode");
        differs(key("product"), (own.product, of_file.product), hex, &element, file)?;
        if let Some(revision) = own.revision {
            let element = format!("Type `{kind}` RevisionNo");
            differs(key("revision"), (revision, chosen.revision), hex, &element, file)?;
        }
        let sizes = (own.output_bytes, of_file.output_bytes);
        differs(key("output_bytes"), sizes, plain, &format!("the RxPdos of `{kind}`"), file)?;
        let sizes = (own.input_bytes, of_file.input_bytes);
        differs(key("input_bytes"), sizes, plain, &format!("the TxPdos of `{kind}`"), file)?;
    }
    ethercat.device = Some(of_file);
    Ok(())
}

/// Returns the keys that describe a device.
pub(super) fn described(chosen: &ChosenSubDevice) -> EthercatDevice {
    // The check refuses more than fits into a frame.
    let bytes = |bytes: u32| u16::try_from(bytes).unwrap_or(u16::MAX);
    let (outputs, inputs) = chosen.lengths();
    EthercatDevice {
        vendor: chosen.vendor_id,
        product: chosen.product_code,
        revision: Some(chosen.revision),
        output_bytes: bytes(outputs),
        input_bytes: bytes(inputs),
    }
}
