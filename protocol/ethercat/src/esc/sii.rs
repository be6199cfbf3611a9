//! The interface by which the MainDevice reads and writes the EEPROM (ETG.1000.4, 6.4).

use alloc::vec::Vec;

use machine::{Duration, Instant};

use super::memory::Memory;
use super::registers::{
    DL_STATUS, PDI_CONFIGURATION, PDI_CONTROL, PULSE_LENGTH, SII_ADDRESS, SII_CONFIG, SII_CONTROL, SII_DATA,
    STATION_ALIAS,
};

/// Low byte of control: reads give 8 bytes, addresses have two bytes.
const CAPABILITIES: u8 = 0xC0;
const WRITE_ENABLE: u8 = 0x01;

/// High byte of control: commands.
const COMMANDS: u8 = 0x07;
const READ: u8 = 1;
const WRITE: u8 = 2;
const RELOAD: u8 = 4;

/// High byte of control: status.
const CHECKSUM_ERROR: u8 = 0x08;
const NOT_LOADED: u8 = 0x10;
const COMMAND_ERROR: u8 = 0x20;
const WRITE_ENABLE_ERROR: u8 = 0x40;
const BUSY: u8 = 0x80;

/// Words of the configuration, and the registers that get them (ESC datasheet section I, ESC configuration area).
const CONFIGURATION: [(usize, u16); 5] = [
    (0, PDI_CONTROL),
    (1, PDI_CONFIGURATION),
    (2, PULSE_LENGTH),
    (3, PDI_CONFIGURATION + 2),
    (5, PDI_CONTROL + 2),
];
const ALIAS_WORD: usize = 4;

/// Bits of DL status: the configuration is loaded, and enhanced link detection, bit 9 of the first word.
const LOADED: u8 = 0x01;
const ENHANCED_LINK: u8 = 0x04;

/// The EEPROM and the state of its interface.
#[derive(Debug)]
pub(crate) struct Sii {
    image: Vec<u8>,
    /// Time that a command takes.
    delay: Duration,
    busy_until: Option<Instant>,
}

impl Sii {
    pub(crate) const fn new(image: Vec<u8>, delay: Duration) -> Self {
        Self { image, delay, busy_until: None }
    }

    pub(crate) fn image_mut(&mut self) -> &mut [u8] {
        &mut self.image
    }

    /// Loads the configuration of the chip after power-on.
    pub(crate) fn load(&mut self, memory: &mut Memory) {
        self.reload(memory);
        let loaded = memory.u8(DL_STATUS) & LOADED != 0;
        let (alias, first) = if loaded { (self.word(ALIAS_WORD), self.word(0)) } else { Default::default() };
        memory.set(STATION_ALIAS, &alias);
        let [_, high] = first;
        let enhanced = if high & 0x02 != 0 { ENHANCED_LINK } else { 0 };
        memory.change(DL_STATUS, |status| status & !ENHANCED_LINK | enhanced);
    }

    /// Loads the configuration once more: all of it but the alias and the link detection, which a chip loads only at
    /// power-on. If the checksum is wrong, the registers keep their values.
    fn reload(&mut self, memory: &mut Memory) {
        self.busy_until = None;
        let configuration = self.image.get(..16).unwrap_or_default();
        let loaded = match configuration.split_at_checked(14) {
            Some((covered, [sum, 0])) => checksum(covered) == *sum,
            _ => false,
        };
        if loaded {
            for (word, register) in CONFIGURATION {
                memory.set(register, &self.word(word));
            }
        }
        memory.change(DL_STATUS, |status| status & !LOADED | u8::from(loaded));
        let status = if loaded { 0 } else { CHECKSUM_ERROR | NOT_LOADED };
        memory.set(SII_CONTROL, &[CAPABILITIES, status]);
    }

    /// Returns whether the MainDevice can access the interface: a command does not run, and it does not belong to the
    /// device's own side.
    pub(crate) fn is_free(&self, memory: &Memory) -> bool {
        memory.u8(SII_CONFIG) & 1 == 0 && memory.u8(SII_CONTROL + 1) & BUSY == 0
    }

    /// Clears the busy bit once the command has taken its time.
    pub(crate) fn refresh(&mut self, now: Instant, memory: &mut Memory) {
        if self.busy_until.is_some_and(|until| until <= now) {
            self.busy_until = None;
            memory.change(SII_CONTROL + 1, |status| status & !BUSY);
        }
    }

    /// Executes the command that was written into the registers.
    pub(crate) fn execute(&mut self, now: Instant, memory: &mut Memory) {
        let enabled = memory.u8(SII_CONTROL) & WRITE_ENABLE != 0;
        memory.set(SII_CONTROL, &[CAPABILITIES]);
        let command = memory.u8(SII_CONTROL + 1) & COMMANDS;
        memory.change(SII_CONTROL + 1, |status| status & !COMMANDS);
        // After an error of a command, no command is executed until this one has cleared it.
        if command != 0 && memory.u8(SII_CONTROL + 1) & COMMAND_ERROR != 0 {
            return;
        }
        memory.change(SII_CONTROL + 1, |status| status & !(COMMAND_ERROR | WRITE_ENABLE_ERROR));
        let at = usize::try_from(memory.u32(SII_ADDRESS)).unwrap_or(usize::MAX).saturating_mul(2);
        let error = match command {
            0 => return,
            READ => {
                // An EEPROM also answers reads past its end; this one returns the bytes of an erased EEPROM.
                let rest = self.image.get(at..).unwrap_or_default();
                let mut data = [0xFF; 8];
                data.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
                memory.set(SII_DATA, &data);
                0
            }
            WRITE if !enabled => WRITE_ENABLE_ERROR,
            WRITE => match self.image.get_mut(at..at.saturating_add(2)) {
                Some(word) => {
                    word.copy_from_slice(memory.get(SII_DATA, 2));
                    0
                }
                None => COMMAND_ERROR,
            },
            RELOAD => {
                self.reload(memory);
                0
            }
            _ => COMMAND_ERROR,
        };
        self.busy_until = (!self.delay.is_zero()).then(|| now + self.delay);
        let busy = if self.busy_until.is_some() { BUSY } else { 0 };
        memory.change(SII_CONTROL + 1, |status| status | error | busy);
    }

    fn word(&self, index: usize) -> [u8; 2] {
        self.image.get(index * 2..).and_then(|rest| rest.first_chunk()).copied().unwrap_or_default()
    }
}

/// Returns the checksum over the configuration of the chip: CRC with polynomial 0x07, starting at 0xFF.
#[must_use]
pub fn checksum(configuration: &[u8]) -> u8 {
    configuration.iter().fold(0xFF, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 != 0 { (crc << 1) ^ 0x07 } else { crc << 1 })
    })
}
