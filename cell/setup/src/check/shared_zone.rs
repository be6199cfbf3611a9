//! Checks of the shared zones of a cell.

use super::{Check, FARTHEST_MM, problem};
use crate::{Cell, Figure, SharedZone, control_character};

/// Most shared zones of a cell: a set of zones has a bit for each.
const MAX_ZONES: usize = 32;

/// Longest name of a zone in characters.
const MAX_ZONE_NAME: usize = 32;

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

#[cfg(test)]
mod tests {
    use crate::{CELLS, Cell, SharedZone, cell_from_text, check_cell};

    /// Returns the error of Setup G with one change.
    fn refused(change: impl FnOnce(&mut Cell)) -> String {
        let (name, text) = CELLS.iter().find(|(name, _)| *name == "G").unwrap();
        let mut cell = cell_from_text(name, text).unwrap();
        change(&mut cell);
        check_cell(&cell).unwrap_err().to_string()
    }

    fn another(cell: &Cell, name: &str) -> SharedZone {
        SharedZone { name: name.to_owned(), ..cell.shared_zones[0].clone() }
    }

    #[test]
    fn a_zone_that_makes_no_sense_is_refused_with_its_name() {
        let said = [
            refused(|cell| cell.shared_zones.push(another(cell, "fixture"))),
            refused(|cell| cell.shared_zones.push(another(cell, "table"))),
            refused(|cell| cell.shared_zones[0].name = " ".to_owned()),
            refused(|cell| cell.shared_zones[0].name = "z".repeat(33)),
            refused(|cell| cell.shared_zones[0].name = "a\u{1b}[2J".to_owned()),
            refused(|cell| cell.shared_zones[0].size_mm.value[1] = 0.0),
            refused(|cell| cell.shared_zones[0].size_mm.value[1] = f64::NAN),
            refused(|cell| cell.shared_zones[0].corner_mm.value[2] = f64::INFINITY),
            refused(|cell| cell.stations[1].robot.link_radius_mm = None),
            refused(|cell| cell.stations[1].robot.link_radius_mm.as_mut().unwrap().value = -1.0),
            refused(|cell| {
                let zones = (0..33).map(|number| another(cell, &number.to_string())).collect();
                cell.shared_zones = zones;
            }),
        ];
        insta::assert_snapshot!(said.join("\n"), @"
        setup G: `shared_zone[1].name`: zones 1 and 2 are both `fixture`
        setup G: `shared_zone.table.corner_mm`: the same box as zone `fixture`; remove one
        setup G: `shared_zone[0].name`: ` `; give it up to 32 characters, one of them a letter or a digit
        setup G: `shared_zone[0].name`: 33 characters; give it up to 32 characters, one of them a letter or a digit
        setup G: `shared_zone[0].name`: has the control character U+001B; names and titles are printable text
        setup G: `shared_zone.fixture.size_mm`: 0 mm: a length is above 0 mm, up to 1000000 mm
        setup G: `shared_zone.fixture.size_mm`: NaN mm: a length is above 0 mm, up to 1000000 mm
        setup G: `shared_zone.fixture.corner_mm`: inf is not within ±1000000 mm
        setup G: `station.right.robot.link_radius_mm`: missing; with zone `fixture` every robot needs the radius of its links
        setup G: `station.right.robot.link_radius_mm`: -1 is not above 0
        setup G: `shared_zone`: 33 zones; a cell has up to 32
        ");
    }

    #[test]
    fn a_zone_in_a_setup_of_one_robot_is_an_unknown_key() {
        let text = crate::SETUPS[0].1.replacen("[plc]", "[[shared_zone]]\nname = \"a\"\n\n[plc]", 1);
        let said = cell_from_text("my.toml", &text).unwrap_err().to_string();
        assert!(said.contains("unknown key `shared_zone`"), "{said}");
    }

    #[test]
    fn two_cells_differ_by_the_keys_of_a_zone_by_its_name() {
        let (name, text) = CELLS.iter().find(|(name, _)| *name == "G").unwrap();
        let cell = cell_from_text(name, text).unwrap();
        let mut other = cell.clone();
        other.shared_zones[0].size_mm.value[0] += 1.0;
        let keys: Vec<_> = cell.differences(&other).unwrap().into_iter().map(|it| it.key).collect();
        assert_eq!(keys, ["shared_zone.fixture.size_mm"]);
    }
}
