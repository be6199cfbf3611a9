//! Objects of EtherCAT by complete access and of any length, what a device stored before the connection, and mailboxes with faults.

use driven_device::DriveEvent;

use crate::cell::{Chosen, DrivenPair, ESI, chosen, drive_config};

/// Returns the analog terminal with a list of stored errors, a record of two settings, and a long text.
fn terminal(coe: &str) -> Chosen {
    let entry = |number: u8, name: &str, kind: &str, bits: u16, offset: u16| {
        format!(
            "<SubItem><SubIdx>{number}</SubIdx><Name>{name}</Name><Type>{kind}</Type><BitSize>{bits}</BitSize>\
             <BitOffs>{offset}</BitOffs><Flags><Access>rw</Access></Flags></SubItem>"
        )
    };
    let types = format!(
        "<DataType><Name>USINT</Name><BitSize>8</BitSize></DataType><DataType><Name>UDINT</Name><BitSize>32</BitSize></DataType>\
         <DataType><Name>STRING(300)</Name><BitSize>2400</BitSize></DataType>\
         <DataType><Name>DT1003</Name><BitSize>48</BitSize>{}{}</DataType>\
         <DataType><Name>DT8001</Name><BitSize>64</BitSize>{}{}{}</DataType></DataTypes>",
        entry(0, "Count", "USINT", 8, 0),
        entry(1, "Newest", "UDINT", 32, 16),
        entry(0, "Count", "USINT", 8, 0),
        entry(1, "Gain", "UINT", 16, 16),
        entry(2, "Offset", "UDINT", 32, 32),
    );
    let types = types.replace(
        "</DataTypes>",
        &format!(
            "<DataType><Name>STRING(16)</Name><BitSize>128</BitSize></DataType>\
             <DataType><Name>DT10F3</Name><BitSize>288</BitSize>{}{}{}{}</DataType></DataTypes>",
            entry(0, "Count", "USINT", 8, 0),
            entry(2, "Newest message", "USINT", 8, 16),
            entry(6, "Message 1", "STRING(16)", 128, 32),
            entry(7, "Message 2", "STRING(16)", 128, 160),
        ),
    );
    let value = |name: &str, data: &str| {
        format!("<SubItem><Name>{name}</Name><Info><DefaultData>{data}</DefaultData></Info></SubItem>")
    };
    let long = "4142".repeat(150);
    let objects = format!(
        "<Object><Index>#x1003</Index><Name>Errors</Name><Type>DT1003</Type><BitSize>48</BitSize><Info>{}{}</Info>\
         <Flags><Access>rw</Access></Flags></Object>\
         <Object><Index>#x10F3</Index><Name>Diagnosis history</Name><Type>DT10F3</Type><BitSize>288</BitSize>\
         <Info>{}{}{}{}</Info><Flags><Access>rw</Access></Flags></Object>\
         <Object><Index>#x8001</Index><Name>Settings</Name><Type>DT8001</Type><BitSize>64</BitSize><Info>{}{}{}</Info>\
         <Flags><Access>rw</Access></Flags></Object>\
         <Object><Index>#x8002</Index><Name>Label</Name><Type>STRING(300)</Type><BitSize>2400</BitSize>\
         <Info><DefaultData>{long}</DefaultData></Info><Flags><Access>rw</Access></Flags></Object></Objects>",
        value("Count", "01"),
        value("Newest", "10420000"),
        value("Count", "07"),
        value("Newest message", "07"),
        // Code, flags, number of the text, time.
        value("Message 1", "00E8105400000A000000000000000000"),
        value("Message 2", "00E8104202000B000000000000000000"),
        value("Count", "02"),
        value("Gain", "0500"),
        value("Offset", "07000000"),
    );
    let text = ESI.replace("</DataTypes>", &types).replace("</Objects>", &objects);
    let text = text.replace("<Mailbox><CoE SdoInfo=\"1\"/></Mailbox>", &format!("<Mailbox>{coe}</Mailbox>"));
    chosen("a.xml", &text, "device_name = \"MU1002\"")
}

const PLAIN: &str = "<CoE SdoInfo=\"1\"/>";

fn answers(cell: &DrivenPair) -> Vec<String> {
    cell.texts().into_iter().filter(|text| text.starts_with("answer")).collect()
}

#[test]
fn an_object_is_read_and_written_as_a_whole_and_in_segments() {
    let mut cell = DrivenPair::of(&terminal(PLAIN), "", "", &drive_config());
    let label = "43".repeat(300);
    cell.pair.command_a(|bus, _| {
        bus.read_parameter("0x8001:all").unwrap();
        bus.write_parameter("0x8001:all", "0200090008000000").unwrap();
        bus.read_parameter("Settings/Offset").unwrap();
        bus.read_parameter("Label").unwrap();
        bus.write_parameter("Label", &label).unwrap();
        bus.read_parameter("Label").unwrap();
    });
    cell.run_to(6_000);
    let found = answers(&cell);
    assert_eq!(found[0], "answer 0x8001:all = 0200050007000000", "{found:?}");
    assert_eq!(found[1], "answer 0x8001:all = 0200090008000000");
    assert_eq!(found[2], "answer Settings/Offset = 8");
    assert_eq!(found[3], format!("answer Label = {}", "4142".repeat(150)));
    assert_eq!(found[5], format!("answer Label = {label}"));
    let counters = cell.pair.a().devices()[0].counters();
    assert_eq!((counters.lost, counters.malformed), (0, 0), "the data run meanwhile");
}

