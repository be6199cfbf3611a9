//! Faults of frames, cables and devices, each at many instants: the MainDevice never hangs, every loss shows in working
//! counter or state, and after a fault that ends all devices are in OP again.

use std::fmt::Write;

use ethercat_subdevice::{AlStatusCode, DeviceConfig, DeviceId, Emergency, LocalClock, Segment};
use ethercrab::{MainDevice, RetryBehaviour};
use machine::{Duration, Instant, Machine, Port, Source};
use virtual_time::Impairment;

use crate::devices::{PLAIN, SMART};
use crate::faulty::FrameFault;
use crate::main_device::Stand;
use crate::operation::{Operation, operate};
use crate::raw_main_device::{APWR, frame};

/// End of a run, and good cycles at its end that count as recovered.
const END: Instant = Instant::from_millis(1_600);
const RECOVERED: usize = 50;

/// Frames of a start, about; and the instant by which all are in OP without faults.
const START_FRAMES: u64 = 700;
const STARTED: Instant = Instant::from_millis(150);

/// What happens to the segment.
#[derive(Clone, Copy, Debug)]
enum SegmentFault {
    Cut(usize, bool),
    Power(usize, bool),
    Fail(usize, u16),
    Eeprom(usize, usize),
    Hang(usize, Duration),
    Raise(usize),
    /// Another sender on the cable sets a station address.
    Readdress(usize, u16),
}

impl SegmentFault {
    fn to(self, segment: &mut Segment, now: Instant) {
        match self {
            Self::Cut(device, cut) => segment.set_cut(DeviceId(device), cut),
            Self::Power(device, powered) => segment.set_power(now, DeviceId(device), powered),
            Self::Fail(device, code) => segment.fail(DeviceId(device), AlStatusCode(code)),
            Self::Eeprom(device, at) => segment.eeprom_mut(DeviceId(device)).unwrap()[at] ^= 0x40,
            Self::Hang(device, delay) => segment.set_answer_delay(DeviceId(device), delay),
            Self::Raise(device) => {
                segment.raise(DeviceId(device), Emergency { code: 0x1000, ..Emergency::default() });
            }
            Self::Readdress(device, address) => {
                let position = u32::from(0_u16.wrapping_sub(device as u16));
                let frame = frame(APWR, position | 0x0010 << 16, &address.to_le_bytes());
                segment.handle_frame(now, Source { port: Port::Ethernet, peer: None }, &frame);
                segment.poll_transmit(now, &mut [0; 64]);
            }
        }
    }
}

/// A fault, before it has an instant.
#[derive(Clone, Debug)]
enum Fault {
    /// These happen to frames one after another, while the devices start or while they run.
    Frames { starting: bool, faults: Vec<FrameFault> },
    /// These happen to the segment, so much after an instant while the devices run.
    Happenings(Vec<(Duration, SegmentFault)>),
    /// The cable is like this all the time.
    Cable(Impairment),
    /// The clocks run too fast or too slow by so many parts per billion.
    Clocks(i64),
}

struct Script {
    name: String,
    fault: Fault,
    /// Whether the fault ends.
    ends: bool,
}

const MS: Duration = Duration::from_millis(1);

fn scripts() -> Vec<Script> {
    let mut scripts = Vec::new();
    let mut add = |name: String, fault, ends| scripts.push(Script { name, fault, ends });
    for (starting, phase) in [(true, "while starting"), (false, "while running")] {
        for (name, faults) in frame_faults() {
            add(format!("{name} {phase}"), Fault::Frames { starting, faults }, true);
        }
    }
    let happen = |list: &[(u32, SegmentFault)]| {
        Fault::Happenings(list.iter().map(|(after, happening)| (MS * *after, *happening)).collect())
    };
    for device in 0..3 {
        use SegmentFault::{Cut, Eeprom, Fail, Hang, Power, Raise, Readdress};
        let (cut, mended) = (Cut(device, true), Cut(device, false));
        add(format!("cable before {device} cut for 5 ms"), happen(&[(0, cut), (5, mended)]), true);
        add(format!("cable before {device} cut for 300 ms"), happen(&[(0, cut), (300, mended)]), true);
        add(format!("cable before {device} cut for good"), happen(&[(0, cut)]), false);
        let (off, on) = (Power(device, false), Power(device, true));
        add(format!("power of {device} lost for 1 ms"), happen(&[(0, off), (1, on)]), true);
        add(format!("power of {device} lost for 200 ms"), happen(&[(0, off), (200, on)]), true);
        add(format!("{device} falls to SAFE-OP, no sync"), happen(&[(0, Fail(device, 0x002D))]), true);
        add(
            format!("{device} has a station address twice"),
            happen(&[(0, Readdress(device, 0x1000 + (device as u16 + 1) % 3))]),
            true,
        );
        let broken = [(0, Eeprom(device, 14)), (1, off), (2, on)];
        add(format!("EEPROM checksum of {device} wrong after power-on"), happen(&broken), false);
        let hangs = [
            (0, Hang(device, Duration::from_secs(9))),
            (1, off),
            (2, on),
            (400, Hang(device, Duration::ZERO)),
        ];
        add(format!("{device} hangs after power-on for 400 ms"), happen(&hangs), true);
        let slow = [(0, Hang(device, MS * 3)), (1, off), (2, on)];
        add(format!("{device} takes 3 ms for an answer after power-on"), happen(&slow), true);
        if device == 0 {
            add("an emergency while running".into(), happen(&[(0, Raise(0))]), true);
        }
    }
    let cable = Impairment { delay: Duration::from_micros(20), ..Impairment::default() };
    for (name, cable) in [
        ("2 of 1000 frames lost", Impairment { loss_ppm: 2_000, ..cable }),
        ("1 of 100 frames twice", Impairment { duplicate_ppm: 10_000, ..cable }),
        (
            "1 of 100 frames held back by 500 us",
            Impairment { reorder_ppm: 10_000, reorder_by: MS / 2, ..cable },
        ),
        ("frames late by up to 900 us", Impairment { jitter: Duration::from_micros(900), ..cable }),
    ] {
        add(name.into(), Fault::Cable(cable), true);
    }
    for ppb in [100_000, -100_000] {
        add(format!("clocks {ppb} ppb off"), Fault::Clocks(ppb), true);
    }
    scripts
}

