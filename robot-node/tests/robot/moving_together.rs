//! An arm that follows a master axis in the PLC: the law time that the feedback has, beside the one that it should have.

use proptest::prelude::*;
use protocol::image::{Control, Motion, Services, Skill, State, Status};
use robot_node::arm::{Joints, distance};
use robot_node::{Program, RobotConfig};

use crate::driven::{Driven, bare, lin, press, ptp, seat};

/// A cycle of the robot, and how exactly the arm follows: at 250 mm/s 0.1 mm.
const CYCLE_S: f64 = 0.004;
const CLOSE_S: f64 = 0.000_4;

/// One cycle: robot's clock, the law time that the arm should have, and the one that it has; in s.
#[derive(Clone, Copy, Debug)]
struct Moment {
    at: f64,
    wanted: f64,
    has: f64,
    joints: Joints,
}

impl Moment {
    fn missing(&self) -> f64 {
        self.wanted - self.has
    }
}

/// A PLC's master, and how its set-points come.
struct Master<F> {
    /// Law time in s at a time of the robot's clock after the call.
    course: F,
    /// How long before they hold set-points are sent, in s.
    lead_s: f64,
    /// Every so many images is lost.
    loses_each: u32,
}

fn master<F: Fn(f64) -> f64>(course: F) -> Master<F> {
    Master { course, lead_s: 0.02, loses_each: u32::MAX }
}

fn ready(setup: &str) -> Driven {
    let mut robot = Driven::ready(bare(setup), Program::default());
    robot.run(vec![ptp(0.0, 0.0, 100.0)]);
    robot
}

/// Lines at 250 mm/s with corners, an exact stop and a PTP.
fn tour() -> Vec<Motion> {
    let corner = |motion| Motion { approximation: 2_000, ..motion };
    vec![
        corner(lin(150.0, 0.0, 100.0)),
        corner(lin(150.0, 80.0, 100.0)),
        corner(lin(0.0, 80.0, 60.0)),
        lin(0.0, 0.0, 60.0),
        corner(ptp(100.0, -60.0, 100.0)),
        corner(lin(20.0, -60.0, 100.0)),
        lin(0.0, 0.0, 100.0),
    ]
}

impl<F: Fn(f64) -> f64> Master<F> {
    /// Runs one skill to its end, after `each` cycle.
    #[track_caller]
    fn leads(
        &self,
        robot: &mut Driven,
        motions: Vec<Motion>,
        mut each: impl FnMut(&mut Driven, f64),
    ) -> Vec<Moment> {
        let called = robot.at.as_nanos() as f64 / 1e9;
        robot.call(Skill::MoveContinuous, motions);
        let number = robot.command.number;
        robot.command.control = Control::ENABLE | Control::EXECUTE | Control::SYNC;
        let (mut moments, mut cycle) = (Vec::new(), 0_u32);
        let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
        while robot.feedback().number != number || robot.feedback().status.0 & ended == 0 {
            cycle += 1;
            assert!(cycle < 100_000, "it never ends: {:?}", robot.feedback());
            let holds_at = f64::from(cycle) * CYCLE_S + self.lead_s;
            if !cycle.is_multiple_of(self.loses_each) {
                robot.command.start_time_ns = ((called + holds_at) * 1e9).round() as u64;
                robot.command.law_time_us = ((self.course)(holds_at) * 1e6).round() as u32;
            }
            each(robot, f64::from(cycle) * CYCLE_S);
            robot.tick();
            let at = f64::from(cycle) * CYCLE_S;
            let has = f64::from(robot.feedback().law_time_us) / 1e6;
            moments.push(Moment { at, wanted: (self.course)(at), has, joints: *robot.controller.joints() });
        }
        moments
    }
}

/// Returns the moments before the arm has come to the end of its law.
fn before_the_end(moments: &[Moment]) -> &[Moment] {
    let last = moments.last().unwrap().has;
    let end = moments.iter().position(|moment| moment.has == last).unwrap();
    &moments[..end]
}

/// Checks that the arm was never farther from its master than that, and never went back.
#[track_caller]
fn follows(moments: &[Moment], most_s: f64) {
    let moments = before_the_end(moments);
    assert!(moments.len() > 100, "{} cycles", moments.len());
    let worst = moments.iter().max_by(|one, other| one.missing().abs().total_cmp(&other.missing().abs()));
    assert!(worst.unwrap().missing().abs() <= most_s, "{worst:?}");
    assert!(moments.is_sorted_by(|one, other| one.has <= other.has), "it goes back");
}

/// A master that passes 0 between two cycles.
fn steady(rate: f64) -> impl Fn(f64) -> f64 {
    move |at| rate * (at - 0.130_1).max(0.0)
}

