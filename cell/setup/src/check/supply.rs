//! Checks of the look-ahead of the robot, of the refill and of the form of the slots.

use protocol::image::SLOTS;

use super::{Check, problem};
use crate::{LookAhead, MOST_QUEUE_MOTIONS, Refill, Setup, SlotForm};

/// Fewest motions that a robot with compact points keeps: all that come with a command are checked before the start.
const LEAST_FOR_POINTS: u32 = 30;

pub(super) fn check(setup: &Setup) -> Check {
    let (plc, robot, slots) = (&setup.plc, &setup.robot, SLOTS as u32);
    let within = |key: &str, found: u32| {
        if (slots..=MOST_QUEUE_MOTIONS).contains(&found) {
            return Ok(());
        }
        Err(problem(key, format!("{found} motions: must be {slots} to {MOST_QUEUE_MOTIONS}")))
    };
    within("robot.queue_motions", robot.queue_holds())?;
    if let LookAhead::Motions(motions) = robot.looks_ahead() {
        within("robot.program_look_ahead", motions)?;
    }
    if robot.takes_compact_points() && robot.queue_holds() < LEAST_FOR_POINTS {
        let text = format!(
            "needs a robot that keeps the {LEAST_FOR_POINTS} points of an image; set robot.queue_motions to {LEAST_FOR_POINTS} to {MOST_QUEUE_MOTIONS}"
        );
        return Err(problem("robot.compact_points", text));
    }
    if plc.sends_in_form() == SlotForm::Compact && !robot.takes_compact_points() {
        let text = "`compact` needs a robot that takes compact points; set robot.compact_points = true";
        return Err(problem("plc.form", text));
    }
    if plc.refills_by() == Refill::Executed {
        return Ok(());
    }
    if robot.queue_holds() == slots {
        let text = format!(
            "`accepted` needs a robot that keeps more than {slots} motions; set robot.queue_motions to {} to {MOST_QUEUE_MOTIONS}",
            slots + 1
        );
        return Err(problem("plc.refill", text));
    }
    if plc.slots_in_use() < slots {
        let text = format!("{} with refill `accepted`: must be {slots}, or leave it out", plc.slots_in_use());
        return Err(problem("plc.queue_depth", text));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::{LookAhead, Provenance, Refill, Sourced, SplineBlock, check, setup};

    #[test]
    fn a_queue_or_look_ahead_that_no_robot_has_and_a_refill_that_it_does_not_serve_are_refused() {
        let with = |queue: u32, refill: Refill| {
            check(&setup("A").unwrap().with_queue_motions(queue).with_refill(refill))
                .map_err(|error| error.to_string())
        };
        assert!(with(5, Refill::Executed).is_ok() && with(200, Refill::Accepted).is_ok());
        insta::assert_snapshot!([
            with(4, Refill::Executed).unwrap_err(),
            with(201, Refill::Executed).unwrap_err(),
            with(5, Refill::Accepted).unwrap_err(),
        ].join("\n"), @"
        setup A: `robot.queue_motions`: 4 motions: must be 5 to 200
        setup A: `robot.queue_motions`: 201 motions: must be 5 to 200
        setup A: `plc.refill`: `accepted` needs a robot that keeps more than 5 motions; set robot.queue_motions to 6 to 200
        ");
        let points = |queue: u32| check(&setup("A").unwrap().with_queue_motions(queue).with_compact_points());
        assert!(points(30).is_ok());
        assert!(points(29).unwrap_err().to_string().contains("robot.compact_points"));
        let mut setup_of_form = setup("A").unwrap().with_queue_motions(30).with_form_compact();
        assert!(check(&setup_of_form).is_ok());
        setup_of_form.robot.compact_points = None;
        assert!(check(&setup_of_form).unwrap_err().to_string().contains("plc.form"));
        let few =
            setup("A").unwrap().with_queue_motions(64).with_refill(Refill::Accepted).with_queue_depth(3);
        assert!(check(&few).unwrap_err().to_string().contains("plc.queue_depth"));
    }

    #[test]
    fn a_look_ahead_is_a_number_of_motions_or_a_whole_spline() {
        let read = |text: &str| toml::from_str::<Sourced<LookAhead>>(text).map(|found| found.value);
        assert_eq!(read("value = 64\nfrom = 'assumed'").unwrap(), LookAhead::Motions(64));
        let whole = LookAhead::Block(SplineBlock::WholeSpline);
        assert_eq!(read("value = 'whole-spline'\nfrom = 'datasheet'").unwrap(), whole);
        let refused = read("value = 'all'\nfrom = 'datasheet'").unwrap_err().to_string();
        assert!(refused.contains("a number of motions, or \"whole-spline\""), "{refused}");
        let mut a = setup("A").unwrap();
        let value = LookAhead::Motions(4);
        a.robot.program_look_ahead = Some(Sourced { value, from: Provenance::Assumed, note: String::new() });
        assert!(check(&a).unwrap_err().to_string().contains("robot.program_look_ahead"));
    }
}
