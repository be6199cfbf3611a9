//! The TCP connections that are open or being opened.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::net::SocketAddrV4;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::network::ids::NicId;
use crate::network::in_flight::{Part, Role};
use machine::{Attempt, Instant, InterfaceId, StreamId};

/// Who has one end of a stream.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct StreamEnd {
    pub(super) nic: NicId,
    pub(super) on: InterfaceId,
}

#[derive(Debug)]
pub(super) struct Stream {
    id: StreamId,
    /// The end that connects, and the one that was asked; `None` if no host was there.
    ends: [Option<StreamEnd>; 2],
    /// What the connecting machine calls it.
    pub(super) attempt: Attempt,
    /// Whether the connecting end knows that it is connected.
    pub(super) connected: bool,
    /// Addresses of the connecting end and of its peer; `None` if nobody could answer.
    pub(super) between: Option<(SocketAddrV4, SocketAddrV4)>,
    /// Bytes sent by each end.
    sent: [u32; 2],
    /// Arrival of the last part towards each end: no part overtakes it.
    last_arrival: [Instant; 2],
    /// Parts that wait until the cable is mended, with the end that they go to.
    pub(super) held: Vec<(Role, Part)>,
    /// When the first of them began to wait.
    pub(super) held_since: Instant,
    /// The ends that closed it; they get no more of it.
    ended: [bool; 2],
}

/// Returns an end's entry.
const fn of<T>([connector, acceptor]: &mut [T; 2], role: Role) -> &mut T {
    match role {
        Role::Connector => connector,
        Role::Acceptor => acceptor,
    }
}

impl Stream {
    pub(super) const fn last_arrival(&mut self, to: Role) -> &mut Instant {
        of(&mut self.last_arrival, to)
    }

    pub(super) const fn sent(&mut self, by: Role) -> &mut u32 {
        of(&mut self.sent, by)
    }

    pub(super) const fn ended(&mut self, by: Role) -> &mut bool {
        of(&mut self.ended, by)
    }

    pub(super) const fn end(&self, role: Role) -> Option<StreamEnd> {
        let [connector, acceptor] = self.ends;
        match role {
            Role::Connector => connector,
            Role::Acceptor => acceptor,
        }
    }

    /// Returns the given end and the other one.
    pub(super) const fn ends_from(&self, from: Role) -> [Option<StreamEnd>; 2] {
        [self.end(from), self.end(from.other())]
    }

    /// Returns both ends, first the one whose interface was added first.
    pub(super) fn roles_by_age(&self) -> Vec<Role> {
        let nic = |role| self.end(role).map(|end| end.nic);
        let mut roles = [Role::Connector, Role::Acceptor].to_vec();
        roles.sort_by_key(|role| nic(*role));
        roles
    }
}

/// All connections that are open or being opened, in the order of their numbers.
#[derive(Debug)]
pub(in crate::network) struct Streams {
    open: Vec<Stream>,
    next_id: u32,
    seed: u64,
    /// Random streams for the sizes of pieces, one for each two interfaces, so that nobody shifts what others draw.
    random: BTreeMap<(NicId, NicId), Pcg64Mcg>,
}

impl Streams {
    pub(in crate::network) const fn new(seed: u64) -> Self {
        Self { open: Vec::new(), next_id: 1, seed, random: BTreeMap::new() }
    }

    /// Opens a stream, which nobody knows yet.
    pub(super) fn open(&mut self, from: StreamEnd, asked: Option<StreamEnd>, attempt: Attempt) -> StreamId {
        let id = StreamId(self.next_id);
        self.next_id = self.next_id.wrapping_add(1);
        let never = Instant::ZERO;
        self.open.push(Stream {
            id,
            ends: [Some(from), asked],
            attempt,
            connected: false,
            between: None,
            sent: [0; 2],
            last_arrival: [never; 2],
            held: Vec::new(),
            held_since: never,
            ended: [false; 2],
        });
        id
    }

    fn index(&self, id: StreamId) -> Option<usize> {
        self.open.binary_search_by_key(&id, |stream| stream.id).ok()
    }

    pub(super) fn find(&self, id: StreamId) -> Option<&Stream> {
        self.open.get(self.index(id)?)
    }

    pub(super) fn get(&mut self, id: StreamId) -> Option<&mut Stream> {
        let index = self.index(id)?;
        self.open.get_mut(index)
    }

    pub(super) fn remove(&mut self, id: StreamId) {
        if let Some(index) = self.index(id) {
            self.open.remove(index);
        }
    }

    pub(super) fn ids(&self) -> Vec<StreamId> {
        self.open.iter().map(|stream| stream.id).collect()
    }

    /// Returns which end of a stream an interface has.
    pub(super) fn role(&self, id: StreamId, nic: NicId) -> Option<Role> {
        let [connector, acceptor] = self.find(id)?.ends;
        let is_of = |end: Option<StreamEnd>| end.is_some_and(|end| end.nic == nic);
        match (is_of(connector), is_of(acceptor)) {
            (true, _) => Some(Role::Connector),
            (_, true) => Some(Role::Acceptor),
            _ => None,
        }
    }

    /// Draws how many of `left` bytes the next piece has: one byte, a segment or all of them.
    pub(super) fn piece(&mut self, id: StreamId, left: usize) -> Option<usize> {
        let [connector, acceptor] = self.find(id)?.ends;
        let (one, other) = (connector?.nic, acceptor?.nic);
        let between = (one.min(other), one.max(other));
        let seed = self.seed;
        let random = self.random.entry(between).or_insert_with(|| {
            let (NicId(first), NicId(second)) = between;
            // The first two interfaces draw from the plain seed.
            let number = (((first as u64) << 32) | second as u64).wrapping_sub(1);
            let number = number.wrapping_mul(0x9E37_79B9_7F4A_7C15);
            Pcg64Mcg::seed_from_u64(seed.rotate_left(31) ^ 0x7CB0_57EA ^ number)
        });
        let limit = match random.next_u32() % 4 {
            0 => 1,
            1 => 24,
            2 => 200,
            _ => 1448,
        };
        Some(1 + random.next_u32() as usize % limit.min(left))
    }
}
