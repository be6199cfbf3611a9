//! Times at which frames arrive, by the kernel's time stamps: shows how evenly a sender keeps its cycle.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::Socket;

use crate::packet_socket::{self, FrameBuffer};
use crate::{Interface, RecorderError};

/// Time without a frame after which the thread checks whether it is to stop.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(100);

/// A frame that arrived.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Arrival {
    /// When the kernel received it from the cable, since 1970 in UTC. That clock is slewed like the monotonic one.
    pub since_1970: Duration,
    /// Its length in bytes, with the Ethernet header.
    pub len: usize,
}

/// Records when frames of other stations arrive, from a thread and a socket of its own.
#[derive(Debug)]
pub struct ArrivalLog {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<io::Result<Vec<Arrival>>>,
    interface: String,
}

impl ArrivalLog {
    /// Starts to record what arrives on an interface. Needs `CAP_NET_RAW`.
    pub fn start(interface: &Interface) -> Result<Self, RecorderError> {
        let name = interface.name().to_owned();
        let failed = |reason| RecorderError::Socket { interface: name.clone(), reason };
        let prepare = |socket: &Socket| {
            socket.set_read_timeout(Some(STOP_CHECK_INTERVAL))?;
            packet_socket::prepare_receive(socket)
        };
        let socket = packet_socket::open(interface, packet_socket::ALL, prepare).map_err(failed)?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let listen = move || {
            let mut arrivals = Vec::new();
            let mut buffer = FrameBuffer::new();
            while !stopped.load(Ordering::Relaxed) {
                match packet_socket::receive(&socket, &mut buffer) {
                    Ok(frame) => {
                        // Not by the source address: EtherCAT's MainDevice sends with one that is not the interface's.
                        if frame.sent == Some(false) {
                            arrivals.push(Arrival { since_1970: frame.since_1970, len: frame.data.len() });
                        }
                    }
                    Err(error) => match error.kind() {
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted => {}
                        _ => return Err(error),
                    },
                }
            }
            Ok(arrivals)
        };
        let thread = std::thread::Builder::new().name("arrivals".to_owned()).spawn(listen).map_err(failed)?;
        Ok(Self { stop, thread, interface: name })
    }

    /// Ends the log and returns its arrivals in order.
    pub fn stop(self) -> Result<Vec<Arrival>, RecorderError> {
        self.stop.store(true, Ordering::Relaxed);
        let log = self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        log.map_err(|reason| RecorderError::Socket { interface: self.interface, reason })
    }
}
