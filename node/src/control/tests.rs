use super::*;
use rustix::event::poll;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};

fn port() -> (ControlPort, SocketAddr) {
    let port = ControlPort::listen(SocketAddr::from(([127, 0, 0, 1], 0)), None).unwrap();
    let address = port.address().unwrap();
    (port, address)
}

/// Waits for the next input of the port.
fn next(port: &mut ControlPort) -> Input {
    loop {
        if let Some(input) = port.next() {
            return input;
        }
        let mut waits = port.poll_fds();
        poll(&mut waits, None).unwrap();
        port.handle();
    }
}

/// Connects a client and waits until the port noticed it.
fn visit(port: &mut ControlPort, address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    assert_eq!(next(port), Input::Attached(stream.local_addr().unwrap()));
    stream
}

fn detached(input: Input) -> String {
    match input {
        Input::Detached { reason, .. } => reason,
        other => panic!("{other:?} instead of a controller that left"),
    }
}

#[test]
fn a_controller_sends_and_receives_lines() {
    let (mut port, address) = port();
    let mut controller = visit(&mut port, address);
    controller.write_all(b"\"rep").unwrap();
    controller.write_all(b"ort\"\n\"stop\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
    assert_eq!(next(&mut port), Input::Line("\"stop\"".to_owned()));
    port.send("\"link_up\"");
    let mut line = String::new();
    BufReader::new(&controller).read_line(&mut line).unwrap();
    assert_eq!(line, "\"link_up\"\n");
}

#[test]
fn a_second_controller_is_told_who_has_the_port_and_the_next_one_gets_it_once_it_is_free() {
    let (mut port, address) = port();
    let mut first = visit(&mut port, address);
    first.write_all(b"\"report\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));

    let second = TcpStream::connect(address).unwrap();
    port.handle();
    let mut lines = BufReader::new(second).lines();
    let peer = first.local_addr().unwrap();
    assert_eq!(lines.next().unwrap().unwrap(), format!(r#"{{"busy":{{"controller":"{peer}"}}}}"#));
    assert!(lines.next().is_none(), "nothing more comes");
    assert!(matches!(next(&mut port), Input::Refused { more: 0, .. }));

    drop(first);
    assert_eq!(detached(next(&mut port)), "it closed the connection");
    visit(&mut port, address);
}

#[test]
fn a_controller_that_sends_nothing_is_replaced_by_the_next() {
    let (mut port, address) = port();
    let silent = visit(&mut port, address);
    let second = TcpStream::connect(address).unwrap();
    assert_eq!(detached(next(&mut port)), "it sent no line before another controller connected");
    assert_eq!(next(&mut port), Input::Attached(second.local_addr().unwrap()));
    assert_eq!((&silent).read(&mut [0]).unwrap(), 0);
}

#[test]
fn a_line_without_an_end_ends_the_connection() {
    let (mut port, address) = port();
    let mut controller = visit(&mut port, address);
    let flood = std::thread::spawn(move || while controller.write_all(&[0xff; 4096]).is_ok() {});
    assert_eq!(detached(next(&mut port)), TOO_LONG);
    // It never closes, so its connection ends with the bytes that are dropped of it.
    while !flood.is_finished() {
        port.handle();
    }
    flood.join().unwrap();
    visit(&mut port, address);
}

const TOO_LONG: &str = "its line has more than 65536 bytes; end each instruction with a line feed";

/// Sends all of it, and returns what came back until the port ended the connection.
fn sent(port: &mut ControlPort, mut client: TcpStream, bytes: Vec<u8>) -> std::io::Result<String> {
    let sender = std::thread::spawn(move || {
        client.write_all(&bytes)?;
        let mut answer = String::new();
        client.read_to_string(&mut answer).map(|_| answer)
    });
    while !sender.is_finished() || !port.dismissed.is_empty() {
        port.handle();
    }
    sender.join().unwrap()
}

#[test]
fn a_line_that_is_too_long_is_denied_with_the_reason_before_the_connection_ends() {
    let denied = format!("{{\"denied\":{{\"reason\":\"{TOO_LONG}\"}}}}\n");
    let longest = 64 * 1024;
    for (end, more) in [(0, 0), (1, 0), (0, 100_000), (1, 100_000)] {
        let line = [vec![b' '; longest + 1], vec![b'\n'; end], vec![b' '; more]].concat();
        let (mut port, address) = port();
        let controller = visit(&mut port, address);
        assert_eq!(sent(&mut port, controller, line.clone()).unwrap(), denied);
        assert_eq!(detached(next(&mut port)), TOO_LONG);
        let mut next_one = visit(&mut port, address);
        next_one.write_all(b"\"report\"\n").unwrap();
        assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));

        let (mut port, address) = guarded_port();
        let client = TcpStream::connect(address).unwrap();
        assert_eq!(sent(&mut port, client, line).unwrap(), denied);
        assert!(matches!(next(&mut port), Input::Refused { reason, .. } if reason == TOO_LONG));
    }
    let (mut port, address) = port();
    let mut controller = visit(&mut port, address);
    controller.write_all(&[vec![b' '; longest - 8], b"\"report\"\n".to_vec()].concat()).unwrap();
    assert!(matches!(next(&mut port), Input::Line(line) if line.len() == longest));
}

#[test]
fn a_second_controller_hears_who_has_the_port_although_it_has_sent_much() {
    let (mut port, address) = port();
    let mut first = visit(&mut port, address);
    first.write_all(b"\"report\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
    let second = TcpStream::connect(address).unwrap();
    let answer = sent(&mut port, second, vec![b'x'; 300_000]).unwrap();
    assert_eq!(answer, format!("{{\"busy\":{{\"controller\":\"{}\"}}}}\n", first.local_addr().unwrap()));
}

#[test]
fn dismissed_clients_that_never_close_fill_no_memory_and_leave_in_time() {
    let (mut port, address) = port();
    let mut first = visit(&mut port, address);
    first.write_all(b"\"report\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
    let others: Vec<_> = (0..3 * MOST_DISMISSED)
        .map(|_| {
            let stream = TcpStream::connect(address).unwrap();
            port.handle();
            stream
        })
        .collect();
    assert_eq!(port.dismissed.len(), MOST_DISMISSED);
    assert!(port.time_left().is_some_and(|time_left| time_left <= Duration::from_secs(2)));
    let now = Instant::now();
    port.dismissed.iter_mut().for_each(|client| client.until = now);
    port.handle();
    assert!(port.dismissed.is_empty());
    drop(others);
}

#[test]
fn a_controller_that_does_not_read_is_disconnected_before_it_fills_the_memory() {
    let (mut port, address) = port();
    let _deaf = visit(&mut port, address);
    let line = "x".repeat(64 * 1024);
    while port.waiting.is_empty() {
        port.send(&line);
    }
    assert_eq!(detached(next(&mut port)), "it does not read the messages");
}

#[test]
fn unread_lines_of_a_disconnected_controller_are_dropped() {
    let (mut port, address) = port();
    let mut controller = visit(&mut port, address);
    controller.write_all(b"POST / HTTP/1.1\n\"stop\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("POST / HTTP/1.1".to_owned()));
    port.disconnect("it sent a line that is not an instruction");
    assert_eq!(detached(next(&mut port)), "it sent a line that is not an instruction");
    assert_eq!(port.next(), None);
}

const TOKEN: &str = "0123456789abcdef";

fn guarded_port() -> (ControlPort, SocketAddr) {
    let token = ControlToken::new(TOKEN).unwrap();
    let port = ControlPort::listen(SocketAddr::from(([127, 0, 0, 1], 0)), Some(token)).unwrap();
    let address = port.address().unwrap();
    (port, address)
}

#[test]
fn an_address_that_other_hosts_reach_is_refused_without_a_token() {
    let everywhere = SocketAddr::from(([0, 0, 0, 0], 0));
    assert!(matches!(ControlPort::listen(everywhere, None), Err(ControlError::NoToken(_))));
    let token = ControlToken::new(TOKEN).unwrap();
    assert!(ControlPort::listen(everywhere, Some(token)).is_ok());
    assert!(ControlPort::listen(SocketAddr::from(([127, 0, 0, 2], 0)), None).is_ok());
}

#[test]
fn a_client_controls_a_guarded_node_once_it_has_shown_the_token_and_hears_nothing_before() {
    let (mut port, address) = guarded_port();
    let mut client = TcpStream::connect(address).unwrap();
    client.write_all(format!("{{\"token\":\"{TOKEN}\"}}\n\"report\"\n").as_bytes()).unwrap();
    assert_eq!(next(&mut port), Input::Attached(client.local_addr().unwrap()));
    assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
}

#[test]
fn a_wrong_token_and_a_line_before_it_are_answered_by_the_reason_alone() {
    for (line, reason) in [
        ("{\"token\":\"0123456789abcdeF\"}\n", WRONG_TOKEN),
        ("\"stop\"\n", NO_TOKEN),
        ("GET / HTTP/1.1\r\n", NO_TOKEN),
    ] {
        let (mut port, address) = guarded_port();
        let mut client = TcpStream::connect(address).unwrap();
        client.write_all(line.as_bytes()).unwrap();
        let peer = client.local_addr().unwrap();
        let expected = Input::Refused { peer, reason: reason.to_owned(), more: 0 };
        assert_eq!(next(&mut port), expected);
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        assert_eq!(answer, format!("{{\"denied\":{{\"reason\":\"{reason}\"}}}}\n"));
    }
}

#[test]
fn clients_that_never_show_the_token_keep_nobody_out_and_are_reported_once() {
    let (mut port, address) = guarded_port();
    let silent: Vec<_> = (0..3 * MOST_UNAUTHENTICATED)
        .map(|_| {
            let stream = TcpStream::connect(address).unwrap();
            port.handle();
            stream
        })
        .collect();
    assert_eq!(port.unauthenticated.len(), MOST_UNAUTHENTICATED);
    let mut client = TcpStream::connect(address).unwrap();
    client.write_all(format!("{{\"token\":\"{TOKEN}\"}}\n").as_bytes()).unwrap();
    assert!(matches!(next(&mut port), Input::Refused { more: 0, .. }));
    assert_eq!(next(&mut port), Input::Attached(client.local_addr().unwrap()));
    drop(silent);
}

#[test]
fn a_client_that_is_silent_for_too_long_is_disconnected() {
    let (mut port, address) = port();
    let _silent = visit(&mut port, address);
    assert!(port.time_left().is_some_and(|time_left| time_left <= FIRST_LINE));
    port.controller.as_mut().unwrap().heard = Instant::now().checked_sub(FIRST_LINE).unwrap();
    port.handle();
    assert_eq!(detached(next(&mut port)), "it sent no whole line for 10 s");

    let (mut port, address) = guarded_port();
    let _guest = TcpStream::connect(address).unwrap();
    while port.unauthenticated.is_empty() {
        port.handle();
    }
    port.unauthenticated[0].heard = Instant::now().checked_sub(FIRST_LINE).unwrap();
    port.handle();
    assert!(matches!(next(&mut port), Input::Refused { .. }) && port.unauthenticated.is_empty());
}

#[test]
fn bytes_of_a_line_and_empty_lines_do_not_extend_the_time_to_the_first_line() {
    for drip in [&b"x"[..], b"\n"] {
        let (mut port, address) = port();
        let mut slow = visit(&mut port, address);
        let almost = FIRST_LINE - Duration::from_millis(1);
        let connected = Instant::now().checked_sub(almost).unwrap();
        port.controller.as_mut().unwrap().heard = connected;
        slow.write_all(drip).unwrap();
        poll(&mut port.poll_fds(), None).unwrap();
        port.handle();
        let heard = port.controller.as_ref().map(|controller| controller.heard);
        assert!(heard.is_none_or(|heard| heard == connected));
    }
}

#[test]
fn an_empty_line_shows_that_a_controller_is_alive_and_is_no_instruction() {
    let (mut port, address) = port();
    let mut controller = visit(&mut port, address);
    controller.write_all(b"\n\r\n\"report\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("\"report\"".to_owned()));
}

#[test]
fn a_controller_whose_line_is_not_followed_hears_why() {
    let (mut port, address) = port();
    let mut controller = visit(&mut port, address);
    controller.write_all(b"\"dance\"\n").unwrap();
    assert_eq!(next(&mut port), Input::Line("\"dance\"".to_owned()));
    port.deny("it sent a line that is not an instruction");
    let mut answer = String::new();
    controller.read_to_string(&mut answer).unwrap();
    assert_eq!(answer, "{\"denied\":{\"reason\":\"it sent a line that is not an instruction\"}}\n");
}
