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

/// Returns a device with a mailbox whose process data are entries of their own mapping objects.
fn mapped_into_itself() -> String {
    let pdo = |kind: &str, manager: u8, index: &str, name: &str| {
        format!(
            "<{kind} Sm=\"{manager}\" Fixed=\"1\"><Index>{index}</Index><Name>{name}</Name><Entry><Index>{index}</Index><SubIndex>1</SubIndex>\
             <BitLen>16</BitLen><Name>Value</Name><DataType>UINT</DataType></Entry></{kind}>"
        )
    };
    let managers = [
        ("#x1000", "#x26", "MBoxOut"),
        ("#x1080", "#x22", "MBoxIn"),
        ("#x1100", "#x64", "Outputs"),
        ("#x1180", "#x20", "Inputs"),
    ];
    let managers = managers.map(|(start, control, name)| {
        format!("<Sm DefaultSize=\"128\" StartAddress=\"{start}\" ControlByte=\"{control}\" Enable=\"1\">{name}</Sm>")
    });
    format!(
        "<EtherCATInfo><Vendor><Id>#x2</Id></Vendor><Descriptions><Devices><Device><Type ProductCode=\"8\" RevisionNo=\"1\">MU-SELF</Type>\
         <Name>maps itself</Name><Fmmu>Outputs</Fmmu><Fmmu>Inputs</Fmmu>{}{}{}<Mailbox DataLinkLayer=\"1\"><CoE SdoInfo=\"1\"/></Mailbox>\
         </Device></Devices></Descriptions></EtherCATInfo>",
        managers.concat(),
        pdo("RxPdo", 2, "#x1600", "Out"),
        pdo("TxPdo", 3, "#x1A00", "In"),
    )
}

/// Expects that a device takes an output of 16 bits and returns it.
fn exchanges_sixteen_bits(text: &str) {
    let device = chosen("a.xml", text, "");
    let echo = "[[inputs]]\nplace = \"0x1A00:01\"\necho = { place = \"0x1600:01\" }\n";
    let mut cell = DrivenPair::of(&device, echo, "", &drive_config());
    cell.pair.command_a(|bus, _| bus.set("Out/Value", "4660")).unwrap();
    cell.run_to(3_000);
    assert!(cell.device().is_up(), "{:?}", cell.texts());
    assert_eq!(cell.output("outputs").as_deref(), Some(&[0x34, 0x12][..]));
    assert_eq!(cell.input("In/Value").as_deref(), Some("4660"));
}

#[test]
fn process_data_whose_entries_are_their_own_mapping_objects_are_exchanged() {
    exchanges_sixteen_bits(&mapped_into_itself());
}

#[test]
fn sync_managers_with_names_of_the_makers_have_the_direction_of_their_process_data() {
    exchanges_sixteen_bits(
        &mapped_into_itself()
            .replace(">Outputs</Sm>", ">Setpoints</Sm>")
            .replace(">Inputs</Sm>", ">Feedback</Sm>"),
    );
}

#[test]
fn process_data_may_lie_anywhere_in_the_address_space_of_a_chip() {
    let text = mapped_into_itself().replace("#x1100", "#x8000").replace("#x1180", "#xFFFA");
    exchanges_sixteen_bits(&text);
    let text = text.replace("#xFFFA", "#xFFFC");
    let said = refusal(&text);
    assert!(said.starts_with("SM3 ends at 0x10002, beyond the memory of a chip"), "{said}");
}

#[test]
fn a_mailbox_with_the_control_byte_of_process_data_is_refused() {
    let said = refusal(&mapped_into_itself().replace("#x22", "#x44"));
    assert!(
        said.starts_with("SM1 is MBoxIn with ControlByte 0x44, by which no chip has a mailbox"),
        "{said}"
    );
}

/// Returns why a device is not emulated.
fn refusal(text: &str) -> String {
    let device = chosen("a.xml", text, "").device;
    let emulated = EmulatedDevice::new(device, DeviceScript::default(), emulation_config(), Instant::ZERO);
    emulated.map(drop).unwrap_err().to_string()
}

#[test]
fn twins_of_type_and_revision_are_chosen_by_product_code() {
    let text = mapped_into_itself();
    let (start, end) = (text.find("<Device>").unwrap(), text.find("</Devices>").unwrap());
    let twin = text[start..end].replace("ProductCode=\"8\"", "ProductCode=\"9\"");
    let text = text.replace("</Devices>", &format!("{twin}</Devices>"));
    let file = read("a.xml", text.clone().into()).unwrap();
    let said = choose(&file, &DeviceChoice::default()).unwrap_err().to_string();
    assert!(said.contains("0x00000008 --revision 0x00000001") && said.contains("0x00000009"), "{said}");
    let twin = chosen("a.xml", &text, "device_name = \"0x00000009\"").device;
    assert_eq!(twin, choose(&file, &twin.choice()).unwrap(), "the printed choice makes the same device");
}

#[test]
fn an_emulated_device_takes_the_start_up_commands_of_its_file_without_a_dictionary() {
    let command = |index: &str, subindex: u8| {
        format!(
            "<InitCmd><Transition>PS</Transition><Index>{index}</Index><SubIndex>{subindex}</SubIndex><Data>3412</Data></InitCmd>"
        )
    };
    let commands = [command("#x8000", 1), command("#x8000", 3), command("#x8001", 0)].concat();
    let text =
        mapped_into_itself().replace("<CoE SdoInfo=\"1\"/>", &format!("<CoE SdoInfo=\"1\">{commands}</CoE>"));
    exchanges_sixteen_bits(&text);
    let device = chosen("a.xml", &text, "");
    let mut cell = DrivenPair::of(&device, "", "", &drive_config());
    cell.pair.command_a(|bus, _| bus.read_parameter("0x8000:03:2")).unwrap();
    cell.run_to(3_000);
    assert!(
        cell.texts().iter().any(|text| text.contains("0x8000:03") && text.contains("4660")),
        "{:?}",
        cell.texts()
    );
}
