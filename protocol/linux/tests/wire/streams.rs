//! TCP connections of a machine to ordinary sockets of this host.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddrV4, TcpListener, TcpStream};
use std::time::Instant;

use protocol_linux::{Driver, Notifier, clock};

use super::machines::tcp::{Caller, EchoServer, FAREWELL, FLOOD, GREETING, LEAVE, TCP_PORT};
use super::test_network::{ADDRESSES, Running, TIMEOUT, TestNetwork};

const SERVER: SocketAddrV4 = SocketAddrV4::new(ADDRESSES[1], TCP_PORT);

impl TestNetwork {
    fn echo_server(&self) -> Running<EchoServer> {
        self.start(1, |_| EchoServer::new(clock::now()))
    }

    /// Returns a client in the left network.
    fn client(&self) -> TcpStream {
        let client = self.ends[0].0.run(|| TcpStream::connect(SERVER)).unwrap().unwrap();
        client.set_nodelay(true).unwrap();
        client.set_read_timeout(Some(TIMEOUT)).unwrap();
        client
    }
}

fn echoes(mut client: &TcpStream, text: &[u8]) -> bool {
    let mut received = vec![0; text.len()];
    client.write_all(text).is_ok() && client.read_exact(&mut received).is_ok() && received == text
}

pub(crate) fn a_client_that_sends_single_bytes_and_closes_its_side_receives_every_answer() {
    let network = TestNetwork::new();
    let server = network.echo_server();
    let text: Vec<u8> = (0..2000_u32).map(|n| n as u8).collect();
    let mut client = network.client();
    for byte in &text {
        client.write_all(&[*byte]).unwrap();
    }
    client.shutdown(Shutdown::Write).unwrap();
    let mut received = Vec::new();
    client.read_to_end(&mut received).unwrap();
    assert!(received == text, "{} of {} bytes came back", received.len(), text.len());
    let server = server.stop();
    assert_eq!(server.driver.machine().opened, server.driver.machine().closed);
}

pub(crate) fn a_connection_that_the_machine_closes_first_sends_its_last_bytes() {
    let network = TestNetwork::new();
    let server = network.echo_server();
    let mut client = network.client();
    client.write_all(LEAVE).unwrap();
    let mut received = Vec::new();
    client.read_to_end(&mut received).unwrap();
    assert_eq!(received, FAREWELL);
    drop(client);
    assert_eq!(
        server.stop().driver.machine().closed,
        [],
        "the machine is not informed of a close that it requested"
    );
}

pub(crate) fn a_client_that_does_not_read_is_disconnected_and_delays_nobody() {
    let network = TestNetwork::new();
    let server = network.echo_server();
    let (mut deaf, other) = (network.client(), network.client());
    deaf.write_all(FLOOD).unwrap();
    let started = Instant::now();
    while deaf.take_error().unwrap().is_none() {
        assert!(started.elapsed() < TIMEOUT, "the client that does not read is still connected");
        assert!(echoes(&other, b"still there?"));
    }
    assert!(echoes(&other, b"and after it?"));
    let server = server.stop();
    assert_eq!(server.driver.statistics().streams.overflowed, 1);
    assert_eq!(server.driver.machine().closed, server.driver.machine().opened[..1]);
}

pub(crate) fn clients_beyond_the_limit_are_disconnected_and_the_others_stay() {
    let network = TestNetwork::new();
    let server = network.echo_server();
    let first = network.client();
    assert!(echoes(&first, b"first"));
    let flood: Vec<_> = (0..100).map(|_| network.client()).collect();
    let served = flood.iter().filter(|client| echoes(client, b"me too")).count();
    assert_eq!(served, 31);
    assert!(echoes(&first, b"still"));
    drop(flood);
    let started = Instant::now();
    while !echoes(&network.client(), b"after the flood") {
        assert!(started.elapsed() < TIMEOUT, "nobody gets in any more");
    }
    let server = server.stop();
    assert!(server.driver.statistics().streams.turned_away >= 69);
    let mut numbers = server.driver.machine().opened.clone();
    numbers.dedup();
    assert!(numbers.len() >= 33 && numbers.is_sorted(), "a number was used again: {numbers:?}");
    assert!(server.driver.machine().ticks > 0);
}

pub(crate) fn a_machine_is_informed_that_nobody_listens_and_connects_once_somebody_does() {
    let network = TestNetwork::new();
    let caller = network.start(0, |_| Caller::new(SERVER, clock::now()));
    caller.until("two refused attempts", 2);
    let listener = network.ends[1].0.run(|| TcpListener::bind(SERVER)).unwrap().unwrap();
    let (mut called, _) = listener.accept().unwrap();
    let mut greeting = [0; GREETING.len()];
    called.read_exact(&mut greeting).unwrap();
    assert_eq!(greeting, GREETING);
    let refused = caller.progress();
    called.write_all(b"me").unwrap();
    drop(called);
    caller.until("the close of the connection", refused + 1);
    let caller = caller.stop();
    let machine = caller.driver.machine();
    assert!(machine.closed.len() > 1 && machine.received.starts_with(b"me"), "{machine:?}");
    assert!(machine.closed.is_sorted(), "a number was used again: {machine:?}");
}

pub(crate) fn the_error_for_a_taken_tcp_port_names_its_user() {
    let network = TestNetwork::new();
    let message = network.run(1, |interface| {
        let _other = TcpListener::bind(SERVER).unwrap();
        let machine = EchoServer::new(clock::now());
        Driver::new(machine, interface.clone(), Notifier::new().unwrap()).unwrap_err().to_string()
    });
    assert!(message.contains("TCP port 44818") && message.contains(" at 10.0.0.2:44818;"), "{message}");
}
