//! The owner of a node on its cyclic thread: commands of the process go in, notices come out.

use std::ops::ControlFlow;
use std::time::Duration;

use machine::{Instant, LinkEvent};
use protocol_linux::{Interface, NoticeSender, Statistics, Task, allocation};

use crate::trace_file::TraceRing;
use crate::{Command, Node, Notice, ShortText, Snapshot};

/// Longest wait for the peer to confirm the end of the connection, before the process ends.
const DISCONNECT_LIMIT: Duration = Duration::from_millis(300);

/// The node's owner on the cyclic thread.
#[derive(Debug)]
pub struct CyclicTask<S> {
    /// The node's interfaces. The index is the [`InterfaceId`](machine::InterfaceId).
    pub(crate) interfaces: Vec<Interface>,
    pub(crate) trace: Option<TraceRing<S>>,
    /// Whether the connection to each station is up.
    links: Vec<bool>,
    /// [`allocation::count`] when all connections were first up.
    pub(crate) at_up: Option<u64>,
    /// When to end although the peer has not confirmed the end of the connection.
    stopping: Option<Instant>,
}

impl<S> CyclicTask<S> {
    /// Creates the owner of a node with so many stations.
    pub(crate) fn new(interfaces: Vec<Interface>, trace: Option<TraceRing<S>>, stations: usize) -> Self {
        Self { interfaces, trace, links: vec![false; stations], at_up: None, stopping: None }
    }

    /// Returns whether one of the connections is up.
    fn is_connected(&self) -> bool {
        self.links.contains(&true)
    }

    /// Notes that the connection to a station is up, or down.
    fn note_link(&mut self, station: usize, is_up: bool) {
        if let Some(link) = self.links.get_mut(station) {
            *link = is_up;
        }
        if !self.links.contains(&false) {
            self.at_up.get_or_insert_with(allocation::count);
        }
    }
}

impl<N: Node> Task<N> for CyclicTask<N::Sample> {
    type Command = Command<N::Order>;
    type Notice = Notice<N::Event, N::Answer>;

    fn command(
        &mut self,
        now: Instant,
        node: &mut N,
        statistics: &Statistics,
        command: Self::Command,
        notices: &mut NoticeSender<Self::Notice>,
    ) -> ControlFlow<()> {
        match command {
            Command::Report => {
                let allocations = allocation::is_armed().then(allocation::count);
                notices.send(Notice::Snapshot(Snapshot::of(node, statistics, allocations, self.at_up)));
            }
            Command::Stop => {
                node.disconnect(now);
                if !self.is_connected() {
                    return ControlFlow::Break(());
                }
                self.stopping = Some(now + DISCONNECT_LIMIT);
            }
            Command::Record(on) => {
                if let Some(trace) = &mut self.trace {
                    trace.record(on);
                }
            }
            Command::Stored(done) => node.stored(now, done),
            Command::Link(status) => node.set_link(&status),
            Command::Carrier(is_up) => node.set_carrier(now, is_up),
            Command::Order(order) => {
                if let Some(answer) = node.order(now, order) {
                    notices.send(Notice::Answer(answer));
                }
            }
        }
        ControlFlow::Continue(())
    }

    fn event(
        &mut self,
        now: Instant,
        node: &mut N,
        event: N::Event,
        notices: &mut NoticeSender<Self::Notice>,
    ) -> ControlFlow<()> {
        let (link, on) = (N::link_event(&event), N::link_interface(&event));
        let station = N::station(&event).unwrap_or_default();
        if N::may_explain(&event) {
            let mut words = ShortText::default();
            // Text that does not fit is cut off.
            let _ = node.explain(&event, &mut words);
            if !words.as_str().is_empty() {
                notices.send(Notice::Explanation(words));
            }
        }
        let remark = N::may_remark(&event).then(|| {
            let mut remark = ShortText::default();
            // Text that does not fit is cut off.
            let _ = node.remark(&event, &mut remark);
            remark
        });
        let identity = matches!(link, Some(LinkEvent::Up)).then(|| {
            let mut identity = ShortText::default();
            // Text that does not fit is cut off.
            let _ = node.write_identity(&event, &mut identity);
            identity
        });
        notices.send(Notice::Event(event));
        if let Some(identity) = identity.filter(|identity| !identity.as_str().is_empty()) {
            notices.send(Notice::Identity(station, identity));
        }
        if let Some(remark) = remark {
            notices.send(Notice::Remark(station, remark));
        }
        match link {
            Some(LinkEvent::Up) => self.note_link(station, true),
            Some(LinkEvent::Down(_)) => {
                self.note_link(station, false);
                if self.stopping.is_some() && !self.is_connected() {
                    return ControlFlow::Break(());
                }
            }
            Some(LinkEvent::SetAddress { address, mask, gateway }) => {
                let done = self.interfaces.get(usize::from(on.0)).map(|interface| {
                    interface.set_address(address, mask).and_then(|()| interface.set_gateway(gateway))
                });
                node.address_set(now, on, matches!(done, Some(Ok(()))));
                if let Some(Err(error)) = done {
                    notices.send(Notice::NoAddress(address, error));
                }
            }
            Some(LinkEvent::Store) => {
                notices.send(Notice::Store(node.to_store().into()));
            }
            Some(
                LinkEvent::Foreign(_) | LinkEvent::Owner(_) | LinkEvent::Conflict(_) | LinkEvent::Health,
            )
            | None => {}
        }
        ControlFlow::Continue(())
    }

    fn inspect(&mut self, now: Instant, node: &N) {
        if let Some(trace) = &mut self.trace {
            trace.record_cycle(node.cycle_number(), |station| node.sample(station, now));
        }
    }

    fn expired(&mut self, _now: Instant, _node: &mut N) -> ControlFlow<()> {
        ControlFlow::Break(())
    }

    fn deadline(&self) -> Option<Instant> {
        self.stopping
    }
}
