use crate::{CELLS, Cell, SETUPS, cell, cell_from_text, cell_to_toml, setup, setup_from_text, setup_to_toml};

fn text(name: &str) -> &'static str {
    CELLS.iter().find(|(known, _)| *known == name).unwrap().1
}

/// Returns the error for the text of a built-in cell with one change, made where `from` is found for the `nth` time.
fn refused(name: &str, nth: usize, from: &str, to: &str) -> String {
    let text = text(name);
    let (at, _) = text.match_indices(from).nth(nth).unwrap_or_else(|| panic!("{from}"));
    let changed = format!("{}{to}{}", &text[..at], &text[at + from.len()..]);
    cell_from_text("my.toml", &changed).map(|_| ()).unwrap_err().to_string()
}

#[test]
fn a_cell_is_written_and_read_back_unchanged() {
    for (name, text) in CELLS {
        let cell = cell_from_text(name, text).unwrap();
        let written = cell_to_toml(&cell).unwrap();
        assert!(written.starts_with("schema = 2\n") || written.contains("\nschema = 2\n"), "{written}");
        assert_eq!(cell_from_text("written", &written).unwrap(), cell, "{name}");
    }
}

#[test]
fn a_setup_of_one_robot_is_a_cell_of_one_station_and_is_written_as_it_was() {
    for (name, text) in SETUPS {
        let one = setup_from_text(name, text).unwrap();
        let cell = cell_from_text(name, text).unwrap();
        assert!(cell.is_one() && cell.names().eq(["robot"]));
        assert!(cell.setups().eq([one.clone()]));
        assert_eq!(cell_to_toml(&cell).unwrap(), setup_to_toml(&one).unwrap(), "{name}");
    }
}

#[test]
fn a_station_is_a_whole_setup_that_is_accepted_written_and_read_back() {
    for (name, _) in CELLS {
        let (cell, _) = cell(name).unwrap();
        for (setup, station) in cell.setups().zip(&cell.stations) {
            crate::check(&setup).unwrap();
            assert_eq!(setup.name, format!("{name}-{}", station.name));
            assert_eq!((&setup.bus, &setup.robot), (&station.bus, &station.robot));
            let again = setup_from_text("written", &setup_to_toml(&setup).unwrap()).unwrap();
            assert_eq!(again, setup);
        }
    }
    // The arms of Setups E and G are those of Setups A and B, and those of Setup F that of Setup D.
    let of = |name: &str| cell(name).unwrap().0;
    for (name, station, origin) in [
        ("E", "left", "A"),
        ("E", "right", "B"),
        ("F", "left", "D"),
        ("F", "right", "D"),
        ("G", "left", "A"),
        ("G", "right", "B"),
    ] {
        let (cell, origin) = (of(name), setup(origin).unwrap());
        let station = cell.station(station).unwrap();
        assert_eq!(station.robot.kinematics, origin.robot.kinematics);
        assert_eq!(station.motions, origin.motions);
        assert_eq!(station.robot.axes.speed_deg_s, origin.robot.axes.speed_deg_s);
    }
}

#[test]
fn a_reader_of_one_robot_refuses_several_and_says_what_is_missing() {
    insta::assert_snapshot!(setup("E").unwrap_err(), @"built-in setup E has 2 stations (left, right), and one is served here; for several: bench --mode virtual, bench gate, bench study, plc-node, plc-node plan --setup, robot-node --station NAME");
    let broken = text("F").replacen("scan_cost_us", "scan_costs_us", 1);
    let said = setup_from_text("my.toml", &broken).unwrap_err().to_string();
    assert!(said.contains("scan_costs_us"), "a mistake in it is named first: {said}");
    insta::assert_snapshot!(setup("Z").unwrap_err(), @"there is no setup `Z`: built in are A, B, C, D, E, F, G; or give the path of a .toml file");
}

