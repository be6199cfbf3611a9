//! The file as a whole: identity, networks, ports, capacity.

use super::syntax::{Sheet, SheetSection};
use super::{CapacityLimit, Eds, EdsPort, assemblies, connections, parameters};
use crate::fault::{FileFault, excerpt};

/// Sections that the reader uses.
const USED: [&str; 8] = [
    "File",
    "Device",
    "Device Classification",
    "Params",
    "Assembly",
    "Connection Manager",
    "Capacity",
    "Port",
];

/// Most sections that are named as not used.
const MOST_OTHER_SECTIONS: usize = 100;

/// Returns whether a text is an EDS of CANopen, which has the same suffix and another form (CiA 306).
pub(crate) fn is_canopen(text: &str) -> bool {
    let sections = text.lines().filter_map(|line| line.trim().strip_prefix('[')?.split(']').next());
    let mut found = [false; 2];
    for section in sections {
        match section.to_ascii_lowercase().as_str() {
            "file" | "device" => return false,
            "fileinfo" | "deviceinfo" => found[0] = true,
            "mandatoryobjects" | "dummyusage" | "1000" => found[1] = true,
            _ => {}
        }
    }
    found.iter().any(|found| *found)
}

/// Reads an EDS.
pub(crate) fn read(text: &str) -> Result<Eds, FileFault> {
    let sheet = Sheet::parse(text)?;
    let mut warnings = Vec::new();
    let Some(device) = sheet.section("Device") else {
        return Err(FileFault::of_file("section [Device] is missing; expected a GSDML, EDS or ESI file"));
    };
    let classes = classes(&sheet, &mut warnings)?;
    let parameters = match sheet.section("Params") {
        Some(section) => parameters::read(&sheet, section)?,
        None => Vec::new(),
    };
    let assemblies = match sheet.section("Assembly") {
        Some(section) => assemblies::read(&sheet, section, &parameters)?,
        None => Vec::new(),
    };
    let connections = match sheet.section("Connection Manager") {
        Some(section) => connections::read(&sheet, section, &parameters, &assemblies)?,
        None => {
            let fault = "section [Connection Manager] is missing; the file offers no connection with data";
            warnings.push(FileFault::of_file(fault));
            Vec::new()
        }
    };
    let file = sheet.section("File");
    let of_file = |key: &str| text_of(&sheet, file, key).map(Option::unwrap_or_default);
    let of_device = |key: &str| text_of(&sheet, Some(device), key).map(Option::unwrap_or_default);
    let other = sheet.sections.iter().map(|section| section.name);
    let other = other.filter(|name| !USED.iter().any(|used| used.eq_ignore_ascii_case(name)));
    Ok(Eds {
        description: of_file("DescText")?,
        file_revision: of_file("Revision")?,
        vendor_id: needed(device, "VendCode")?,
        vendor: of_device("VendName")?,
        device_type: needed(device, "ProdType")?,
        device_type_name: of_device("ProdTypeStr")?,
        product_code: needed(device, "ProdCode")?,
        major_revision: needed(device, "MajRev")?,
        minor_revision: needed(device, "MinRev")?,
        product_name: of_device("ProdName")?,
        catalog: text_of(&sheet, Some(device), "Catalog")?,
        classes,
        parameters,
        assemblies,
        connections,
        ports: ports(&sheet)?,
        capacity: capacity(&sheet)?,
        other_sections: other.take(MOST_OTHER_SECTIONS).map(str::to_owned).collect(),
        warnings,
    })
}

fn text_of(
    sheet: &Sheet<'_>,
    section: Option<&SheetSection<'_>>,
    key: &str,
) -> Result<Option<String>, FileFault> {
    let entry = section.and_then(|section| section.entry(key));
    entry.map(|entry| sheet.keep(entry.field(0))).transpose()
}

fn needed<N: TryFrom<i64>>(device: &SheetSection<'_>, key: &str) -> Result<N, FileFault> {
    let missing = || device.finding(format!("{key} is missing; add it"));
    let entry = device.entry(key).ok_or_else(missing)?;
    entry.number(0)?.ok_or_else(missing)
}

/// Returns the networks of the file, and refuses one that is not for EtherNet/IP.
fn classes(sheet: &Sheet<'_>, warnings: &mut Vec<FileFault>) -> Result<Vec<String>, FileFault> {
    let Some(section) = sheet.section("Device Classification") else {
        if let Some(other) = sheet.section("IO_Info").or_else(|| sheet.section("DeviceNet Class")) {
            return Err(other.finding("an EDS of DeviceNet; expected one of EtherNet/IP"));
        }
        warnings.push(FileFault::of_file("section [Device Classification] is missing; read as EtherNet/IP"));
        return Ok(Vec::new());
    };
    let mut classes = Vec::new();
    for (_, entry) in section.numbered("Class") {
        for field in 0..entry.count() {
            classes.push(sheet.keep(entry.field(field))?);
        }
    }
    if !classes.iter().any(|class| class.eq_ignore_ascii_case("EtherNetIP")) {
        let found = excerpt(&classes.join(", "));
        return Err(
            section.finding(format!("`{found}`: must be EtherNetIP; this device has another network"))
        );
    }
    Ok(classes)
}

fn ports(sheet: &Sheet<'_>) -> Result<Vec<EdsPort>, FileFault> {
    let mut ports = Vec::new();
    for (number, entry) in sheet.section("Port").into_iter().flat_map(|section| section.numbered("Port")) {
        sheet.charge(size_of::<EdsPort>())?;
        ports.push(EdsPort {
            entry: number,
            kind: sheet.keep(entry.field(0))?,
            name: sheet.keep(entry.field(1))?,
            path: sheet.keep(entry.field(2))?,
            number: entry.number(3)?,
        });
    }
    Ok(ports)
}

fn capacity(sheet: &Sheet<'_>) -> Result<Vec<CapacityLimit>, FileFault> {
    let mut limits = Vec::new();
    for entry in sheet.section("Capacity").into_iter().flat_map(|section| &section.entries) {
        sheet.charge(size_of::<CapacityLimit>())?;
        let fields =
            (0..entry.count()).map(|field| sheet.keep(entry.field(field))).collect::<Result<_, _>>()?;
        limits.push(CapacityLimit { key: sheet.keep(entry.key)?, fields });
    }
    Ok(limits)
}
