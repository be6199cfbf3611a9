//! One machine on several interfaces of the host, or on one of them twice.

mod notebook;

use std::net::{Ipv4Addr, SocketAddrV4, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};

use machine::arp::{ArpPacket, Operation};
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{
    Attempt, Cycle, Duration, Instant, InterfaceId, Port, PortRequest, StreamChange, StreamRequest,
};
use networked_tests::End;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Driver, DriverError, Interface, Notifier, OpenPort, clock};

use super::test_network::TIMEOUT;
use notebook::{Call, Notebook, Until};

const ETHER_TYPE: u16 = 0x88B5;
const RAW: PortRequest = PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] };
const UDP: u16 = 4_001;
const OTHER_UDP: u16 = 4_002;
const TCP: u16 = 4_003;
const PERIOD: Duration = Duration::from_millis(2);
const BUSES: [InterfaceId; 2] = [InterfaceId(0), InterfaceId(1)];

/// Addresses of the machine and of its peer on each cable.
const fn address(cable: u8, host: u8) -> Ipv4Addr {
    Ipv4Addr::new(10, 0, cable, host)
}

/// A network with the machine, and two that each have one peer at the other end of a cable.
struct Star {
    plc: NetworkNamespace,
    peers: [Option<NetworkNamespace>; 2],
}

impl Star {
    fn new() -> Self {
        let plc = NetworkNamespace::new().unwrap();
        let peers = [0, 1].map(|cable: u8| {
            let peer = NetworkNamespace::new().unwrap();
            let near =
                End { network: &plc, name: NAMES[usize::from(cable)], address: Some(address(cable, 1)) };
            networked_tests::cable([
                near,
                End { network: &peer, name: "peer0", address: Some(address(cable, 2)) },
            ]);
            Some(peer)
        });
        Self { plc, peers }
    }

    /// Runs `job` at the machine's interfaces.
    fn run<T: Send>(&self, job: impl FnOnce([Interface; 2]) -> T + Send) -> T {
        self.plc.run(|| job(NAMES.map(|name| Interface::open(name).unwrap()))).unwrap()
    }

    /// Runs `job` where the peer on a cable is.
    fn at_peer<T: Send>(&self, cable: usize, job: impl FnOnce(&Interface) -> T + Send) -> T {
        let network = self.peers[cable].as_ref().unwrap();
        network.run(|| job(&Interface::open("peer0").unwrap())).unwrap()
    }

    /// Returns a socket of the peer on a cable, at the machine's first UDP port.
    fn socket(&self, cable: usize) -> UdpSocket {
        let socket = self.at_peer(cable, |_| UdpSocket::bind(("0.0.0.0", UDP)).unwrap());
        socket.set_read_timeout(Some(TIMEOUT)).unwrap();
        socket
    }
}

const NAMES: [&str; 2] = ["plc0", "plc1"];

fn driver(machine: Notebook, interfaces: impl Into<Vec<Interface>>) -> Driver<Notebook> {
    Driver::new(machine, interfaces, Notifier::new().unwrap()).unwrap()
}

