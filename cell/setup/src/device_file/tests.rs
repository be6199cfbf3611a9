//! Setups with device files: what they fill in, and what is refused.

use std::path::Path;

use crate::{BusKind, EthernetIpFormat, SETUPS, Setup, cell, setup, setup_from_text, setup_to_toml};

/// Our device file of a kind.
fn file_of(kind: &str) -> (String, String) {
    devices::files().into_iter().find(|(name, _)| name.ends_with(kind) || name.contains(kind)).unwrap()
}

const KINDS: [(&str, &str); 4] = [("A", "GSDML"), ("B", ".eds"), ("C", "robot.xml"), ("D", "GSDML")];

/// Returns a built-in setup whose section of the bus also has these lines.
fn with(name: &str, lines: &str) -> String {
    let (_, text) = SETUPS.iter().find(|(known, _)| *known == name).unwrap();
    text.replacen("[bus]\n", &format!("[bus]\n{lines}\n"), 1)
}

/// Reads a setup with these lines beside these files.
fn read(name: &str, lines: &str, files: &[(&str, &str)]) -> Result<Setup, String> {
    let place = tempfile::tempdir().unwrap();
    for (file, text) in files {
        std::fs::write(place.path().join(file), text).unwrap();
    }
    read_in(place.path(), &with(name, lines))
}

fn read_in(place: &Path, text: &str) -> Result<Setup, String> {
    let path = place.join("my.toml");
    std::fs::write(&path, text).unwrap();
    let place = format!("{}/", place.display());
    setup(path.to_str().unwrap()).map_err(|error| error.to_string().replace(&place, ""))
}

#[test]
fn our_own_files_say_what_our_setups_say_and_the_copy_of_such_a_setup_needs_no_file() {
    for (name, kind) in KINDS {
        let (_, text) = file_of(kind);
        let setup = read(name, "device = \"d\"", &[("d", &text)]).unwrap();
        assert!(setup.bus.device.is_some() && setup.bus.device_paths.is_none());
        let copy = setup_from_text("copy", &setup_to_toml(&setup).unwrap()).unwrap();
        assert_eq!(copy, setup, "{name}");
    }
}

#[test]
fn a_path_is_relative_to_the_setup_and_a_station_of_a_cell_has_a_file_of_its_own() {
    let place = tempfile::tempdir().unwrap();
    std::fs::create_dir(place.path().join("files")).unwrap();
    std::fs::write(place.path().join("files/d.eds"), file_of(".eds").1).unwrap();
    let setup = read_in(place.path(), &with("B", "device = \"files/d.eds\"")).unwrap();
    let BusKind::EthernetIp(_, ethernet_ip) = &setup.bus.kind else { panic!("EtherNet/IP") };
    let adapter = ethernet_ip.adapter.as_ref().unwrap();
    assert_eq!((adapter.consumed_assembly, adapter.consumed_bytes), (150, 256));
    assert_eq!(adapter.consumed_format, EthernetIpFormat::RunIdleHeader);
    let e = crate::CELLS.iter().find(|(name, _)| *name == "E").unwrap().1;
    let right = "kind = \"ethernet-ip\"";
    let path = place.path().join("e.toml");
    let write =
        |line: &str| std::fs::write(&path, e.replacen(right, &format!("{right}\n{line}"), 1)).unwrap();
    write("device = \"files/d.eds\"");
    let (read, _) = cell(path.to_str().unwrap()).unwrap();
    let has_file: Vec<_> = read.stations.iter().map(|station| station.bus.device.is_some()).collect();
    assert_eq!(has_file, [false, true]);
    write("device = \"d.eds\"");
    let said = cell(path.to_str().unwrap()).unwrap_err().to_string();
    assert!(said.contains("`station.right.bus.device`: cannot read "), "{said}");
}

#[test]
fn what_a_file_and_keys_of_the_setup_say_differently_is_refused_with_file_element_and_key() {
    let refused = |name: &str, kind: &str, section: &str| {
        let text = with(name, "device = \"d\"").replacen("[robot]\n", &format!("{section}\n[robot]\n"), 1);
        let place = tempfile::tempdir().unwrap();
        std::fs::write(place.path().join("d"), file_of(kind).1).unwrap();
        read_in(place.path(), &text).map(|_| ()).unwrap_err()
    };
    let profinet = |vendor: &str, module: &str| {
        let section = format!("[bus.profinet.device]\nvendor = {vendor}\ndevice = 1\nmodules = [{module}]\n");
        refused("A", "GSDML", &section)
    };
    insta::assert_snapshot!(profinet("0x2A", ""), @"my.toml:36: `bus.profinet.device.vendor`: 0x002A differs from 0xFFFF of DeviceIdentity VendorID in d; correct it, or leave the section out");
    insta::assert_snapshot!(profinet("0xFFFF", "{ slot = 2, ident = 1, submodules = [{ subslot = 1, ident = 1 }] }"), @"my.toml:38: `bus.profinet.device.modules[0].slot`: slot 2 is empty by d; plug it by `config`, or leave it out");
    insta::assert_snapshot!(profinet("0xFFFF", "{ slot = 1, ident = 0x100, submodules = [{ subslot = 1, ident = 0x101, input_bytes = 64, output_bytes = 256 }] }"), @"my.toml:38: `bus.profinet.device.modules[0].submodules[0].input_bytes`: 64 differs from 256 of IOData Input of subslot 1.1 in d; correct it, or leave the section out");
    let adapter = "[bus.ethernet_ip.adapter]\nconsumed_assembly = 150\nconsumed_bytes = 256\n\
                   produced_assembly = 101\nproduced_bytes = 256\n";
    insta::assert_snapshot!(refused("B", ".eds", adapter), @"my.toml:33: `bus.ethernet_ip.adapter.produced_assembly`: 101 differs from 100 of the path of connection `Exclusive Owner` in d; correct it, or leave the section out");
    let device =
        "[bus.ethercat.device]\nvendor = 0xFFFFFFFF\nproduct = 9\noutput_bytes = 256\ninput_bytes = 256\n";
    insta::assert_snapshot!(refused("C", "robot.xml", device), @"my.toml:25: `bus.ethercat.device.product`: 0x0009 differs from 0x0001 of Type `skillbench-robot` ProductCode in d; correct it, or leave the section out");
}

