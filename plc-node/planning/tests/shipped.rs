//! The applications that the project ships, on Setup A.

#![expect(clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use planning::{APPLICATIONS, Application, Plan, count, plan, stream};
use protocol::image::{self, MotionKind};
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

#[test]
fn the_measured_variant_is_the_sequence_of_thirteen_motions() {
    let setup = setup_a();
    let by_hand = setup::application("pick-and-place").expect("built in");
    assert_eq!(planned("pick-and-place-measured").wire_motions(&setup), setup::motions(&setup, &by_hand));
}

#[test]
fn the_measured_variant_is_one_continuous_motion_and_the_one_with_a_gripper_three() {
    let sizes = |name| planned(name).continuous.iter().map(|it| it.motions.len()).collect::<Vec<_>>();
    assert_eq!(sizes("pick-and-place-measured"), [13]);
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

#[test]
fn every_motion_kind_of_the_image_can_be_planned() {
    let mut kinds: Vec<u8> = APPLICATIONS
        .iter()
        .flat_map(|(name, _)| planned(name).motions.into_iter().map(|motion| motion.kind.into()))
        .collect();
    let joints = include_str!("../../../bench/applications/pick-and-place-measured.toml")
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