pub(crate) fn one_thread_serves_two_interfaces_with_one_wakeup_a_cycle() {
    const CYCLES: usize = 100;
    let star = Star::new();
    let sockets = [star.socket(0), star.socket(1)];
    let (machine, statistics) = star.run(|interfaces| {
        let mut machine = Notebook::on([&[PortRequest::Udp(UDP)], &[PortRequest::Udp(UDP)]]);
        machine.cyclic = vec![
            (BUSES[0], Port::Udp(UDP), SocketAddrV4::new(address(0, 2), UDP)),
            (BUSES[1], Port::Udp(UDP), SocketAddrV4::new(address(1, 2), UDP)),
        ];
        let mut driver = driver(machine, interfaces);
        for (cable, socket) in (0..).zip(&sockets) {
            socket.send_to(&[cable], (address(cable, 1), UDP)).unwrap();
        }
        let start = clock::now() + PERIOD;
        driver
            .run(&mut Until(|machine: &mut Notebook| {
                machine.cycle.get_or_insert_with(|| Cycle::new(start, PERIOD));
                machine.timeouts() >= CYCLES
            }))
            .unwrap();
        let statistics = driver.statistics().clone();
        (driver.into_machine(), statistics)
    });
    // Each interface's own datagram, and nothing of the other's.
    let mut frames = machine.frames();
    frames.sort_by_key(|(on, ..)| *on);
    assert_eq!(frames, BUSES.map(|on| (on, Port::Udp(UDP), vec![on.0])));
    for (on, socket) in (0_u8..).zip(&sockets) {
        let mut received = [0; 8];
        for _ in 0..CYCLES {
            let (len, from) = socket.recv_from(&mut received).unwrap();
            assert_eq!((&received[..len], from.ip()), (&[b'#', on][..], address(on, 1).into()));
        }
    }
    assert_eq!((statistics.sent, statistics.send_errors), (2 * CYCLES as u64, 0));
    // The datagrams that waited may take a wake-up each.
    let cycles = machine.timeouts() as u64;
    assert!(
        (cycles..=cycles + 2).contains(&statistics.wakeups),
        "{} wake-ups in {cycles} cycles",
        statistics.wakeups
    );
}

pub(crate) fn two_buses_on_the_same_interface_of_the_host_have_sockets_of_their_own() {
    let star = Star::new();
    let socket = star.socket(0);
    let machine = star.run(|[interface, _]| {
        let mac = interface.mac();
        let machine = Notebook::on([&[RAW, PortRequest::Udp(UDP)], &[RAW, PortRequest::Udp(OTHER_UDP)]]);
        let mut driver = driver(machine, [interface.clone(), interface]);
        star.at_peer(0, |peer| {
            let frame = [&mac.0[..], &peer.mac().0, &ETHER_TYPE.to_be_bytes(), &[7; 46]].concat();
            OpenPort::open(peer, RAW).unwrap().send(&frame, None, 0).unwrap();
        });
        for port in [UDP, OTHER_UDP] {
            socket.send_to(&port.to_be_bytes(), (address(0, 1), port)).unwrap();
        }
        let mut is_sent = false;
        driver
            .run(&mut Until(|machine: &mut Notebook| {
                if !std::mem::replace(&mut is_sent, true) {
                    let peer = SocketAddrV4::new(address(0, 2), UDP);
                    machine.queue =
                        vec![(BUSES[1], Port::Udp(OTHER_UDP), peer), (BUSES[0], Port::Udp(UDP), peer)];
                }
                machine.frames().len() >= 4
            }))
            .unwrap();
        driver.into_machine()
    });
    for (on, udp) in BUSES.into_iter().zip([UDP, OTHER_UDP]) {
        let of_bus: Vec<_> = machine.frames().into_iter().filter(|(there, ..)| *there == on).collect();
        let is_raw =
            |(_, port, bytes): &(_, Port, Vec<u8>)| *port == Port::Ethernet && bytes[14..] == [7; 46];
        assert!(of_bus.len() == 2 && of_bus.iter().any(is_raw), "{of_bus:?}");
        assert!(of_bus.contains(&(on, Port::Udp(udp), udp.to_be_bytes().to_vec())), "{of_bus:?}");
    }
    for (on, udp) in [(0, UDP), (1, OTHER_UDP)] {
        let mut received = [0; 8];
        let (len, from) = socket.recv_from(&mut received).unwrap();
        assert_eq!((&received[..len], from.port()), (&[b'#', on][..], udp));
    }
}

