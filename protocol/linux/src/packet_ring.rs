//! Frames that pass an interface, in memory shared with the kernel (`PACKET_RX_RING`, packet(7)). It needs no system
//! call per frame and wakes no thread; each system call would take some 2 µs of that processor.

use std::io;
use std::os::fd::AsFd as _;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use socket2::Socket;

use crate::Interface;
use crate::packet_socket::{self, FrameBuffer};
use crate::socket_option;
use capture_file::Packet;

/// Size of a slot in bytes: a frame with the usual 1500 bytes of payload and the kernel's header. Longer frames are
/// cut.
const SLOT: usize = 2_048;

/// Size of a block of the ring in bytes.
const BLOCK: usize = 1 << 16;

/// The reader's side of the ring.
#[derive(Debug)]
pub(crate) struct PacketRing {
    socket: Socket,
    memory: NonNull<u8>,
    slots: usize,
    next: usize,
}

// SAFETY: the ring owns its memory, and the owner of the ring is its only reader.
unsafe impl Send for PacketRing {}

impl PacketRing {
    /// Opens a ring with room for at least `slots` frames. Needs `CAP_NET_RAW`.
    pub(crate) fn open(interface: &Interface, slots: usize) -> io::Result<Self> {
        let blocks = (slots * SLOT).div_ceil(BLOCK);
        let slots = blocks * BLOCK / SLOT;
        let socket = packet_socket::open(interface, packet_socket::ALL, |socket| {
            packet_socket::request_timestamps(socket)?;
            let version = libc::tpacket_versions::TPACKET_V2 as libc::c_int;
            socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_VERSION, &version)?;
            let wanted = libc::tpacket_req {
                tp_block_size: BLOCK as u32,
                tp_block_nr: blocks as u32,
                tp_frame_size: SLOT as u32,
                tp_frame_nr: slots as u32,
            };
            socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_RX_RING, &wanted)
        })?;
        let (protection, flags) = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED);
        // SAFETY: a new mapping of the whole ring at an address that the kernel chooses.
        let memory =
            unsafe { mmap(std::ptr::null_mut(), slots * SLOT, protection, flags, socket.as_fd(), 0) }?;
        let memory = NonNull::new(memory.cast()).ok_or(io::ErrorKind::OutOfMemory)?;
        Ok(Self { socket, memory, slots, next: 0 })
    }

    /// Returns the socket, to set further options.
    pub(crate) const fn socket(&self) -> &Socket {
        &self.socket
    }

    /// Returns the next frame, if there is one.
    pub(crate) fn take<'a>(&mut self, buffer: &'a mut FrameBuffer) -> Option<Packet<'a>> {
        // SAFETY: `next` is below the number of slots, so this is within the mapping.
        let slot = unsafe { self.memory.add(self.next * SLOT) };
        let header = slot.cast::<libc::tpacket2_hdr>();
        // SAFETY: a slot begins with this header, and the header with its status: an aligned word that the kernel and
        // the reader hand each other, and that outlives the reference.
        let status = unsafe { AtomicU32::from_ptr(&raw mut (*header.as_ptr()).tp_status) };
        let found = status.load(Ordering::Acquire);
        if found & libc::TP_STATUS_USER == 0 {
            return None;
        }
        // SAFETY: the slot belongs to the reader until it is handed back below, and all bytes are valid for these
        // structures; the address follows the header and is aligned like it.
        let (header, address) = unsafe {
            let behind = libc::TPACKET2_HDRLEN - size_of::<libc::sockaddr_ll>();
            (header.read(), slot.add(behind).cast::<libc::sockaddr_ll>().read())
        };
        let start = usize::from(header.tp_mac).min(SLOT);
        let room = buffer.room();
        let len = (header.tp_snaplen as usize).min(SLOT - start).min(room.len());
        // SAFETY: the source ends within the slot, the destination is at least as long, and the two do not overlap.
        unsafe { slot.add(start).copy_to_nonoverlapping(NonNull::from(room).cast(), len) };
        status.store(libc::TP_STATUS_KERNEL, Ordering::Release);
        self.next = (self.next + 1) % self.slots;
        Some(Packet {
            since_1970: Duration::new(header.tp_sec.into(), header.tp_nsec),
            sent: Some(address.sll_pkttype == libc::PACKET_OUTGOING),
            data: buffer
                .frame(len, packet_socket::removed_tag(found, header.tp_vlan_tpid, header.tp_vlan_tci)),
            comment: None,
        })
    }

    /// Returns how many frames found no room since the last call.
    ///
    /// # Errors
    ///
    /// The interface went down or was removed since then.
    pub(crate) fn left_out(&self) -> io::Result<u64> {
        if let Some(error) = self.socket.take_error()? {
            return Err(error);
        }
        let counted: libc::tpacket_stats =
            socket_option::get(&self.socket, libc::SOL_PACKET, libc::PACKET_STATISTICS)?;
        Ok(counted.tp_drops.into())
    }
}

impl Drop for PacketRing {
    fn drop(&mut self) {
        // SAFETY: the whole mapping that `open` made; nothing borrows from it.
        let _ = unsafe { munmap(self.memory.as_ptr().cast(), self.slots * SLOT) };
    }
}
