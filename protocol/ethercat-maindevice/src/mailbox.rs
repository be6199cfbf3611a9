//! Objects and emergencies while process data are exchanged.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::task::Poll;

use ethercrab::MainDevice;
use ethercrab::error::Error;
use machine::Duration;

use crate::bring_up::Group;
use crate::coe::SdoObject;
use crate::commissioning::{SdoAnswer, SdoRequest};
use crate::incoming_mailbox::IncomingMailbox;
use crate::process::{PROCESS, Process};
use crate::sdo::access;
use crate::sdo_fault::SdoFault;
use crate::time;

/// Time between two looks at requests and at the mailbox.
const LOOK: Duration = Duration::from_millis(10);

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
            let answer = answer(main, group, &request).await;
            PROCESS.with_borrow_mut(|process| process.commissioning().answered(answer));
        } else {
            // A frame that is lost shows in the cyclic exchange.
            let _ = read_emergency(main, group).await;
            time::wait_until(time::now() + LOOK).await;
        }
    }
}

async fn answer(main: &MainDevice<'_>, group: &Group, request: &SdoRequest) -> SdoAnswer {
    let in_words = |fault: SdoFault| fault.to_string();
    let device = group.subdevice(main, 0).map_err(|error| in_words(error.into()))?;
    let object =
        SdoObject { index: request.index, subindex: request.subindex, is_complete: request.is_complete };
    access(main, device.configured_address(), object, request.data.as_deref()).await.map_err(in_words)
}

/// Reads the mailbox if it is full, and keeps an emergency in it.
async fn read_emergency(main: &MainDevice<'_>, group: &Group) -> Result<(), Error> {
    let Some(place) = PROCESS.with_borrow(Process::mailbox) else {
        return Ok(());
    };
    let station = group.subdevice(main, 0)?.configured_address();
    IncomingMailbox { main, station, place }.take_unasked().await.map(drop)
}