pub(crate) fn a_port_that_two_buses_need_on_one_interface_is_refused_and_named() {
    let star = Star::new();
    let errors = star.run(|[interface, other]| {
        let open = |machine: Notebook, interfaces: Vec<Interface>| {
            Driver::new(machine, interfaces, Notifier::new().unwrap()).map(drop).map_err(|e| e.to_string())
        };
        let udp = || Notebook::on([&[PortRequest::Udp(UDP)], &[PortRequest::Udp(UDP)]]);
        let tcp = || Notebook { listens: Some(TCP), ..Notebook::default() };
        let twice = || vec![interface.clone(), interface.clone()];
        let each = || vec![interface.clone(), other.clone()];
        // On an interface each, they are two ports.
        assert_eq!((open(udp(), each()), open(tcp(), each())), (Ok(()), Ok(())));
        [open(udp(), twice()), open(tcp(), twice()), open(udp(), vec![other])].map(Result::unwrap_err)
    });
    let [udp, tcp, count] = errors;
    let remedy = "on `plc0` is needed by two buses of this node: give one of them another interface";
    assert_eq!(udp, format!("UDP port {UDP} {remedy}"));
    assert_eq!(tcp, format!("TCP port {TCP} {remedy}"));
    assert_eq!(count, "1 network interfaces were given to a node that needs 2: one for each bus");
}

pub(crate) fn the_interface_that_is_removed_is_named() {
    for (gone, name) in NAMES.into_iter().enumerate() {
        let mut star = Star::new();
        let mut driver = star.run(|interfaces| {
            let mut machine = Notebook::on([&[RAW, PortRequest::Udp(UDP)], &[RAW, PortRequest::Udp(UDP)]]);
            machine.cycle = Some(Cycle::new(clock::now(), PERIOD));
            machine.cyclic = (0..2)
                .map(|cable| (InterfaceId(cable), Port::Udp(UDP), SocketAddrV4::new(address(cable, 2), UDP)))
                .collect();
            driver(machine, interfaces)
        });
        // A veth end is removed with its namespace, and takes the other end with it.
        star.peers[gone] = None;
        let result = driver.run(&mut Until(|_: &mut Notebook| false));
        let is_named = matches!(&result, Err(DriverError::InterfaceGone { interface }) if interface == name);
        assert!(is_named, "{result:?}");
    }
}

pub(crate) fn connections_are_made_and_accepted_at_each_interface() {
    let star = Star::new();
    let listeners = [0, 1].map(|cable| star.at_peer(cable, |_| TcpListener::bind(("0.0.0.0", TCP)).unwrap()));
    let to = |cable: u8| StreamRequest::Connect {
        to: SocketAddrV4::new(address(cable, 2), TCP),
        attempt: Attempt(1),
    };
    let calls = star.run(|interfaces| {
        let machine = Notebook {
            listens: Some(TCP),
            // The same attempt at both is two connections.
            requests: vec![(BUSES[1], to(1)), (BUSES[0], to(0))],
            ..Notebook::default()
        };
        let mut driver = driver(machine, interfaces);
        let connect = |cable: u8| TcpStream::connect((address(cable, 1), TCP)).unwrap();
        let _clients = [star.at_peer(0, |_| connect(0)), star.at_peer(1, |_| connect(1))];
        driver.run(&mut Until(|machine: &mut Notebook| machine.calls.len() >= 4)).unwrap();
        driver.into_machine().calls
    });
    for (cable, listener) in (0..).zip(&listeners) {
        assert_eq!(listener.accept().unwrap().1.ip(), address(cable, 1));
        let on = InterfaceId(cable);
        let of_bus = |wanted: &dyn Fn(&StreamChange) -> bool| {
            let found = |call: &&Call| matches!(call, Call::Stream(there, _, change) if *there == on && wanted(change));
            calls.iter().filter(found).count()
        };
        assert_eq!(of_bus(&|change| *change == StreamChange::Connected(Attempt(1))), 1, "{calls:?}");
        let peer = address(cable, 2);
        let is_client =
            |change: &StreamChange| matches!(change, StreamChange::Accepted(from) if *from.ip() == peer);
        assert_eq!(of_bus(&is_client), 1, "{calls:?}");
    }
    let mut numbers: Vec<_> = calls
        .iter()
        .filter_map(|call| if let Call::Stream(_, id, _) = call { Some(*id) } else { None })
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    assert_eq!(numbers.len(), 4, "connections of all interfaces are numbered together: {calls:?}");
}

