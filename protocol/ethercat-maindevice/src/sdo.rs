//! Access to objects by the mailbox of a device, in PRE-OP and while process data are exchanged: expedited, normal and in segments.

use ethercrab::error::CoeAbortCode;
use ethercrab::{Command, MainDevice};
use machine::{Duration, Instant};

use crate::coe::{self, Mail, Sdo, SdoObject};
use crate::commissioning::LONGEST_OBJECT;
use crate::incoming_mailbox::{IncomingMailbox, LONGEST_MAILBOX, is_full, keep};
use crate::sdo_fault::{ANSWER_WITHIN, SdoFault};
use crate::time;

/// Time between two looks at the mailbox while an answer is awaited.
const LOOK_FOR_ANSWER: Duration = Duration::from_millis(1);

/// Messages of earlier accesses that are taken out of the mailbox before the next access.
const MOST_STALE: usize = 8;

/// Sync managers 0 and 1, the mailboxes: start, length, control, status (ETG.1000.4, sync manager).
const SYNC_MANAGERS: u16 = 0x0800;
const OUT_STATUS: u16 = 0x0805;

/// Abort code of an access that took too long (ETG.1000.6, table 41).
const ABORT_TIMEOUT: u32 = 0x0504_0000;

/// Reads an object, or writes it.
pub(crate) async fn access(
    main: &MainDevice<'_>,
    station: u16,
    object: SdoObject,
    data: Option<&[u8]>,
) -> Result<Vec<u8>, SdoFault> {
    let client = SdoClient::open(main, station).await?;
    let result = match data {
        Some(data) => client.write(object, data).await.map(|()| Vec::new()),
        None => client.read(object).await,
    };
    if result == Err(SdoFault::NoAnswer) {
        // The device forgets the access. Whether it takes this does not matter.
        let _ = client.send(&coe::abort(object, ABORT_TIMEOUT)).await;
    }
    result
}

/// Waits until the next look at a mailbox. Returns false if it is too late for one.
async fn look_again(until: Instant) -> bool {
    if time::now() >= until {
        return false;
    }
    time::wait_until(time::now() + LOOK_FOR_ANSWER).await;
    true
}

/// Mailboxes of a device.
struct SdoClient<'a> {
    main: &'a MainDevice<'a>,
    station: u16,
    /// Start and length in bytes of the mailbox to the device.
    out: (u16, u16),
    back: IncomingMailbox<'a>,
}