#[test]
fn an_arm_is_where_its_master_is_from_the_start_to_the_end_whatever_the_masters_rate() {
    for rate in [1.0, 0.9, 0.5, 0.1] {
        let mut robot = ready("A");
        let moments = master(steady(rate)).leads(&mut robot, tour(), |_, _| {});
        assert!(robot.is_done(), "{rate}: {:?}", robot.feedback());
        follows(&moments, CLOSE_S);
    }
}

#[test]
fn the_law_time_at_the_end_is_what_the_arm_needs_alone_whatever_the_masters_rate() {
    let ends = [1.0, 0.5, 0.1].map(|rate| {
        let mut robot = ready("A");
        master(steady(rate)).leads(&mut robot, tour(), |_, _| {}).last().unwrap().has
    });
    let mut alone = ready("A");
    let from = alone.at;
    alone.run(tour());
    let alone_s = alone.at.since(from).as_secs_f64();
    for end in ends {
        // Alone, the cycles in which five motions are checked come first.
        assert!((0.0..0.03).contains(&(alone_s - end)), "{end} s, alone {alone_s} s");
        assert!((end - ends[0]).abs() < 0.000_1, "{ends:?}");
    }
}

/// Returns the joints at a law time, between those of three cycles of an arm that went at full rate.
fn joints_at(alone: &[Moment], law_s: f64) -> Joints {
    let next = alone.partition_point(|moment| moment.has < law_s).clamp(1, alone.len() - 2);
    let near = [&alone[next - 1], &alone[next], &alone[next + 1]];
    let share = |one: usize, others: [usize; 2]| -> f64 {
        let [x, y] = others.map(|other| (law_s - near[other].has) / (near[one].has - near[other].has));
        x * y
    };
    let shares = [share(0, [1, 2]), share(1, [0, 2]), share(2, [0, 1])];
    core::array::from_fn(|axis| (0..3).map(|moment| shares[moment] * near[moment].joints[axis]).sum())
}

#[test]
fn at_each_law_time_the_arm_is_where_it_is_alone() {
    let application = |setup: &str| {
        let (setup, found) = planning::setup_with_application(setup).unwrap();
        found.plan(&setup).unwrap().wire_motions(&setup)
    };
    let robot = |setup: &str| match setup {
        "B" => Driven::ready(bare("B"), Program::default()),
        _ => ready("A"),
    };
    for (setup, motions) in [("A", tour()), ("B", application("B"))] {
        let alone = master(|_| 4_000.0).leads(&mut robot(setup), motions.clone(), |_, _| {});
        let start = alone.iter().rposition(|moment| moment.has == 0.0).unwrap();
        let alone = &alone[start..=before_the_end(&alone).len()];
        let arm = bare(setup).arm;
        for rate in [0.97, 0.5, 0.13] {
            let mut led = robot(setup);
            let moments = master(steady(rate)).leads(&mut led, motions.clone(), |_, _| {});
            assert!(led.is_done(), "{setup}: {:?}", led.feedback());
            follows(&moments, CLOSE_S);
            let inner = |moment: &&Moment| moment.has > CYCLE_S && moment.has < alone[alone.len() - 2].has;
            let away = |moment: &Moment| {
                let [led, alone] =
                    [moment.joints, joints_at(alone, moment.has)].map(|joints| arm.forward(&joints));
                distance(led.position, alone.position)
            };
            let farthest = moments.iter().filter(inner).map(away).fold(0.0, f64::max);
            assert!(farthest < 0.1, "{setup}, {rate}: {farthest} mm");
        }
    }
}

#[test]
fn a_lin_force_waits_for_its_master_too() {
    let config = bare("A");
    let surfaces = vec![seat(&config, 8.0, 5.0)];
    let mut robot = Driven::ready(RobotConfig { surfaces, ..config }, Program::default());
    robot.run(vec![ptp(100.0, 40.0, 20.0)]);
    let start = *robot.controller.joints();
    robot.call(Skill::MoveLinForceCartesian, vec![press(-10.0, 25.0)]);
    robot.control(Control::SYNC);
    robot.run_ms(1_000);
    assert_eq!((robot.feedback().state, robot.controller.joints()), (State::Running, &start));
    robot.command.law_time_us = 1_000;
    robot.wait_for_end();
    assert!(robot.is_done(), "{:?}", robot.feedback());
}

#[test]
fn a_master_that_slows_down_and_hurries_is_followed_though_each_tenth_frame_is_lost() {
    for seconds in [0.3, 0.5, 1.0] {
        let course = |at: f64| {
            let at = (at - 0.130_1).max(0.0);
            0.7 * at + 0.2 * seconds * libm::sin(at / seconds)
        };
        for loses_each in [u32::MAX, 10] {
            let mut robot = ready("A");
            let moments = Master { loses_each, ..master(course) }.leads(&mut robot, tour(), |_, _| {});
            assert!(robot.is_done());
            follows(&moments, 2.0 * CLOSE_S);
        }
    }
}

