//! The file as a whole: identity, access points, texts.

use super::modules::{GsdmlModule, GsdmlSubmodule};
use super::names::{GsdmlNames, PlacementKind};
use super::slots::{Placement, SlotRanges};
use super::{AccessPoint, CyclicTiming, Gsdml, diagnosis, records};
use crate::fault::{FileFault, excerpt};
use crate::xml::Element;

/// Newest version of the schema that this reader knows.
const NEWEST: &str = "2.46";
/// Oldest version: before it, files had another structure.
const OLDEST: &str = "2.0";

/// Reads a GSDML file.
pub(crate) fn read(file: &str, root: Element<'_>) -> Result<Gsdml, FileFault> {
    let identification = root.at(&["ProfileHeader", "ProfileIdentification"]).map_or("", Element::text);
    if !identification.contains("PROFINET") {
        let fault = format!("profile `{}`: must be a PROFINET Device Profile", excerpt(identification));
        return Err(root.finding(fault));
    }
    let needed = |path: &[&str]| {
        let fault = || root.finding(format!("element {} is missing; add it", path.join("/")));
        root.at(path).ok_or_else(fault)
    };
    let process = needed(&["ProfileBody", "ApplicationProcess"])?;
    let identity = needed(&["ProfileBody", "DeviceIdentity"])?;
    let mut context = GsdmlNames::new(process)?;
    let schema_version = schema_version(file, root, &mut context)?;
    let access_points = needed(&["ProfileBody", "ApplicationProcess", "DeviceAccessPointList"])?
        .list("DeviceAccessPointItem", |item| AccessPoint::read(&mut context, item, &schema_version))?;
    if access_points.is_empty() {
        return Err(process.finding("the file has no access point; add a DeviceAccessPointItem"));
    }
    let list = |name: &str| process.child(name);
    let modules = list("ModuleList").map_or(Ok(Vec::new()), |within| {
        within.list("ModuleItem", |item| GsdmlModule::read(&mut context, item))
    })?;
    let mut submodules = Vec::new();
    if let Some(within) = list("SubmoduleList") {
        for name in ["SubmoduleItem", "PortSubmoduleItem"] {
            submodules.extend(within.list(name, |item| GsdmlSubmodule::read(&mut context, item))?);
        }
    }
    let family = root.at(&["ProfileBody", "DeviceFunction", "Family"]);
    let of_family = |name: &str| root.keep(family.and_then(|it| it.attribute(name)).unwrap_or_default());
    let vendor = identity.child("VendorName").and_then(|name| name.attribute("Value")).unwrap_or_default();
    Ok(Gsdml {
        vendor_id: identity.required_number("VendorID")?,
        device_id: identity.required_number("DeviceID")?,
        vendor: identity.keep(vendor)?,
        info: identity.child("InfoText").map_or(Ok(String::new()), |info| context.text_of(info))?,
        main_family: of_family("MainFamily")?,
        product_family: of_family("ProductFamily")?,
        access_points,
        modules,
        submodules,
        values: records::value_texts(&mut context, process)?,
        channel_diagnosis: diagnosis::channels(&mut context, process)?,
        unit_diagnosis: diagnosis::units(&mut context, process)?,
        schema_version,
        warnings: context.into_warnings(),
    })
}

/// Returns the version of the file's schema, from the location of the schema or the file's name.
fn schema_version(file: &str, root: Element<'_>, context: &mut GsdmlNames<'_>) -> Result<String, FileFault> {
    let location = root.attribute("schemaLocation").unwrap_or_default();
    let after = |text: &str, mark: &str| {
        let rest = text.split_once(mark)?.1;
        let version: String = rest.chars().take_while(|it| it.is_ascii_digit() || *it == '.').collect();
        Some(version.trim_end_matches('.').to_owned()).filter(|version| !version.is_empty())
    };
    let found = after(location, "DeviceProfile-V").or_else(|| after(file, "GSDML-V"));
    let Some(version) = found else {
        context.warn(root.finding(format!("the file does not give its version; read as {NEWEST}")));
        return Ok(NEWEST.to_owned());
    };
    if is_after(root, OLDEST, &version)? {
        return Err(
            root.finding(format!("version {version}: must be {OLDEST} or newer; ask the maker for one"))
        );
    }
    Ok(version)
}

