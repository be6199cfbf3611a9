//! What a MainDevice sets of a drive, by SDO.

use ethercat_drive::{DriveConfig, Drives};
use ethercat_maindevice::ethercrab::error::{CoeAbortCode, Error, MailboxError};
use ethercat_maindevice::ethercrab::{MainDevice, MainDeviceConfig, Timeouts};
use ethercat_maindevice::{Scripted, time, with_main_device};
use machine::{Duration, Instant};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const QUICK_STOP_OPTION: u16 = 0x605A;

/// Sets each option code, and returns those that the drive takes and those that it refuses as out of range.
async fn set_all(main: &MainDevice<'_>) -> Result<[Vec<i16>; 2], Error> {
    let group = main.init_single_group::<2, 64>(time::now_ns).await?;
    let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
    let [mut taken, mut refused] = [Vec::new(), Vec::new()];
    for code in -1..=9_i16 {
        match device.sdo_write(QUICK_STOP_OPTION, 0, code).await {
            Ok(()) => taken.push(device.sdo_read::<i16>(QUICK_STOP_OPTION, 0).await?),
            Err(Error::Mailbox(MailboxError::Aborted { code: CoeAbortCode::ValueOutOfRange, .. })) => {
                refused.push(code);
            }
            Err(error) => return Err(error),
        }
    }
    Ok([taken, refused])
}

#[test]
fn the_drive_takes_the_quick_stop_options_that_it_has_and_refuses_others() {
    let drives = Drives::new(&[DriveConfig::new(1, 1_000.0)], Duration::from_millis(1), Instant::ZERO);
    let cable = Impairment { delay: Duration::from_micros(10), ..Impairment::default() };
    let config =
        PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    let script = with_main_device(Timeouts::default(), MainDeviceConfig::default(), set_all);
    let mut pair = Pair::new(Scripted::new(script, Instant::ZERO), drives, config);
    let ended = loop {
        if let Event::A(result) = pair.next_event(Instant::ZERO + Duration::from_secs(10)).unwrap() {
            break result;
        }
    };
    assert_eq!(ended, Ok([vec![0, 1, 2, 5, 6], vec![-1, 3, 4, 7, 8, 9]]));
}