#[test]
fn an_arm_stands_with_its_master_and_goes_on_with_it() {
    // Half speed for a second; within half a second to rest, a second of it, and back.
    let course = |at: f64| match at {
        ..1.0 => 0.5 * at,
        ..1.5 => 0.5 * at - 0.5 * (at - 1.0) * (at - 1.0),
        ..2.5 => 0.625,
        ..3.0 => 0.625 + 0.5 * (at - 2.5) * (at - 2.5),
        _ => 0.75 + 0.5 * (at - 3.0),
    };
    let mut robot = ready("A");
    let moments = master(course).leads(&mut robot, tour(), |robot, at| {
        let stands = (1.7..2.47).contains(&at);
        assert!(!stands || robot.feedback().path_speed < 1.0, "{at} s: {:?}", robot.feedback());
    });
    assert!(robot.is_done());
    let later = before_the_end(&moments).iter().filter(|moment| moment.at > 0.2);
    let worst = later.max_by(|one, other| one.missing().abs().total_cmp(&other.missing().abs())).unwrap();
    assert!(worst.missing().abs() < 2.0 * CLOSE_S, "{worst:?}");
}

#[test]
fn after_a_suspend_the_arm_catches_up_with_a_master_that_is_slower_than_it_may_be() {
    let mut robot = ready("A");
    let moments = master(steady(0.5)).leads(&mut robot, tour(), |robot, at| {
        robot.command.control.set(Control::SUSPEND, (1.0..1.3).contains(&at));
        robot.command.control.set(Control::RESUME, (1.3..1.4).contains(&at));
    });
    assert!(robot.is_done());
    let suspended = moments.iter().find(|moment| moment.at > 1.29).unwrap();
    assert!(suspended.missing() > 0.1, "{suspended:?}");
    let late = before_the_end(&moments).iter().filter(|moment| moment.at > 3.0);
    late.for_each(|moment| assert!(moment.missing().abs() < CLOSE_S, "{moment:?}"));
}

#[test]
fn the_override_is_the_most_that_the_arm_goes_and_the_feedback_says_how_far_it_came() {
    let mut robot = ready("A");
    robot.command.override_percent = 30;
    let moments = master(steady(0.5)).leads(&mut robot, tour(), |_, _| {});
    let rates = moments.windows(2).map(|pair| (pair[1].has - pair[0].has) / CYCLE_S);
    assert!(rates.clone().all(|rate| rate < 0.302), "{:?}", rates.reduce(f64::max));
    let end = before_the_end(&moments).last().unwrap();
    assert!(end.missing() > 0.5 && robot.is_done(), "{end:?}");
}

#[test]
fn a_jump_ahead_is_made_up_at_the_programmed_speed_and_at_a_jump_back_the_arm_waits() {
    let ahead = |at: f64| if at < 1.0 { 0.5 * at } else { 0.5 * at + 0.3 };
    let back = |at: f64| if at < 1.0 { 0.8 * at } else { 0.8 * at - 0.3 };
    for course in [&ahead as &dyn Fn(f64) -> f64, &back] {
        let mut robot = ready("A");
        let moments = master(course).leads(&mut robot, tour(), |_, _| {});
        assert!(robot.is_done(), "{:?}", robot.feedback());
        let mut steps = moments.windows(2).map(|pair| pair[1].has - pair[0].has);
        assert!(steps.all(|step| (0.0..=1.1 * CYCLE_S).contains(&step)));
        let late = before_the_end(&moments).iter().filter(|moment| moment.at > 2.2);
        late.for_each(|moment| assert!(moment.missing().abs() < CLOSE_S, "{moment:?}"));
    }
}

#[test]
fn without_new_set_points_the_arm_stops_and_with_them_it_goes_on() {
    let mut robot = ready("A");
    robot.call(Skill::MoveContinuous, tour());
    robot.control(Control::SYNC);
    let called = robot.at.as_nanos();
    for cycle in 0..2_800_u64 {
        // Nothing new between 1 and 6 s.
        if !(250..1_500).contains(&cycle) {
            robot.command.start_time_ns = called + cycle * 4_000_000;
            robot.command.law_time_us = (cycle.min(250) + cycle.saturating_sub(1_500)) as u32 * 2_000;
        }
        robot.tick();
        if cycle == 500 {
            let feedback = robot.feedback();
            assert_eq!(feedback.state, State::Running);
            assert!(feedback.status.contains(Status::AT_REST), "{feedback:?}");
            // It went on for the 100 ms that the last rate counts.
            assert!((500_000..700_000).contains(&feedback.law_time_us), "{feedback:?}");
        }
    }
    robot.wait_for_end();
    assert!(robot.is_done());
}

