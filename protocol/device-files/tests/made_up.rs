//! Files with the shapes of other makers' files, made up: what is read, what is refused and in which words.

#![expect(clippy::panic, reason = "a test fails by panicking")]

use device_files::{DeviceFile, EsiDevice, Gsdml, read};

fn refusal(name: &str, text: &str) -> String {
    read(name, text.into()).err().map_or_else(|| panic!("{name} is read"), |error| error.to_string())
}

/// Makes a GSDML file from the content of its lists, the first of which is in line 4.
fn gsdml_text(access_point: &str, lists: &str) -> String {
    format!(
        "<ISO15745Profile schemaLocation='x GSDML-DeviceProfile-V2.35.xsd'><ProfileHeader>\
         <ProfileIdentification>PROFINET Device Profile</ProfileIdentification></ProfileHeader>\n\
         <ProfileBody><DeviceIdentity VendorID='0x1' DeviceID='2'><VendorName Value='Maker'/></DeviceIdentity>\n\
         <ApplicationProcess><DeviceAccessPointList><DeviceAccessPointItem ID='DAP' PhysicalSlots='0..3' \
         ModuleIdentNumber='0x10' MinDeviceInterval='32' {access_point}</DeviceAccessPointItem></DeviceAccessPointList>\n\
         {lists}</ApplicationProcess></ProfileBody></ISO15745Profile>"
    )
}

fn gsdml(access_point: &str, lists: &str) -> Gsdml {
    match read("GSDML-V2.35-a.xml", gsdml_text(access_point, lists).into()) {
        Ok(DeviceFile::Gsdml(gsdml)) => gsdml,
        other => panic!("{other:?}"),
    }
}

fn devices(content: &str) -> Vec<EsiDevice> {
    match read("a.xml", esi_text(content).into()) {
        Ok(DeviceFile::Esi(esi)) => esi.devices,
        other => panic!("{other:?}"),
    }
}

fn esi_text(device: &str) -> String {
    format!(
        "<EtherCATInfo><Vendor><Id>#x2</Id></Vendor><Descriptions><Devices><Device>\
         <Type ProductCode='#x1' RevisionNo='2'>D</Type>\n{device}</Device></Devices></Descriptions></EtherCATInfo>"
    )
}

const EDS: &str = "[File]\n[Device]\nVendCode=1;ProdType=12;ProdCode=3;MajRev=1;MinRev=2;\n\
    [Device Classification]\nClass1=EtherNetIP;\n";

#[test]
fn files_of_another_kind_are_refused_by_their_kind() {
    for (name, text, said) in [
        (
            "a.eds",
            "[FileInfo]\nFileName=a\n[DeviceInfo]\n; x\n",
            "a.eds:0: file: an EDS of CANopen; expected one of EtherNet/IP",
        ),
        (
            "a.xml",
            "<EtherCATConfig/>",
            "a.xml:1: EtherCATConfig: a network configuration (ENI); expected the ESI of a device",
        ),
        (
            "a.xml",
            "\n<IODevice/>",
            "a.xml:2: IODevice: an IODD of IO-Link; expected the file of the IO-Link master",
        ),
        (
            "a.xml",
            "<ISO15745ProfileContainer/>",
            "a.xml:1: ISO15745ProfileContainer: a profile of CANopen or POWERLINK; expected a GSDML or ESI file",
        ),
        (
            "a.xml",
            "<ISO15745Profile/>",
            "a.xml:1: ISO15745Profile: profile ``: must be a PROFINET Device Profile",
        ),
        (
            "a.xml",
            "<svg/>",
            "a.xml:1: file: element `svg`: expected ISO15745Profile (GSDML) or EtherCATInfo (ESI)",
        ),
        ("a", "", "a:0: file: section [Device] is missing; expected a GSDML, EDS or ESI file"),
        ("a", "\u{7F}ELF", "a:1: file: an entry before the first section"),
    ] {
        assert_eq!(refusal(name, text), said);
    }
    let device_net = EDS.replace("EtherNetIP", "DeviceNet");
    assert_eq!(
        refusal("a.eds", &device_net),
        "a.eds:4: [Device Classification]: `DeviceNet`: must be EtherNetIP; this device has another network"
    );
}

#[test]
fn xml_that_is_cut_or_not_well_formed_is_refused_with_its_line() {
    for (text, said) in [
        ("<a>\n<b>", "a:2: b: the element does not end; the file is cut"),
        ("<a/>\n<b/>", "a:2: file: a second outermost element; a file has one"),
        ("<a>\n&x;</a>", "a:2: a: `&x;`: not an entity of XML; write `&` as `&amp;`"),
    ] {
        assert_eq!(refusal("a", text), said);
    }
    assert!(refusal("a", "<a>\n</b>").starts_with("a:2: "));
    assert!(refusal("a", "<a>\n<b c=></b></a>").starts_with("a:2: "));
    assert!(refusal("a", &"<a>".repeat(1000)).contains("deeper than 64"));
    let references = format!("<a>{}</a>", "&lt;".repeat(2_400_000));
    assert_eq!(refusal("a", &references), "a:1: a: more than 2400000 tags and texts; split the file");
}