/// Returns whether a version comes after another, as decimals: 2.35 comes before 2.4.
fn is_after(element: Element<'_>, version: &str, other: &str) -> Result<bool, FileFault> {
    let order = |version: &str| {
        let fault = || element.finding(format!("version `{}`: must be such as V2.35", excerpt(version)));
        version.parse::<f64>().map_err(|_| fault())
    };
    Ok(order(version)? > order(other)?)
}

impl AccessPoint {
    fn read(
        context: &mut GsdmlNames<'_>,
        item: Element<'_>,
        schema_version: &str,
    ) -> Result<Self, FileFault> {
        let required =
            item.attribute("RequiredSchemaVersion").map(|version| version.trim_start_matches(['V', 'v']));
        // The version that the access point requires decides, not that of the file.
        if let Some(version) = required
            && is_after(item, version, NEWEST)?
        {
            let fault = format!("version {version} is newer than {NEWEST}; what is new in it is ignored");
            context.warn(item.finding(fault));
        }
        let limits = item.child("IOConfigData");
        let limit = |name: &str| limits.map_or(Ok(None), |limits| limits.number(name));
        let class = item.child("CertificationInfo").and_then(|info| info.attribute("ConformanceClass"));
        let interface = item.at(&["SystemDefinedSubmoduleList", "InterfaceSubmoduleItem"]);
        // Before version 2.1 the relations stood in the access point itself.
        let relations =
            interface.and_then(|it| it.child("ApplicationRelations")).or(item.child("ApplicationRelations"));
        let modes = relations.and_then(|it| it.attribute("StartupMode")).unwrap_or("Legacy");
        item.charge(2 * modes.len())?;
        Ok(Self {
            module: GsdmlModule::read(context, item)?,
            required_schema_version: item.keep(required.unwrap_or(schema_version))?,
            physical_slots: SlotRanges::of(item, "PhysicalSlots")?,
            fixed_in_slots: match SlotRanges::of(item, "FixedInSlots")? {
                SlotRanges(ranges) if ranges.is_empty() => SlotRanges(vec![(0, 0)]),
                ranges => ranges,
            },
            dns_compatible_name: item.keep(item.attribute("DNS_CompatibleName").unwrap_or_default())?,
            min_device_interval: item.required_number("MinDeviceInterval")?,
            object_uuid_index: item.number("ObjectUUID_LocalIndex")?.unwrap_or(1),
            has_multiple_write: item.is("MultipleWriteSupported")?,
            conformance_class: item.keep_some(class)?,
            max_input_length: limit("MaxInputLength")?,
            max_output_length: limit("MaxOutputLength")?,
            max_data_length: limit("MaxDataLength")?,
            modules: Placement::list(context, item.child("UseableModules"), PlacementKind::Module)?,
            timing: timing(relations)?,
            startup_modes: modes
                .split([';', ' '])
                .filter(|mode| !mode.is_empty())
                .map(str::to_owned)
                .collect(),
        })
    }
}

fn timing(relations: Option<Element<'_>>) -> Result<Vec<CyclicTiming>, FileFault> {
    let mut timing = Vec::new();
    for (name, rt_class) in [("TimingProperties", 1), ("RT_Class3TimingProperties", 3)] {
        let Some(element) = relations.and_then(|relations| relations.child(name)) else { continue };
        let or = |attribute: &str, usual: &str| match element.attribute(attribute) {
            Some(_) => SlotRanges::of(element, attribute),
            None => Ok(SlotRanges::parse(usual).unwrap_or_default()),
        };
        timing.push(CyclicTiming {
            rt_class,
            // The defaults of the schema.
            send_clocks: or("SendClock", "32")?,
            reduction_ratios: or("ReductionRatio", "1 2 4 8 16 32 64 128 256 512")?,
        });
    }
    Ok(timing)
}
