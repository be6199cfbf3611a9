//! Captures of anybody: files that are cut or damaged, and frames that only look like those of a PLC and a robot.

use std::sync::LazyLock;
use std::time::Duration;

use capture_file::reader::CaptureReader;
use tap::{CaptureObserver, ExpectedRun, TapConfig};

/// The plan of Setup A.
static EXPECTED: LazyLock<Option<ExpectedRun>> = LazyLock::new(|| {
    let (setup, found) = planning::setup_with_application("A").ok()?;
    Some(ExpectedRun::of(&found.plan(&setup).ok()?, &setup))
});

/// Reads a capture and measures what is in it. Bytes that are no capture are frames, each with its length in two bytes before it.
pub(crate) fn capture(data: &[u8]) {
    let Some(expected) = EXPECTED.clone() else { return };
    let mut observer =
        CaptureObserver::new(TapConfig { expected, cycle: Duration::from_millis(1), robot: None });
    match CaptureReader::new(data) {
        Ok(mut reader) => loop {
            match reader.next_packet() {
                Ok(Some(packet)) => observer.handle_packet(packet.nanos, packet.data, packet.is_cut()),
                Ok(None) => break,
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        },
        Err(error) => {
            assert!(!error.to_string().is_empty());
            frames(data, &mut observer);
        }
    }
    match observer.finish() {
        Ok(findings) => assert!(findings.packets > 0),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn frames(mut data: &[u8], observer: &mut CaptureObserver) {
    let mut nanos = 0_u64;
    while let Some((length, rest)) = data.split_first_chunk::<2>() {
        let length = usize::from(u16::from_be_bytes(*length)).min(rest.len());
        let (frame, after) = rest.split_at(length);
        observer.handle_packet(nanos, frame, false);
        nanos += 1_000_000;
        data = after;
    }
}