#[test]
fn a_file_that_does_not_fit_the_setup_is_refused_with_what_would() {
    let [gsdml, eds, esi] = ["GSDML", ".eds", "robot.xml"].map(|kind| file_of(kind).1);
    let refused = |name: &str, lines: &str, files: &[(&str, &str)]| read(name, lines, files).unwrap_err();
    let device = "device = \"d\"";
    insta::assert_snapshot!(refused("A", device, &[]), @"my.toml:20: `bus.device`: cannot read d: No such file or directory (os error 2); the path is relative to the setup's directory");
    insta::assert_snapshot!(refused("A", device, &[("d", &eds)]), @"my.toml:20: `bus.device`: d: the file describes a device of EtherNet/IP, and the setup has profinet; use the robot's file for profinet");
    insta::assert_snapshot!(refused("B", device, &[("d", "<EtherCATConfig/>")]), @"my.toml:20: `bus.device`: d:1: EtherCATConfig: a network configuration (ENI); expected the ESI of a device");
    insta::assert_snapshot!(refused("A", "config = \"c.toml\"", &[]), @"
    my.toml:19: in `bus`: `config` needs the key `device`, a device file
       19 | [bus]
    ");
    let both = "device = \"d\"\nconfig = \"c.toml\"";
    insta::assert_snapshot!(refused("A", both, &[("d", &gsdml), ("c.toml", "slots = 1\n")]), @"
    my.toml:21: `bus.config`: cannot read c.toml: TOML parse error at line 1, column 1
      |
    1 | slots = 1
      | ^^^^^
    unknown field `slots`, expected one of `access_point`, `connection`, `device_name`, `revision`, `pdos`, `modules`
    ");
    insta::assert_snapshot!(refused("A", both, &[("d", &gsdml), ("c.toml", "connection = \"1\"\n")]), @"
    my.toml:21: `bus.config`: d: --connection: not an option of a GSDML; leave it out
      `plc-node io --device 'd' OPTIONS --print-config` prints the file for `config`
    ");
    // Two devices in one file, of which the setup names none.
    let (start, end) = (esi.find("<Device ").unwrap(), esi.find("</Device>").unwrap() + "</Device>".len());
    let second = esi[start..end].replace(">skillbench-robot</Type>", ">other</Type>");
    let two = format!("{}{second}{}", &esi[..start], &esi[start..]);
    insta::assert_snapshot!(refused("C", device, &[("d", &two)]), @"
    my.toml:16: `bus.device`: d: --device-name: the file has 2; choose one
      other --revision 0x00010000  skillbench robot
      skillbench-robot --revision 0x00010000  skillbench robot
      `plc-node io --device 'd' OPTIONS --print-config` prints the file for `config`
    ");
    assert!(read("C", both, &[("d", &two), ("c.toml", "device_name = \"other\"\n")]).is_ok());
    insta::assert_snapshot!(refused("B", device, &[("d", &eds.replace("Param1, 256, Assem100", "Param1, 252, Assem100"))]), @"my.toml:20: `bus.device`: d: 252 bytes from and 256 to the robot: the image has 256 each way; no exclusive-owner connection carries 256 bytes each way: at most 252 from and 256 to the robot; use a file with longer assemblies");
    let slow = gsdml.replace("MinDeviceInterval=\"8\"", "MinDeviceInterval=\"128\"");
    insta::assert_snapshot!(refused("A", device, &[("d", &slow)]), @"my.toml:22: `bus.cycle_us`: 1000 µs: the device file allows at least 4000 µs (MinDeviceInterval)");
    let text = setup_from_text("sent", &with("A", device)).unwrap_err();
    insta::assert_snapshot!(text, @"sent:20: `bus.device`: d: this text of a setup has no directory to find it in; give the setup as a file");
}

#[test]
fn modules_of_an_esi_are_refused_by_name() {
    let coupler = include_str!("../../../../scripts/interop/files/made-up-coupler.xml");
    let said = read("C", "device = \"d\"", &[("d", coupler)]).unwrap_err();
    assert!(
        said.contains("`Power with a status` is a module of an ESI, which a setup does not have yet"),
        "{said}"
    );
}

#[test]
fn a_copy_in_which_somebody_changed_one_of_two_descriptions_is_refused() {
    for (name, kind) in KINDS {
        let setup = read(name, "device = \"d\"", &[("d", &file_of(kind).1)]).unwrap();
        let copy = setup_to_toml(&setup).unwrap();
        let key = match name {
            "B" => "produced_bytes = 256",
            "C" => "input_bytes = 256",
            _ => "input_length = 256",
        };
        let changed = copy.replacen(key, &key.replace("256", "300"), 1);
        assert_ne!(changed, copy, "{name}");
        let said = setup_from_text("copy", &changed).unwrap_err().to_string();
        assert!(said.contains("`bus.chosen_device`: differs from the section of the bus"), "{name}: {said}");
    }
}
