//! Checks of a cell: each station by itself as a setup, then the stations beside each other.

use std::net::Ipv4Addr;

use super::{Check, FARTHEST_MM, MAX_NAME, Problem, problem};
use crate::cell::{CELL_SCHEMA, ETHERCAT};
use crate::{BusKind, Cell, Figure, Profinet, SlotForm, Station};

/// Longest name of a station in characters: it is part of the names of files and of options.
const MAX_STATION_NAME: usize = 32;

/// Most stations of a cell.
const MAX_STATIONS: usize = 64;

/// Two roots nearer than this, in mm, are the same place: no two arms can be bolted there.
const SAME_ROOT_MM: f64 = 1.0;

pub(crate) fn check_cell(cell: &Cell) -> Check {
    if cell.is_one() {
        return cell.setups().try_for_each(|setup| super::check_setup(&setup));
    }
    super::head(&cell.name, &cell.title, cell.paper.as_ref())?;
    let longest = MAX_NAME - MAX_STATION_NAME - 1;
    let length = cell.name.chars().count();
    if length > longest {
        let text =
            format!("{length} characters; the names of stations follow it, so give it up to {longest}");
        return Err(problem("name", text));
    }
    number_of_stations(cell.stations.len())?;
    super::shared_zone::check(cell)?;
    cell.stations.iter().enumerate().try_for_each(|(index, station)| station_name(index, &station.name))?;
    for (index, station) in cell.stations.iter().enumerate() {
        let earlier = cell.stations.iter().take(index);
        if let Some(number) = earlier.clone().position(|other| other.name == station.name) {
            let text = format!("stations {} and {} are both `{}`", number + 1, index + 1, station.name);
            return Err(problem(format!("station[{index}].name"), text));
        }
        alone(cell, station)?;
        earlier.into_iter().try_for_each(|other| beside(other, station))?;
    }
    positions(cell)
}

fn number_of_stations(found: usize) -> Check {
    match found {
        0 => {
            let text =
                format!("schema = {CELL_SCHEMA} needs a section [[station]] for each robot; found none");
            Err(problem("station", text))
        }
        1..=MAX_STATIONS => Ok(()),
        _ => Err(problem("station", format!("{found} stations; a cell has up to {MAX_STATIONS}"))),
    }
}

/// Checks a name that is part of options such as `--attach plc=HOST:PORT,left=HOST:PORT`.
fn station_name(index: usize, name: &str) -> Check {
    let key = || format!("station[{index}].name");
    let is_allowed = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if name.is_empty() || name.starts_with('-') || !name.bytes().all(is_allowed) {
        let text = format!("`{}`: write a to z, 0 to 9 and hyphens, such as `left`", name.escape_debug());
        return Err(problem(key(), text));
    }
    if name.len() > MAX_STATION_NAME {
        let text = format!("{} characters; a station's name has up to {MAX_STATION_NAME}", name.len());
        return Err(problem(key(), text));
    }
    if name == "plc" {
        return Err(problem(key(), "`plc` names the PLC in commands and files: choose another name"));
    }
    Ok(())
}

/// Checks what is in one station.
fn alone(cell: &Cell, station: &Station) -> Check {
    let key = |key: &str| format!("station.{}.{key}", station.name);
    if cell.plc.sends_in_form() == SlotForm::Compact && !station.robot.takes_compact_points() {
        let text = "plc.form = \"compact\" needs robots that take compact points; set it to true, or leave plc.form out";
        return Err(problem(key("robot.compact_points"), text));
    }
    super::parts(&cell.setup_of(station)).map_err(|Problem { key: of_setup, text }| {
        let is_shared = of_setup.starts_with("plc.");
        Problem { key: if is_shared { of_setup } else { key(&of_setup) }, text }
    })?;
    let root = &station.root_mm_deg.value;
    if let Some(wrong) = root.iter().find(|value| !value.is_finite() || value.abs() > FARTHEST_MM) {
        let text = format!("{} is not within ±{FARTHEST_MM} mm", Figure(*wrong));
        return Err(problem(key("root_mm_deg"), text));
    }
    if let Some(position) = station.position
        && station.bus.kind.name() != ETHERCAT
    {
        let kind = station.bus.kind.name();
        let text =
            format!("{position}: only stations on EtherCAT have a position; `{}` is on {kind}", station.name);
        return Err(problem(key("position"), text));
    }
    Ok(())
}

/// Checks a station and one of those before it.
fn beside(other: &Station, station: &Station) -> Check {
    let key = |key: &str| format!("station.{}.{key}", station.name);
    let [x, y, z, ..] = station.root_mm_deg.value;
    let [other_x, other_y, other_z, ..] = other.root_mm_deg.value;
    if [x - other_x, y - other_y, z - other_z].iter().all(|apart| apart.abs() < SAME_ROOT_MM) {
        let text =
            format!("the arms of `{}` and `{}` stand at one place; move one", other.name, station.name);
        return Err(problem(key("root_mm_deg"), text));
    }
    peers(other, station)?;
    addresses(other, station)?;
    if other.bus.kind.name() == station.bus.kind.name() { one_bus(other, station) } else { Ok(()) }
}

