//! One station of a setup, by its name.

use planning::Plan;
use setup::{Cell, Setup};

use crate::cell_run_error::CellRunError;

/// Plans one station of a setup: the named one, or the only one. Returns it as a setup, and its motions. `application` replaces that
/// of a setup with one robot.
///
/// # Errors
///
/// [`CellRunError`], and those of finding and planning setup and application.
pub fn plan_station(
    setup: &str,
    name: Option<&str>,
    application: Option<&str>,
) -> anyhow::Result<(Setup, Plan)> {
    let (cell, _) = setup::cell(setup)?;
    let index = choose_station(&cell, name)?;
    if cell.is_one() {
        let (setup, found) = planning::setup_and_application(setup, application)?;
        let plan = found.plan(&setup)?;
        found.reach(&plan, &setup)?;
        return Ok((setup, plan));
    }
    if application.is_some() {
        return Err(CellRunError::Application(cell.name).into());
    }
    let (cell, found) = planning::cell_with_applications(setup)?;
    let planned = found.plan(&cell)?.stations.swap_remove(index);
    Ok((planned.setup, planned.plan))
}

/// Returns the index of the named station, or of the only one.
pub(crate) fn choose_station(cell: &Cell, name: Option<&str>) -> Result<usize, CellRunError> {
    match (name, cell.stations.len()) {
        (Some(name), _) => find_station(cell, name),
        (None, 1) => Ok(0),
        (None, _) => Err(CellRunError::NoStation { setup: cell.name.clone(), stations: names(cell) }),
    }
}

/// Returns the index of the station that a robot node can be.
pub(crate) fn find_station(cell: &Cell, name: &str) -> Result<usize, CellRunError> {
    let Some(index) = cell.names().position(|known| known == name) else {
        let (setup, name) = (cell.name.clone(), name.to_owned());
        return Err(CellRunError::UnknownStation { setup, name, stations: names(cell) });
    };
    Ok(index)
}

/// Returns the names of the stations.
pub(crate) fn names(cell: &Cell) -> Vec<String> {
    cell.names().map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(name: &str) -> Cell {
        setup::cell(name).unwrap().0
    }

    #[test]
    fn a_robot_is_one_station_and_a_wrong_name_is_answered_by_the_one_that_was_meant_or_by_all() {
        let find = |cell: &Cell, name| find_station(cell, name).map_err(|error| error.to_string());
        let e = cell("E");
        assert_eq!((find(&e, "left"), find(&e, "right")), (Ok(0), Ok(1)));
        assert_eq!(find(&e, "lefft").unwrap_err(), "setup E has no station `lefft`: did you mean `left`?");
        assert_eq!(find(&e, "middle").unwrap_err(), "setup E has no station `middle`: there is left, right");
        assert_eq!(find(&cell("A"), "robot"), Ok(0));
    }
}
