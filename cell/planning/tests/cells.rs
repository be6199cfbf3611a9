//! Applications for several arms, planned on cells of several stations.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a cell that cannot be planned fails the test")]

use planning::{ARMS_APPLICATIONS, PlannedCell, cell_with_applications};

fn planned(name: &str) -> PlannedCell {
    let (cell, found) = cell_with_applications(name).unwrap();
    found.plan(&cell).unwrap_or_else(|error| panic!("{error}"))
}

fn shipped(name: &str) -> &'static str {
    ARMS_APPLICATIONS.iter().find(|(known, _)| *known == name).unwrap().1
}

fn changed(name: &str, from: &str, to: &str) -> String {
    let text = shipped(name);
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1)
}

#[test]
fn the_arms_of_setups_e_and_f_reach_their_parts_and_rest_at_every_mark() {
    for (name, of_e) in [("E", true), ("F", false)] {
        let cell = planned(name);
        assert_eq!(cell.stations.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(), ["left", "right"]);
        assert_eq!(cell.marks.len(), 4);
        for station in &cell.stations {
            let plan = &station.plan;
            assert!(
                station.reached.stopped.is_empty(),
                "{name} {}: {:?}",
                station.name,
                station.reached.stopped
            );
            assert_eq!(plan.waits.iter().map(|wait| wait.mark).collect::<Vec<_>>(), [1, 2, 3, 4]);
            for wait in &plan.waits {
                let last = &plan.motions[wait.after - 1];
                assert_eq!(last.zone_mm, 0.0, "{name} {}: {}", station.name, last.name);
                assert_eq!(last.wire(&station.setup).approximation, 0);
            }
            let of_motions = plan.reasons.iter().filter(|reason| reason.why.is_of_zone()).count();
            assert_eq!(of_motions, plan.motions.len(), "one reason of a zone for each motion");
        }
        for mark in &cell.marks {
            assert_eq!(cell.waiting_at(mark.number).count(), 2);
        }
        assert_eq!(cell.marks.iter().any(|mark| mark.together), !of_e);
    }
}

