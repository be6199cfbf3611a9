use crate::{
    BusKind, EthernetIp, EthernetIpFormat, Profinet, SETUPS, Setup, read as parse, setup, setup_to_toml,
    setup_with_directory,
};

/// Returns Setup A's text with one change.
fn changed(from: &str, to: &str) -> String {
    let (_, text) = SETUPS[0];
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1)
}

/// Returns the error for a setup file with this text.
fn refusal(text: &str) -> String {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    std::fs::write(&path, text).unwrap();
    let error = setup(path.to_str().unwrap()).unwrap_err();
    error.to_string().replace(&directory.path().display().to_string(), "DIR")
}

fn profinet_of(setup: &Setup) -> &Profinet {
    match &setup.bus.kind {
        BusKind::Profinet(_, profinet) => profinet,
        other => panic!("{other:?}"),
    }
}

fn ethernet_ip_of(setup: &Setup) -> &EthernetIp {
    match &setup.bus.kind {
        BusKind::EthernetIp(_, ethernet_ip) => ethernet_ip,
        other => panic!("{other:?}"),
    }
}

#[test]
fn listed_peers_are_read_and_written_and_what_their_bus_does_not_tell_is_refused() {
    let with = |name, lines: &str| {
        let built_in = SETUPS.iter().find(|(known, _)| *known == name).unwrap().1;
        built_in.replacen("plc_address", &format!("{lines}\nplc_address"), 1)
    };
    let read = |text: &str| crate::setup_from_text("test", text);
    let listed = "allowed_plcs = [{ address = \"192.168.64.1\", mac = \"02:00:00:00:00:01\" }]\nrobot = { mac = \"02:00:00:00:00:02\" }";
    let setup = read(&with("A", listed)).unwrap();
    assert_eq!(setup.bus.allowed().0.len(), 1);
    assert_eq!(setup.bus.robot.unwrap().mac.unwrap().to_string(), "02:00:00:00:00:02");
    let again = read(&setup_to_toml(&setup).unwrap()).unwrap();
    assert_eq!(again, setup);
    for (name, wrong) in [
        ("A", "allowed_plcs = [{}]"),
        ("A", "robot = { serial_number = 7 }"),
        ("A", "robot = { mac = \"02:00\" }"),
        ("A", "robot = { address = \"192.168.64.2\" }"),
        ("B", "allowed_plcs = [{ mac = \"02:00:00:00:00:01\" }]"),
    ] {
        assert!(read(&with(name, wrong)).is_err(), "{name}: {wrong}");
    }
}

