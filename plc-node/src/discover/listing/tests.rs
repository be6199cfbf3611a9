use super::super::found_device::roles;
use super::*;

fn listing() -> Listing {
    Listing {
        interface: "eth0".to_owned(),
        timeout_ms: 2_000,
        profinet: Some(vec![Station {
            name: "skillbench-robot".to_owned(),
            mac: "02:00:00:00:00:02".to_owned(),
            ip_address: None,
            subnet_mask: None,
            gateway: None,
            type_of_station: "skillbench robot".to_owned(),
            vendor_id: Some(0x0493),
            device_id: None,
            roles: roles(0b11),
        }]),
        ethernet_ip: Some(vec![Device {
            ip_address: Ipv4Addr::new(192, 168, 64, 2),
            mac_addresses: Some(vec!["02:00:00:00:00:03".to_owned()]),
            listens_at: "192.168.64.2:44818".to_owned(),
            product_name: "skillbench robot".to_owned(),
            vendor_id: 0xFFFF,
            device_type: 0x2B,
            product_code: 1,
            revision: "1.001".to_owned(),
            serial_number: 0x1234_5678,
            status: 0,
            state: 3,
        }]),
        ethercat: None,
        conflicts: Vec::new(),
        skipped: Vec::new(),
        ignored_answers: 2,
    }
}

