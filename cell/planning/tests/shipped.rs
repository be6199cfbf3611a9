//! The applications that the project ships, on Setup A.

#![expect(clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use planning::{APPLICATIONS, Application, Plan, count, plan, stream};
use protocol::image::{self, Configuration, MotionKind};
use setup::Setup;

fn application(name: &str) -> Application {
    let (_, text) = APPLICATIONS.iter().find(|(known, _)| *known == name).expect("shipped");
    Application::parse(name, text).unwrap_or_else(|error| panic!("{error}"))
}

fn setup_a() -> Setup {
    setup::setup("A").expect("built in")
}

fn planned(name: &str) -> Plan {
    plan(&application(name), &setup_a()).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn each_shipped_application_reads_as_in_its_snapshot() {
    for (name, _) in APPLICATIONS {
        insta::assert_snapshot!(*name, planned(name).to_string());
    }
}

/// What the measured figures belong to: it must not change unnoticed.
#[test]
fn the_measured_variant_is_the_sequence_of_thirteen_motions() {
    use MotionKind::{LinCartesian as Lin, PtpCartesian as Ptp};
    let by_hand = [
        (Ptp, [0.0, 0.0, 100.0], true),
        (Lin, [0.0, 0.0, 30.0], true),
        (Lin, [0.0, 0.0, 0.0], false), // grip
        (Lin, [0.0, 0.0, 30.0], true),
        (Lin, [0.0, 0.0, 100.0], true),
        (Ptp, [150.0, 0.0, 150.0], true), // over the wall
        (Ptp, [300.0, 0.0, 100.0], true),
        (Lin, [300.0, 0.0, 30.0], true),
        (Lin, [300.0, 0.0, 0.0], false), // insert
        (Lin, [300.0, 0.0, 30.0], true),
        (Lin, [300.0, 0.0, 100.0], true),
        (Ptp, [150.0, 0.0, 150.0], true),
        (Ptp, [-100.0, 100.0, 150.0], false), // the end, which is the start
    ];
    let mut setup = setup_a();
    setup.motions.velocity_percent.value = 25.0;
    let expected = by_hand.map(|(kind, [x, y, z], blends)| {
        // 25 % of 2000 mm/s and 50 % of 5000 mm/s² on the path, shares of the axes' speeds for a PTP.
        let (velocity, acceleration) = if kind == Lin { (5_000, 2_500) } else { (2_500, 5_000) };
        let target = [x, y, z, 0.0, 0.0, 180.0];
        let approximation = if blends { 1_000 } else { 0 };
        image::Motion { kind, target, velocity, acceleration, approximation, base: 1, ..image::Motion::EMPTY }
    });
    assert_eq!(plan(&application("pick-and-place"), &setup).expect("plans").wire_motions(&setup), expected);
}

#[test]
fn the_measured_variant_is_one_continuous_motion_and_the_one_with_a_gripper_three() {
    let sizes = |name| planned(name).continuous.iter().map(|it| it.motions.len()).collect::<Vec<_>>();
    assert_eq!(sizes("pick-and-place"), [13]);
    assert_eq!(sizes("pick-and-place-gripper"), [3, 6, 4]);
}

#[test]
fn palletising_places_two_hundred_parts_on_two_hundred_cells() {
    let plan = planned("palletising");
    let mut places: Vec<[i64; 3]> = plan
        .motions
        .iter()
        .filter(|motion| motion.name == "LIN place")
        .map(|motion| motion.target.point.coordinates().map(|mm| mm.round() as i64))
        .collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!((plan.cycles.len(), places.len()), (200, 200));
    assert_eq!((places.first(), places.last()), (Some(&[-80, 60, 10]), Some(&[60, 140, 70])));
}

/// The pre-movement is a line to the path's beginning: elbow and wrist are the same before it, the joints' signs need not.
#[test]
fn a_frames_configuration_is_that_of_each_motion_to_it_and_before_a_path_without_the_turn() {
    let configured = include_str!("../../applications/pick-and-place.toml")
        .replace("home = {", "home = { configuration = { status = 2 },")
        .replace("carrier-rim = {", "carrier-rim = { configuration = { status = 2, turn = 9 },");
    let application = Application::parse("test", &configured).expect("reads");
    let plan = plan(&application, &setup_a()).expect("plans");
    let [elbow, whole] = [None, Some(9)].map(|turn| Some(Configuration { status: 2, turn }));
    let given = |motion: &image::Motion| motion.configuration;
    assert_eq!(
        plan.wire_motions(&setup_a()).iter().map(given).collect::<Vec<_>>(),
        [elbow, whole, None, whole, None, None, None, None, None, None, None, None, elbow]
    );
    assert_eq!(plan.wire_to_start(&setup_a()).from_anywhere.as_ref().and_then(given), elbow);
    let shown = plan.to_string();
    assert_eq!(shown.matches("configuration: status 2, turn 9\n").count(), 2, "{shown}");
    assert_eq!(shown.matches("configuration: status 2\n").count(), 2, "{shown}");
}

#[test]
fn every_motion_kind_of_the_image_can_be_planned() {
    let mut kinds: Vec<u8> = APPLICATIONS
        .iter()
        .flat_map(|(name, _)| planned(name).motions.into_iter().map(|motion| motion.kind.into()))
        .collect();
    let joints = include_str!("../../applications/pick-and-place.toml")
        .replace("home = {", "home = { joints_deg = [-60.0, 90.0, 150.0, 0.0, 0.0, 0.0],");
    let with_joints = Application::parse("test", &joints).expect("reads");
    let by_joints = plan(&with_joints, &setup_a()).expect("plans").wire_motions(&setup_a());
    kinds.extend(by_joints.iter().map(|motion| u8::from(motion.kind)));
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds, [1, 2, 3, 4, 5, 6]);
    let last = by_joints.last().expect("has motions");
    assert_eq!((last.kind, last.target), (MotionKind::PtpJoint, [-60.0, 90.0, 150.0, 0.0, 0.0, 0.0]));
}