#[test]
fn the_version_that_an_access_point_requires_decides_on_a_warning() {
    let newer = gsdml("RequiredSchemaVersion='V2.99'>", "");
    assert_eq!(newer.warnings.len(), 1);
    assert_eq!(
        newer.warnings[0].to_string(),
        "3: DeviceAccessPointItem DAP: version 2.99 is newer than 2.46; what is new in it is ignored"
    );
    assert_eq!(gsdml("RequiredSchemaVersion='V2.1'>", "").warnings, []);
    let old = gsdml_text(">", "").replace("V2.35", "V1.0");
    assert_eq!(
        refusal("a", &old),
        "a:1: ISO15745Profile: version 1.0: must be 2.0 or newer; ask the maker for one"
    );
}

#[test]
fn modules_submodules_and_records_are_read_with_places_defaults_and_texts() {
    let read = gsdml(
        "><UseableModules><ModuleItemRef ModuleItemTarget='M' AllowedInSlots='1..2 3'/>\
         <ModuleItemRef ModuleItemTarget='Gone'/></UseableModules>",
        "<ModuleList><ModuleItem ID='M' ModuleIdentNumber='0x20'><ModuleInfo><Name TextId='T'/></ModuleInfo>\
         <UseableSubmodules><SubmoduleItemRef SubmoduleItemTarget='S' AllowedInSubslots='2..4'/></UseableSubmodules>\
         </ModuleItem></ModuleList>\
         <SubmoduleList><SubmoduleItem ID='S' SubmoduleIdentNumber='0x30' API='1'><IOData><Input>\
         <DataItem DataType='Unsigned16' TextId='T'><BitDataItem BitOffset='3' TextId='Gone'/></DataItem>\
         <DataItem DataType='OctetString' Length='5'/></Input></IOData><RecordDataList>\
         <ParameterRecordDataItem Index='7' Length='4' TransferSequence='2'><Name TextId='T'/>\
         <Const ByteOffset='0' Data='0x01,0x02,0x03,0x04'/>\
         <Ref DataType='BitArea' ByteOffset='1' BitOffset='4' BitLength='4' DefaultValue='9' ValueItemTarget='V'/>\
         </ParameterRecordDataItem><F_ParameterRecordDataItem Index='8'/></RecordDataList></SubmoduleItem></SubmoduleList>\
         <ValueList><ValueItem ID='V'><Assignments><Assign Content='9' TextId='T'/></Assignments></ValueItem></ValueList>\
         <ChannelDiagList><ChannelDiagItem ErrorType='256'><Name TextId='T'/><ExtChannelDiagList>\
         <ExtChannelDiagItem ErrorType='5'/></ExtChannelDiagList></ChannelDiagItem></ChannelDiagList>\
         <ExternalTextList><PrimaryLanguage><Text TextId='T' Value='Größe &lt;1&gt;'/></PrimaryLanguage></ExternalTextList>",
    );
    let warnings: Vec<_> = read.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(
        warnings,
        [
            "3: ModuleItemRef: ModuleItemTarget `Gone` is not in the file; ignored",
            "4: BitDataItem: TextId `Gone` is not in the file; shown as it is",
        ]
    );
    let placement = &read.access_point("DAP").unwrap().modules[0];
    assert!(placement.fits(3) && !placement.fits(0) && placement.allowed.to_string() == "1..2 3");
    assert_eq!(read.module("M").unwrap().name, "Größe <1>");
    let submodule = read.submodule("S").unwrap();
    assert_eq!((submodule.inputs.length, submodule.outputs.length, submodule.api), (7, 0, 1));
    let [safety, record] = &submodule.records[..] else { panic!("two records") };
    assert!(safety.is_safety && !record.is_safety);
    assert_eq!(record.default, [1, 0x92, 3, 4]);
    assert_eq!(read.values[0].texts[0].value, 9);
    let types: Vec<_> = read.channel_diagnosis.iter().map(|it| (it.error_type, it.extended_type)).collect();
    assert_eq!(types, [(256, None), (256, Some(5))]);
}