#[test]
fn an_init_command_with_complete_access_is_written_at_the_start() {
    let coe = "<CoE SdoInfo=\"1\"><InitCmd CompleteAccess=\"1\"><Transition>PS</Transition><Index>#x8001</Index>\
               <SubIndex>0</SubIndex><Data>02002A0001000000</Data></InitCmd></CoE>";
    let mut cell = DrivenPair::of(&terminal(coe), "", "", &drive_config());
    cell.pair.command_a(|bus, _| bus.read_parameter("Settings/Gain")).unwrap();
    cell.run_to(4_000);
    assert_eq!(answers(&cell), ["answer Settings/Gain = 42"], "{:?}", cell.texts());
}

#[test]
fn errors_that_the_device_stored_before_the_connection_are_said() {
    let mut cell = DrivenPair::of(&terminal(PLAIN), "", "", &drive_config());
    cell.run_to(3_000);
    let said = "earlier stored error 0x4210: temperature";
    assert!(cell.texts().iter().any(|text| text == said), "{:?}", cell.texts());
    assert!(answers(&cell).is_empty(), "the controller's own reads are no answers: {:?}", cell.texts());
}

#[test]
fn the_newest_message_of_the_diagnosis_history_is_said_and_no_older_one() {
    let mut cell = DrivenPair::of(&terminal(PLAIN), "", "", &drive_config());
    cell.run_to(3_000);
    let said: Vec<_> = cell.texts().into_iter().filter(|text| text.contains("message")).collect();
    assert_eq!(
        said,
        ["earlier diagnosis message 0x4210E800: error, temperature; text 0x000B of its ESI"],
        "{:?}",
        cell.texts()
    );
    assert!(answers(&cell).is_empty(), "the controller's own reads are no answers: {:?}", cell.texts());
}

/// Reads an object while the mailbox has a fault, and after it. Returns both answers.
fn with_fault(kind: &str, name: &str) -> [String; 2] {
    let script = format!("[[faults]]\nat = 4\nseconds = 4\nkind = \"{kind}\"\n");
    let mut cell = DrivenPair::of(&terminal(PLAIN), &script, "", &drive_config());
    cell.run_to(4_500);
    cell.pair.command_a(|bus, _| bus.read_parameter(name)).unwrap();
    cell.run_to(9_000);
    cell.pair.command_a(|bus, _| bus.read_parameter(name)).unwrap();
    cell.run_to(13_000);
    let device = &cell.pair.a().devices()[0];
    assert!(device.is_up() && device.counters().lost == 0, "{kind}: the data run: {:?}", cell.texts());
    let downs = cell.events.iter().filter(|event| matches!(event, DriveEvent::Down(..))).count();
    assert_eq!(downs, 0, "{kind}: {:?}", cell.texts());
    answers(&cell).try_into().unwrap()
}

#[test]
fn faults_of_the_mailbox_are_said_or_do_no_harm_and_the_next_access_succeeds() {
    let good = "answer Settings/Gain = 5";
    let no_answer = "answer Settings/Gain: no fitting answer within 1 s; try again";
    let faults = [
        ("mailbox_lost", no_answer),
        ("mailbox_late", no_answer),
        ("mailbox_length", no_answer),
        ("mailbox_protocol", no_answer),
        ("mailbox_doubled", good),
        ("mailbox_counter", good),
        ("mailbox_toggle", good),
        (
            "mailbox_error",
            "answer Settings/Gain: the device refuses the message: mailbox error 0x0007, out of memory",
        ),
    ];
    for (kind, during) in faults {
        assert_eq!(with_fault(kind, "Settings/Gain"), [during, good], "{kind}");
    }
}

#[test]
fn segments_that_are_wrong_or_double_are_told_apart() {
    let good = format!("answer Label = {}", "4142".repeat(150));
    let [during, after] = with_fault("mailbox_toggle", "Label");
    assert_eq!(during, "answer Label: no fitting answer within 1 s; try again");
    assert_eq!(after, good);
    assert_eq!(with_fault("mailbox_doubled", "Label"), [good.clone(), good]);
}

#[test]
fn the_answer_of_an_earlier_access_is_not_taken_for_another_object() {
    let script = "[[faults]]\nat = 4\nkind = \"mailbox_late\"\n";
    let mut cell = DrivenPair::of(&terminal(PLAIN), script, "", &drive_config());
    cell.run_to(4_500);
    cell.pair.command_a(|bus, _| {
        bus.read_parameter("Settings/Gain").unwrap();
        bus.read_parameter("Settings/Offset").unwrap();
    });
    cell.run_to(9_000);
    let found = answers(&cell);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found.iter().all(|answer| answer.contains("no fitting answer")), "{found:?}");
}
