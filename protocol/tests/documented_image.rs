//! `docs/process-image.md`, from which PLC programmers type the image in, agrees with the image.

#![expect(clippy::panic, reason = "a table that cannot be read fails the test")]

use machine::wire::{BigEndian, Reader, Writer};
use protocol::image::{
    COMMAND_FIELDS, Command, CommandSealer, CompactPoints, Control, ErrorNumber, FEEDBACK_FIELDS, Feedback,
    FeedbackSealer, FieldType, IMAGE_LEN, ImageField, MOTION_FIELDS, MOTION_LEN, Motion, MotionKind,
    OPTION_FIELDS, Order, POINT_FIELDS, PointHead, PointSum, Services, Skill, Slots, State, Status,
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

/// Returns whether a row gives no meaning to its bytes or bits.
fn is_reserved(row: &[&str]) -> bool {
    row[1] == "reserved"
}

/// Returns for each byte whether the table gives it a meaning. The table must have every byte once.
fn documented(heading: &str, len: usize) -> Vec<bool> {
    let mut has_meaning = Vec::new();
    for row in table(heading) {
        let (from, to) = bytes(row[0]);
        assert_eq!(from, has_meaning.len(), "`{heading}`, row {row:?}");
        has_meaning.resize(to, !is_reserved(&row));
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
        documented.resize(to, !is_reserved(&row));
    }
    assert_eq!(documented, &carried(&image)[..36]);
}

#[test]
fn the_pages_of_blocks_and_of_skills_name_the_one_of_each_kind() {
    let blocks = include_str!("../../docs/plcopen.md");
    let skills = table("### Skills");
    for kind in MotionKind::standard() {
        let (code, name) = (u8::from(kind).to_string(), format!("{:?}", kind.skill()));
        assert!(blocks.contains(&format!("\n| `{name}` |")), "docs/plcopen.md lacks `{name}`");
        assert!(skills.iter().any(|row| row[0] == code && row[1] == name), "no skill {code} `{name}`");
    }
}

#[test]
fn the_page_gives_each_auxiliary_field_to_the_kinds_that_have_it() {
    let rows = table("### Auxiliary bytes");
    type Has = fn(MotionKind) -> bool;
    let fields: [(&str, Has); 4] = [
        ("status", MotionKind::has_configuration),
        ("turn", MotionKind::has_configuration),
        ("deceleration", |kind| !kind.has_auxiliary()),
        ("jerk", |kind| !kind.has_auxiliary()),
    ];
    for (field, has_field) in fields {
        let row = rows.iter().find(|row| row[1] == field).unwrap_or_else(|| panic!("no row `{field}`"));
        let kinds = MotionKind::standard().filter(|kind| has_field(*kind)).map(u8::from);
        assert_eq!(row[3], kinds.map(|code| code.to_string()).collect::<Vec<_>>().join(", "), "`{field}`");
    }
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
    for row in table(heading).into_iter().filter(|row| !is_reserved(row)) {
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

/// Returns a field's row as the page has it: bytes, name and type.
fn row_of(field: &ImageField) -> [String; 3] {
    let until = field.first + field.form.len();
    let bytes =
        if field.form.len() == 1 { field.first.to_string() } else { format!("{}..{until}", field.first) };
    let form = match field.form {
        FieldType::Usint => "USINT".to_owned(),
        FieldType::Uint => "UINT".to_owned(),
        FieldType::Udint | FieldType::Check => "UDINT".to_owned(),
        FieldType::Ulint => "ULINT".to_owned(),
        FieldType::Word(_) => "WORD".to_owned(),
        FieldType::Code(_) => (if field.form.len() == 1 { "USINT" } else { "UINT" }).to_owned(),
        FieldType::Real(1) => "REAL".to_owned(),
        FieldType::Real(count) => format!("{count} × REAL"),
        FieldType::Int(count) => format!("{count} × INT"),
        FieldType::Motion => "motion".to_owned(),
        FieldType::Reserved(_) => String::new(),
    };
    [bytes, field.name.to_owned(), form]
}

#[test]
fn the_tables_from_which_other_programs_are_made_have_the_rows_of_the_page() {
    let tables = [
        ("## Command: from the PLC to the robot", COMMAND_FIELDS),
        ("## Feedback: from the robot to the PLC", FEEDBACK_FIELDS),
        ("## One motion", MOTION_FIELDS),
        ("### Auxiliary bytes", OPTION_FIELDS),
        ("## Compact points", POINT_FIELDS),
    ];
    for (heading, fields) in tables {
        let has_units = heading.contains("from the") || heading == "## Compact points";
        let documented: Vec<_> = table(heading)
            .iter()
            .map(|row| {
                let name = if is_reserved(row) { "reserved" } else { row[1] };
                let form = if is_reserved(row) { "" } else { row[2].trim_end_matches(", or other fields") };
                [row[0].to_owned(), name.to_owned(), form.to_owned()]
            })
            .collect();
        assert_eq!(documented, fields.iter().map(row_of).collect::<Vec<_>>(), "{heading}");
        if has_units {
            let units = table(heading).into_iter().filter(|row| !is_reserved(row)).map(|row| row[3]);
            let is_used = |field: &&ImageField| !matches!(field.form, FieldType::Reserved(_));
            assert_eq!(
                units.collect::<Vec<_>>(),
                fields.iter().filter(is_used).map(|field| field.unit).collect::<Vec<_>>(),
                "{heading}"
            );
        }
    }
}

/// Returns the bytes of a line of the page's example of compact points.
fn example_bytes(range: &str) -> Vec<u8> {
    let line = PAGE.lines().find_map(|line| line.strip_prefix(range));
    let line = line.unwrap_or_else(|| panic!("the example has no line `{range}`"));
    let hexadecimal = line.split_whitespace().map_while(|word| match word.len() {
        2 => u8::from_str_radix(word, 16).ok(),
        _ => None,
    });
    hexadecimal.collect()
}

#[test]
fn the_example_of_compact_points_is_what_its_words_say() {
    let head = PointHead::of(
        &Motion {
            kind: MotionKind::Spline,
            target: [400.0, 0.0, 100.0, 0.0, 0.0, 180.0],
            velocity: 5_000,
            acceleration: 5_000,
            approximation: 50,
            base: 1,
            ..Motion::EMPTY
        },
        5,
        3,
    );
    let (mut points, mut sum) = (CompactPoints::new(head), PointSum::default());
    for (index, [x, y]) in (0..).zip([[400.0, 0.25], [399.99, 0.5]]) {
        let difference = sum.advance(&head, [x, y, 100.0, 0.0, 0.0, 180.0]).unwrap();
        points.set_difference(index, difference);
    }
    let (control, skill) = (Control::EXECUTE | Control::COMPACT, Skill::MoveTrajectory);
    let command = Command { control, skill, slots: Slots::Points(points), ..Command::default() };
    let mut image = [0; IMAGE_LEN];
    command.emit::<BigEndian>(&mut image);
    for (range, from, until) in
        [("36..60", 36, 60), ("60..70", 60, 70), ("70..76", 70, 76), ("76..82", 76, 82), ("82..88", 82, 88)]
    {
        assert_eq!(example_bytes(range), &image[from..until], "{range}");
    }
    assert_eq!(sum.motion(&head).target, [399.99, 0.5, 100.0, 0.0, 0.0, 180.0]);
}
