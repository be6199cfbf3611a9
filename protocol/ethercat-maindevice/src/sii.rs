//! A device's EEPROM, read through the registers of its chip (ETG.1000.4, 6.4; content: ETG.1000.6, ETG.2010).

use ethercrab::Command;
use machine::Duration;

use crate::time;

/// Registers: which side uses the interface, then control, address and data.
const CONFIG: u16 = 0x0500;
const CONTROL: u16 = 0x0502;
const DATA: u16 = 0x0508;

/// In the low byte of control: a read gives 8 bytes instead of 4.
const EIGHT_BYTES: u8 = 0x40;

/// In the high byte of control: no command, which clears errors; the command to read; errors of commands; and busy. That
/// the chip's own configuration is damaged (0x18) does not keep the rest from being read.
const NOTHING: u8 = 0x00;
const READ: u8 = 0x01;
const ERRORS: u8 = 0x60;
const BUSY: u8 = 0x80;

/// Time from one read of the busy bit to the next, and the largest number of reads. An EEPROM takes about 0.5 ms for 8
/// bytes.
const LOOK: Duration = Duration::from_micros(200);
const LOOKS: u32 = 100;

/// Byte addresses.
const IDENTITY: u32 = 0x10;
const CATEGORIES: u32 = 0x80;

/// Types of categories (ETG.1000.6, table of categories).
const STRINGS: u16 = 10;
const GENERAL: u16 = 30;
const END: u16 = 0xFFFF;

/// Largest number of categories that are read; a device has about ten.
const MOST_CATEGORIES: u32 = 64;

/// In the category General: the numbers of the strings with order code and name.
const ORDER_CODE: u32 = 2;
const NAME: u32 = 3;

/// Clears the errors of commands in all devices: while it has one, a chip ignores commands, and ethercrab does not look at it.
pub(crate) async fn clear_errors(main: &ethercrab::MainDevice<'_>) {
    let _ = Command::bwr(CONTROL).ignore_wkc().send(main, [0, NOTHING]).await;
}

/// The identity of a device, from its EEPROM.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Identity {
    /// Vendor ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision number.
    pub revision: u32,
    /// Serial number; 0 for devices without one.
    pub serial_number: u32,
    /// Order code; empty if there is none.
    pub order_code: Vec<u8>,
    /// Name; empty if there is none.
    pub name: Vec<u8>,
}

/// Why a device's EEPROM cannot be read.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Unreadable {
    /// The device's own processor uses it.
    HeldByDevice,
    /// The chip reports an error, or is not ready in time.
    Failed,
    /// A frame did not come back, or no device counted it.
    NoAnswer,
}

/// The EEPROM of the device at one position on the cable, with the bytes that were read last.
pub(crate) struct Sii<'a> {
    main: &'a ethercrab::MainDevice<'a>,
    position: u16,
    /// Byte address of `bytes`; `None` before the first read.
    at: Option<u32>,
    bytes: [u8; 8],
    len: u32,
}

impl<'a> Sii<'a> {
    pub(crate) const fn new(main: &'a ethercrab::MainDevice<'a>, position: u16) -> Self {
        Self { main, position, at: None, bytes: [0; 8], len: 0 }
    }

    pub(crate) async fn identity(mut self) -> Result<Identity, Unreadable> {
        let [config] = self.register::<1>(CONFIG).await?;
        if config & 1 != 0 {
            return Err(Unreadable::HeldByDevice);
        }
        let vendor = self.u32(IDENTITY).await?;
        let product = self.u32(IDENTITY + 4).await?;
        let revision = self.u32(IDENTITY + 8).await?;
        let serial_number = self.u32(IDENTITY + 12).await?;
        let (order_code, name) = self.names().await?;
        Ok(Identity { vendor, product, revision, serial_number, order_code, name })
    }

