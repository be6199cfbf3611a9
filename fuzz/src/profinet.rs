//! An IO-Controller and an IO-Device beside a stranger that sends to one of them.

use std::sync::LazyLock;

use machine::Instant;
use profinet::block::{BlockReader, BlockWriter};
use profinet::record::{self, ReadResponse, WriteRequest, WriteResponse};
use profinet::rt::Transport;
use virtual_time::hostile::{Choices as _, Phases, Script};

use crate::attack::{self, Attack, RunsAlone};

#[allow(dead_code, reason = "other tests use the others")]
#[path = "../../protocol/profinet/tests/profinet/samples.rs"]
mod samples;

#[path = "../../protocol/profinet/tests/strangers/pair.rs"]
mod pair;

use pair::ControllerAndDevice;
pub(crate) use pair::STATIONS;
pub(crate) use samples::DEVICE;

/// The pair alone, by transport and by whether its stations list each other.
static ALONE: LazyLock<RunsAlone<(bool, bool)>> = LazyLock::new(RunsAlone::default);

/// The search for the device takes 260 ms.
const PHASES: Phases = attack::phases(320);

const fn transport(udp: bool) -> Transport {
    if udp { Transport::Udp } else { Transport::Rt1 }
}

/// Attacks the device.
pub(crate) fn device(data: &[u8]) {
    attack(1, data);
}

/// Attacks the controller.
pub(crate) fn controller(data: &[u8]) {
    attack(0, data);
}

/// Room for what was read from an input and is written again.
const WRITTEN: usize = 1 << 20;

/// Reads records of a device and calls that carry some: what was read is the same when it is written and read again.
pub(crate) fn blocks(data: &[u8]) {
    let mut script = Script::new(data);
    let kind = script.below(4);
    let len = data.len();
    let bytes = script.take(len);
    let mut buf = vec![0; WRITTEN];
    let mut written = |emit: &mut dyn FnMut(&mut BlockWriter<'_>)| {
        let mut writer = BlockWriter::new(&mut buf);
        emit(&mut writer);
        let len = writer.finish().unwrap_or_else(|error| panic!("{error:?}"));
        buf[..len].to_vec()
    };
    let mut reader = BlockReader::new(&bytes);
    match kind {
        0 => {
            let Some(found) = record::parse_diagnosis(&bytes) else { return };
            let again = written(&mut |writer| found.iter().for_each(|it| it.emit(writer)));
            assert_eq!(record::parse_diagnosis(&again), Some(found));
        }
        1 => {
            let Ok(whole) = WriteRequest::parse(&mut reader) else { return };
            let parts: Vec<_> = whole.writes().collect();
            let is_last_bad = parts.iter().rev().skip(1).all(Result::is_ok);
            assert!(is_last_bad, "a Write after a malformed one");
            let good: Vec<_> = parts.into_iter().flatten().collect();
            let again = written(&mut |writer| {
                record::emit_multiple_write(7, whole.address.ar, good.iter().copied(), writer);
            });
            let whole = WriteRequest::parse(&mut BlockReader::new(&again));
            let whole = whole.unwrap_or_else(|error| panic!("{error:?}"));
            assert!(whole.writes().eq(good.into_iter().map(Ok)));
        }
        2 => {
            while !reader.is_empty() {
                let Ok(answer) = WriteResponse::parse(&mut reader) else { return };
                let again = written(&mut |writer| answer.emit(writer));
                assert_eq!(WriteResponse::parse(&mut BlockReader::new(&again)), Ok(answer));
            }
        }
        _ => {
            let _ = record::Identification::parse(&bytes);
            if let Ok(answer) = ReadResponse::parse(&mut reader) {
                let _ = record::parse_real_identification(answer.record);
            }
        }
    }
}

fn attack(target: usize, data: &[u8]) {
    let mut choices = Script::new(data);
    let mut is = || choices.below(2) == 1;
    let (udp, listed, forges) = (is(), is(), is());
    let pair = || ControllerAndDevice::new(transport(udp), listed, crate::allocations);
    let alone = attack::alone(&ALONE, (udp, listed), PHASES, pair);
    // The search for the device has ended, and the device has accepted the Connect.
    let connected = Instant::from_millis(300);
    let attack =
        Attack { stations: STATIONS, phases: PHASES, target, listed, connected, forges, listen: None };
    attack.run(ControllerAndDevice::new(transport(udp), listed, crate::allocations), alone, choices);
}
