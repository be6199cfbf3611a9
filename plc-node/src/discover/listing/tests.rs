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
    ──────────────────────────────────────────────────────────────────────────────────────────────────────────
     IP address     Product            Vendor   Type   Code   Revision   Serial number   Status   State
    ──────────────────────────────────────────────────────────────────────────────────────────────────────────
     192.168.64.2   skillbench robot   65535    43     1      1.001      0x12345678      0x0000   operational
    ──────────────────────────────────────────────────────────────────────────────────────────────────────────

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
