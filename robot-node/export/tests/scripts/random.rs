//! Random scripts: what the PLC's program asks for, how fast everything is, and which images are late.

use plc_node::function_blocks::BufferMode;
use protocol::image::{MotionKind, Order};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use robot_export::execution::FormCode;

use super::cell::{BAD_MOTION, CellPace, SUPPLIED, ScriptCell};
use super::plc::{
    DISABLE, ENABLE, HALT, INTERRUPT, LINE, LOWEST, OTHER, PROGRAM, RESET, SKILLS, STOP, Supply, WAY, motion,
    program,
};
use super::rules::{Broken, Rule, broken};

/// Runs one script; returns how many motions the arm began.
pub(crate) fn script(code: &FormCode, seed: u64) -> Result<usize, Broken> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut draw = move |below: u32| random.next_u32() % below.max(1);
    let order = [Order::BigEndian, Order::LittleEndian][draw(2) as usize];
    let advance = 1 + draw(5) as usize;
    let mut cell = ScriptCell::new(code, order, advance);
    let pace = CellPace {
        steps: [3, 8, 25, 60][draw(4) as usize],
        shares: [[4, 4, 2], [8, 2, 2], [2, 8, 2], [4, 4, 8]][draw(4) as usize],
        delays: [draw(4) as usize, draw(4) as usize],
    };
    cell.robot.set_braking(draw(12));
    let mut salt = draw(200) * 1_000;
    for block in [ENABLE, RESET] {
        cell.run(block, pace, &mut draw)?;
    }
    let ran = act_all(&mut cell, pace, &mut salt, &mut draw)
        .and_then(|()| recover(&mut cell, pace, &mut salt, &mut draw));
    ran.map_err(|broken| Broken { text: format!("{}; {}", broken.text, cell.describe()), ..broken })?;
    Ok(cell.robot.begun().len())
}

fn act_all(
    cell: &mut ScriptCell<'_>,
    pace: CellPace,
    salt: &mut u32,
    draw: &mut impl FnMut(u32) -> u32,
) -> Result<(), Broken> {
    for _ in 0..4 + draw(12) {
        act(cell, salt, draw);
        // A pass of the cyclic task takes some sixty statements.
        for _ in 0..draw(240 / pace.steps + 4) {
            for supply in SUPPLIED {
                cell.plc.supplies[supply].available += draw(2);
            }
            cell.scan(pace, draw)?;
        }
    }
    Ok(())
}

/// Gives a block of a skill new motions, unless it is under way, and starts it.
fn start(cell: &mut ScriptCell<'_>, block: usize, salt: &mut u32, draw: &mut impl FnMut(u32) -> u32) {
    if cell.execute[block] || cell.outputs[block].busy {
        return;
    }
    let kinds =
        [MotionKind::LinCartesian, MotionKind::PtpCartesian, MotionKind::PtpJoint, MotionKind::Circular];
    let count = if block == LINE { 1 } else { 1 + draw(14) };
    let is_bad = block == OTHER && draw(3) == 0;
    let motions = (0..count).map(|at| {
        *salt += 1;
        let kind = if block == LINE { kinds[0] } else { kinds[draw(4) as usize] };
        motion(kind, *salt, if is_bad && at == BAD_MOTION { LOWEST - 1.0 } else { 5.0 })
    });
    let motions = motions.collect();
    cell.plc.supplies[block] = Supply { motions, available: if draw(3) == 0 { 1 } else { 1_000 } };
    cell.pulse(block);
}

fn act(cell: &mut ScriptCell<'_>, salt: &mut u32, draw: &mut impl FnMut(u32) -> u32) {
    cell.mode = [BufferMode::Aborting, BufferMode::Buffered][draw(2) as usize];
    match draw(20) {
        0..=4 => start(cell, WAY, salt, draw),
        5 | 6 => start(cell, LINE, salt, draw),
        7 | 8 => start(cell, OTHER, salt, draw),
        9 => start(cell, PROGRAM, salt, draw),
        10 => cell.pulse(HALT),
        11 => cell.pulse(STOP),
        12 => cell.pulse(DISABLE),
        13 => cell.pulse(INTERRUPT),
        14 => cell.pulse(ENABLE),
        15 => cell.pulse(RESET),
        16 => cell.set_override(f64::from([0, 30, 100][draw(3) as usize])),
        17 => cell.stale[draw(2) as usize] = draw(30),
        18 => cell.lost = draw(200),
        _ => {
            // Halt and start at once: the next command waits while the one before is cancelled.
            cell.pulse(HALT);
            start(cell, WAY, salt, draw);
        }
    }
}

/// Leads the robot to `Ready` from wherever the script left it, and executes a skill to its end.
fn recover(
    cell: &mut ScriptCell<'_>,
    pace: CellPace,
    salt: &mut u32,
    draw: &mut impl FnMut(u32) -> u32,
) -> Result<(), Broken> {
    cell.set_override(100.0);
    let mut scans = 0;
    while cell.is_busy() || cell.lost > 0 || cell.stale != [0; 2] {
        cell.scan(pace, draw)?;
        for supply in SUPPLIED {
            cell.plc.supplies[supply].available += 1;
        }
        scans += 1;
        if scans > 60_000 {
            return broken(Rule::Recovers, "the script does not end");
        }
    }
    cell.settle(pace, draw)?;
    for block in [STOP, ENABLE, RESET] {
        let outputs = cell.run(block, pace, draw)?;
        // A robot that stands in an error is enabled and waits for its reset.
        if !outputs.done && block != ENABLE {
            let error = cell.plc.error(block);
            return broken(Rule::Recovers, format!("block {block} at the end: {outputs:?}, {error:?}"));
        }
    }
    if !cell.is_enabled() {
        return broken(Rule::Recovers, "not enabled after a reset");
    }
    for block in [WAY, PROGRAM] {
        let begun = cell.robot.begun().len();
        let count = if block == PROGRAM { program().len() } else { 11 };
        *salt += 100;
        let motions = (0..11).map(|at| motion(MotionKind::LinCartesian, *salt + at, 5.0)).collect();
        if block < SKILLS {
            cell.plc.supplies[block] = Supply { motions, available: 3 };
        }
        let outputs = cell.run(block, pace, draw)?;
        if !outputs.done || cell.robot.begun().len() != begun + count {
            let error = cell.plc.error(block);
            return broken(Rule::Recovers, format!("block {block} after a reset: {outputs:?}, {error:?}"));
        }
    }
    Ok(())
}