pub(crate) fn a_machine_connects_to_more_stations_than_clients_may_connect_to_it() {
    const STATIONS: u16 = 100;
    let star = Star::new();
    let listeners = [0, 1].map(|cable| star.at_peer(cable, |_| TcpListener::bind(("0.0.0.0", TCP)).unwrap()));
    let calls = star.run(|interfaces| {
        let connect = |number: u16| {
            let on = BUSES[usize::from(number % 2)];
            let to = SocketAddrV4::new(address(on.0, 2), TCP);
            (on, StreamRequest::Connect { to, attempt: Attempt(number) })
        };
        let machine = Notebook { requests: (0..STATIONS).map(connect).collect(), ..Notebook::default() };
        let mut driver = driver(machine, interfaces);
        let all = usize::from(STATIONS);
        driver.run(&mut Until(|machine: &mut Notebook| machine.calls.len() >= all)).unwrap();
        driver.into_machine().calls
    });
    let is_open = |call: &Call| matches!(call, Call::Stream(_, _, StreamChange::Connected(_)));
    assert!(calls.iter().all(is_open), "{calls:?}");
    drop(listeners);
}

pub(crate) fn frames_of_many_stations_wake_the_thread_in_groups() {
    let star = Star::new();
    let sockets = [star.socket(0), star.socket(1)];
    let is_over = AtomicBool::new(false);
    let (wakeups, frames, time) = std::thread::scope(|scope| {
        for (cable, socket) in (0..).zip(&sockets) {
            let is_over = &is_over;
            scope.spawn(move || {
                while !is_over.load(Ordering::Relaxed) {
                    socket.send_to(&[cable], (address(cable, 1), UDP)).unwrap();
                    let next = clock::now() + Duration::from_micros(20);
                    while clock::now() < next {
                        std::hint::spin_loop();
                    }
                }
            });
        }
        let ran = star.run(|interfaces| {
            let machine = Notebook::on([&[PortRequest::Udp(UDP)], &[PortRequest::Udp(UDP)]]);
            let mut driver = driver(machine, interfaces);
            let start = clock::now();
            driver.run(&mut Until(|machine: &mut Notebook| machine.calls.len() >= 5_000)).unwrap();
            let time = clock::now().since(start);
            (driver.statistics().wakeups, driver.statistics().received, time)
        });
        is_over.store(true, Ordering::Relaxed);
        ran
    });
    // A burst, then one in 250 µs; twice that, since a loaded host wakes the thread for more than its frames. Without groups it
    // would be nearly one for each frame.
    let most = 2 * (32 + time.as_micros() / 250 + 2);
    assert!(u128::from(wakeups) <= most, "{wakeups} wake-ups for {frames} frames, at most {most}");
}

/// Frames of one port that a driver takes in a row.
const BATCH: usize = 64;

/// Returns what a machine was called for whose frames wait at both interfaces when its driver starts, two batches each.
fn calls_with_waiting_frames(machine: Notebook, due: Option<Instant>) -> Vec<Call> {
    let star = Star::new();
    let sockets = [star.socket(0), star.socket(1)];
    star.run(|interfaces| {
        let mut driver = driver(machine, interfaces);
        for (cable, socket) in (0..).zip(&sockets) {
            for _ in 0..2 * BATCH {
                socket.send_to(&[cable], (address(cable, 1), UDP)).unwrap();
            }
        }
        let mut due = due;
        driver
            .run(&mut Until(|machine: &mut Notebook| {
                machine.due = machine.due.or(due.take());
                machine.frames().len() >= 4 * BATCH
            }))
            .unwrap();
        driver.into_machine().calls
    })
}

