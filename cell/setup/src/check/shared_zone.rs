//! Checks of the shared zones of a cell.

use super::{Check, problem};
use crate::{Cell, Figure, SharedZone, control_character};

/// Most shared zones of a cell: a set of zones has a bit for each.
const MAX_ZONES: usize = 32;

/// Longest name of a zone in characters.
const MAX_ZONE_NAME: usize = 32;

/// Farthest coordinate of a corner and largest length, in mm.
const FARTHEST_MM: f64 = 1e6;

pub(super) fn check(cell: &Cell) -> Check {
    let zones = &cell.shared_zones;
    if zones.len() > MAX_ZONES {
        let text = format!("{} zones; a cell has up to {MAX_ZONES}", zones.len());
        return Err(problem("shared_zone", text));
    }
    for (index, zone) in zones.iter().enumerate() {
        named(index, zone)?;
        let mut earlier = zones.iter().take(index);
        if let Some(number) = earlier.clone().position(|other| other.name == zone.name) {
            let text = format!("zones {} and {} are both `{}`", number + 1, index + 1, zone.name);
            return Err(problem(format!("shared_zone[{index}].name"), text));
        }
        placed(zone)?;
        let is_same = |other: &&SharedZone| {
            other.corner_mm.value == zone.corner_mm.value && other.size_mm.value == zone.size_mm.value
        };
        if let Some(other) = earlier.find(is_same) {
            let text = format!("the same box as zone `{}`; remove one", other.name);
            return Err(problem(format!("shared_zone.{}.corner_mm", zone.name), text));
        }
    }
    let Some(first) = zones.first() else { return Ok(()) };
    match cell.stations.iter().find(|station| station.robot.link_radius_mm.is_none()) {
        None => Ok(()),
        Some(station) => {
            let text =
                format!("missing; with zone `{}` every robot needs the radius of its links", first.name);
            Err(problem(format!("station.{}.robot.link_radius_mm", station.name), text))
        }
    }
}

fn named(index: usize, zone: &SharedZone) -> Check {
    let key = || format!("shared_zone[{index}].name");
    if let Some(text) = control_character(&zone.name) {
        return Err(problem(key(), text));
    }
    let length = zone.name.chars().count();
    if length > MAX_ZONE_NAME || !zone.name.chars().any(char::is_alphanumeric) {
        let found =
            if length > MAX_ZONE_NAME { format!("{length} characters") } else { format!("`{}`", zone.name) };
        let text =
            format!("{found}; give it up to {MAX_ZONE_NAME} characters, one of them a letter or a digit");
        return Err(problem(key(), text));
    }
    Ok(())
}

fn placed(zone: &SharedZone) -> Check {
    let key = |key: &str| format!("shared_zone.{}.{key}", zone.name);
    let is_near = |value: &f64| value.is_finite() && value.abs() <= FARTHEST_MM;
    if let Some(wrong) = zone.corner_mm.value.iter().find(|value| !is_near(value)) {
        let text = format!("{} is not within ±{FARTHEST_MM} mm", Figure(*wrong));
        return Err(problem(key("corner_mm"), text));
    }
    if let Some(wrong) = zone.size_mm.value.iter().find(|value| !is_near(value) || **value <= 0.0) {
        let text = format!("{} mm: a length is above 0 mm, up to {FARTHEST_MM} mm", Figure(*wrong));
        return Err(problem(key("size_mm"), text));
    }
    Ok(())
}
