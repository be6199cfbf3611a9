//! Checks of the look-ahead of the robot and of the refill.

use protocol::image::SLOTS;

use super::{Check, problem};
use crate::{LookAhead, MOST_QUEUE_MOTIONS, Refill, Setup};

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
