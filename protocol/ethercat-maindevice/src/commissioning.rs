//! What a tool for commissioning asks beside process data: objects written in PRE-OP, devices held in SAFE-OP, objects read and
//! written, emergencies.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::task::Poll;

use ethercrab::error::Error;
use ethercrab::subdevice_group::PreOp;
use ethercrab::{Command, MainDevice, SubDeviceState};
use machine::{Duration, Instant};

use crate::al::{self, REQUEST_OP, REQUEST_SAFE_OP};
use crate::bring_up::{Group, GroupIn};
use crate::problem::Problem;
use crate::process::PROCESS;
use crate::recovery::TO_OP;
use crate::time;

/// Time between two looks at requests and at the mailbox.
const LOOK: Duration = Duration::from_millis(10);

/// Emergencies that wait for the owner; later ones are lost.
const MOST_EMERGENCIES: usize = 16;

/// Status of sync manager 1, the mailbox for the MainDevice, and its bit for a full mailbox (ETG.1000.4, sync manager).
const MAILBOX_STATUS: u16 = 0x080D;
const FULL: u8 = 0x08;

/// Longest mailbox that is read.
const LONGEST_MAILBOX: u16 = 1486;

/// Longest data that are written: ethercrab writes expedited SDOs only.
const LONGEST_WRITE: usize = 4;

/// Object that is written in PRE-OP.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct StartupWrite {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Data in the byte order of the wire, at most four bytes.
    pub data: Vec<u8>,
}

/// Access to an object.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SdoRequest {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Bytes to read: 1, 2, 4 or 8.
    pub len: usize,
    /// Data to write; none for a read.
    pub data: Option<Vec<u8>>,
}

/// Data read, nothing of a write, or why not.
pub type SdoAnswer = Result<Vec<u8>, String>;

/// Wishes of the owner, and what came of them.
#[derive(Debug)]
pub(crate) struct Commissioning {
    pub(crate) startup: Vec<StartupWrite>,
    pub(crate) holds_safe_op: bool,
    pub(crate) mailbox: Option<(u16, u16)>,
    request: Option<SdoRequest>,
    is_asked: bool,
    pub(crate) answer: Option<SdoAnswer>,
    pub(crate) emergencies: VecDeque<[u8; 8]>,
}

impl Commissioning {
    pub(crate) const fn none() -> Self {
        Self {
            startup: Vec::new(),
            holds_safe_op: false,
            mailbox: None,
            request: None,
            is_asked: false,
            answer: None,
            emergencies: VecDeque::new(),
        }
    }

    pub(crate) fn ask(&mut self, request: SdoRequest) -> bool {
        if self.is_asked || self.answer.is_some() {
            return false;
        }
        self.is_asked = true;
        self.request = Some(request);
        true
    }
}

/// Writes what the owner wants in PRE-OP to the first device.
pub(crate) async fn write_startup(main: &MainDevice<'_>, group: &GroupIn<PreOp>) -> Result<(), Problem> {
    let writes = PROCESS.with_borrow(|process| process.commissioning.startup.clone());
    for StartupWrite { index, subindex, data } in writes {
        let refused = |error| Problem::Startup { index, subindex, error };
        let device = group.subdevice(main, 0).map_err(refused)?;
        device.sdo_write(index, subindex, data.as_slice()).await.map_err(refused)?;
    }
    Ok(())
}

/// Place of the devices between SAFE-OP and OP.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Stage {
    /// They are on their way to OP, or there.
    Op,
    /// They are held in SAFE-OP.
    Held,
    /// They were held, and get until this time to come to OP.
    Rising(Instant),
}

impl Stage {
    pub(crate) fn of_start() -> Self {
        let holds = PROCESS.with_borrow(|process| process.commissioning.holds_safe_op);
        if holds { Self::Held } else { Self::Op }
    }

    /// Follows what the owner wants. Returns whether OP was requested just now.
    pub(crate) async fn follow(&mut self, main: &MainDevice<'_>, devices: usize) -> bool {
        let holds = PROCESS.with_borrow(|process| process.commissioning.holds_safe_op);
        let is_held = *self == Self::Held;
        if let Self::Rising(until) = self
            && *until < time::now()
        {
            *self = Self::Op;
        }
        if holds == is_held {
            return false;
        }
        *self = if holds { Self::Held } else { Self::Rising(time::now() + TO_OP) };
        for index in 0..devices {
            // A device that does not answer shows in the next cycle.
            let _ = al::request(main, index, if holds { REQUEST_SAFE_OP } else { REQUEST_OP }).await;
        }
        !holds
    }

