//! The mark: both ends send a datagram a cycle from a loop that does nothing else.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};

use machine::Instant;
use protocol_linux::{clock, scheduling};

use super::cable::{Cable, PLC, ROBOT};
use super::{INTERVAL, SETTLE, TURN};

const PORT: u16 = 2_223;

/// Time that the two threads have to get going.
const LEAD: std::time::Duration = std::time::Duration::from_millis(10);

/// From a frame of the robot's end to the next of the PLC's. An adapter's interval begins when it opens the connection,
/// a scanner's when it hears of that, so the contenders' frames follow each other like this: on one host, where both
/// ends share the cores, that costs what two other phases would not, and is to cost all of them alike.
const BEHIND: std::time::Duration = std::time::Duration::from_micros(30);

/// What a class 1 frame with 256 bytes of data has behind the UDP header: 18 bytes of items, the sequence count.
const PAYLOAD: [u8; 276] = [0; 276];

/// Sends both ways for a turn. Returns when it began.
pub(super) fn exchange(cable: &Cable) -> anyhow::Result<Instant> {
    let start = clock::now() + LEAD;
    std::thread::scope(|scope| {
        let robot = scope.spawn(|| cable.robot.run(|_| send(start, ROBOT, PLC)));
        let plc = cable.plc.run(|_| send(start + BEHIND, PLC, ROBOT));
        robot.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)).and(plc)
    })?;
    Ok(start)
}

fn send(start: Instant, from: Ipv4Addr, to: Ipv4Addr) -> anyhow::Result<()> {
    // Bound, so that what the other end sends is not answered by ICMP; it is never read.
    let socket = UdpSocket::bind(SocketAddrV4::new(from, PORT))?;
    socket.connect(SocketAddrV4::new(to, PORT))?;
    // Its warning, if there is one, is that of the contenders' threads too.
    let _ = scheduling::make_real_time();
    let end = start + SETTLE + TURN;
    let mut due = start + INTERVAL;
    while due < end {
        clock::sleep_until(due);
        // The kernel has a moment's reason not to take one; that frame then misses in the table.
        let _ = socket.send(&PAYLOAD);
        (due, _) = due.next_on_grid(INTERVAL, clock::now());
    }
    Ok(())
}