#[test]
fn each_bus_has_a_table_with_its_own_columns() {
    insta::assert_snapshot!(listing().to_string(), @"
    PROFINET: 1 station
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     Station name       MAC address         IP address   Type of station    VendorID   DeviceID   Roles
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     skillbench-robot   02:00:00:00:00:02   (none)       skillbench robot   0x0493     –          IO-Device, IO-Controller
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────

    EtherNet/IP: 1 device
    ──────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     IP address     MAC address         Product            Vendor   Type   Code   Revision   Serial number   Status   State
    ──────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     192.168.64.2   02:00:00:00:00:03   skillbench robot   65535    43     1      1.001      0x12345678      0x0000   operational
    ──────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────

    2 broken or foreign answers were ignored.
    ");
}

#[test]
fn the_json_has_a_list_for_each_searched_bus_and_null_for_others() {
    let skipped = vec![Skipped { bus: Bus::EthernetIp, reason: "no address".to_owned() }];
    let listing = Listing { ethernet_ip: None, skipped, ..listing() };
    insta::assert_snapshot!(listing.to_json().unwrap(), @r#"
    {
      "interface": "eth0",
      "timeout_ms": 2000,
      "profinet": [
        {
          "name": "skillbench-robot",
          "mac": "02:00:00:00:00:02",
          "ip_address": null,
          "subnet_mask": null,
          "gateway": null,
          "type_of_station": "skillbench robot",
          "vendor_id": 1171,
          "device_id": null,
          "roles": [
            "IO-Device",
            "IO-Controller"
          ]
        }
      ],
      "ethernet_ip": null,
      "ethercat": null,
      "conflicts": [],
      "skipped": [
        {
          "bus": "ethernet-ip",
          "reason": "no address"
        }
      ],
      "ignored_answers": 2
    }
    "#);
}

#[test]
fn a_search_without_answers_says_what_was_searched() {
    let nothing = Listing {
        profinet: Some(Vec::new()),
        ethernet_ip: Some(Vec::new()),
        ignored_answers: 0,
        ..listing()
    };
    insta::assert_snapshot!(nothing.to_string(), @r"
    PROFINET: no station answered DCP Identify on eth0, asked 3 times in 2000 ms.

    EtherNet/IP: no device answered ListIdentity on eth0, asked 3 times in 2000 ms.
    ");
}

fn station(mac: u8, name: &str, host: Option<u8>) -> Station {
    let station = listing().profinet.unwrap().remove(0);
    Station {
        name: name.to_owned(),
        mac: format!("02:00:00:00:00:{mac:02X}"),
        ip_address: host.map(|host| Ipv4Addr::new(192, 168, 64, host)),
        ..station
    }
}

fn device(host: u8, serial_number: u32, macs: Option<&[&str]>) -> Device {
    let device = listing().ethernet_ip.unwrap().remove(0);
    let mac_addresses = macs.map(|macs| macs.iter().map(|mac| (*mac).to_owned()).collect());
    Device { ip_address: Ipv4Addr::new(192, 168, 64, host), mac_addresses, serial_number, ..device }
}

/// Returns the lines about conflicts. Each device's stations answered ARP for its address.
fn found_conflicts(stations: &[Station], devices: &[Device]) -> Vec<String> {
    let hosts = devices
        .iter()
        .filter_map(|device| Some((device.ip_address, device.mac_addresses.clone()?)))
        .collect();
    conflicts(stations, devices, &hosts).iter().map(Conflict::to_string).collect()
}

#[test]
fn twins_and_shared_addresses_are_marked_and_named_with_their_mac_addresses() {
    let stations = vec![
        station(1, "valves", Some(2)),
        station(2, "valves", None),
        station(3, "drives", Some(2)),
        station(4, "", None),
        station(5, "", None),
    ];
    let one = device(7, 0x10, Some(&["02:00:00:00:00:11", "02:00:00:00:00:12"]));
    let two = device(8, 0x10, Some(&["02:00:00:00:00:13"]));
    let devices = vec![one, two];
    let hosts = BTreeMap::from([(
        Ipv4Addr::new(192, 168, 64, 7),
        vec!["02:00:00:00:00:11".to_owned(), "02:00:00:00:00:12".to_owned()],
    )]);
    let conflicts = conflicts(&stations, &devices, &hosts);
    let listing = Listing {
        profinet: Some(stations),
        ethernet_ip: Some(devices),
        conflicts,
        ignored_answers: 0,
        ..listing()
    };
    insta::assert_snapshot!(listing.to_string(), @"
    PROFINET: 5 stations
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     Station name   MAC address         IP address       Type of station    VendorID   DeviceID   Roles
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     valves !       02:00:00:00:00:01   192.168.64.2 !   skillbench robot   0x0493     –          IO-Device, IO-Controller
     valves !       02:00:00:00:00:02   (none)           skillbench robot   0x0493     –          IO-Device, IO-Controller
     drives         02:00:00:00:00:03   192.168.64.2 !   skillbench robot   0x0493     –          IO-Device, IO-Controller
     (none)         02:00:00:00:00:04   (none)           skillbench robot   0x0493     –          IO-Device, IO-Controller
     (none)         02:00:00:00:00:05   (none)           skillbench robot   0x0493     –          IO-Device, IO-Controller
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────

    EtherNet/IP: 2 devices
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     IP address       MAC address                            Product            Vendor   Type   Code   Revision   Serial number   Status   State
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────
     192.168.64.7 !   02:00:00:00:00:11, 02:00:00:00:00:12   skillbench robot   65535    43     1      1.001      0x00000010 !    0x0000   operational
     192.168.64.8     02:00:00:00:00:13                      skillbench robot   65535    43     1      1.001      0x00000010 !    0x0000   operational
    ───────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────

    ! 2 devices have the station name valves: 02:00:00:00:00:01 (192.168.64.2), 02:00:00:00:00:02; rename all but one
    ! 2 devices have the IP address 192.168.64.2: 02:00:00:00:00:01 (valves), 02:00:00:00:00:03 (drives); give all but one another address
    ! 2 devices have the IP address 192.168.64.7: 02:00:00:00:00:11, 02:00:00:00:00:12; give all but one another address
    ! 2 devices have the serial number 0x00000010: 02:00:00:00:00:11 or 02:00:00:00:00:12 (192.168.64.7), 02:00:00:00:00:13 (192.168.64.8); an originator takes them for one device; ask the maker for another number
    ");
    let json: Vec<_> = listing.conflicts.iter().map(|it| serde_json::to_string(it).unwrap()).collect();
    assert_eq!(
        json[0],
        r#"{"shared":"station-name","value":"valves","devices":[{"mac":"02:00:00:00:00:01","station_name":"valves","ip_address":"192.168.64.2","serial_number":null},{"mac":"02:00:00:00:00:02","station_name":"valves","ip_address":null,"serial_number":null}],"remedy":"rename all but one"}"#
    );
    let shared = |json: &String| json.split("\"devices\"").next().unwrap().to_owned();
    assert_eq!(
        json.iter().map(shared).skip(1).collect::<Vec<_>>(),
        [
            r#"{"shared":"ip-address","value":"192.168.64.2","#,
            r#"{"shared":"ip-address","value":"192.168.64.7","#,
            r#"{"shared":"serial-number","value":"0x00000010","#,
        ]
    );
}

#[test]
fn names_that_differ_in_case_only_are_twins() {
    let stations = [station(1, "valves", None), station(2, "Valves", None)];
    assert_eq!(
        found_conflicts(&stations, &[]),
        ["2 devices have the station name valves: 02:00:00:00:00:01, 02:00:00:00:00:02; rename all but one"]
    );
    assert!(
        marked(
            &conflicts(&stations, &[], &BTreeMap::new()),
            SharedProperty::StationName,
            "Valves".to_owned()
        )
        .ends_with(" !")
    );
}

#[test]
fn stations_without_a_name_or_an_address_and_devices_of_two_vendors_share_nothing() {
    let stations = [station(1, "", None), station(2, "", None), station(3, "valves", Some(2))];
    let other_vendor = Device { vendor_id: 1, ..device(4, 0x10, None) };
    assert_eq!(found_conflicts(&stations, &[device(3, 0x10, None), other_vendor]), [""; 0]);
}

#[test]
fn a_device_on_both_buses_or_with_two_addresses_is_one_device() {
    let mac = "02:00:00:00:00:01";
    let stations = [station(1, "valves", Some(2))];
    assert_eq!(found_conflicts(&stations, &[device(2, 0x10, Some(&[mac]))]), [""; 0]);
    let multihomed = [device(2, 0x10, Some(&[mac])), device(3, 0x10, Some(&[mac]))];
    assert_eq!(found_conflicts(&[], &multihomed), [""; 0]);
}

#[test]
fn a_station_and_a_device_of_another_mac_address_at_one_ip_address_are_named() {
    let stations = [station(1, "valves", Some(2))];
    let devices = [device(2, 0x10, Some(&["02:00:00:00:00:09"]))];
    assert_eq!(
        found_conflicts(&stations, &devices),
        [
            "2 devices have the IP address 192.168.64.2: 02:00:00:00:00:01 (valves), 02:00:00:00:00:09; give all but one another \
          address"
        ]
    );
}

#[test]
fn devices_whose_mac_addresses_are_not_known_are_named_by_serial_number_and_address() {
    let devices = [device(2, 0x10, None), device(2, 0x11, None), device(3, 0x11, None)];
    assert_eq!(
        found_conflicts(&[], &devices),
        [
            "2 devices have the IP address 192.168.64.2: unknown MAC address (serial number 0x00000010), unknown MAC address \
             (serial number 0x00000011); give all but one another address",
            "2 devices have the serial number 0x00000011: unknown MAC address (192.168.64.2), unknown MAC address \
             (192.168.64.3); an originator takes them for one device; ask the maker for another number",
        ]
    );
}

#[test]
fn a_line_names_at_most_twelve_devices_and_counts_the_others() {
    let stations: Vec<_> = (1..=20).map(|mac| station(mac, "valves", None)).collect();
    let lines = found_conflicts(&stations, &[]);
    assert!(
        lines[0].starts_with("20 devices have") && lines[0].contains(":0C and 8 more; rename"),
        "{lines:?}"
    );
}

/// `INSTA_UPDATE=always` writes it again, as for snapshots.
#[test]
#[expect(clippy::disallowed_methods, reason = "the test compares a file of this crate")]
fn the_committed_schema_matches_the_listing() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/schemas/discover.schema.json");
    let schema = serde_json::to_string_pretty(&schemars::schema_for!(Listing)).unwrap() + "\n";
    if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
        std::fs::write(path, &schema).unwrap();
    }
    assert!(
        std::fs::read_to_string(path).unwrap_or_default() == schema,
        "the listing changed: INSTA_UPDATE=always cargo test -p plc-node --lib discover"
    );
}
