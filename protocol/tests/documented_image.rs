//! `docs/process-image.md`, from which PLC programmers type the image in, agrees with the image.

#![expect(clippy::panic, reason = "a table that cannot be read fails the test")]

use machine::wire::{BigEndian, Reader, Writer};
use protocol::image::{
    Command, CommandSealer, Control, ErrorNumber, Feedback, FeedbackSealer, IMAGE_LEN, MOTION_LEN, Motion,
    MotionKind, Order, Services, Skill, State, Status,
};

const PAGE: &str = include_str!("../../docs/process-image.md");

/// Returns the cells of the rows of the first table below a heading.
fn table(heading: &str) -> Vec<Vec<&'static str>> {
    let from = PAGE.lines().skip_while(|line| *line != heading).skip(1);
    let table = from.skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|'));
    let cells = |row: &'static str| row.trim_matches('|').split('|').map(str::trim).collect();
    let rows: Vec<_> = table.skip(2).map(cells).collect();
    assert!(!rows.is_empty(), "there is no table below `{heading}`");
    rows
}

/// Reads the first byte and the one after the last: `0..2`, `6`, `101..104`.
fn bytes(cell: &str) -> (usize, usize) {
    let number = |text: &str| text.parse().unwrap_or_else(|_| panic!("`{cell}` is no range of bytes"));
    match cell.split_once("..") {
        Some((from, to)) => (number(from), number(to)),
        None => (number(cell), number(cell) + 1),
    }
}

/// Returns for each byte whether the table gives it a meaning. The table must have every byte once.
fn documented(heading: &str, len: usize) -> Vec<bool> {
    let mut has_meaning = Vec::new();
    for row in table(heading) {
        let (from, to) = bytes(row[0]);
        assert_eq!(from, has_meaning.len(), "`{heading}`, row {row:?}");
        has_meaning.resize(to, row[1] != "reserved");
    }
    assert_eq!(has_meaning.len(), len, "the table below `{heading}` ends early or late");
    has_meaning
}

/// Returns which bytes of an image of ones are left after it was read and written.
fn carried(image: &[u8]) -> Vec<bool> {
    image.iter().map(|byte| *byte != 0).collect()
}

#[test]
fn the_page_has_every_byte_of_the_command_and_calls_the_others_reserved() {
    let mut image = [0; IMAGE_LEN];
    Command::parse::<BigEndian>(&[0xFF; IMAGE_LEN]).unwrap().emit::<BigEndian>(&mut image);
    CommandSealer::default().seal(Order::BigEndian, &mut image);
    assert_eq!(documented("## Command: from the PLC to the robot", IMAGE_LEN), carried(&image));
}

#[test]
fn the_page_has_every_byte_of_the_feedback_and_calls_the_others_reserved() {
    let mut image = [0; IMAGE_LEN];
    Feedback::parse::<BigEndian>(&[0xFF; IMAGE_LEN]).unwrap().emit::<BigEndian>(&mut image);
    FeedbackSealer::default().seal(Order::BigEndian, &mut image);
    assert_eq!(documented("## Feedback: from the robot to the PLC", IMAGE_LEN), carried(&image));
}

#[test]
fn the_page_has_every_byte_of_a_motion() {
    let ones = [0xFF; MOTION_LEN];
    let motion = Motion::parse(&mut Reader::<BigEndian>::new(&ones)).unwrap();
    let mut image = [0; MOTION_LEN];
    motion.emit(&mut Writer::<BigEndian>::new(&mut image));
    assert_eq!(documented("## One motion", MOTION_LEN), carried(&image));
}

#[test]
fn the_page_has_every_auxiliary_byte_of_a_motion_without_a_point_or_force() {
    let mut ones = [0xFF; MOTION_LEN];
    // A configuration with a turn: bit 6 of the status says that there is none.
    (ones[24], ones[42]) = (0xBF, MotionKind::LinCartesian.into());
    let motion = Motion::parse(&mut Reader::<BigEndian>::new(&ones)).unwrap();
    let mut image = [0; MOTION_LEN];
    motion.emit(&mut Writer::<BigEndian>::new(&mut image));
    let mut documented = vec![true; 24];
    for row in table("### Auxiliary bytes") {
        let (from, to) = bytes(row[0]);
        assert_eq!(from, documented.len(), "row {row:?}");
        documented.resize(to, row[1] != "reserved");
    }
    assert_eq!(documented, &carried(&image)[..36]);
}

/// Returns the numbers in the first column of a table; a row without one belongs to the row above it.
fn codes(heading: &str) -> Vec<u16> {
    let cells = table(heading).into_iter().map(|row| row[0]).filter(|cell| !cell.is_empty());
    cells
        .map(|cell| cell.parse().unwrap_or_else(|_| panic!("`{cell}` below `{heading}` is no code")))
        .collect()
}

#[test]
fn the_page_has_every_error_number_and_every_skill() {
    let is_known =
        |code: &u16| !matches!(ErrorNumber::from(*code), ErrorNumber::Unknown(_) | ErrorNumber::None);
    assert_eq!(codes("## Error numbers"), (0..=u16::MAX).filter(is_known).collect::<Vec<_>>());
    let is_known = |code: &u8| !matches!(Skill::from(*code), Skill::Unknown(_));
    let known: Vec<_> = (0..=u8::MAX).filter(is_known).map(u16::from).collect();
    assert_eq!(codes("### Skills"), known);
}

#[test]
fn the_page_has_every_kind_of_motion_and_every_state() {
    let kinds = PAGE.lines().skip_while(|line| !line.starts_with("| kind | motion |")).skip(2);
    let documented: Vec<_> = kinds
        .take_while(|line| line.starts_with('|'))
        .filter_map(|row| row.split('|').nth(1)?.trim().parse::<u8>().ok())
        .collect();
    let is_known = |code: &u8| !matches!(MotionKind::from(*code), MotionKind::Unknown(_) | MotionKind::None);
    assert_eq!(documented, (0..=u8::MAX).filter(is_known).collect::<Vec<_>>());
    for code in 0..=u8::MAX {
        match State::from(code) {
            State::Unknown(_) => {}
            state => {
                let words = format!("{code} `{state:?}`");
                assert!(PAGE.contains(&words), "the page lacks {words}");
            }
        }
    }
}

/// Returns the names of a table's bits by their numbers, empty where they are reserved.
fn bits(heading: &str) -> Vec<String> {
    let mut names = Vec::new();
    for row in table(heading).into_iter().filter(|row| row[1] != "reserved") {
        assert_eq!(row[0], names.len().to_string(), "`{heading}`");
        names.push(format!("{{{}}}", row[1]));
    }
    names.resize(16, "{}".to_owned());
    names
}

#[test]
fn the_page_has_every_control_and_status_bit_by_its_name() {
    let control: Vec<_> = (0..16).map(|bit| format!("{:?}", Control(1 << bit))).collect();
    assert_eq!(bits("### Control bits"), control);
    let status: Vec<_> = (0..16).map(|bit| format!("{:?}", Status(1 << bit))).collect();
    assert_eq!(bits("### Status bits"), status);
    let services: Vec<_> = (0..16).map(|bit| format!("{:?}", Services(1 << bit))).collect();
    assert_eq!(bits("### Services"), services);
}