#[test]
fn drives_are_refused_on_an_arm_that_they_cannot_move() {
    let with = |text: String| text.replacen("model = ", "drives = \"ethercat\"\nmodel = ", 1);
    let (_, shipped) = SETUPS[0];
    let read = |text: String| crate::setup_from_text("test", &with(text));
    let setup = read(shipped.to_owned()).unwrap();
    assert_eq!(crate::setup_from_text("test", &setup_to_toml(&setup).unwrap()).unwrap(), setup);
    let refused = |from, to| read(changed(from, to)).unwrap_err().to_string();
    insta::assert_snapshot!(refused("cycle_us = { value = 4000", "cycle_us = { value = 24000"), @"test:37: `robot.cycle_us`: 24000 µs is not a cycle of drives over EtherCAT: 250 to 20000 µs, or leave out robot.drives");
    insta::assert_snapshot!(refused("upper_deg = { value = [132.0", "upper_deg = { value = [30000.0"), @"test:71: `robot.axes.upper_deg`: joint 1: 30000 is more than a drive counts: 32 bits of 100000 increments per degree (mm), so up to 21475; or leave out robot.drives");
    let unknown =
        crate::setup_from_text("test", &with(shipped.to_owned()).replace("\"ethercat\"", "\"sercos\""));
    insta::assert_snapshot!(unknown.unwrap_err(), @r#"
    test:35: in `robot.drives`: unknown value `sercos`, expected `ethercat`
       35 | drives = "sercos"
    "#);
}

#[test]
fn the_error_for_an_unknown_setup_lists_the_existing_ones() {
    insta::assert_snapshot!(setup("Z").unwrap_err(), @"there is no setup `Z`: built in are A, B, C, D, E, F, G; or give the path of a .toml file");
}

#[test]
fn the_error_for_a_missing_file_names_it() {
    insta::assert_snapshot!(setup("no/such.toml").unwrap_err(), @"cannot read the setup file no/such.toml: No such file or directory (os error 2)");
}

#[test]
fn the_error_for_broken_toml_gives_file_line_and_expectation() {
    insta::assert_snapshot!(refusal(&changed("[plc]", "[plc")), @"
    DIR/my.toml:14: unclosed table, expected `]`
       14 | [plc
    ");
}

#[test]
fn the_error_for_an_unknown_key_gives_file_line_key_and_the_one_that_was_meant() {
    insta::assert_snapshot!(refusal(&changed("scan_cost_us", "scan_cost_ms")), @r#"
    DIR/my.toml:16: in `plc.scan_cost_ms`: unknown key `scan_cost_ms`: did you mean `scan_cost_us`?
       16 | scan_cost_ms = { value = 150, from = "assumed", note = "a short program on a fast PLC" }
    "#);
    insta::assert_snapshot!(refusal(&changed("link_1_mm", "link_one_mm")), @r#"
    DIR/my.toml:64: in `robot.kinematics`: unknown key `link_one_mm`, expected one of `link_1_mm`, `link_2_mm`, `height_mm`
       64 | link_one_mm = { value = 225.0, from = "datasheet" }
    "#);
}

#[test]
fn the_error_for_a_value_of_the_wrong_type_gives_its_key() {
    insta::assert_snapshot!(refusal(&changed("{ value = 150,", "{ value = \"short\",")), @r#"
    DIR/my.toml:16: in `plc.scan_cost_us.value`: invalid type: text "short", expected an integer, 0 to 4294967295
       16 | scan_cost_us = { value = "short", from = "assumed", note = "a short program on a fast PLC" }
          |                  ^^^^^
    "#);
    insta::assert_snapshot!(refusal(&changed("\"udp\"", "\"tcp\"")), @r#"
    DIR/my.toml:30: in `bus.profinet.cyclic`: unknown value `tcp`, expected `udp` or `rt1`
       30 | cyclic = "tcp"
    "#);
    insta::assert_snapshot!(refusal(&changed("192.168.64.2", "192.168.64.256")), @r#"
    DIR/my.toml:26: in `bus.robot_address`: not an IPv4 address: expected four numbers of 0 to 255
       26 | robot_address = "192.168.64.256"
    "#);
}

#[test]
fn the_error_for_a_missing_key_names_it() {
    insta::assert_snapshot!(refusal(&changed("model = ", "# model = ")), @"
    DIR/my.toml:34: in `robot`: missing key `model`
       34 | [robot]
    ");
}

#[test]
fn what_only_this_bus_needs_must_be_there() {
    insta::assert_snapshot!(refusal(&changed("robot_address = ", "# robot_address = ")), @r#"
    DIR/my.toml:19: in `bus`: `kind = "profinet"` needs the key `robot_address`
       19 | [bus]
    "#);
}

#[test]
fn a_number_without_its_source_is_refused() {
    insta::assert_snapshot!(refusal(&changed("{ value = 1000, from = \"paper\", note = \"section 6.2\" }", "{ value = 1000 }")), @"
    DIR/my.toml:15: in `plc.scan_cycle_us`: missing key `from`
       15 | scan_cycle_us = { value = 1000 }
    ");
    insta::assert_snapshot!(refusal(&changed("{ value = 1000, from = \"paper\", note = \"section 6.2\" }", "1000")), @r#"
    DIR/my.toml:15: in `plc.scan_cycle_us`: invalid type: integer `1000`, expected a value with its source: { value = ..., from = "paper", "datasheet", "calibrated" or "assumed" }
       15 | scan_cycle_us = 1000
    "#);
}

#[test]
fn wrong_values_are_refused_with_their_key() {
    let refusals = [
        ("schema = 1", "schema = 2"),
        ("scan_cycle_us = { value = 1000", "scan_cycle_us = { value = 0"),
        ("scan_cost_us = { value = 150", "scan_cost_us = { value = 1500"),
        ("\ncycle_us = { value = 1000", "\ncycle_us = { value = 1100"),
        ("\ncycle_us = { value = 1000", "\ncycle_us = { value = 125"),
        ("\ncycle_us = { value = 1000", "\ncycle_us = { value = 2048000"),
        ("watchdog_cycles = { value = 500", "watchdog_cycles = { value = 0"),
        ("watchdog_cycles = { value = 500", "watchdog_cycles = { value = 61441"),
        ("\ncycle_us = { value = 4000", "\ncycle_us = { value = 0"),
        (
            "[bus.profinet]\ncyclic = \"udp\"\nplc_station_name = \"skillbench-plc\"\nrobot_station_name = \"skillbench-robot\"\n",
            "",
        ),
        ("skillbench-plc", "Skillbench PLC"),
        ("robot_address = \"192.168.64.2\"", "robot_address = \"192.168.65.2\""),
        ("255.255.255.0", "255.0.255.0"),
        ("[-132.0, -145.0, 0.0, -355.0]", "[-132.0, -145.0, 0.0]"),
        ("[132.0, 145.0, 200.0, 355.0]", "[132.0, -145.0, 200.0, 355.0]"),
        ("[420.0, 720.0,", "[420.0, 0.0,"),
        ("path_acceleration_mm_s2 = { value = 5000.0", "path_acceleration_mm_s2 = { value = inf"),
        ("acceleration_percent = { value = 50.0", "acceleration_percent = { value = 120.0"),
        ("approximation_mm = { value = 10.0", "approximation_mm = { value = nan"),
        ("number = 1", "number = 16"),
        ("acceleration_percent = { value = 50.0", "acceleration_percent = { value = 1e308"),
        ("title = \"", "title = \"\\u001b[2J"),
        ("model = \"", "model = \"\\u0007"),
        ("\nname = \"A\"", "\nname = \" - \""),
        (
            "\nname = \"A\"",
            "\nname = \"a name that is too long for a directory which has a date in its name too\"",
        ),
    ];
    let said: Vec<_> = refusals.iter().map(|(from, to)| refusal(&changed(from, to))).collect();
    insta::assert_snapshot!(said.join("\n"), @r#"
    DIR/my.toml:4: `schema`: 2 needs a section [[station]] for each robot, found none: add them, or write 1
    DIR/my.toml:15: `plc.scan_cycle_us`: a cycle of 0 µs never ends; 1000 is one millisecond
    DIR/my.toml:16: `plc.scan_cost_us`: a scan that costs 1500 µs does not fit into a cycle of 1000 µs
    DIR/my.toml:21: `bus.cycle_us`: 1100 µs is not a PROFINET cycle: 31.25 µs times a power of two, such as 250, 500, 1000, 2000, 4000
    DIR/my.toml:21: `bus.cycle_us`: 125 µs is not a cycle that can be served over udp: 250 to 1920000 µs
    DIR/my.toml:21: `bus.cycle_us`: 2048000 µs is not a cycle that can be served over udp: 250 to 1920000 µs
    DIR/my.toml:22: `bus.watchdog_cycles`: 0 would give every connection up at once; at least 1, and 3 is usual
    DIR/my.toml:22: `bus.watchdog_cycles`: 61441 cycles of 1000 µs hold for 61441 ms; PROFINET allows 61440 ms over udp, so at most 7680 cycles
    DIR/my.toml:36: `robot.cycle_us`: a cycle of 0 µs never ends; 1000 is one millisecond
    DIR/my.toml:19: in `bus`: `kind = "profinet"` needs a section [bus.profinet]
       19 | [bus]
    DIR/my.toml:31: `bus.profinet.plc_station_name`: `Skillbench PLC` is not a name of station: lower-case letters, digits and hyphens, in labels of 1 to 63 characters with dots between them, 240 in all, and neither an IP address nor port-001
    DIR/my.toml:26: `bus.robot_address`: 192.168.65.2 is not in the subnet of 192.168.64.1
    DIR/my.toml:27: `bus.subnet_mask`: 255.0.255.0 is not a subnet mask
    DIR/my.toml:69: `robot.axes.lower_deg`: found 3 numbers, expected 4, one for each joint
    DIR/my.toml:70: `robot.axes.upper_deg`: joint 2: the upper limit -145 is not above the lower one -145
    DIR/my.toml:71: `robot.axes.speed_deg_s`: 0 is not above 0
    DIR/my.toml:43: `robot.path_acceleration_mm_s2`: inf is not a finite number
    DIR/my.toml:79: `motions.acceleration_percent`: 120 is not a share: above 0, at most 100 %
    DIR/my.toml:80: `motions.approximation_mm`: NaN is not a finite number
    DIR/my.toml:83: `robot.bases[0].number`: 16 is not the number of a frame that can be listed: 1 to 15
    DIR/my.toml:79: `motions.acceleration_percent`: 1e308 is not a share: above 0, at most 100 %
    DIR/my.toml:6: `title`: has the control character U+001B; names and titles are printable text
    DIR/my.toml:35: `robot.model`: has the control character U+0007; names and titles are printable text
    DIR/my.toml:5: `name`: ` - `; give it up to 64 characters, of which one is a letter or a digit
    DIR/my.toml:5: `name`: 72 characters; give it up to 64 characters, of which one is a letter or a digit
    "#);
}

#[test]
fn the_limit_of_the_watchdog_depends_on_the_rt_class() {
    let text = changed("\"udp\"", "\"rt1\"")
        .replace("watchdog_cycles = { value = 500", "watchdog_cycles = { value = 1921");
    insta::assert_snapshot!(refusal(&text), @"DIR/my.toml:22: `bus.watchdog_cycles`: 1921 cycles of 1000 µs hold for 1921 ms; PROFINET allows 1920 ms over rt1, so at most 1920 cycles");
}

/// Returns Setup A with a device of four bytes in each direction, with one change.
fn with_device(from: &str, to: &str) -> String {
    let text = "robot_station_name = \"skillbench-robot\"\n";
    let device = "[bus.profinet.device]\nvendor = 0x0493\ndevice = 2\nmodules = [\n\
        { slot = 0, ident = 1, submodules = [{ subslot = 1, ident = 1 }] },\n\
        { slot = 4, ident = 0x40, submodules = [{ subslot = 1, ident = 0x140, input_bytes = 4, output_bytes = 4 }] },\n]\n";
    changed(text, &format!("{text}{}", device.replacen(from, to, 1)))
}

#[test]
fn a_device_other_than_our_robot_is_described_by_its_modules() {
    let setup = parse::<Setup>("with a device", &with_device("", "")).unwrap();
    let device = profinet_of(&setup).device.as_ref().unwrap();
    assert_eq!((device.vendor, device.modules[1].submodules[0].ident), (0x0493, 0x140));
    let written = setup_to_toml(&setup).unwrap();
    assert_eq!(parse::<Setup>("written", &written).unwrap(), setup, "{written}");
}

#[test]
fn a_device_that_no_connect_request_can_describe_is_refused() {
    insta::assert_snapshot!(refusal(&with_device("slot = 4", "slot = 0")), @"DIR/my.toml:36: `bus.profinet.device.modules`: list every slot once, the lowest first");
    insta::assert_snapshot!(refusal(&with_device("[{ subslot = 1, ident = 1 }]", "[]")), @"DIR/my.toml:37: `bus.profinet.device.modules[0].submodules`: list every subslot once, the lowest first; a module has at least one");
    insta::assert_snapshot!(refusal(&with_device("input_bytes = 4, ", "")), @"DIR/my.toml:36: `bus.profinet.device.modules`: the modules have 0 bytes of input and 4 of output; the process image needs both");
}

#[test]
fn an_application_path_is_relative_to_the_setup_file_and_independent_of_it_for_a_built_in_setup() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    std::fs::write(&path, changed("name = \"A\"", "name = \"mine\"")).unwrap();
    let (mine, from) = setup_with_directory(path.to_str().unwrap()).unwrap();
    assert_eq!((mine.name.as_str(), from.as_deref()), ("mine", Some(directory.path())));
    assert_eq!(setup_with_directory("a").unwrap().1, None);
}

#[test]
fn a_written_setup_is_read_back_unchanged() {
    let setup = setup("A").unwrap();
    let text = setup_to_toml(&setup).unwrap();
    assert_eq!(parse::<Setup>("written", &text).unwrap(), setup, "{text}");
}

#[test]
fn a_written_setup_looks_like_a_shipped_one() {
    let text = setup_to_toml(&setup("A").unwrap()).unwrap();
    let opening: Vec<_> = text.lines().take(17).collect();
    insta::assert_snapshot!(opening.join("\n"), @r#"
    schema = 1
    name = "A"
    title = "Siemens S7-1517, PROFINET, KUKA KR 6 R500 (SCARA)"
    application = "pick-and-place"

    [paper]
    rc = { aet_ms = 3725.0, mad_ms = 3.6 }
    sm = { aet_ms = 6477.0, mad_ms = 11.3 }
    cm = { aet_ms = 3729.0, mad_ms = 3.3 }

    [plc]
    scan_cycle_us = { value = 1000, from = "paper", note = "section 6.2" }
    scan_cost_us = { value = 150, from = "assumed", note = "a short program on a fast PLC" }
    queue_depth = { value = 5, from = "paper", note = "section 5.2: five motions of 44 bytes fit the image" }

    [bus]
    kind = "profinet"
    "#);
}

#[test]
fn ethernet_ip_has_a_range_of_packet_intervals_and_eight_timeout_multipliers() {
    let with = |cycle_us: u32, watchdog: u32, section: &str| {
        let text = changed("\"profinet\"", "\"ethernet-ip\"")
            .replacen("cycle_us = { value = 1000, from = \"paper\", note = \"section 6.2\" }\nwatchdog_cycles = { value = 500,",
                &format!("cycle_us = {{ value = {cycle_us}, from = \"paper\" }}\nwatchdog_cycles = {{ value = {watchdog},"), 1)
            .replacen("[robot]", &format!("{section}\n[robot]"), 1);
        refusal(&text)
    };
    let multiplier = |value: u32| {
        format!("[bus.ethernet_ip]\ntimeout_multiplier = {{ value = {value}, from = \"assumed\" }}\n")
    };
    let said = [with(400, 100, ""), with(1000, 513, ""), with(1000, 100, &multiplier(100))];
    for (said, key) in
        said.iter().zip(["bus.cycle_us", "bus.watchdog_cycles", "bus.ethernet_ip.timeout_multiplier"])
    {
        assert!(said.contains(key), "{said}");
    }
    let text = changed("\"profinet\"", "\"ethernet-ip\"");
    let setup: Setup = parse("the section [bus.profinet] may stay", &text).unwrap();
    crate::check(&setup).unwrap();
    assert_eq!(ethernet_ip_of(&setup).timeout_intervals(&setup.bus.watchdog_cycles), 500);
}

#[test]
fn a_foreign_adapter_is_described_in_the_setup_and_may_support_other_intervals() {
    let with = |route: &str| {
        let adapter = format!(
            "[bus.ethernet_ip]\nmulticast = true\n[bus.ethernet_ip.adapter]\nconsumed_assembly = 770\nconsumed_bytes = 4\n\
             produced_assembly = 769\nproduced_bytes = 16\nroute = {route}\n\n[robot]"
        );
        changed("\"profinet\"", "\"ethernet-ip\"")
            .replacen(
                "cycle_us = { value = 1000, from = \"paper\", note = \"section 6.2\" }\nwatchdog",
                "cycle_us = { value = 400, from = \"paper\" }\nwatchdog",
                1,
            )
            .replacen("[robot]", &adapter, 1)
    };
    let setup: Setup = parse("my.toml", &with("[1, 0]")).unwrap();
    crate::check(&setup).unwrap();
    let adapter = ethernet_ip_of(&setup).adapter.as_ref().unwrap();
    assert_eq!((adapter.consumed_assembly, adapter.produced_bytes, adapter.key), (770, 16, None));
    let odd = refusal(&with("[1]"));
    assert!(odd.contains("bus.ethernet_ip.adapter.route") && odd.contains("even number of bytes"), "{odd}");
    let formats = (adapter.consumed_format, adapter.produced_format);
    assert_eq!(
        formats,
        (EthernetIpFormat::RunIdleHeader, EthernetIpFormat::Modeless),
        "as most adapters have them"
    );
    let other = with("[]\nconsumed_format = \"modeless\"\nproduced_format = \"zero_length\"");
    let setup: Setup = parse("my.toml", &other).unwrap();
    let adapter = ethernet_ip_of(&setup).adapter.as_ref().unwrap();
    let formats = (adapter.consumed_format, adapter.produced_format);
    assert_eq!(formats, (EthernetIpFormat::Modeless, EthernetIpFormat::ZeroLength));
    let heartbeat = refusal(&with("[]\nproduced_format = \"heartbeat\""));
    assert!(heartbeat.contains("carries none of produced_bytes = 16"), "{heartbeat}");
}

#[test]
fn setup_c_differs_from_setup_a_by_its_bus_alone() {
    let (a, c) = (setup("A").unwrap(), setup("C").unwrap());
    let differences = a.differences(&c).unwrap();
    let others: Vec<_> = differences
        .into_iter()
        .map(|difference| difference.key)
        .filter(|key| !key.starts_with("bus.") && !["name", "title", "paper"].contains(&key.as_str()))
        .collect();
    assert_eq!(others, Vec::<String>::new());
}

#[test]
fn ethercat_has_a_range_of_cycles_a_longest_watchdog_and_data_that_fit_one_frame() {
    let (_, text) = SETUPS[2];
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        refusal(&text.replacen(from, to, 1))
    };
    let device = |bytes: u32| {
        let device = "vendor = 2\nproduct = 3\ninput_bytes = 256";
        with("[robot]", &format!("[bus.ethercat.device]\n{device}\noutput_bytes = {bytes}\n\n[robot]"))
    };
    let said = [
        with(
            "\ncycle_us = { value = 1000, from = \"assumed\"",
            "\ncycle_us = { value = 100, from = \"assumed\"",
        ),
        with("watchdog_cycles = { value = 500", "watchdog_cycles = { value = 6554"),
        device(701),
    ];
    insta::assert_snapshot!(said.join("\n"), @"
    DIR/my.toml:17: `bus.cycle_us`: 100 µs is not a cycle of this MainDevice: 250 to 100000 µs
    DIR/my.toml:18: `bus.watchdog_cycles`: 6554 cycles of 1000 µs hold for 6554 ms; the watchdog of a SubDevice has 6553 ms at most, so at most 6553 cycles
    DIR/my.toml:26: `bus.ethercat.device.output_bytes`: 701 bytes cannot carry the process image in one frame: 1 to 700 bytes
    ");
}

/// `INSTA_UPDATE=always` writes it again, as for snapshots.
#[test]
fn the_committed_schema_is_that_of_the_types() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/setup.schema.json");
    let schema = serde_json::to_string_pretty(&schemars::schema_for!(Setup)).unwrap() + "\n";
    if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
        std::fs::write(path, &schema).unwrap();
    }
    assert!(
        include_str!("../../schemas/setup.schema.json") == schema,
        "the keys of a setup changed: INSTA_UPDATE=always cargo test -p setup the_committed_schema"
    );
}

#[test]
fn limits_of_drives_that_no_healthy_motor_keeps_are_refused_and_missing_ones_are_assumed() {
    let text = SETUPS.iter().find(|(known, _)| *known == "A").unwrap().1;
    let refused = |from: &str, to: &str| {
        crate::setup_from_text("test", &text.replacen(from, to, 1)).unwrap_err().to_string()
    };
    let said = [
        refused("torque_percent = { value = 300.0", "torque_percent = { value = 150.0"),
        refused("speed_percent = { value = 120.0", "speed_percent = { value = 90.0"),
        refused("following_error_deg = { value = 1.0", "following_error_deg = { value = 400.0"),
        refused("in_position_deg = { value = 0.0005", "in_position_deg = { value = 2.0"),
        refused("in_position_deg = { value = 0.0005", "in_position_deg = { value = 0.000001"),
        refused("settling_ms = { value = 500", "settling_ms = { value = 0"),
    ];
    insta::assert_snapshot!(said.join("\n"), @"
    test:55: `robot.servo.torque_percent`: 150: must be 200 to 1000 %: twice the rated acceleration, since a drive takes up a robot cycle's change of speed in half of it
    test:54: `robot.servo.speed_percent`: 90: must be 100 to 1000 %: the joint's rated speed
    test:56: `robot.servo.following_error_deg`: 400: must be 0.00001 to 360 degrees (mm): an increment
    test:58: `robot.servo.in_position_deg`: 2: must be 0.00001 to 1 degrees (mm): an increment to the following error
    test:58: `robot.servo.in_position_deg`: 0.000001: must be 0.00001 to 1 degrees (mm): an increment to the following error
    test:59: `robot.servo.settling_ms`: 0 is not above 0
    ");
    let (start, end) = (text.find("[robot.servo]").unwrap(), text.find("[robot.kinematics]").unwrap());
    let without = format!("{}{}", &text[..start], &text[end..]);
    let setup = crate::setup_from_text("test", &without).unwrap();
    assert_eq!(setup.robot.servo, None);
    let driven = setup.with_drives(crate::Drives::Ethercat);
    assert_eq!(driven.robot.servo, Some(crate::Servo::assumed()));
    let again = without.replacen("model = ", "drives = \"ethercat\"\nmodel = ", 1);
    let again = crate::setup_from_text("test", &again).unwrap();
    assert_eq!(again.robot.servo, Some(crate::Servo::assumed()), "as the run directory's setup shows it");
}

#[test]
fn a_bracket_too_many_or_too_few_is_named_with_the_right_header() {
    let said = |from, to| refusal(&changed(from, to));
    insta::assert_snapshot!(said("[plc]", "[[plc]]"), @"
    DIR/my.toml:14: in `plc`: `[[plc]]` begins a list, expected a single table: write `[plc]`
       14 | [[plc]]
    ");
    insta::assert_snapshot!(said("[robot.kinematics]", "[[robot.kinematics]]"), @"
    DIR/my.toml:62: in `robot.kinematics`: `[[robot.kinematics]]` begins a list, expected a single table: write `[robot.kinematics]`
       62 | [[robot.kinematics]]
    ");
    insta::assert_snapshot!(said("[[robot.bases]]", "[robot.bases]"), @"
    DIR/my.toml:82: in `robot.bases`: `[robot.bases]` is a single table, expected a list of them: write `[[robot.bases]]`
       82 | [robot.bases]
    ");
    let both = changed("[[robot.bases]]", "[robot.bases]") + "\n[[robot.bases]]\nnumber = 2\n";
    insta::assert_snapshot!(refusal(&both), @"
    DIR/my.toml:86: `[robot.bases]` in line 82 begins a single table: write `[[robot.bases]]` there too
       86 | [[robot.bases]]
    ");
}

#[test]
fn a_file_that_is_not_utf_8_or_not_a_file_is_refused_with_its_place() {
    let directory = tempfile::tempdir().unwrap();
    let said = |name: &str, bytes: &[u8]| {
        let path = directory.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = setup(path.to_str().unwrap()).unwrap_err();
        error.to_string().replace(&directory.path().display().to_string(), "DIR")
    };
    let latin_1 = b"schema = 1\nname = \"Gr\xFCn\"\n";
    insta::assert_snapshot!(said("latin.toml", latin_1), @"DIR/latin.toml: line 2 has the byte 0xFC, which is not UTF-8: save the file as UTF-8");
    let utf_16: Vec<u8> = "\u{FEFF}schema = 1".encode_utf16().flat_map(u16::to_le_bytes).collect();
    insta::assert_snapshot!(said("wide.toml", &utf_16), @"DIR/wide.toml: the file is in UTF-16: save it as UTF-8");
    insta::assert_snapshot!(said("bare.toml", &utf_16[2..]), @"DIR/bare.toml: the file is in UTF-16: save it as UTF-8");
    insta::assert_snapshot!(said("large.toml", &vec![b' '; 17 << 20]), @"cannot read the setup file DIR/large.toml: it has 17 MiB; such a file has 16 MiB at most");
    #[cfg(unix)]
    insta::assert_snapshot!(setup("/dev/null").unwrap_err(), @"cannot read the setup file /dev/null: it is a pipe or a device; give the path of a file");
}

#[test]
fn an_address_without_quotes_is_refused_with_the_line_to_write() {
    let said = |to: &str| refusal(&changed("plc_address = \"192.168.64.1\"", to));
    insta::assert_snapshot!(said("plc_address = 192.168.64.1"), @"
    DIR/my.toml:25: 192.168.64.1 is a text: write `plc_address = \"192.168.64.1\"`
       25 | plc_address = 192.168.64.1
    ");
    insta::assert_snapshot!(said("plc_address = 10.0.0.1 # of the PLC"), @"
    DIR/my.toml:25: 10.0.0.1 is a text: write `plc_address = \"10.0.0.1\"`
       25 | plc_address = 10.0.0.1 # of the PLC
    ");
}

#[test]
fn forces_and_rates_that_no_arm_has_are_refused() {
    let said = |from, to| refusal(&changed(from, to));
    insta::assert_snapshot!(said("path_jerk_mm_s3 = { value = 500000.0", "path_jerk_mm_s3 = { value = 1e300"), @"DIR/my.toml:44: `robot.path_jerk_mm_s3`: 1e300: must be 0.001 to 1000000000");
    insta::assert_snapshot!(said("path_jerk_mm_s3 = { value = 500000.0", "path_jerk_mm_s3 = { value = 1e-300"), @"DIR/my.toml:44: `robot.path_jerk_mm_s3`: 1e-300: must be 0.001 to 1000000000");
    insta::assert_snapshot!(said("max_n = { value = 100.0", "max_n = { value = 1e300"), @"DIR/my.toml:47: `robot.force.max_n`: 1e300: must be at most 1000000");
    insta::assert_snapshot!(said("tolerance_n = { value = 0.5", "tolerance_n = { value = 1e300"), @"DIR/my.toml:49: `robot.force.tolerance_n`: 1e300: must be at most 1000000");
    insta::assert_snapshot!(said("\njerk_mm_s3 = { value = 50000.0", "\njerk_mm_s3 = { value = 1e300"), @"DIR/my.toml:51: `robot.force.jerk_mm_s3`: 1e300: must be 0.001 to 1000000000");
    insta::assert_snapshot!(said("jerk_deg_s3 = { value = [150000.0", "jerk_deg_s3 = { value = [1e300"), @"DIR/my.toml:73: `robot.axes.jerk_deg_s3`: 1e300: must be 0.001 to 1000000000");
}

#[test]
fn an_arm_of_more_than_ten_metres_is_refused() {
    let said = |from, to| refusal(&changed(from, to));
    insta::assert_snapshot!(said("link_2_mm = { value = 275.0", "link_2_mm = { value = 1e300"), @"DIR/my.toml:65: `robot.kinematics.link_2_mm`: 1e300 mm is more than an arm has: at most 10000 mm");
    insta::assert_snapshot!(said("mm_deg = { value = [300.0", "mm_deg = { value = [30000.0"), @"DIR/my.toml:84: `robot.bases[0].mm_deg`: 30000 mm is more than an arm has: at most 10000 mm");
}