fn frame_faults() -> Vec<(&'static str, Vec<FrameFault>)> {
    use FrameFault::{AgainAfter, Count, Double, HeldFor, Late, LoseReply, LoseRequest, Swap};
    vec![
        ("a request lost", vec![LoseRequest]),
        ("a reply lost", vec![LoseReply]),
        ("10 replies lost", vec![LoseReply; 10]),
        ("a reply late by 40 ms", vec![Late(MS * 40)]),
        ("5 replies late by 40 ms", vec![Late(MS * 40); 5]),
        ("a reply twice", vec![Double]),
        ("a reply again after 40 ms", vec![AgainAfter(MS * 40)]),
        ("a reply behind the next", vec![Swap]),
        ("a working counter too low", vec![Count(-1)]),
        ("a working counter too high", vec![Count(1)]),
        ("a reply just before the 64th after it", vec![HeldFor(64)]),
        ("a reply just before the 256th after it", vec![HeldFor(256)]),
    ]
}

fn run(script: &Script, seed: u64) -> Option<Operation> {
    // The instant differs from seed to seed, evenly over the phase.
    let part = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32;
    let offset = Duration::from_micros(part % 200_000);
    let clock = |error_ppb| LocalClock { start_ns: seed * 1_000_003, error_ppb };
    let ppb = if let Fault::Clocks(ppb) = script.fault { ppb } else { 0 };
    let mut segment = Segment::new();
    segment.add(&DeviceConfig { clock: clock(0), ..DeviceConfig::new(&SMART) });
    segment.add(&DeviceConfig::new(&PLAIN));
    segment.add(&DeviceConfig { clock: clock(ppb), ..DeviceConfig::new(&SMART) });
    let mut stand = Stand::new(&mut segment);
    (stand.seed, stand.echo, stand.limit) = (seed, true, END.since(Instant::ZERO) * 4);
    // A PLC does not wait 5 s for a device that is not there, and asks again when a frame is lost.
    stand.timeouts.state_transition = MS * 100;
    stand.timeouts.pdu = MS * 10;
    stand.config.retry_behaviour = RetryBehaviour::Count(2);
    let mut happenings = Vec::new();
    match &script.fault {
        Fault::Frames { starting, faults } => {
            let first = if *starting { part % START_FRAMES } else { 1_000 + part % 100 };
            stand.faults = (first..).zip(faults.iter().copied()).collect();
        }
        Fault::Happenings(list) => {
            happenings = list.iter().map(|(after, what)| (STARTED + offset + *after, *what)).collect();
        }
        Fault::Cable(cable) => stand.cable = *cable,
        Fault::Clocks(_) => stand.config.dc_static_sync_iterations = 500,
    }
    let script = async |main: &MainDevice<'_>| operate(main, 3, END.as_nanos()).await;
    stand.run_with(script, &happenings, |segment, now, happening| happening.to(segment, now)).result
}

/// Runs all scripts with so many seeds. Returns a table of the worst run of each.
fn run_all(seeds: u64) -> String {
    let mut table = String::new();
    for script in scripts() {
        let runs: Vec<Option<Operation>> = (0..seeds).map(|seed| run(&script, seed)).collect();
        for (seed, operation) in runs.iter().enumerate() {
            let run = format!("{}, seed {seed}: {operation:?}", script.name);
            let operation = operation.as_ref().expect(&run);
            assert_eq!(operation.silent, 0, "{run}");
            assert_eq!(operation.good_since >= RECOVERED, script.ends, "{run}");
        }
        let worst = |figure: fn(&Operation) -> usize| runs.iter().flatten().map(figure).max().unwrap_or(0);
        let failed = worst(|run| run.failed_starts);
        let (starts, bad) = (worst(|run| run.starts), worst(|run| run.bad));
        writeln!(table, "{:<54} {failed:>6} {starts:>6} {bad:>10}", script.name).unwrap();
    }
    table
}

#[test]
fn every_fault_shows_and_those_that_end_are_recovered_from() {
    assert!(scripts().len() >= 53, "{} scripts", scripts().len());
    let head = format!("{:<54} {:>6} {:>6} {:>10}\n", "", "failed", "starts", "bad cycles");
    insta::assert_snapshot!(head + &run_all(5));
}

#[test]
#[ignore = "takes minutes: all scripts with 100 seeds each"]
fn every_fault_shows_with_a_hundred_seeds() {
    run_all(100);
}