impl<'a> SdoClient<'a> {
    /// Asks the device where its mailboxes are, as ethercrab configured them.
    async fn open(main: &'a MainDevice<'a>, station: u16) -> Result<Self, SdoFault> {
        let managers = Command::fprd(station, SYNC_MANAGERS).receive::<[u8; 16]>(main).await?;
        let ([out, back], _) = managers.as_chunks::<8>() else { return Err(SdoFault::NoMailbox) };
        let place = |[a, b, c, d, ..]: [u8; 8]| (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        let (out, back) = (place(*out), place(*back));
        let fits = |(_, len): (u16, u16)| (24..=LONGEST_MAILBOX).contains(&len);
        if !fits(out) || !fits(back) {
            return Err(SdoFault::NoMailbox);
        }
        Ok(Self { main, station, out, back: IncomingMailbox { main, station, place: back } })
    }

    /// Waits until the device has taken the last message. Returns false once it is too late.
    async fn wait_until_taken(&self, until: Instant) -> Result<bool, SdoFault> {
        while is_full(self.main, self.station, OUT_STATUS).await? {
            if !look_again(until).await {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Waits for a message. Returns false once it is too late.
    async fn wait_for_mail(&self, until: Instant) -> Result<bool, SdoFault> {
        while !self.back.is_full().await? {
            if !look_again(until).await {
                return Ok(false);
            }
        }
        Ok(true)
    }

    async fn send(&self, mail: &[u8]) -> Result<(), SdoFault> {
        if !self.wait_until_taken(time::now() + ANSWER_WITHIN).await? {
            return Err(SdoFault::NoAnswer);
        }
        // The last byte makes the mailbox full.
        let (start, len) = self.out;
        Command::fpwr(self.station, start).with_len(len).send(self.main, mail).await?;
        Ok(())
    }

    /// Takes out of the mailbox what is left of earlier accesses.
    async fn drain(&self) -> Result<(), SdoFault> {
        for _ in 0..MOST_STALE {
            if !self.back.take_unasked().await? {
                break;
            }
        }
        Ok(())
    }

    /// Sends a request, and waits for the message that `accept` takes. Others are of earlier accesses, repeated or damaged.
    async fn ask<T>(
        &self,
        request: &[u8],
        object: SdoObject,
        mut accept: impl FnMut(&Sdo<'_>) -> Option<T>,
    ) -> Result<T, SdoFault> {
        self.send(request).await?;
        let until = time::now() + ANSWER_WITHIN;
        while self.wait_for_mail(until).await? {
            match coe::parse(&self.back.take().await?) {
                Some(Mail::Emergency(emergency)) => keep(emergency),
                Some(Mail::Fault(detail)) => return Err(SdoFault::NotUnderstood(detail)),
                Some(Mail::Sdo(Sdo::Aborted { index, subindex, code }))
                    if (index, subindex) == (object.index, object.subindex) =>
                {
                    return Err(SdoFault::Aborted(CoeAbortCode::from(code)));
                }
                Some(Mail::Sdo(sdo)) => {
                    if let Some(accepted) = accept(&sdo) {
                        return Ok(accepted);
                    }
                }
                Some(Mail::Other) | None => {}
            }
            if time::now() >= until {
                break;
            }
        }
        Err(SdoFault::NoAnswer)
    }

    async fn read(&self, object: SdoObject) -> Result<Vec<u8>, SdoFault> {
        self.drain().await?;
        let (whole, mut read) = self
            .ask(&coe::upload(object), object, |sdo| match *sdo {
                Sdo::Uploaded { index, subindex, whole, data }
                    if (index, subindex) == (object.index, object.subindex) =>
                {
                    Some((whole, data.to_vec()))
                }
                _ => None,
            })
            .await?;
        let whole = whole.map_or(read.len(), |whole| usize::try_from(whole).unwrap_or(usize::MAX));
        if whole > LONGEST_OBJECT {
            let _ = self.send(&coe::abort(object, ABORT_TIMEOUT)).await;
            return Err(SdoFault::TooLong);
        }
        let mut wanted = false;
        let mut is_last = read.len() >= whole;
        while !is_last {
            let request = coe::upload_segment(wanted);
            let segment = self.ask(&request, object, |sdo| match *sdo {
                Sdo::UploadedSegment { toggle, is_last, data } if toggle == wanted => {
                    Some((is_last, data.to_vec()))
                }
                _ => None,
            });
            let (last, data) = segment.await?;
            // A segment without data that is not the last one would go on for ever.
            if data.is_empty() && !last || read.len() + data.len() > LONGEST_OBJECT {
                return Err(SdoFault::TooLong);
            }
            read.extend(data);
            (is_last, wanted) = (last, !wanted);
        }
        // A mailbox may carry more bytes than the object has.
        read.truncate(whole.max(1));
        Ok(read)
    }

    async fn write(&self, object: SdoObject, data: &[u8]) -> Result<(), SdoFault> {
        self.drain().await?;
        let room = usize::from(self.out.1);
        let (request, mut done) = coe::download(object, data, room);
        self.ask(&request, object, |sdo| match *sdo {
            Sdo::Downloaded { index, subindex } => {
                ((index, subindex) == (object.index, object.subindex)).then_some(())
            }
            _ => None,
        })
        .await?;
        let mut wanted = false;
        while let Some(rest) = data.get(done..).filter(|rest| !rest.is_empty()) {
            let (request, taken) = coe::download_segment(wanted, rest, room);
            self.ask(&request, object, |sdo| match *sdo {
                Sdo::DownloadedSegment { toggle } => (toggle == wanted).then_some(()),
                _ => None,
            })
            .await?;
            (done, wanted) = (done + taken, !wanted);
        }
        Ok(())
    }
}