#[test]
fn faults_of_a_gsdml_file_name_line_and_element() {
    let record = |inner: &str| {
        format!(
            "<SubmoduleList><SubmoduleItem ID='S' SubmoduleIdentNumber='1'>\n<RecordDataList>\
             <ParameterRecordDataItem Index='1' Length='2'>{inner}</ParameterRecordDataItem></RecordDataList>\
             </SubmoduleItem></SubmoduleList>"
        )
    };
    for (lists, said) in [
        (
            "<ModuleList><ModuleItem ID='M'/></ModuleList>".to_owned(),
            "4: ModuleItem M: attribute ModuleIdentNumber is missing; add it",
        ),
        (
            "<ModuleList><ModuleItem ID='M' ModuleIdentNumber='x'/></ModuleList>".to_owned(),
            "4: ModuleItem M: ModuleIdentNumber `x`: must be a number from 0 to 4294967295",
        ),
        (
            "<ModuleList><ModuleItem ID='M'/><ModuleItem ID='M'/></ModuleList>".to_owned(),
            "4: ModuleItem M: the ID is there twice; rename one",
        ),
        (
            record("<Ref DataType='Unsigned32' ByteOffset='0'/>"),
            "5: Ref: 4 bytes at byte 0 of a record of 2 bytes; enlarge its Length",
        ),
        (
            record("<Ref DataType='Unsigned8' ByteOffset='0' DefaultValue='a'/>"),
            "5: Ref: DefaultValue `a` does not fit DataType `Unsigned8`; correct it",
        ),
        (record("<Const Data='0xZZ'/>"), "5: Const: Data must be bytes such as `0x01,0x02`"),
    ] {
        assert_eq!(refusal("a", &gsdml_text(">", &lists)), format!("a:{said}"));
    }
    assert_eq!(
        refusal("a", &gsdml_text("FixedInSlots='5..2'>", "")),
        "a:3: DeviceAccessPointItem DAP: FixedInSlots `5..2`: must be numbers such as `0..3 8`"
    );
}

#[test]
fn sizes_of_an_eds_are_those_of_assemblies_members_and_parameters() {
    let text = format!(
        "{EDS}[Params]\nParam1=0,,,0,0xC7,2,\"Speed\",\"rpm\",\"\",0,100,8,,,,,,,,,0;\nEnum1=0,\"Off\",8,\"On\";\n\
         [Assembly]\nAssem1=\"In\",\"20 04 24 01\",,0,,,8,Param1,,Assem2;\nAssem2=\"Part\",,,0,,,,Param1;\n\
         [Connection Manager]\nConnection1=0x04010002,0x44640405,,,Assem1,20000,Param1,Assem2,,,4,,\"Owner\",\"\",\"20 04\";\n"
    );
    let Ok(DeviceFile::Eds(eds)) = read("a.eds", text.clone().into()) else { panic!("refused") };
    let sizes: Vec<_> = eds.assemblies.iter().map(|assembly| assembly.size).collect();
    assert_eq!(sizes, [Some(3), Some(2)], "8 bits, and the 2 bytes of the parameter in the other assembly");
    let [connection] = &eds.connections[..] else { panic!("one connection") };
    assert_eq!((connection.o_to_t.size, connection.t_to_o.size), (Some(3), Some(8)));
    assert_eq!((connection.o_to_t.rpi_us, connection.t_to_o.rpi_us), (None, Some(20_000)));
    assert_eq!(connection.configuration_size, Some(4));
    assert_eq!(eds.parameter(1).unwrap().texts[1].text, "On");
    for (from, to, said) in [
        (
            "Assem2=\"Part\",,,0,,,,Param1",
            "Assem2=\"Part\",,,0,,,,Assem1",
            "Assem2 field 7: Assem2 names itself through others; remove the ring",
        ),
        ("8,Param1,,Assem2", ",Param9,,Assem2", "Assem1 field 8: `Param9` is not in the file; add it"),
        (
            "20000,Param1,Assem2",
            "20000,Param1,Assem7",
            "Connection1 field 8: `Assem7` is not in the file; add it",
        ),
        ("Enum1=", "Enum4=", "Enum4 field 1: Param4 is not in the file; add it or remove its texts"),
        ("0x04010002", "0x104010002", "Connection1 field 1: `0x104010002`: must be a number of 32 bits"),
    ] {
        assert!(text.contains(from));
        let found = refusal("a", &text.replace(from, to));
        assert!(found.ends_with(said), "{found}");
    }
}