#[test]
fn schema_and_stations_must_agree() {
    let one = SETUPS[0].1.replacen("schema = 1", "schema = 2", 1);
    let said = [
        cell_from_text("my.toml", &one).unwrap_err().to_string(),
        setup_from_text("my.toml", &one).unwrap_err().to_string(),
        refused("E", 0, "schema = 2", "schema = 1"),
        refused("E", 0, "schema = 2", "schema = 3"),
        refused("E", 0, "schema = 2\n", ""),
        cell_from_text("my.toml", "schema = 2\nstation = []").unwrap_err().to_string(),
    ];
    insta::assert_snapshot!(said.join("\n"), @"
    my.toml:4: `schema`: 2 needs a section [[station]] for each robot, found none: add them, or write 1
    my.toml:4: `schema`: 2 needs a section [[station]] for each robot, found none: add them, or write 1
    my.toml:6: `schema`: 1: a setup with [[station]] has schema = 2
    my.toml:6: `schema`: 3: a setup with [[station]] has schema = 2
    my.toml: `schema`: no version: a setup with [[station]] has schema = 2
    my.toml:1: missing key `name`
        1 | schema = 2
    ");
}

#[test]
fn names_of_stations_are_short_and_plain_and_each_is_there_once() {
    let long = format!("name = \"{}\"", "a".repeat(33));
    let cases =
        ["name = \"left\"", "name = \"Right\"", "name = \"\"", "name = \"-r\"", "name = \"plc\"", &long];
    let said = cases.map(|name| refused("E", 0, "name = \"right\"", name));
    insta::assert_snapshot!(said.join("\n"), @"
    my.toml:95: `station[1].name`: stations 1 and 2 are both `left`
    my.toml:95: `station[1].name`: `Right`: write a to z, 0 to 9 and hyphens, such as `left`
    my.toml:95: `station[1].name`: ``: write a to z, 0 to 9 and hyphens, such as `left`
    my.toml:95: `station[1].name`: `-r`: write a to z, 0 to 9 and hyphens, such as `left`
    my.toml:95: `station[1].name`: `plc` names the PLC in commands and files: choose another name
    my.toml:95: `station[1].name`: 33 characters; a station's name has up to 32
    ");
    let longest = "E".repeat(31);
    assert!(cell_from_text("my", &text("E").replacen("\"E\"", &format!("\"{longest}\""), 1)).is_ok());
    insta::assert_snapshot!(refused("E", 0, "name = \"E\"", &format!("name = \"E{longest}\"")), @"my.toml:7: `name`: 32 characters; the names of stations follow it, so give it up to 31");
}

#[test]
fn a_wrong_number_in_a_station_is_named_with_its_station() {
    let said = [
        refused(
            "E",
            0,
            "interpreter_quantum_us = { value = 24000",
            "interpreter_quantum_us = { value = 24000000",
        ),
        refused("E", 0, "watchdog_cycles = { value = 512", "watchdog_cycles = { value = 513"),
        refused("E", 0, "scan_cost_us = { value = 150", "scan_cost_us = { value = 1500"),
        refused("E", 0, "mm_deg = { value = [750.0, 0.0,", "mm_deg = { value = [750.0, inf,"),
        refused("E", 0, "mm_deg = { value = [750.0, 0.0,", "mm_deg = { value = [750.0,"),
        refused("E", 0, "root_mm_deg", "root_mm"),
        refused(
            "E",
            0,
            "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], from = \"assumed\"",
            "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
        ),
    ];
    insta::assert_snapshot!(said.join("\n"), @r#"
    my.toml:113: `station.right.robot.interpreter_quantum_us`: 24000000 µs is above ten seconds
    my.toml:102: `station.right.bus.watchdog_cycles`: an EtherNet/IP connection waits for 512 packet intervals at most, not for 513
    my.toml:13: `plc.scan_cost_us`: a scan that costs 1500 µs does not fit into a cycle of 1000 µs
    my.toml:97: `station.right.root_mm_deg`: inf is not within ±1000000 mm
    my.toml:97: in `station[1].root_mm_deg.value`: found 5 numbers, expected 6
       97 | root_mm_deg = { value = [750.0, -175.0, 180.0, 0.0, 0.0], from = "assumed", note = "opposite of the SCARA, facing it, the table 200 mm above its foot" }
          |                 ^^^^^
    my.toml:20: in `station[0].root_mm`: unknown key `root_mm`: did you mean `root_mm_deg`?
       20 | root_mm = { value = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], from = "assumed", note = "the cell's origin" }
    my.toml:20: in `station[0].root_mm_deg`: missing key `from`
       20 | root_mm_deg = { value = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], note = "the cell's origin" }
    "#);
}

#[test]
fn stations_that_clash_are_refused() {
    let same_root = "root_mm_deg = { value = [0.0, 0.4, 0.0, 90.0, 0.0, 0.0]";
    let said = [
        refused("E", 0, "root_mm_deg = { value = [750.0, 0.0, -175.0, 180.0, 0.0, 0.0]", same_root),
        refused("E", 0, "192.168.64.3", "192.168.64.2"),
        refused("E", 1, "plc_address = \"192.168.64.1\"", "plc_address = \"192.168.64.9\""),
        refused("E", 1, "plc_address = \"192.168.64.1\"", "plc_address = \"192.168.64.2\""),
        refused("E", 1, "subnet_mask = \"255.255.255.0\"", "subnet_mask = \"255.255.0.0\""),
        refused("E", 0, "plc_address = \"192.168.64.1\"", "plc_address = \"192.168.64.3\""),
    ];
    insta::assert_snapshot!(said.join("\n"), @"
    my.toml:97: `station.right.root_mm_deg`: the arms of `left` and `right` stand at one place; move one
    my.toml:106: `station.right.bus.robot_address`: 192.168.64.2 is the address of station `left` too
    my.toml:105: `station.right.bus.plc_address`: 192.168.64.9: beside `left` the PLC has 192.168.64.1 in the same subnet; use one address, or two subnets
    my.toml:105: `station.right.bus.plc_address`: 192.168.64.2 is the address of station `left`
    my.toml:107: `station.right.bus.subnet_mask`: 255.255.0.0 overlaps the subnet of `left` with its mask 255.255.255.0: use one mask
    my.toml:106: `station.right.bus.robot_address`: 192.168.64.3 is the PLC's address beside `left`
    ");
}

/// Returns Setup F with both stations on one bus: on EtherCAT as the right one, or on PROFINET as the left one.
fn on_one_bus(on_ethercat: bool) -> String {
    let text = text("F");
    let (left, rest) = text.split_once("[station.bus]").unwrap();
    let (left_bus, rest) = rest.split_once("[station.robot]").unwrap();
    let (middle, rest) = rest.split_once("[station.bus]").unwrap();
    let (right_bus, right) = rest.split_once("[station.robot]").unwrap();
    let second =
        left_bus.replace("192.168.64.2", "192.168.64.3").replace("skillbench-left", "skillbench-right");
    let (first, second) = if on_ethercat { (right_bus, right_bus) } else { (left_bus, second.as_str()) };
    let bus = "[station.bus]";
    format!("{left}{bus}{first}[station.robot]{middle}{bus}{second}[station.robot]{right}")
}

fn said(text: &str) -> String {
    cell_from_text("my.toml", text).map_or_else(|error| error.to_string(), |_| "accepted".to_owned())
}

fn changed_last(text: &str, from: &str, to: &str) -> String {
    let at = text.rfind(from).unwrap_or_else(|| panic!("{from}"));
    format!("{}{to}{}", &text[..at], &text[at + from.len()..])
}

#[test]
fn two_stations_on_one_profinet_bus_share_its_controller_and_nothing_else() {
    let text = on_one_bus(false);
    assert_eq!(said(&text), "accepted");
    let with_mac = |number: u8| {
        format!("plc_address = \"192.168.64.1\"\nrobot = {{ mac = \"02:00:00:00:00:0{number}\" }}")
    };
    let listed = changed_last(&text, "plc_address = \"192.168.64.1\"", &with_mac(1));
    let both = |number| listed.replacen("plc_address = \"192.168.64.1\"", &with_mac(number), 1);
    assert_eq!(said(&both(2)), "accepted");
    let refusals = [
        changed_last(&text, "skillbench-right", "skillbench-left"),
        changed_last(&text, "skillbench-plc", "another-plc"),
        changed_last(
            &text,
            "cycle_us = { value = 2000, from = \"assumed\", note = \"the arm's",
            "cycle_us = { value = 4000, from = \"assumed\", note = \"the arm's",
        ),
        changed_last(
            &changed_last(&text, "plc_address = \"192.168.64.1\"", "plc_address = \"192.168.65.1\""),
            "192.168.64.3",
            "192.168.65.3",
        ),
        both(1),
    ];
    insta::assert_snapshot!(refusals.map(|text| said(&text)).join("\n"), @"
    my.toml:110: `station.right.bus.profinet.robot_station_name`: `skillbench-left` is the name of `left` too
    my.toml:109: `station.right.bus.profinet.plc_station_name`: `another-plc`, but `skillbench-plc` at station `left`; the IO-Controller has one name
    my.toml:99: `station.right.bus.cycle_us`: 4000 µs, but 2000 µs at station `left` on the same bus; one bus has one value, write it at both
    my.toml:103: `station.right.bus.plc_address`: 192.168.65.1, but 192.168.64.1 at station `left` on the same bus; one bus has one value, write it at both
    my.toml:105: `station.right.bus.robot`: 02:00:00:00:00:01 is the MAC address of station `left` too
    ");
}

#[test]
fn stations_on_ethercat_have_places_in_a_line() {
    let text = on_one_bus(true);
    let at = |left: &str, right: &str| {
        let name = |name| format!("name = \"{name}\"");
        let left = text.replacen(&name("left"), &format!("{}\n{left}", name("left")), 1);
        left.replacen(&name("right"), &format!("{}\n{right}", name("right")), 1)
    };
    let places = |text: &str| -> Vec<_> {
        let cell = cell_from_text("my.toml", text).unwrap();
        cell.stations.iter().map(|station| cell.ethercat_position(station)).collect()
    };
    assert_eq!(places(&text), [Some(0), Some(1)]);
    assert_eq!(places(&at("position = 1", "position = 0")), [Some(1), Some(0)]);
    assert_eq!(cell("F").map(|(cell, _)| cell.ethercat_position(&cell.stations[0])).unwrap(), None);
    let refusals = [at("position = 1", ""), at("position = 0", "position = 2"), text_of_f_with_a_position()];
    insta::assert_snapshot!(refusals.map(|text| said(&text)).join("\n"), @"
    my.toml:85: `station.right.position`: 1 is the place of station `left` too
    my.toml:87: `station.right.position`: 2: the line has 2 stations, so 0 to 1
    my.toml:17: `station.left.position`: 0: only stations on EtherCAT have a position; `left` is on profinet
    ");
}

fn text_of_f_with_a_position() -> String {
    text("F").replacen("name = \"left\"", "name = \"left\"\nposition = 0", 1)
}

#[test]
fn a_cell_has_up_to_64_stations() {
    let with = |count: usize| {
        let (cell, _) = cell("F").unwrap();
        let right = cell.stations[1].clone();
        let stations = (0..count).map(|number| {
            let mut station = right.clone();
            station.name = format!("arm-{number}");
            station.root_mm_deg.value[1] = number as f64 * 2_000.0;
            station
        });
        Cell { stations: stations.collect(), ..cell }
    };
    crate::check_cell(&with(64)).unwrap();
    insta::assert_snapshot!(crate::check_cell(&with(65)).unwrap_err(), @"setup F: `station`: 65 stations; a cell has up to 64");
}

#[test]
fn a_difference_of_a_station_is_named_by_its_station_wherever_that_stands() {
    let (shipped, _) = cell("E").unwrap();
    let mut changed = shipped.clone();
    changed.stations.reverse();
    assert_eq!(shipped.differences(&changed).unwrap(), []);
    let changed = changed.with_station("right", |setup| setup.with_velocity(12.5)).unwrap();
    let keys =
        |cell: &Cell| -> Vec<_> { shipped.differences(cell).unwrap().into_iter().map(|it| it.key).collect() };
    assert_eq!(keys(&changed), ["station.right.motions.velocity_percent"]);
    let alone = Cell { stations: vec![shipped.stations[0].clone()], ..shipped.clone() };
    let differences = shipped.differences(&alone).unwrap();
    assert_eq!(differences.len(), 1);
    assert_eq!((differences[0].key.as_str(), &differences[0].second), ("station.right", &None));
    assert_eq!(differences[0].first.as_deref(), Some("a station"));
}

#[test]
fn a_study_changes_one_station_or_each_and_says_that_its_numbers_are_assumed() {
    let (shipped, _) = cell("E").unwrap();
    let changed = shipped.clone().with_station("left", |setup| setup.with_queue_depth(2)).unwrap();
    assert_eq!(changed.plc.slots_in_use(), 2);
    assert_eq!(shipped.clone().with_station("middle", |setup| setup), None);
    let each = shipped
        .clone()
        .with_each_station(crate::Setup::uncalibrated)
        .with_each_station(|it| it.with_queue_depth(3));
    crate::check_cell(&each).unwrap();
    assert!(!cell_to_toml(&each).unwrap().contains("calibrated\""));
    assert_eq!(each.plc.queue_depth.unwrap().note, "varied for a study, from 5");
}

#[test]
fn compact_points_need_every_robot_of_a_cell_to_take_them() {
    let (shipped, _) = cell("F").unwrap();
    let compact = shipped.with_each_station(|setup| setup.with_queue_motions(30).with_form_compact());
    crate::check_cell(&compact).unwrap();
    let written = cell_from_text("my", &cell_to_toml(&compact).unwrap()).unwrap();
    assert_eq!(written, compact);
    let mut one = compact;
    one.stations[1].robot.compact_points = None;
    insta::assert_snapshot!(crate::check_cell(&one).unwrap_err(), @r#"setup F: `station.right.robot.compact_points`: plc.form = "compact" needs robots that take compact points; set it to true, or leave plc.form out"#);
}

/// `INSTA_UPDATE=always` writes it again, as for snapshots.
#[test]
fn the_committed_schema_of_cells_is_that_of_the_types() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/cell.schema.json");
    let schema = serde_json::to_string_pretty(&schemars::schema_for!(Cell)).unwrap() + "\n";
    if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
        std::fs::write(path, &schema).unwrap();
    }
    assert!(
        include_str!("../../schemas/cell.schema.json") == schema,
        "the keys of a cell changed: INSTA_UPDATE=always cargo test -p setup the_committed_schema"
    );
}