    /// Notes the states of a good exchange.
    pub(crate) fn reached(&mut self, states: &[SubDeviceState]) {
        if matches!(self, Self::Rising(_)) && states.iter().all(|state| *state == SubDeviceState::Op) {
            *self = Self::Op;
        }
    }

    /// Returns whether devices in SAFE-OP are where they should be.
    pub(crate) fn takes_safe_op(self) -> bool {
        self != Self::Op
    }

    pub(crate) fn is_good(self, state: SubDeviceState) -> bool {
        state == SubDeviceState::Op || self.takes_safe_op() && state == SubDeviceState::SafeOp
    }
}

/// Runs the cyclic exchange, and serves the owner's requests meanwhile.
pub(crate) async fn serve_while<T>(
    main: &MainDevice<'_>,
    group: &Group,
    mut exchange: Pin<&mut impl Future<Output = T>>,
) -> T {
    let is_wanted = PROCESS.with_borrow(|process| process.commissioning.mailbox.is_some());
    if !is_wanted {
        return exchange.await;
    }
    let mut serve = pin!(serve(main, group));
    poll_fn(|context| {
        if let Poll::Ready(result) = exchange.as_mut().poll(context) {
            return Poll::Ready(result);
        }
        let _ = serve.as_mut().poll(context);
        Poll::Pending
    })
    .await
}

/// Answers requests, and looks for emergencies between them; it never ends.
async fn serve(main: &MainDevice<'_>, group: &Group) {
    PROCESS.with_borrow_mut(|process| {
        // A request of an earlier connection has ended with it.
        process.commissioning.is_asked = process.commissioning.request.is_some();
    });
    loop {
        let request = PROCESS.with_borrow_mut(|process| process.commissioning.request.take());
        if let Some(request) = request {
            let answer = access(main, group, &request).await;
            PROCESS.with_borrow_mut(|process| {
                process.commissioning.is_asked = false;
                process.commissioning.answer = Some(answer);
            });
        } else {
            // A frame that is lost shows in the cyclic exchange.
            let _ = read_emergency(main, group).await;
            time::wait_until(time::now() + LOOK).await;
        }
    }
}

async fn access(main: &MainDevice<'_>, group: &Group, request: &SdoRequest) -> SdoAnswer {
    let refused = |error: Error| format!("the device refuses it: {error}");
    let device = group.subdevice(main, 0).map_err(refused)?;
    let (index, subindex) = (request.index, request.subindex);
    if let Some(data) = &request.data {
        if data.len() > LONGEST_WRITE {
            return Err(format!("{} bytes: only up to {LONGEST_WRITE} can be written", data.len()));
        }
        return device
            .sdo_write(index, subindex, data.as_slice())
            .await
            .map(|()| Vec::new())
            .map_err(refused);
    }
    match request.len {
        1 => device.sdo_read::<[u8; 1]>(index, subindex).await.map(Vec::from),
        2 => device.sdo_read::<[u8; 2]>(index, subindex).await.map(Vec::from),
        4 => device.sdo_read::<[u8; 4]>(index, subindex).await.map(Vec::from),
        8 => device.sdo_read::<[u8; 8]>(index, subindex).await.map(Vec::from),
        len => return Err(format!("{len} bytes: only 1, 2, 4 or 8 can be read")),
    }
    .map_err(refused)
}

/// Reads the mailbox if it is full, and keeps an emergency in it (ETG.1000.6, 5.6.4: mailbox type CoE, service 1).
async fn read_emergency(main: &MainDevice<'_>, group: &Group) -> Result<(), Error> {
    let Some((start, len)) = PROCESS.with_borrow(|process| process.commissioning.mailbox) else {
        return Ok(());
    };
    let station = group.subdevice(main, 0)?.configured_address();
    let status = Command::fprd(station, MAILBOX_STATUS).receive::<u8>(main).await?;
    if status & FULL == 0 {
        return Ok(());
    }
    let mail = Command::fprd(station, start).receive_slice(main, len.min(LONGEST_MAILBOX)).await?;
    // Header: length, station, channel, type and counter; then CoE's number and service, and 8 bytes.
    let bytes: &[u8] = &mail;
    if let [_, _, _, _, _, kind, _, service, rest @ ..] = bytes
        && kind & 0x0F == 3
        && service >> 4 == 1
        && let Some(emergency) = rest.first_chunk::<8>()
    {
        PROCESS.with_borrow_mut(|process| {
            if process.commissioning.emergencies.len() < MOST_EMERGENCIES {
                process.commissioning.emergencies.push_back(*emergency);
            }
        });
    }
    Ok(())
}
