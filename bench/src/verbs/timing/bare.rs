//! The reference of the comparison: both ends send one datagram per cycle from a loop that does nothing else.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

use machine::Instant;
use protocol_linux::{clock, scheduling};

use super::cable::{Cable, PLC, ROBOT};
use super::{INTERVAL, SETTLE, TURN};

const PORT: u16 = 2_223;

/// Time for the two threads to start.
const LEAD: std::time::Duration = std::time::Duration::from_millis(10);

/// Time from a frame of the robot's end to the next one of the PLC's. The contenders' frames follow each other like
/// this, since an adapter's interval begins when it opens the connection and a scanner's when it receives the reply.
/// On one host, whose cores both ends share, this phase costs more than others; it must cost all contenders the same.
const PHASE_OFFSET: std::time::Duration = std::time::Duration::from_micros(30);

/// Length of a class 1 frame with 256 bytes of data behind the UDP header: 18 bytes of items, the sequence count.
const PAYLOAD: [u8; 276] = [0; 276];

/// Sends in both directions for a turn. Returns when it began.
pub(super) fn exchange(cable: &Cable) -> anyhow::Result<Instant> {
    let start = clock::now() + LEAD;
    std::thread::scope(|scope| {
        let robot = scope.spawn(|| cable.robot.run(|_| send(start, ROBOT, PLC)));
        let plc = cable.plc.run(|_| send(start + PHASE_OFFSET, PLC, ROBOT));
        robot.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)).and(plc)
    })?;
    Ok(start)
}

fn send(start: Instant, from: Ipv4Addr, to: Ipv4Addr) -> anyhow::Result<()> {
    // Bound, so that the other end's datagrams are not answered by ICMP; they are never read.
    let socket = UdpSocket::bind(SocketAddrV4::new(from, PORT))?;
    socket.connect(SocketAddrV4::new(to, PORT))?;
    // The contenders' threads report the same warning, if there is one.
    let _ = scheduling::make_real_time();
    let end = start + SETTLE + TURN;
    let mut due = start + INTERVAL;
    while due < end {
        clock::sleep_until(due);
        // If the kernel refuses one at some moment, that frame is missing in the table.
        let _ = socket.send(&PAYLOAD);
        (due, _) = due.next_on_grid(INTERVAL, clock::now());
    }
    Ok(())
}
