//! The sockets that nodes and benches of this computer hold open for others, as the kernel lists them.

use std::collections::BTreeSet;
use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::Path;

/// Programs whose sockets are listed.
const PROGRAMS: [&str; 3] = ["plc-node", "robot-node", "bench"];

/// State of a listening TCP socket in /proc/net/tcp.
const LISTEN: &str = "0A";

/// A socket that receives what others send.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct Listening {
    /// The program and its process number.
    pub program: String,
    /// Protocol, address and port, or EtherType.
    pub socket: String,
}

/// Returns the sockets of all nodes and benches whose files this user may read.
#[must_use]
pub fn find_sockets() -> Vec<Listening> {
    let Ok(processes) = fs::read_dir("/proc") else { return Vec::new() };
    let mut found: Vec<_> = processes.flatten().flat_map(|process| of_process(&process.path())).collect();
    found.sort();
    found
}

fn of_process(process: &Path) -> Vec<Listening> {
    let name = fs::read_to_string(process.join("comm")).unwrap_or_default();
    let name = name.trim();
    if !PROGRAMS.contains(&name) {
        return Vec::new();
    }
    let inodes = inodes(&process.join("fd"));
    let number = process.file_name().unwrap_or_default().to_string_lossy();
    let table = |file: &str| fs::read_to_string(process.join("net").join(file)).unwrap_or_default();
    let tcp = rows(&table("tcp"), &inodes, |row| row.state == LISTEN);
    let udp = rows(&table("udp"), &inodes, |_| true);
    let tcp = tcp.into_iter().map(|at| format!("TCP {at}{}", purpose(at, true)));
    let udp = udp.into_iter().map(|at| format!("UDP {at}{}", purpose(at, false)));
    let raw = ether_types(&table("packet"), &inodes);
    let raw = raw.into_iter().map(|ether_type| format!("EtherType 0x{ether_type:04X}"));
    let program = format!("{name} {number}");
    tcp.chain(udp).chain(raw).map(|socket| Listening { program: program.clone(), socket }).collect()
}

/// Returns the purpose of one of our ports.
const fn purpose(at: SocketAddrV4, is_tcp: bool) -> &'static str {
    match (at.port(), is_tcp) {
        (44_818, _) => " (EtherNet/IP)",
        (2_222, false) => " (EtherNet/IP, cyclic)",
        (34_962, false) => " (PROFINET, cyclic)",
        (34_964, false) => " (PROFINET)",
        (_, true) if at.ip().is_loopback() => " (control port, this computer only)",
        (_, true) => " (control port, with a token)",
        _ => "",
    }
}

/// Returns the sockets among the open files of a process.
fn inodes(files: &Path) -> BTreeSet<u64> {
    let Ok(files) = fs::read_dir(files) else { return BTreeSet::new() };
    let inode = |link: &Path| {
        let target = fs::read_link(link).ok()?;
        target.to_str()?.strip_prefix("socket:[")?.strip_suffix(']')?.parse().ok()
    };
    files.flatten().filter_map(|file| inode(&file.path())).collect()
}

struct ListenedRow<'a> {
    state: &'a str,
}

/// Returns the local addresses in a table of /proc/net, of the wanted rows that have one of these inodes.
fn rows(table: &str, inodes: &BTreeSet<u64>, wanted: impl Fn(&ListenedRow<'_>) -> bool) -> Vec<SocketAddrV4> {
    let row = |line: &str| {
        let fields: Vec<_> = line.split_whitespace().collect();
        let [_, local, _, state, _, _, _, _, _, inode, ..] = fields[..] else { return None };
        let is_wanted = inodes.contains(&inode.parse().ok()?) && wanted(&ListenedRow { state });
        let (ip, port) = local.split_once(':')?;
        // The address is a number in the order of this processor's memory.
        let ip = Ipv4Addr::from(u32::from_str_radix(ip, 16).ok()?.to_ne_bytes());
        let port = u16::from_str_radix(port, 16).ok()?;
        is_wanted.then_some(SocketAddrV4::new(ip, port))
    };
    table.lines().skip(1).filter_map(row).collect()
}

/// Returns the EtherTypes in /proc/net/packet of sockets with one of these inodes.
fn ether_types(table: &str, inodes: &BTreeSet<u64>) -> Vec<u16> {
    let row = |line: &str| {
        let fields: Vec<_> = line.split_whitespace().collect();
        let [_, _, _, protocol, _, _, _, _, inode, ..] = fields[..] else { return None };
        let ether_type = u16::from_str_radix(protocol, 16).ok()?;
        inodes.contains(&inode.parse().ok()?).then_some(ether_type)
    };
    table.lines().skip(1).filter_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TCP: &str = "\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:1E14 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 31 1 0 100 0 0 10 0
   1: 0140A8C0:AF12 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 32 1 0 100 0 0 10 0
   2: 0140A8C0:AF12 0240A8C0:C350 01 00000000:00000000 00:00000000 00000000     0        0 33 1 0 100 0 0 10 0
   3: 00000000:0016 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 99 1 0 100 0 0 10 0
";
    const PACKET: &str = "\
sk               RefCnt Type Proto  Iface R Rmem   User   Inode
0000000000000000 3      3    8892   4     1 0      0      34
0000000000000000 3      3    0003   4     1 0      0      98
";

    #[test]
    fn listening_sockets_of_these_files_are_found_in_the_kernels_tables() {
        let own = BTreeSet::from([31, 32, 33, 34]);
        let found = rows(TCP, &own, |row| row.state == LISTEN);
        let shown: Vec<_> = found.iter().map(|at| format!("{at}{}", purpose(*at, true))).collect();
        assert_eq!(
            shown,
            ["127.0.0.1:7700 (control port, this computer only)", "192.168.64.1:44818 (EtherNet/IP)"]
        );
        assert_eq!(ether_types(PACKET, &own), [0x8892]);
        assert_eq!(rows("broken", &own, |_| true), []);
    }

    #[test]
    fn looking_at_this_computer_finds_no_port_of_a_test() {
        assert!(find_sockets().iter().all(|found| found.socket.len() > 4));
    }
}
