//! The mailbox by which a device sends to the MainDevice.

use ethercrab::error::Error;
use ethercrab::{Command, MainDevice};

use crate::coe::{self, Mail};
use crate::process::PROCESS;

/// Emergencies that wait for the owner; later ones are lost.
const MOST_EMERGENCIES: usize = 16;

/// State of sync manager 1, and its bit of a full mailbox (ETG.1000.4, sync manager).
const STATUS: u16 = 0x080D;
const FULL: u8 = 0x08;

/// Longest mailbox that is read or written.
pub(crate) const LONGEST_MAILBOX: u16 = 1486;

/// Mailbox of a device for its messages to the MainDevice.
pub(crate) struct IncomingMailbox<'a> {
    pub(crate) main: &'a MainDevice<'a>,
    pub(crate) station: u16,
    /// Start and length in bytes.
    pub(crate) place: (u16, u16),
}

impl IncomingMailbox<'_> {
    /// Returns whether a message is in it.
    pub(crate) async fn is_full(&self) -> Result<bool, Error> {
        is_full(self.main, self.station, STATUS).await
    }

    /// Takes the message that is in it.
    pub(crate) async fn take(&self) -> Result<Vec<u8>, Error> {
        let (start, len) = self.place;
        let mail = Command::fprd(self.station, start).receive_slice(self.main, len.min(LONGEST_MAILBOX));
        Ok(mail.await?.to_vec())
    }

    /// Takes a message that nobody asked for, and keeps it if it is an emergency. Returns false if there is none.
    pub(crate) async fn take_unasked(&self) -> Result<bool, Error> {
        if !self.is_full().await? {
            return Ok(false);
        }
        if let Some(Mail::Emergency(emergency)) = coe::parse(&self.take().await?) {
            keep(emergency);
        }
        Ok(true)
    }
}

/// Returns whether the mailbox of this sync manager is full.
pub(crate) async fn is_full(main: &MainDevice<'_>, station: u16, status: u16) -> Result<bool, Error> {
    let status = Command::fprd(station, status).receive::<u8>(main).await?;
    Ok(status & FULL != 0)
}

/// Keeps an emergency for the owner.
pub(crate) fn keep(emergency: [u8; 8]) {
    PROCESS.with_borrow_mut(|process| {
        let emergencies = &mut process.commissioning().emergencies;
        if emergencies.len() < MOST_EMERGENCIES {
            emergencies.push_back(emergency);
        }
    });
}
