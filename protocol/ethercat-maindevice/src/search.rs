//! A search for SubDevices that does not change them: which devices are on the cable, at which position, with which
//! addresses and in which state.
//!
//! ethercrab's own way of finding devices takes all of them to INIT and gives them new station addresses. A search must
//! not do that, so it addresses them by their position, reads registers, and writes only to the EEPROM interface, whose
//! registers say what to read. If a device's own processor uses the EEPROM, the search does not
//! take the EEPROM away from it.

use std::fmt;

use ethercrab::error::Error;
use ethercrab::{Command, MainDeviceConfig, RetryBehaviour, Timeouts};
use machine::{Duration, Instant};

use crate::problem;
use crate::script::{Scripted, with_main_device};
use crate::sii::{Identity, Sii, Unreadable};
use crate::time;

/// Largest number of devices in a listing. No real cable has more.
const MOST_DEVICES: u16 = 1024;

/// How often a frame that does not come back is repeated.
const REPETITIONS: usize = 3;

/// Least number of frames that a search has time for: it sets how long one of them may take.
const FRAMES: u32 = 20;

/// Longest time that a frame may take.
const FRAME: Duration = Duration::from_millis(30);

/// Register of the station address; the alias follows it (ETG.1000.4).
const STATION_ADDRESS: u16 = 0x0010;

/// In the AL status: the device indicates an error.
const ERROR: u16 = 0x10;

/// Register of the AL status; the AL status code is 4 bytes behind it.
const AL_STATUS: u16 = 0x0130;

/// A SubDevice that answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FoundSubDevice {
    /// Its place on the cable; the device next to the MainDevice has 0.
    pub position: u16,
    /// Station address that a MainDevice gave it; 0 before.
    pub station_address: u16,
    /// Station alias, from its EEPROM or its switches; 0 if it has none.
    pub alias: u16,
    /// AL status: the state in bits 0 to 3, an error in bit 4.
    pub status: u16,
    /// AL status code, 0 without an error.
    pub status_code: u16,
    /// What its EEPROM says, or why it cannot be read.
    pub identity: Result<Identity, Unreadable>,
}

impl FoundSubDevice {
    /// Writes the state, and the error if the device indicates one.
    pub fn write_state(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let state = match self.status & 0x0F {
            1 => "INIT",
            2 => "PRE-OP",
            3 => "BOOT",
            4 => "SAFE-OP",
            8 => "OP",
            _ => return write!(words, "AL status 0x{:04X}", self.status),
        };
        words.write_str(state)?;
        if self.status & ERROR == 0 { Ok(()) } else { problem::write_code(words, self.status_code) }
    }
}

/// What a search found.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct Found {
    /// The devices, in their order on the cable.
    pub devices: Vec<FoundSubDevice>,
    /// Whether any frame came back. Only a device, or a switch that returns frames, sends one back.
    pub frames_return: bool,
    /// Whether the end of the cable was reached before the time was over.
    pub complete: bool,
}

/// Returns a machine that searches for `length` at most, from `start` on. Its event is what it found.
pub fn search(start: Instant, length: Duration) -> Scripted<impl Future<Output = Found> + Send> {
    let timeouts = Timeouts { pdu: (length / FRAMES).min(FRAME), ..Timeouts::default() };
    let config = MainDeviceConfig {
        dc_static_sync_iterations: 0,
        retry_behaviour: RetryBehaviour::Count(REPETITIONS),
    };
    let script = with_main_device(timeouts, config, async move |main: &ethercrab::MainDevice<'_>| {
        let mut found = Found::default();
        let _ = time::by(start + length, list(main, &mut found)).await;
        found
    });
    Scripted::new(script, start)
}

/// Reads one position after the other, until no device answers.
async fn list(main: &ethercrab::MainDevice<'_>, found: &mut Found) {
    for position in 0..MOST_DEVICES {
        match device(main, position).await {
            Ok(device) => {
                found.frames_return = true;
                found.devices.push(device);
            }
            Err(Error::WorkingCounter { received: 0, .. }) => {
                (found.frames_return, found.complete) = (true, true);
                return;
            }
            Err(_) => return,
        }
    }
}

async fn device(main: &ethercrab::MainDevice<'_>, position: u16) -> Result<FoundSubDevice, Error> {
    let addresses = Command::aprd(position, STATION_ADDRESS).receive::<[u8; 4]>(main).await?;
    let status = Command::aprd(position, AL_STATUS).receive::<[u8; 6]>(main).await?;
    let identity = Sii::new(main, position).identity().await;
    let ([station_low, station_high, alias_low, alias_high], [low, high, _, _, code_low, code_high]) =
        (addresses, status);
    Ok(FoundSubDevice {
        position,
        station_address: u16::from_le_bytes([station_low, station_high]),
        alias: u16::from_le_bytes([alias_low, alias_high]),
        status: u16::from_le_bytes([low, high]),
        status_code: u16::from_le_bytes([code_low, code_high]),
        identity,
    })
}
