//! Device files of other makers, made of ours, with what our robot's do not have.

pub(crate) const GSDML: &str =
    include_str!("../../../protocol/devices/GSDML-V2.4-skillbench-robot-20261127.xml");
pub(crate) const EDS: &str = include_str!("../../../protocol/devices/skillbench-robot.eds");
pub(crate) const ESI: &str = include_str!("../../../protocol/devices/skillbench-robot.xml");

/// The choice from each: modules, connection or process data.
pub(crate) const CHOICES: [(&str, &str); 3] = [
    ("A", "[modules]\n1 = \"M64\"\n2 = \"M128\"\n4 = \"M128\"\n"),
    ("B", "connection = \"1\"\n"),
    ("C", "pdos = [\"0x1600\", \"0x1601\", \"0x1A00\"]\n"),
];

/// Returns the file for the bus of a built-in setup.
pub(crate) fn file(setup: &str) -> String {
    match setup {
        "A" => gsdml(),
        "B" => eds(),
        _ => esi(),
    }
}

/// Returns a setup with these lines in its section of the bus.
pub(crate) fn with_lines(setup: &str, lines: &str) -> String {
    setup.replacen("[bus]\n", &format!("[bus]\n{lines}\n"), 1)
}

/// A device of another maker: modules of 64, 128 and 300 bytes each way for four slots, one of them with a start-up record.
fn gsdml() -> String {
    let (head, rest) = GSDML.split_at(GSDML.find("<ModuleList>").unwrap());
    let rest = &rest[rest.find("</ModuleList>").unwrap()..];
    let refs: String = [64, 128, 300]
        .map(|len| format!("<ModuleItemRef ModuleItemTarget=\"M{len}\" AllowedInSlots=\"1..4\"/>"))
        .concat();
    let head = head
        .replace("VendorID=\"0xFFFF\" DeviceID=\"0x0001\"", "VendorID=\"0x002A\" DeviceID=\"0x0314\"")
        .replace("PhysicalSlots=\"0..1\"", "PhysicalSlots=\"0..4\"")
        .replace("<ModuleItemRef ModuleItemTarget=\"ID_Module1\" FixedInSlots=\"1\"/>", &refs)
        .replace(
            "MaxInputLength=\"261\" MaxOutputLength=\"261\"",
            "MaxInputLength=\"900\" MaxOutputLength=\"900\"",
        );
    let module = |len: u32| {
        let data = format!("<DataItem DataType=\"OctetString\" Length=\"{len}\" TextId=\"IDT_Module1\"/>");
        let record = "<RecordDataList><ParameterRecordDataItem Index=\"7\" Length=\"2\"><Name TextId=\"IDT_Module1\"/>\
                      <Const Data=\"0x12,0x34\"/></ParameterRecordDataItem></RecordDataList>";
        let record = if len == 64 { record } else { "" };
        format!(
            "<ModuleItem ID=\"M{len}\" ModuleIdentNumber=\"0x{len:08X}\"><ModuleInfo><Name TextId=\"IDT_Module1\"/>\
             <InfoText TextId=\"IDT_Module1_Info\"/></ModuleInfo><VirtualSubmoduleList>\
             <VirtualSubmoduleItem ID=\"S{len}\" SubmoduleIdentNumber=\"0x{len:08X}\" FixedInSubslots=\"1\" MayIssueProcessAlarm=\"false\">\
             <IOData><Input>{data}</Input><Output>{data}</Output></IOData>{record}\
             <ModuleInfo><Name TextId=\"IDT_Module1\"/><InfoText TextId=\"IDT_Module1_Info\"/></ModuleInfo>\
             </VirtualSubmoduleItem></VirtualSubmoduleList></ModuleItem>"
        )
    };
    format!("{head}<ModuleList>{}{rest}", [64, 128, 300].map(module).concat())
}

/// An adapter of another maker: longer data, zero length O→T, a header T→O, and two bytes of configuration.
fn eds() -> String {
    EDS.replace("VendCode = 65535", "VendCode = 42")
        .replacen("0x77640405", "0x77644105", 1)
        .replace("Param1, 256, Assem150", "Param1, 300, Assem150")
        .replacen("Param1, 256, Assem100", "Param1, 260, Assem100", 1)
        .replacen("0, Assem151", "2, Assem151", 1)
        .replace("0xC7, 2, \"queue depth\", \"motions\", \"\", ,,,", "0xC7, 2, \"queue depth\", \"motions\", \"\", 0,9,7,")
        .replace(
            "        0,                           $ bytes\n        0x0000,                      $ descriptor\n        ,;",
            "        2, 0x0000, ,, 16, Param36;",
        )
}

/// A SubDevice of another maker: a second object with outputs that is not assigned unless a setup chooses it.
fn esi() -> String {
    let entry = "<Entry><Index>#x0</Index><BitLen>128</BitLen></Entry>";
    let pdo = format!("<RxPdo><Index>#x1601</Index><Name>More</Name>{}</RxPdo><TxPdo ", entry.repeat(4));
    ESI.replace("#xFFFFFFFF", "#x0000002A")
        .replace("ProductCode=\"#x00000001\"", "ProductCode=\"#x00000314\"")
        .replace("StartAddress=\"#x1400\"", "StartAddress=\"#x1800\"")
        .replace("PdoAssign=\"false\"", "PdoAssign=\"true\"")
        .replacen("<TxPdo ", &pdo, 1)
}