    /// Returns order code and name.
    async fn names(&mut self) -> Result<(Vec<u8>, Vec<u8>), Unreadable> {
        let (mut strings, mut general) = (None, None);
        let mut at = CATEGORIES;
        for _ in 0..MOST_CATEGORIES {
            let kind = self.u16(at).await?;
            let len = u32::from(self.u16(at + 2).await?) * 2;
            match kind {
                END => break,
                STRINGS => strings = Some((at + 4, len)),
                GENERAL => general = Some(at + 4),
                _ => {}
            }
            if strings.is_some() && general.is_some() {
                break;
            }
            at += 4 + len;
        }
        let (Some(strings), Some(general)) = (strings, general) else { return Ok(Default::default()) };
        let (order_code, name) = (self.byte(general + ORDER_CODE).await?, self.byte(general + NAME).await?);
        Ok((self.string(strings, order_code).await?, self.string(strings, name).await?))
    }

    /// Returns string `number`, from 1, of the category with this address and length; empty if there is none.
    async fn string(&mut self, (start, len): (u32, u32), number: u8) -> Result<Vec<u8>, Unreadable> {
        if number == 0 || number > self.byte(start).await? {
            return Ok(Vec::new());
        }
        let mut at = start + 1;
        for _ in 1..number {
            at += 1 + u32::from(self.byte(at).await?);
        }
        let bytes = u32::from(self.byte(at).await?);
        let mut string = Vec::new();
        if at + 1 + bytes <= start + len {
            for place in at + 1..=at + bytes {
                string.push(self.byte(place).await?);
            }
        }
        Ok(string)
    }

    async fn u32(&mut self, at: u32) -> Result<u32, Unreadable> {
        let low = self.u16(at).await?;
        Ok(u32::from(low) | u32::from(self.u16(at + 2).await?) << 16)
    }

    async fn u16(&mut self, at: u32) -> Result<u16, Unreadable> {
        Ok(u16::from_le_bytes([self.byte(at).await?, self.byte(at + 1).await?]))
    }

    async fn byte(&mut self, at: u32) -> Result<u8, Unreadable> {
        if self.at.is_none_or(|start| at < start || at >= start + self.len) {
            // The interface counts in words.
            self.fetch(at & !1).await?;
        }
        let offset = self.at.and_then(|start| usize::try_from(at - start).ok());
        offset.and_then(|offset| self.bytes.get(offset)).copied().ok_or(Unreadable::Failed)
    }

    /// Reads from this address on.
    async fn fetch(&mut self, at: u32) -> Result<(), Unreadable> {
        let [_, high] = self.ready().await?;
        let [a, b, c, d] = (at / 2).to_le_bytes();
        // While a command of another MainDevice has an error, a chip ignores the next one.
        if high & ERRORS != 0 {
            self.command([0, NOTHING, a, b, c, d]).await?;
        }
        self.command([0, READ, a, b, c, d]).await?;
        let [low, high] = self.ready().await?;
        if high & ERRORS != 0 {
            return Err(Unreadable::Failed);
        }
        self.bytes = self.register(DATA).await?;
        self.len = if low & EIGHT_BYTES != 0 { 8 } else { 4 };
        self.at = Some(at);
        Ok(())
    }

    /// Writes control and address.
    async fn command(&self, command: [u8; 6]) -> Result<(), Unreadable> {
        let sent = Command::apwr(self.position, CONTROL).send_receive::<[u8; 6]>(self.main, command);
        sent.await.map(|_| ()).map_err(|_| Unreadable::NoAnswer)
    }

    /// Waits until the interface is not busy. Returns its control register.
    async fn ready(&self) -> Result<[u8; 2], Unreadable> {
        for _ in 0..LOOKS {
            let [low, high] = self.register(CONTROL).await?;
            if high & BUSY == 0 {
                return Ok([low, high]);
            }
            time::wait_until(time::now() + LOOK).await;
        }
        Err(Unreadable::Failed)
    }

    async fn register<const N: usize>(&self, register: u16) -> Result<[u8; N], Unreadable> {
        let read = Command::aprd(self.position, register).receive::<[u8; N]>(self.main);
        read.await.map_err(|_| Unreadable::NoAnswer)
    }
}
