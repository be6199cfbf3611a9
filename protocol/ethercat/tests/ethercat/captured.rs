//! Requests that were sent to hardware, sent to an emulated device with the same process data: its answers are those of
//! the hardware, byte for byte but for reserved ones. Where the bytes are from: `vectors/README.md`.

use ethercat_subdevice::description::{
    Access, DataType, Description, Entry, Mailbox, Object, ObjectCode, Pdo, PdoEntry,
};
use ethercat_subdevice::{DeviceConfig, Segment};

use crate::raw_main_device::RawMainDevice;

/// Length of the mailboxes in bytes. The EK1914's have 256; messages say their own length.
const MAILBOX: usize = 128;

const fn entry(index: u16, subindex: u8, bits: u8) -> PdoEntry {
    PdoEntry { index, subindex, bits, data_type: DataType::Unsigned32, name: "Entry" }
}

const fn gap(bits: u8) -> PdoEntry {
    entry(0, 0, bits)
}

/// Returns the status bits and the value of one channel.
const fn channel(index: u16) -> [PdoEntry; 10] {
    [
        entry(index, 1, 1),
        entry(index, 2, 1),
        entry(index, 3, 2),
        entry(index, 5, 2),
        entry(index, 7, 1),
        gap(1),
        gap(6),
        entry(index, 15, 1),
        entry(index, 16, 1),
        entry(index, 17, 16),
    ]
}

static CHANNELS: [[PdoEntry; 10]; 4] = [channel(0x6000), channel(0x6010), channel(0x6020), channel(0x6030)];

const fn pdo(index: u16, entries: &'static [PdoEntry]) -> Pdo {
    Pdo { index, name: "PDO", entries }
}

static EL3004: Description = Description {
    vendor_id: 2,
    product_code: 0x0BBC_3052,
    revision: 0x0015_0000,
    order_code: "EL3004",
    name: "Four analogue inputs",
    group: "Test devices",
    device_type: 0,
    hardware_version: "08",
    software_version: "08",
    outputs: &[],
    inputs: &[
        pdo(0x1A00, &CHANNELS[0]),
        pdo(0x1A02, &CHANNELS[1]),
        pdo(0x1A04, &CHANNELS[2]),
        pdo(0x1A06, &CHANNELS[3]),
    ],
    mailbox: Some(Mailbox { len: MAILBOX as u16, file_capacity: 0 }),
    objects: &[Object {
        index: 0xF008,
        name: "Code word",
        code: ObjectCode::Variable,
        entries: &[Entry {
            subindex: 0,
            name: "Code word",
            data_type: DataType::Unsigned32,
            access: Access::ReadWrite,
            capacity: 4,
            default: &[0; 4],
        }],
    }],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// Returns frames of safety over EtherCAT and the bits beside them, in one direction.
const fn safety(index: u16) -> [PdoEntry; 6] {
    [
        entry(index, 1, 8),
        entry(index + 1, 1, 1),
        entry(index + 1, 2, 1),
        gap(6),
        entry(index, 3, 16),
        entry(index, 2, 16),
    ]
}

static SAFE_OUTPUTS: [PdoEntry; 6] = safety(0x7000);
static SAFE_INPUTS: [PdoEntry; 6] = safety(0x6000);
static OUTPUTS: [PdoEntry; 7] = [
    entry(0x7010, 1, 1),
    entry(0x7010, 2, 1),
    entry(0x7010, 3, 1),
    entry(0x7010, 4, 1),
    entry(0x7010, 5, 1),
    entry(0x7010, 6, 1),
    gap(10),
];
static INPUTS: [PdoEntry; 5] =
    [entry(0x6010, 1, 1), entry(0x6010, 2, 1), entry(0x6010, 3, 1), entry(0x6010, 4, 1), gap(12)];

static EK1914: Description = Description {
    order_code: "EK1914",
    name: "Coupler with safe inputs and outputs",
    outputs: &[pdo(0x1600, &SAFE_OUTPUTS), pdo(0x1601, &OUTPUTS)],
    inputs: &[pdo(0x1A00, &SAFE_INPUTS), pdo(0x1A01, &INPUTS)],
    objects: &[],
    ..EL3004
};

/// Returns the messages of a file: a request, and its answer.
fn pairs(text: &str) -> Vec<[Vec<u8>; 2]> {
    let bytes = |line: &str| {
        let bytes = line[2..].split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap());
        bytes.collect::<Vec<u8>>()
    };
    let lines: Vec<_> = text.lines().collect();
    let pair = |pair: &[&str]| {
        assert!(pair[0].starts_with('>') && pair[1].starts_with('<'), "{pair:?}");
        [bytes(pair[0]), bytes(pair[1])]
    };
    lines.chunks_exact(2).map(pair).collect()
}

/// Returns an answer without bytes that have no meaning: the answer to a download ends with four reserved ones (ETG.1000.6,
/// SDO download normal response). The EL3004 leaves the request's data there, we write zeros.
fn meaning(answer: &[u8]) -> &[u8] {
    const COMMAND: usize = 8;
    const RESERVED: usize = 12;
    const DOWNLOADED: u8 = 0x60;
    if answer.get(COMMAND) == Some(&DOWNLOADED) { &answer[..RESERVED] } else { answer }
}

/// Sends each request to a device that was just switched on. Returns the answers that differ from those of the
/// hardware.
fn differences(description: &'static Description, text: &str) -> Vec<[Vec<u8>; 3]> {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(description));
    let mut main_device = RawMainDevice::start(segment);
    let mut differences = Vec::new();
    for [request, expected] in pairs(text) {
        let mut message = request.clone();
        message.resize(MAILBOX, 0);
        assert_eq!(main_device.write(0x1000, &message), 1);
        let (answer, working_counter) = main_device.read(0x1080, MAILBOX);
        assert_eq!(working_counter, 1, "no answer to {request:02X?}");
        let (answer, rest) = answer.split_at(expected.len());
        assert!(rest.iter().all(|byte| *byte == 0), "more than the hardware's answer");
        if meaning(answer) != meaning(&expected) {
            differences.push([request, answer.to_vec(), expected]);
        }
    }
    differences
}

#[test]
fn an_emulated_el3004_answers_as_the_hardware_does() {
    let pdos = include_str!("../vectors/el3004-pdos.hex");
    assert_eq!(pairs(pdos).len(), 50);
    assert_eq!(differences(&EL3004, pdos), Vec::<[Vec<u8>; 3]>::new());
    let objects = include_str!("../vectors/el3004-objects.hex");
    assert_eq!(pairs(objects).len(), 3);
    assert_eq!(differences(&EL3004, objects), Vec::<[Vec<u8>; 3]>::new());
}

#[test]
fn an_emulated_ek1914_answers_as_the_hardware_does() {
    let pdos = include_str!("../vectors/ek1914-pdos.hex");
    assert_eq!(pairs(pdos).len(), 34);
    assert_eq!(differences(&EK1914, pdos), Vec::<[Vec<u8>; 3]>::new());
    let name = include_str!("../vectors/ek1914-name.hex");
    assert_eq!(pairs(name).len(), 1);
    assert_eq!(differences(&EK1914, name), Vec::<[Vec<u8>; 3]>::new());
}

#[test]
fn a_device_with_other_process_data_is_noticed() {
    let differing = differences(&EK1914, include_str!("../vectors/el3004-pdos.hex"));
    assert!(differing.len() > 40, "{}", differing.len());
}
