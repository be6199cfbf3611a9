//! Files with shapes of other makers' files, made up: each device is emulated and driven.

use device_files::{DeviceChoice, choose, read};
use emulated_device::{DeviceScript, EmulatedDevice};
use machine::Instant;

use crate::cell::{Chosen, DrivenPair, GSDML, chosen, drive_config, emulation_config};

/// Places of inputs and outputs, each in a sync manager of its own, of four bits each.
const SYNC_MANAGERS: &str = r##"<EtherCATInfo><Vendor><Id>#x2</Id></Vendor><Descriptions><Devices><Device>
<Type ProductCode="7" RevisionNo="1">MU2208</Type><Name>two outputs</Name><Fmmu>Outputs</Fmmu><Fmmu>Outputs</Fmmu>
<Sm StartAddress="#x0F00" ControlByte="#x44" Enable="1">Outputs</Sm><Sm StartAddress="#x0F01" ControlByte="#x44" Enable="1">Outputs</Sm>
<Sm StartAddress="#x1000" ControlByte="0" Enable="1">Inputs</Sm><Sm StartAddress="#x1100" ControlByte="0" Enable="1">Inputs</Sm>
<RxPdo Sm="0"><Index>#x1600</Index><Name>A</Name><Entry><Index>#x7000</Index><SubIndex>1</SubIndex><BitLen>4</BitLen><Name>Out</Name>
<DataType>USINT</DataType></Entry></RxPdo>
<RxPdo Sm="1"><Index>#x1601</Index><Name>B</Name><Entry><Index>#x7010</Index><SubIndex>1</SubIndex><BitLen>4</BitLen><Name>Out</Name>
<DataType>USINT</DataType></Entry></RxPdo>
<TxPdo Sm="3"><Index>#x1A01</Index><Name>D</Name><Entry><Index>#x6010</Index><SubIndex>1</SubIndex><BitLen>16</BitLen><Name>In</Name>
<DataType>UINT</DataType></Entry></TxPdo>
<TxPdo Sm="2"><Index>#x1A00</Index><Name>C</Name><Entry><Index>#x6000</Index><SubIndex>1</SubIndex><BitLen>3</BitLen><Name>In</Name>
<DataType>USINT</DataType></Entry></TxPdo>
<TxPdo Sm="2"><Index>#x1A00</Index><Name>C again</Name></TxPdo>
</Device></Devices></Descriptions></EtherCATInfo>"##;

#[test]
fn data_in_several_sync_managers_of_one_direction_are_exchanged_each_from_a_whole_byte() {
    let device = chosen("a.xml", SYNC_MANAGERS, "");
    let script = "[[inputs]]\nplace = \"0x6000:01\"\ntype = \"uint8\"\nvalue = 5\n\
                  [[inputs]]\nplace = \"0x6010:01\"\ntype = \"uint16\"\nvalue = 4660\n";
    let mut cell = DrivenPair::of(&device, script, "", &drive_config());
    cell.pair.command_a(|bus, _| bus.set("A/Out", "9")).unwrap();
    cell.pair.command_a(|bus, _| bus.set("B/Out", "6")).unwrap();
    cell.run_to(3_000);
    assert!(cell.device().is_up(), "{:?}", cell.texts());
    assert_eq!(cell.output("outputs").as_deref(), Some(&[9, 6][..]));
    assert_eq!(cell.pair.a().devices()[0].inputs().unwrap().bytes(), [5, 0x34, 0x12]);
    assert_eq!((cell.input("C/In").as_deref(), cell.input("D/In").as_deref()), (Some("5"), Some("4660")));
}

#[test]
fn process_data_that_show_registers_are_refused_in_an_emulated_device() {
    let text = SYNC_MANAGERS.replace("#x1100", "#x09AE");
    let device = chosen("a.xml", &text, "").device;
    let error = EmulatedDevice::new(device, DeviceScript::default(), emulation_config(), Instant::ZERO);
    let said = error.map(drop).unwrap_err().to_string();
    assert!(said.starts_with("SM3 shows registers from 0x09AE on, which are not emulated"), "{said}");
    let device = chosen("a.xml", &text, "pdos = [\"0x1600\", \"0x1601\", \"0x1A00\"]").device;
    assert!(EmulatedDevice::new(device, DeviceScript::default(), emulation_config(), Instant::ZERO).is_ok());
}

/// Returns the made-up IO-Device with a module of PROFIsafe in slot 1, one with data in slot 2, and one without a submodule in slot 3.
fn safety_device() -> Chosen {
    let start = GSDML.find("<ModuleItem ID=\"M_2AO\"").unwrap();
    let end = start + GSDML[start..].find("</ModuleItem>").unwrap() + "</ModuleItem>".len();
    let safety = GSDML[start..end]
        .replace("M_2AO", "M_SAFE")
        .replace("ID=\"S_2AO\"", "ID=\"S_SAFE\" PROFIsafeSupported=\"true\"");
    let empty = "<ModuleItem ID=\"M_NONE\" ModuleIdentNumber=\"0x00000077\"><ModuleInfo><Name TextId=\"T_8DI\"/></ModuleInfo></ModuleItem>";
    let reference = "<ModuleItemRef ModuleItemTarget=\"M_8DI\" AllowedInSlots=\"1..4\"/>";
    let references = ["M_SAFE", "M_NONE"].map(|id| reference.replace("M_8DI", id)).concat() + reference;
    let text = GSDML
        .replacen(reference, &references, 1)
        .replace("</ModuleList>", &format!("{safety}{empty}</ModuleList>"));
    chosen("GSDML-V2.35-a.xml", &text, "[modules]\n1 = \"M_SAFE\"\n2 = \"M_2AO\"\n3 = \"M_NONE\"\n")
}

#[test]
fn outputs_count_beside_a_safety_module_and_a_module_without_submodules() {
    let mut cell = DrivenPair::of(&safety_device(), "", "", &drive_config());
    cell.pair.command_a(|bus, _| bus.set("2.1", "01020304")).unwrap();
    cell.run_to(3_000);
    assert!(cell.device().is_up(), "{:?}", cell.texts());
    assert_eq!(cell.output("2.1").as_deref(), Some(&[1, 2, 3, 4][..]));
    assert_eq!(cell.output("1.1"), None, "data of PROFIsafe are never made");
}

#[test]
fn numbers_with_two_prefixes_and_defaults_of_half_a_byte_are_read() {
    let text = SYNC_MANAGERS.replace("<Index>#x7000</Index>", "<Index>#x0x7000</Index>").replace(
        "</Device></Devices>",
        "<Profile><Dictionary><DataTypes><DataType><Name>USINT</Name><BitSize>8</BitSize></DataType></DataTypes><Objects><Object>\
         <Index>#x2000</Index><Name>Half</Name><Type>USINT</Type><BitSize>8</BitSize><Info><DefaultData>0</DefaultData></Info>\
         </Object></Objects></Dictionary></Profile></Device></Devices>",
    );
    let file = read("a.xml", text.into()).unwrap();
    let [warning] = file.warnings() else { panic!("{:?}", file.warnings()) };
    assert!(warning.to_string().ends_with("such as 0800; the default is left out"), "{warning}");
    assert!(choose(&file, &DeviceChoice::default()).is_ok());
}
