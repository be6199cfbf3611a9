//! From the adapter of an EDS to `[bus.ethernet_ip.adapter]`.

use device_files::{ChosenAdapter, Eds, EdsConnection, RealTimeFormat, excerpt};

use super::{FileName, differs, hex, plain};
use crate::problem::{Check, problem};
use crate::{EthernetIp, EthernetIpAdapter, EthernetIpFormat, EthernetIpKey};

const KEY: &str = "bus.ethernet_ip.adapter";

/// Fills in the adapter, or compares it with that of the setup. The route to it is the setup's.
pub(super) fn fill(
    ethernet_ip: &mut EthernetIp,
    eds: &Eds,
    chosen: &ChosenAdapter,
    file: &FileName,
) -> Check {
    let Some(connection) = eds.connections.iter().find(|it| it.number == chosen.connection) else {
        return Ok(());
    };
    let name = excerpt(&connection.name);
    let types = &connection.t_to_o.types;
    if [&connection.o_to_t, &connection.t_to_o].iter().any(|end| end.types == ["null"]) {
        let text = format!("{}: connection `{name}` is of type null, without data; choose another", file.0);
        return Err(problem("bus.device", text));
    }
    if ethernet_ip.multicast && !types.is_empty() && !types.contains(&"multicast") {
        let text = format!("connection `{name}` in {} has no multicast T->O; leave it out", file.0);
        return Err(problem("bus.ethernet_ip.multicast", text));
    }
    let data = driven_device::configuration_data(eds, chosen);
    let data = data.map_err(|error| problem("bus.device", format!("{}: {error}", file.0)))?;
    let mut of_file = adapter(connection, chosen, data);
    if let Some(own) = &ethernet_ip.adapter {
        compare(own, &of_file, &name, file)?;
        of_file.route.clone_from(&own.route);
    }
    ethernet_ip.multicast |= types.contains(&"multicast") && !types.contains(&"point to point");
    ethernet_ip.adapter = Some(of_file);
    Ok(())
}

fn adapter(
    connection: &EdsConnection,
    chosen: &ChosenAdapter,
    configuration_data: Vec<u8>,
) -> EthernetIpAdapter {
    EthernetIpAdapter {
        consumed_assembly: chosen.consumed_point,
        consumed_bytes: chosen.consumed.as_ref().map_or(0, |consumed| consumed.size),
        produced_assembly: chosen.produced.instance,
        produced_bytes: chosen.produced.size,
        consumed_format: format(connection.o_to_t.real_time_format),
        produced_format: format(connection.t_to_o.real_time_format),
        configuration_assembly: chosen.configuration.as_ref().map(|configuration| configuration.instance),
        configuration_data,
        route: Vec::new(),
        key: Some(EthernetIpKey {
            vendor: chosen.vendor_id,
            device_type: chosen.device_type,
            product_code: chosen.product_code,
            major_revision: chosen.revision.0,
            minor_revision: chosen.revision.1,
            compatible: false,
        }),
    }
}

/// Returns whether the keys describe an adapter, as far as it says.
pub(super) fn is_of(own: &EthernetIpAdapter, chosen: &ChosenAdapter) -> bool {
    let has_header = |format| format == EthernetIpFormat::RunIdleHeader;
    let consumed = chosen.consumed.as_ref();
    own.consumed_assembly == chosen.consumed_point
        && own.consumed_bytes == consumed.map_or(0, |consumed| consumed.size)
        && has_header(own.consumed_format) == consumed.is_some_and(|consumed| consumed.has_header)
        && (own.produced_assembly, own.produced_bytes) == (chosen.produced.instance, chosen.produced.size)
        && has_header(own.produced_format) == chosen.produced.has_header
}

const fn format(format: RealTimeFormat) -> EthernetIpFormat {
    match format {
        RealTimeFormat::ZeroLength => EthernetIpFormat::ZeroLength,
        RealTimeFormat::Heartbeat => EthernetIpFormat::Heartbeat,
        RealTimeFormat::Header32Bit => EthernetIpFormat::RunIdleHeader,
        RealTimeFormat::Modeless | RealTimeFormat::Safety | RealTimeFormat::Reserved => {
            EthernetIpFormat::Modeless
        }
    }
}

/// Compares each key. One that the setup leaves out, or 0 in an electronic key, fits any value.
fn compare(own: &EthernetIpAdapter, of_file: &EthernetIpAdapter, connection: &str, file: &FileName) -> Check {
    let key = |key: &str| format!("{KEY}.{key}");
    let element = |name: &str| format!("{name} of connection `{connection}`");
    let points = (own.consumed_assembly, of_file.consumed_assembly);
    differs(key("consumed_assembly"), points, plain, &element("the path"), file)?;
    let points = (own.produced_assembly, of_file.produced_assembly);
    differs(key("produced_assembly"), points, plain, &element("the path"), file)?;
    let sizes = (own.consumed_bytes, of_file.consumed_bytes);
    differs(key("consumed_bytes"), sizes, plain, &element("the O->T size"), file)?;
    let sizes = (own.produced_bytes, of_file.produced_bytes);
    differs(key("produced_bytes"), sizes, plain, &element("the T->O size"), file)?;
    let shown = |format: &EthernetIpFormat| format!("{format:?}");
    let formats = (own.consumed_format, of_file.consumed_format);
    differs(key("consumed_format"), formats, shown, &element("the connection parameters"), file)?;
    let formats = (own.produced_format, of_file.produced_format);
    differs(key("produced_format"), formats, shown, &element("the connection parameters"), file)?;
    if let Some(own) = own.configuration_assembly {
        let shown = |assembly: &Option<u32>| assembly.map_or_else(|| "none".to_owned(), |it| it.to_string());
        let assemblies = (Some(own), of_file.configuration_assembly);
        differs(key("configuration_assembly"), assemblies, shown, &element("the path"), file)?;
    }
    if !own.configuration_data.is_empty() {
        let shown = |data: &&Vec<u8>| format!("{data:?}");
        let data = (&own.configuration_data, &of_file.configuration_data);
        differs(key("configuration_data"), data, shown, &element("the configuration"), file)?;
    }
    let (Some(own), Some(of_file)) = (&own.key, &of_file.key) else { return Ok(()) };
    for (name, own, of_file, element) in [
        ("vendor", own.vendor, of_file.vendor, "VendCode"),
        ("device_type", own.device_type, of_file.device_type, "ProdType"),
        ("product_code", own.product_code, of_file.product_code, "ProdCode"),
        ("major_revision", own.major_revision.into(), of_file.major_revision.into(), "MajRev"),
        ("minor_revision", own.minor_revision.into(), of_file.minor_revision.into(), "MinRev"),
    ] {
        if own != 0 {
            differs(format!("{KEY}.key.{name}"), (own, of_file), hex, element, file)?;
        }
    }
    Ok(())
}