#[test]
fn a_stream_hands_out_the_motions_of_the_plan_and_goes_round_and_round() {
    let setup = setup_a();
    for (name, _) in APPLICATIONS {
        let application = application(name);
        let once = planned(name).wire_motions(&setup);
        let total = count(&application, &setup, 3).expect("plans");
        let streamed: Vec<image::Motion> = stream(&application, &setup, 3)
            .enumerate()
            .map(|(index, item)| {
                let item = item.expect("plans");
                assert_eq!(item.number, index as u64 + 1);
                item.motion
            })
            .collect();
        assert_eq!(streamed.len() as u64, total, "{name}");
        assert_eq!(streamed[..once.len()], once, "{name}");
        assert_eq!(
            streamed[streamed.len() - once.len()..],
            once,
            "{name}: all shipped ones end where they start"
        );
    }
}

#[test]
fn a_plan_fits_a_narrow_screen_and_says_the_same_there() {
    for (name, _) in APPLICATIONS {
        let plan = plan(&application(name), &setup_a()).expect("plans");
        let (wide, narrow) = (plan.to_string(), format!("{plan:60}"));
        let widest = narrow.lines().map(|line| line.chars().count()).max().expect("has lines");
        assert!(widest <= 60, "{name}: {widest}\n{narrow}");
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>().join(" ");
        let first_cycle = plan.cycles.get(1).copied().unwrap_or(plan.motions.len());
        for motion in plan.motions.iter().take(first_cycle) {
            assert!(words(&narrow).contains(&words(&motion.name)), "{name}: {}", motion.name);
        }
        assert_eq!(wide, format!("{plan:65535}"), "{name}");
        for reason in ["stops exactly", "continuous motion"] {
            let count = |text: &str| words(text).matches(reason).count();
            assert_eq!(count(&wide), count(&narrow), "{name}: {reason}");
        }
    }
}

/// The arm stands at `home` with its elbow on one side; `flipped` is the same pose with the elbow on the other.
fn flipped(steps: &str) -> Plan {
    let text = format!(
        r#"
        schema = 2
        name = "flip"
        title = "the other elbow"
        tool = "gripper"
        base = "table"
        start = "home"
        [tools]
        gripper = 0
        [bases]
        table = 0
        [frames]
        home = {{ mm_deg = [300.0, 100.0, 100.0, 0.0, 0.0, 180.0], configuration = {{ status = 0 }} }}
        flipped = {{ mm_deg = [300.0, 100.0, 100.0, 0.0, 0.0, 180.0], configuration = {{ status = 2 }} }}
        two = {{ mm_deg = [320.0, 100.0, 100.0, 0.0, 0.0, 180.0] }}
        {steps}
        "#
    );
    plan(&Application::parse("flip.toml", &text).expect("reads"), &setup_a()).expect("plans")
}

#[test]
fn another_configuration_is_gone_to_where_the_tool_stands() {
    let reached = flipped("[[step]]\nname = \"A\"\nreach = \"flipped\"\nlabels = [\"accurate-stop\"]");
    let names = |plan: &Plan| plan.motions.iter().map(|it| it.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&reached), ["PTP A"]);
    assert_eq!(reached.motions[0].configuration, Some(Configuration { status: 2, turn: None }));
    let to_start: Vec<_> =
        reached.to_start.from_end.iter().map(|it| it.configuration.map(|it| it.status)).collect();
    assert_eq!(to_start, [Some(0)], "the next cycle starts with the elbow of `home`");

    let step = |name: &str, from: &str, to: &str| {
        format!(
            "[[step]]\nname = \"{name}\"\nfrom = \"{from}\"\npath = [{{ line = \"{to}\" }}]\nlabels = [\"accurate-stop\"]\n"
        )
    };
    assert_eq!(names(&flipped(&step("B", "flipped", "two"))), ["PTP before B", "LIN B"]);
    // A line keeps the elbow, so the arm stands as `home` asks.
    let there_and_back = step("C", "home", "two") + &step("D", "two", "home") + &step("E", "home", "two");
    assert_eq!(names(&flipped(&there_and_back)), ["LIN C", "LIN D", "LIN E"]);
}
