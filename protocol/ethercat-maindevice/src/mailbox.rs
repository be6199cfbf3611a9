//! Objects and emergencies while process data are exchanged.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::task::Poll;

use ethercrab::error::Error;
use ethercrab::{Command, MainDevice};
use machine::Duration;

use crate::bring_up::Group;
use crate::commissioning::{SdoAnswer, SdoRequest};
use crate::process::{PROCESS, Process};
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

/// Runs the cyclic exchange, and serves the owner's requests meanwhile.
pub(crate) async fn serve_while<T>(
    main: &MainDevice<'_>,
    group: &Group,
    mut exchange: Pin<&mut impl Future<Output = T>>,
) -> T {
    let is_wanted = PROCESS.with_borrow(|process| process.mailbox().is_some());
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
    loop {
        let request = PROCESS.with_borrow_mut(|process| process.commissioning().next_request());
        if let Some(request) = request {
            let answer = access(main, group, &request).await;
            PROCESS.with_borrow_mut(|process| process.commissioning().answered(answer));
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
    let Some((start, len)) = PROCESS.with_borrow(Process::mailbox) else {
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
            let emergencies = &mut process.commissioning().emergencies;
            if emergencies.len() < MOST_EMERGENCIES {
                emergencies.push_back(*emergency);
            }
        });
    }
    Ok(())
}