fn bus_of(call: &Call) -> Option<InterfaceId> {
    if let Call::Frame(on, ..) = call { Some(*on) } else { None }
}

pub(crate) fn after_a_stall_the_frames_that_came_meanwhile_are_taken_before_what_is_overdue() {
    let machine = Notebook::on([&[PortRequest::Udp(UDP)], &[PortRequest::Udp(UDP)]]);
    let calls = calls_with_waiting_frames(machine, Some(Instant::ZERO));
    let until_due = calls.split(|call| *call == Call::Timeout).next().unwrap();
    for on in BUSES {
        let frames = until_due.iter().filter(|call| bus_of(call) == Some(on)).count();
        assert_eq!(frames, 2 * BATCH, "{on:?}, before a deadline that the host met too late");
    }
}

pub(crate) fn an_interface_whose_frames_are_left_for_a_deadline_does_not_keep_the_other_one_waiting() {
    let machine =
        Notebook { is_busy: true, ..Notebook::on([&[PortRequest::Udp(UDP)], &[PortRequest::Udp(UDP)]]) };
    let calls = calls_with_waiting_frames(machine, None);
    let buses: Vec<_> = calls.iter().filter_map(bus_of).collect();
    for on in BUSES {
        let first = buses.iter().position(|from| *from == on);
        assert!(first.is_some_and(|first| first < BATCH), "{on:?}: its first frame is number {first:?}");
    }
    let in_a_row = calls.split(|call| *call == Call::Timeout).map(<[_]>::len).max();
    assert!(in_a_row <= Some(2), "{in_a_row:?} frames in a row of {}", calls.len());
}

pub(crate) fn an_arp_packet_makes_every_bus_on_its_interface_look_at_the_neighbours_again() {
    let star = Star::new();
    let right = star.at_peer(0, Interface::mac);
    let wrong = Mac([2, 0, 0, 0, 0, 0x77]);
    star.run(|[interface, _]| {
        let ports: [&[PortRequest]; 2] = [&[machine::arp::ETHERNET], &[PortRequest::Udp(UDP)]];
        let cycle = Some(Cycle::new(clock::now(), PERIOD));
        let machine = Notebook { neighbour: Some(right), cycle, ..Notebook::on(ports) };
        let mut driver = driver(machine, [interface.clone(), interface.clone()]);
        let datagram = (BUSES[1], Port::Udp(UDP), SocketAddrV4::new(address(0, 2), UDP));
        let mut step = 0;
        driver
            .run(&mut Until(|machine: &mut Notebook| {
                let is_claim = |(_, _, frame): &(_, _, Vec<u8>)| frame[6..12] == wrong.0;
                match step {
                    0 => machine.queue = vec![datagram],
                    // Somebody's ARP changes the entry that was right, and the first bus alone receives it.
                    1 => {
                        assert_eq!(interface.neighbour(address(0, 2)).unwrap(), Some(right));
                        interface.set_neighbour(address(0, 2), wrong).unwrap();
                        star.at_peer(0, |peer| claim(peer, address(0, 2), wrong));
                    }
                    2 if !machine.frames().iter().any(is_claim) => return false,
                    2 => machine.queue = vec![datagram],
                    _ => return true,
                }
                step += 1;
                false
            }))
            .unwrap();
        assert_eq!(interface.neighbour(address(0, 2)).unwrap(), Some(right));
    });
}

/// Sends a request from `peer` in which `mac` claims an address.
fn claim(peer: &Interface, address: Ipv4Addr, mac: Mac) {
    let packet = ArpPacket {
        operation: Operation::Request,
        sender_mac: mac,
        sender_address: address,
        target_mac: Mac([0; 6]),
        target_address: address,
    };
    let mut frame = [0; FRAME_CAPACITY];
    let len = packet.emit_frame(&mut frame).unwrap();
    OpenPort::open(peer, machine::arp::ETHERNET).unwrap().send(&frame[..len], None, 0).unwrap();
}