/// Refuses two robots that could not be told apart by what the PLC is to check of them.
fn peers(other: &Station, station: &Station) -> Check {
    let (Some(one), Some(peer)) = (&other.bus.robot, &station.bus.robot) else { return Ok(()) };
    let same = |what, found: String| {
        let text = format!("{found} is the {what} of station `{}` too", other.name);
        Err(problem(format!("station.{}.bus.robot", station.name), text))
    };
    match (peer.mac.filter(|_| peer.mac == one.mac), peer.serial_number) {
        (Some(mac), _) => same("MAC address", mac.to_string()),
        (None, Some(number)) if one.serial_number == Some(number) => {
            same("serial number", number.to_string())
        }
        _ => Ok(()),
    }
}

/// Checks that each address belongs to one node, and that two subnets which overlap are one.
fn addresses(other: &Station, station: &Station) -> Check {
    let (Some(one), Some(two)) = (other.bus.addresses(), station.bus.addresses()) else { return Ok(()) };
    let key = |key: &str| format!("station.{}.bus.{key}", station.name);
    let name = &other.name;
    if one.robot == two.robot {
        return Err(problem(
            key("robot_address"),
            format!("{} is the address of station `{name}` too", two.robot),
        ));
    }
    if two.robot == one.plc {
        return Err(problem(
            key("robot_address"),
            format!("{} is the PLC's address beside `{name}`", two.robot),
        ));
    }
    if two.plc == one.robot {
        return Err(problem(key("plc_address"), format!("{} is the address of station `{name}`", two.plc)));
    }
    let mask = u32::from(one.mask) & u32::from(two.mask);
    let net = |address: Ipv4Addr| u32::from(address) & mask;
    if net(one.plc) != net(two.plc) {
        return Ok(());
    }
    if one.mask != two.mask {
        let text =
            format!("{} overlaps the subnet of `{name}` with its mask {}: use one mask", two.mask, one.mask);
        return Err(problem(key("subnet_mask"), text));
    }
    if one.plc != two.plc {
        let text = format!(
            "{}: beside `{name}` the PLC has {} in the same subnet; use one address, or two subnets",
            two.plc, one.plc
        );
        return Err(problem(key("plc_address"), text));
    }
    Ok(())
}

/// Checks what the PLC has only once on a bus.
fn one_bus(other: &Station, station: &Station) -> Check {
    let same = |key: &str, one: String, two: String| {
        if one == two {
            return Ok(());
        }
        let text = format!(
            "{two}, but {one} at station `{}` on the same bus; one bus has one value, write it at both",
            other.name
        );
        Err(problem(format!("station.{}.bus.{key}", station.name), text))
    };
    same(
        "cycle_us",
        format!("{} µs", other.bus.cycle_us.value),
        format!("{} µs", station.bus.cycle_us.value),
    )?;
    if let (Some(one), Some(two)) = (other.bus.addresses(), station.bus.addresses()) {
        same("plc_address", one.plc.to_string(), two.plc.to_string())?;
        same("subnet_mask", one.mask.to_string(), two.mask.to_string())?;
    }
    match (&other.bus.kind, &station.bus.kind) {
        (BusKind::Profinet(_, one), BusKind::Profinet(_, two)) => {
            one_controller(&other.name, one, station, two)
        }
        _ => Ok(()),
    }
}

/// Checks the names of two devices of one IO-Controller.
fn one_controller(other: &str, one: &Profinet, station: &Station, two: &Profinet) -> Check {
    let key = |key: &str| format!("station.{}.bus.profinet.{key}", station.name);
    let device = &two.robot_station_name;
    if *device == one.robot_station_name {
        return Err(problem(key("robot_station_name"), format!("`{device}` is the name of `{other}` too")));
    }
    if two.plc_station_name != one.plc_station_name {
        let text = format!(
            "`{}`, but `{}` at station `{other}`; the IO-Controller has one name",
            two.plc_station_name, one.plc_station_name
        );
        return Err(problem(key("plc_station_name"), text));
    }
    Ok(())
}

/// Checks that the stations on EtherCAT fill the line, each at a place of its own.
fn positions(cell: &Cell) -> Check {
    let on_it: Vec<_> = cell
        .stations
        .iter()
        .filter_map(|station| Some((station, usize::from(cell.ethercat_position(station)?))))
        .collect();
    for (index, (station, position)) in on_it.iter().enumerate() {
        let key = || format!("station.{}.position", station.name);
        if let Some((other, _)) = on_it.iter().take(index).find(|(_, other)| other == position) {
            let text = format!("{position} is the place of station `{}` too", other.name);
            return Err(problem(key(), text));
        }
        if *position >= on_it.len() {
            let text =
                format!("{position}: the line has {} stations, so 0 to {}", on_it.len(), on_it.len() - 1);
            return Err(problem(key(), text));
        }
    }
    Ok(())
}