#[test]
fn an_esi_device_is_read_with_its_pdos_commands_clock_and_dictionary() {
    let devices = devices(
        "<Name LcId='1031'>Klemme</Name><Name LcId='1033'>Terminal</Name><Sm StartAddress='#x1000' ControlByte='#x44'>Outputs</Sm>\
         <TxPdo Sm='3'><Index>#x1a00</Index><Exclude>#x1a01</Exclude><Name>In</Name><Entry><Index>#x6000</Index>\
         <SubIndex>17</SubIndex><BitLen>16</BitLen><DataType>INT</DataType></Entry><Entry><Index>0</Index><BitLen>4</BitLen></Entry></TxPdo>\
         <TxPdo Ref='Other'/><Mailbox><CoE PdoAssign='1'><InitCmd><Transition>PS</Transition><Index>#x1C32</Index>\
         <SubIndex>1</SubIndex><Data>0100</Data></InitCmd></CoE><FoE/></Mailbox>\
         <Dc><OpMode><Name>DC</Name><AssignActivate>#x300</AssignActivate><CycleTimeSync0 Factor='1'>0</CycleTimeSync0></OpMode></Dc>\
         <Profile><Dictionary><DataTypes><DataType><Name>DT1018</Name><BitSize>80</BitSize><SubItem><SubIdx>0</SubIdx>\
         <Name>SubIndex 000</Name><Type>USINT</Type><BitSize>8</BitSize></SubItem><SubItem><Name>Elements</Name>\
         <Type>ARR</Type></SubItem></DataType><DataType><Name>ARR</Name><BaseType>UDINT</BaseType><BitSize>64</BitSize>\
         <ArrayInfo><LBound>1</LBound><Elements>2</Elements></ArrayInfo></DataType></DataTypes><Objects><Object>\
         <Index>#x1018</Index><Name>Identity</Name><Type>DT1018</Type><Info><SubItem><Name>Count</Name><Info><DefaultData>02</DefaultData>\
         </Info></SubItem><SubItem><Name>Vendor ID</Name><Info><DefaultValue>#x2</DefaultValue></Info></SubItem></Info></Object>\
         </Objects></Dictionary></Profile>",
    );
    let [device] = &devices[..] else { panic!("one device") };
    assert_eq!((device.name.as_str(), device.product_code, device.revision), ("Terminal", 1, 2));
    let [pdo] = &device.tx_pdos[..] else { panic!("one PDO") };
    assert_eq!((pdo.index, pdo.bits, &pdo.excludes[..]), (0x1A00, 20, &[0x1A01][..]));
    let mailbox = device.mailbox.as_ref().unwrap();
    assert_eq!(mailbox.protocols, ["CoE", "FoE"]);
    let coe = mailbox.coe.as_ref().unwrap();
    assert!(coe.has_pdo_assign && coe.init_commands[0].data == [1, 0]);
    assert_eq!(device.dc_modes[0].assign_activate, 0x300);
    let [object] = &device.dictionary.as_ref().unwrap().objects[..] else { panic!("one object") };
    let entries: Vec<_> =
        object.entries.iter().map(|it| (it.subindex, it.name.as_str(), it.bits, &it.default[..])).collect();
    assert_eq!(
        entries,
        [
            (0, "Count", 8, &[2][..]),
            (1, "Vendor ID", 32, &[2, 0, 0, 0][..]),
            (2, "SubIndex 002", 32, &[][..])
        ]
    );
}

#[test]
fn faults_of_an_esi_file_name_line_and_element() {
    let dictionary = |types: &str| {
        format!(
            "<Profile><Dictionary><DataTypes>{types}</DataTypes><Objects><Object><Index>1</Index><Type>A</Type></Object>\
             </Objects></Dictionary></Profile>"
        )
    };
    let array = |name: &str, base: &str, count: u32| {
        format!(
            "<DataType><Name>{name}</Name><BaseType>{base}</BaseType><ArrayInfo><LBound>1</LBound>\
             <Elements>{count}</Elements></ArrayInfo></DataType>"
        )
    };
    let item = "<DataType><Name>A</Name><SubItem><Type>B</Type></SubItem></DataType>";
    for (device, said) in [
        ("<RxPdo/>".to_owned(), "2: RxPdo: element Index is missing; add it"),
        (
            "<RxPdo><Index>#x10000</Index></RxPdo>".to_owned(),
            "2: Index: `#x10000`: must be a number from 0 to 65535",
        ),
        (
            "<Eeprom><ConfigData>080</ConfigData></Eeprom>".to_owned(),
            "2: ConfigData: `080`: must be bytes in hexadecimal, such as 0800",
        ),
        (
            dictionary(&[item, &array("B", "C", 1), &array("C", "B", 1)].concat()),
            "2: DataType: type `B` names itself through others; remove the ring",
        ),
        (
            dictionary(&[item, &array("B", "UINT", 256)].concat()),
            "2: DataType: 256 elements from 1: an object has 255 entries at most",
        ),
    ] {
        assert_eq!(refusal("a", &esi_text(&device)), format!("a:{said}"));
    }
}