#[test]
fn a_set_point_far_from_the_robots_clock_gives_its_law_time_and_no_rate() {
    for off_ns in [-3_600_000_000_000_i64, -1_000_000_000, 1_000_000_000, i64::MAX / 2] {
        let mut robot = ready("A");
        robot.run_ms(2_000);
        robot.call(Skill::MoveContinuous, tour());
        robot.control(Control::SYNC);
        for cycle in 0..1_000_u32 {
            let holds_at = robot.at.as_nanos().saturating_add_signed(off_ns).max(1);
            (robot.command.start_time_ns, robot.command.law_time_us) =
                (holds_at, (cycle * 2_000).min(400_000));
            robot.tick();
        }
        let feedback = robot.feedback();
        assert!(feedback.status.contains(Status::AT_REST | Status::BUSY), "{off_ns}: {feedback:?}");
        // Far less than the arm could have driven in 4 s.
        assert!(feedback.law_time_us < 600_000, "{off_ns}: {feedback:?}");
        robot.control(Control::HALT);
        robot.wait(|feedback| feedback.state == State::Halted);
    }
}

#[test]
fn a_plc_that_does_not_know_the_robots_clock_leads_without_it() {
    let mut robot = ready("A");
    robot.call(Skill::MoveContinuous, tour());
    robot.control(Control::SYNC);
    robot.command.start_time_ns = 0;
    for cycle in 0..1_000_u32 {
        robot.command.law_time_us = cycle * 2_000;
        robot.tick();
        let missing = f64::from(cycle) * 0.002 - f64::from(robot.feedback().law_time_us) / 1e6;
        // The master starts before the arm has checked its motions.
        assert!(cycle < 100 || missing.abs() < CYCLE_S, "{missing} s missing in cycle {cycle}");
    }
}

#[test]
fn a_robot_says_that_it_serves_a_master_and_without_one_nothing_else() {
    let [mut today, mut other] = [ready("A"), ready("A")];
    assert_eq!(today.feedback().services, Services::SYNC);
    // What a PLC sends in these bytes has no meaning without SYNC.
    other.command.law_time_us = 123_456;
    for robot in [&mut today, &mut other] {
        robot.call(Skill::MoveContinuous, tour());
    }
    while !(today.is_done() && other.is_done()) {
        today.tick();
        other.tick();
        assert_eq!(today.controller.joints(), other.controller.joints());
        assert_eq!((today.feedback(), today.feedback().law_time_us), (other.feedback(), 0));
    }
}

#[test]
fn a_master_may_come_and_go_while_the_arm_moves() {
    let mut robot = ready("A");
    let moments = master(steady(0.4)).leads(&mut robot, tour(), |robot, at| {
        robot.command.control.set(Control::SYNC, at < 1.0);
    });
    assert!(robot.is_done());
    // 0.35 s of the law with the master, the rest at the override.
    assert!((3.2..3.7).contains(&moments.last().unwrap().at), "{:?}", moments.last());
    assert_eq!(robot.feedback().law_time_us, 0);
    // One that comes later finds the arm ahead: it waits.
    let mut robot = ready("A");
    let moments = master(steady(0.5)).leads(&mut robot, tour(), |robot, at| {
        robot.command.control.set(Control::SYNC, at > 0.5);
    });
    assert!(robot.is_done());
    let late = before_the_end(&moments).iter().filter(|moment| moment.at > 2.0);
    late.for_each(|moment| assert!(moment.missing().abs() < CLOSE_S, "{moment:?}"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A cycle that exceeds a joint's rating would end the skill with an error.
    #[test]
    fn no_master_takes_the_arm_beyond_its_limits_or_keeps_it_from_the_end(
        legs in prop::collection::vec((0.0..2.0_f64, -0.3..0.6_f64, 0.05..0.6_f64), 1..12),
        overrides in prop::collection::vec(20..=100_u8, 1..6),
        loses_each in 2..100_u32,
        lead_s in -0.02..0.08_f64,
    ) {
        // Legs of a rate, a jump before and a duration; then steadily on, so that it ends.
        let course = |at: f64| {
            let (mut law, mut left) = (0.0, at);
            for (rate, jump, seconds) in &legs {
                law += jump + rate * left.min(*seconds);
                left -= seconds;
                if left <= 0.0 {
                    return law;
                }
            }
            law + left
        };
        let mut robot = ready("A");
        let moments = Master { course, lead_s, loses_each }.leads(&mut robot, tour(), |robot, at| {
            let index = (at / 0.4) as usize % overrides.len();
            robot.command.override_percent = overrides[index];
        });
        prop_assert!(robot.is_done(), "{:?}", robot.feedback());
        prop_assert!(moments.is_sorted_by(|one, other| one.has <= other.has));
        prop_assert!(moments.windows(2).all(|pair| pair[1].has - pair[0].has <= 1.1 * CYCLE_S));
    }
}
