//! The files that `devices` writes are read back as the stacks' descriptions.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

use device_files::{ConnectionUse, DeviceFile, Eds, Esi, Gsdml, RealTimeFormat, read};
use protocol::stations::{ETHERCAT_ROBOT, ETHERNET_IP_ROBOT, PROFINET_ROBOT};

fn file(part: &str) -> DeviceFile {
    let files = devices::files();
    let (name, text) = files.iter().find(|(name, _)| name.contains(part)).unwrap();
    let read = read(name, text.clone().into()).unwrap();
    assert_eq!(read.warnings(), []);
    read
}

fn gsdml() -> Gsdml {
    let DeviceFile::Gsdml(gsdml) = file("GSDML") else { panic!("another format") };
    gsdml
}

fn eds() -> Eds {
    let DeviceFile::Eds(eds) = file(".eds") else { panic!("another format") };
    eds
}

fn esi() -> Esi {
    let DeviceFile::Esi(esi) = file("robot.xml") else { panic!("another format") };
    esi
}

#[test]
fn a_gsdml_file_is_read_back_with_every_submodule_of_the_device() {
    let gsdml = gsdml();
    let identity = PROFINET_ROBOT.identity;
    assert_eq!((gsdml.vendor_id, gsdml.device_id), (identity.vendor, identity.device));
    let [access_point] = &gsdml.access_points[..] else { panic!("one access point") };
    assert_eq!(access_point.min_device_interval, 8);
    for module in PROFINET_ROBOT.modules {
        let read = match module.slot {
            0 => &access_point.module,
            slot => {
                let placement = access_point.modules.iter().find(|it| it.fixed.contains(slot)).unwrap();
                gsdml.module(&placement.id).unwrap()
            }
        };
        assert_eq!(read.ident, module.ident);
        for submodule in module.submodules {
            let fixed = read.submodules.iter().find(|it| it.fixed_in_subslots.contains(submodule.subslot));
            let system = read.system_submodules.iter().find(|it| it.subslot == submodule.subslot);
            let ident = fixed.map(|it| it.ident).or(system.map(|it| it.ident));
            assert_eq!(ident, Some(submodule.ident), "slot {} subslot {}", module.slot, submodule.subslot);
            let lengths = fixed.map_or((0, 0), |it| (it.inputs.length, it.outputs.length));
            assert_eq!(lengths, (submodule.input_len.into(), submodule.output_len.into()));
        }
    }
}

#[test]
fn an_eds_file_is_read_back_with_every_connection_of_the_adapter() {
    let eds = eds();
    let robot = &ETHERNET_IP_ROBOT;
    assert_eq!(
        (eds.vendor_id, eds.device_type, eds.product_code),
        (robot.vendor, robot.device_type, robot.product_code)
    );
    assert_eq!(eds.product_name, robot.product_name);
    let [owner, input_only, listen_only] = &eds.connections[..] else { panic!("three connections") };
    assert_eq!(owner.uses, [ConnectionUse::ExclusiveOwner]);
    assert_eq!(
        (owner.o_to_t.size, owner.t_to_o.size, owner.configuration_size),
        (Some(256), Some(256), Some(0))
    );
    assert_eq!(owner.o_to_t.real_time_format, RealTimeFormat::Header32Bit);
    assert_eq!(owner.t_to_o.real_time_format, RealTimeFormat::Modeless);
    assert_eq!(owner.t_to_o.types, ["multicast", "point to point"]);
    assert_eq!(owner.path, "20 04 24 97 2C 96 2C 64");
    assert_eq!(owner.o_to_t.rpi_limits_us, Some((robot.min_rpi_us, robot.max_rpi_us)));
    assert_eq!(input_only.uses, [ConnectionUse::InputOnly]);
    assert_eq!(input_only.o_to_t.real_time_format, RealTimeFormat::Heartbeat);
    assert_eq!(listen_only.uses, [ConnectionUse::ListenOnly]);
    assert_eq!(eds.assembly(150).and_then(|assembly| assembly.size), Some(256));
}

#[test]
fn an_esi_file_is_read_back_with_the_process_data_of_the_sub_device() {
    let esi = esi();
    let [device] = &esi.devices[..] else { panic!("one device") };
    let robot = &ETHERCAT_ROBOT;
    assert_eq!(
        (esi.vendor_id, device.product_code, device.revision),
        (robot.vendor_id, robot.product_code, robot.revision)
    );
    let usage: Vec<_> = device.sync_managers.iter().map(|manager| manager.usage.as_str()).collect();
    assert_eq!(usage, ["MBoxOut", "MBoxIn", "Outputs", "Inputs"]);
    let addresses: Vec<_> = device.sync_managers.iter().map(|manager| manager.start_address).collect();
    assert_eq!(addresses, [0x1000, 0x1080, 0x1100, 0x1400]);
    let bits = |pdos: &[device_files::EsiPdo]| pdos.iter().map(|pdo| pdo.bits).sum::<u32>();
    assert_eq!((bits(&device.rx_pdos), bits(&device.tx_pdos)), (2048, 2048));
    assert_eq!(device.rx_pdos[0].sync_manager, Some(2));
    let coe = device.mailbox.as_ref().and_then(|mailbox| mailbox.coe.as_ref()).unwrap();
    assert!(coe.has_sdo_info && coe.has_complete_access && !coe.has_pdo_assign);
    assert_eq!(device.eeprom.as_ref().unwrap().config_data[0], 8);
}