#[test]
fn the_plans_of_two_arms_show_where_they_wait() {
    let cell = planned("E");
    insta::assert_snapshot!(cell.to_string(), @"
    marks
         1  offered   left after motion 5, right after motion 1
         2  gripped   left after motion 5, right after motion 2
         3  released  left after motion 5, right after motion 2
         4  clear     left after motion 5, right after motion 3
      RC: programs meet by digital outputs: left 14 and 15, right 12 and 13
    ");
    insta::assert_snapshot!(format!("{:60}", cell.stations[0].plan), @"
    hand-over-giver on setup E-left: one arm picks a part, hands
    it over to another arm, which inserts it 300 mm away

    labels at process level
      pick   accurate path, accurate stop  to the part in the
             carrier
      lift   accurate path                 the part out of the
             carrier
      offer  blending                      to the middle
      back   blending, accurate stop       back to the start

    planning steps
      I    paths of the process
      II   linear pre- and post-movements
      III  secondary motions
      IV   continuous motions and their zones

    step IV: continuous motion 1, 3 motions
         1  PTP before pick, step III, blending
            to 0.0, 0.0, 110.0 mm; 0.0, 0.0, 180.0°
            at 100 %, zone 10.00 mm
            the approximation distance
         2  LIN before pick, step II, blending
            to 0.0, 0.0, 90.0 mm; 0.0, 0.0, 180.0°
            at 100 %, zone 10.00 mm
            the next motion continues straight, so blending
            stays on the path
         3  LIN pick, step I, accurate path, accurate stop
            to 0.0, 0.0, 60.0 mm; 0.0, 0.0, 180.0°
            at 100 %, zone 0.00 mm
            grip happens here
      then  grip: set output 0, wait 120 ms

    step IV: continuous motion 2, 2 motions
         4  LIN lift, step I, accurate path
            to 0.0, 0.0, 90.0 mm; 0.0, 0.0, 180.0°
            at 100 %, zone 0.00 mm
            no blending: the direction depends on the arm
         5  PTP offer, step III, accurate stop
            to 150.0, -20.0, 95.0 mm; 0.0, 0.0, 180.0°
            at 100 %, zone 0.00 mm
            release happens here
      wait  at mark 1
      wait  at mark 2
      then  release: clear output 0, wait 120 ms
      wait  at mark 3
      wait  at mark 4

    step IV: continuous motion 3, 1 motion
         6  PTP back, step III, accurate stop
            to -100.0, 100.0, 90.0 mm; 0.0, 0.0, 180.0°
            at 100 %, zone 0.00 mm
            stops exactly

    6 motions in 3 continuous motions
    ");
    let taker = format!("{:100}", cell.stations[1].plan);
    insta::assert_snapshot!(taker, @"
    hand-over-taker on setup E-right: one arm picks a part, hands it over to another arm, which inserts
    it 300 mm away

    labels at process level
      come      blending                      to the middle
      take      accurate path, accurate stop  grip the part from the side
      pull out  accurate path                 the part down out of the giver's gripper
      insert    accurate path, accurate stop  insert the part
      leave     accurate path                 away from the part
      back      blending, accurate stop       back to the start

    planning steps
      I    paths of the process
      II   linear pre- and post-movements
      III  secondary motions
      IV   continuous motions and their zones

    step IV: continuous motion 1, 2 motions
         1  PTP come, step III, blending
            to 150.0, -80.0, 55.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 0.00 mm
            waits at mark 1
      wait  at mark 1
         2  LIN take, step I, accurate path, accurate stop
            to 150.0, -20.0, 55.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 0.00 mm
            grip happens here
      then  grip: set output 0, wait 120 ms
      wait  at mark 2
      wait  at mark 3

    step IV: continuous motion 2, 4 motions
         3  LIN pull out, step I, accurate path
            to 150.0, -20.0, 25.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 0.00 mm
            waits at mark 4
      wait  at mark 4
         4  PTP before insert, step III, blending
            to 300.0, -100.0, 90.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 10.00 mm
            the approximation distance
         5  LIN before insert, step II, blending
            to 300.0, -100.0, 50.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 10.00 mm
            the next motion continues straight, so blending stays on the path
         6  LIN insert, step I, accurate path, accurate stop
            to 300.0, -100.0, 20.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 0.00 mm
            release happens here
      then  release: clear output 0, wait 120 ms

    step IV: continuous motion 3, 3 motions
         7  LIN leave, step I, accurate path
            to 300.0, -100.0, 50.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 10.00 mm
            the next motion continues straight, so blending stays on the path
         8  LIN after leave, step II, blending
            to 300.0, -100.0, 90.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 10.00 mm
            the approximation distance
         9  PTP back, step III, accurate stop
            to 250.0, -80.0, 120.0 mm; 0.0, 0.0, -90.0°
            at 100 %, zone 0.00 mm
            stops exactly

    9 motions in 3 continuous motions
    ");
}

#[test]
fn both_arms_of_setup_f_go_the_same_way_while_they_carry_the_plate() {
    let cell = planned("F");
    let carried = |station: &str| {
        let station = cell.station(station).unwrap();
        let at = |mark| station.plan.waits.iter().find(|wait| wait.mark == mark).unwrap().after;
        station.plan.motions[at(2)..at(3)].to_vec()
    };
    let (left, right) = (carried("left"), carried("right"));
    assert_eq!((left.len(), right.len()), (3, 3));
    for (left, right) in left.iter().zip(&right) {
        let apart = right.target.point - left.target.point;
        assert_eq!(apart.coordinates(), [400.0, 0.0, 0.0], "the plate keeps its length");
        assert_eq!((left.zone_mm, left.speed_mm_s), (right.zone_mm, right.speed_mm_s));
    }
}

#[test]
fn the_tools_meet_in_the_cell_where_the_part_is_handed_over() {
    let (cell, _) = setup::cell("E").unwrap();
    let planned = planned("E");
    let tool_in_cell = |name: &str, mark: u32| {
        let (station, plan) = (cell.station(name).unwrap(), planned.station(name).unwrap());
        let after = plan.plan.waits.iter().find(|wait| wait.mark == mark).unwrap().after;
        let installation = arm::Installation::from_setup(&plan.setup).unwrap();
        let joints = plan.reached.targets[after - 1];
        let root = arm::Frame::from_mm_deg(station.root_mm_deg.value);
        root * installation.arm.forward(&joints) * installation.tools[1].unwrap()
    };
    let (giver, taker) = (tool_in_cell("left", 2), tool_in_cell("right", 2));
    let apart = [0, 1, 2].map(|axis| giver.position[axis] - taker.position[axis]);
    for (apart, wanted) in apart.into_iter().zip([0.0, 0.0, 40.0]) {
        assert!((apart - wanted).abs() < 0.01, "the taker grips 40 mm below the giver: {apart}");
    }
}

#[test]
fn an_action_at_a_mark_comes_after_the_wait_and_one_of_the_step_before_it() {
    let cell = planned("E");
    let of = |name: &str| {
        let plan = &cell.station(name).unwrap().plan;
        plan.waits.iter().map(|wait| (wait.mark, wait.after_action)).collect::<Vec<_>>()
    };
    // The giver releases the part after mark 2; the taker grips it before.
    assert_eq!(of("left"), [(1, false), (2, false), (3, true), (4, true)]);
    assert_eq!(of("right"), [(1, false), (2, true), (3, true), (4, false)]);
    for station in &cell.stations {
        let plan = &station.plan;
        for stop in plan.continuous.iter().filter(|stop| stop.then.is_some()) {
            assert_eq!(plan.motions[stop.motions.end - 1].zone_mm, 0.0);
        }
        let actions: Vec<_> = plan.stops().iter().filter_map(|stop| Some(stop.then?.set)).collect();
        assert_eq!(actions, [true, false], "grip and release, {}", station.name);
    }
}

#[test]
fn a_mark_keeps_its_place_where_motions_are_divided_or_joined() {
    let cell = planned("E");
    for station in &cell.stations {
        let plan = &station.plan;
        for other in [plan.divided(4, 2.0), plan.joined()] {
            assert_eq!(other.waits.len(), plan.waits.len());
            for (wait, moved) in plan.waits.iter().zip(&other.waits) {
                assert_eq!((wait.mark, wait.after_action), (moved.mark, moved.after_action));
                assert_eq!(plan.motions[wait.after - 1].target, other.motions[moved.after - 1].target);
                assert_eq!(other.motions[moved.after - 1].zone_mm, 0.0);
            }
        }
    }
}

/// Returns the error of a cell in a file: Setup E with one change.
fn refused_cell(from: &str, to: &str) -> String {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    let text = setup::CELLS[0].1;
    assert!(text.contains(from), "{from}");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let found = cell_with_applications(path.to_str().unwrap()).and_then(|(cell, found)| found.plan(&cell));
    found.map(|_| ()).unwrap_err().to_string().replace(&directory.path().display().to_string(), "DIR")
}

#[test]
fn stations_and_arms_must_fit_each_other() {
    let said = [
        refused_cell("application = \"giver\"", "application = \"thief\""),
        refused_cell("application = \"giver\"", "application = \"taker\""),
        refused_cell("application = \"hand-over\"", "application = \"hand-under\""),
        refused_cell("application = \"hand-over\"", "application = \"no.toml\""),
        refused_cell("application = \"hand-over\"\n", ""),
        refused_cell(
            "mm_deg = { value = [450.0, 150.0, 200.0, -90.0",
            "mm_deg = { value = [450.0, 151.0, 200.0, -90.0",
        ),
        refused_cell("root_mm_deg = { value = [750.0", "root_mm_deg = { value = [900.0"),
        refused_cell(
            "number = 1\nmm_deg = { value = [0.0, 0.0, 60.0",
            "number = 2\nmm_deg = { value = [0.0, 0.0, 60.0",
        ),
    ];
    insta::assert_snapshot!(said.join("\n"), @"
    DIR/my.toml: `station.left.application`: `thief` is not an arm of built-in application hand-over: it has giver, taker
    DIR/my.toml: `station.right.application`: station `left` is arm `taker` too; each arm is one station
    there is no application `hand-under`: did you mean `hand-over`? built in are hand-over, carry-plate, take-turns; or give the path of a .toml file
    cannot read the application file DIR/no.toml: No such file or directory (os error 2)
    there is no application `giver`: built in are pick-and-place, pick-and-place-gripper, gluing, palletising, engraving, insertion-with-force; or give the path of a .toml file
    DIR/my.toml: `station.right.robot.bases`: base 1 lies 1.00 mm and 0.00° from that of `left` in the cell; one application needs one place: correct it or a root_mm_deg
    DIR/my.toml: `station.right.robot.bases`: base 1 lies 150.00 mm and 0.00° from that of `left` in the cell; one application needs one place: correct it or a root_mm_deg
    built-in application hand-over on setup E-left: step `pick`, motion 1: the setup's robot has no tool 1; it has 0, 2
    ");
}

#[test]
fn an_arm_that_does_not_reach_its_part_is_named_with_its_station() {
    let directory = tempfile::tempdir().unwrap();
    let far = changed("hand-over", "inserted = { mm_deg = [300.0,", "inserted = { mm_deg = [700.0,");
    std::fs::write(directory.path().join("far.toml"), far).unwrap();
    let path = directory.path().join("my.toml");
    std::fs::write(&path, setup::CELLS[0].1.replacen("\"hand-over\"", "\"far.toml\"", 1)).unwrap();
    let (cell, found) = cell_with_applications(path.to_str().unwrap()).unwrap();
    let said = found.plan(&cell).unwrap_err().to_string();
    let said = said.replace(&directory.path().display().to_string(), "DIR");
    insta::assert_snapshot!(said, @"DIR/far.toml on setup E-right: motion 4 `PTP before insert`, its target: the wrist centre would be 581.777 mm from axis 2; the arm reaches from 25.200 to 475.200 mm; 106.6 mm are missing: change frame `above-assembly` or the step's approach_mm, or base 1 in the setup");
}

#[test]
fn a_station_may_have_an_application_of_its_own_and_a_setup_of_one_robot_is_a_cell() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    let own = setup::CELLS[0].1.replacen("application = \"hand-over\"\n", "", 1);
    let own = own.replacen("application = \"giver\"", "application = \"pick-and-place\"", 1);
    let own = own.replacen("application = \"taker\"", "application = \"gluing\"", 1);
    std::fs::write(&path, own).unwrap();
    let (cell, found) = cell_with_applications(path.to_str().unwrap()).unwrap();
    assert_eq!(
        found.stations.iter().map(|it| it.application.name.as_str()).collect::<Vec<_>>(),
        ["pick-and-place", "gluing"]
    );
    assert_eq!(found.marks, []);
    assert_eq!(cell.setups().next().unwrap().application, "pick-and-place");

    let alone = planned("A");
    let (setup, found) = planning::setup_with_application("A").unwrap();
    assert_eq!(alone.stations[0].plan, found.plan(&setup).unwrap());
    assert_eq!((alone.stations.len(), alone.stations[0].setup.clone()), (1, setup));
}
