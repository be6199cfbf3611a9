//! What a robot behind the skill process image does at the least, so that a foreign fieldbus stack can stand in for
//! the robot node. It is written from the image's byte tables alone and shares no code with it, so that a peer sees
//! the bytes as they are.
//!
//! ```text
//! command   0 control (bit 0 enable, 1 execute)  2 life  4 number  6 skill  8 total  12 written  16 program  36 slots
//! feedback  0 status  2 state  4 number  8 executed  12 accepted  22 life echo  24 life  36 execution time in ns
//! ```

use std::time::{Duration, Instant};

/// Length in bytes of the image in either direction.
pub const IMAGE: usize = 256;

/// The robot's own measure of every skill in ns: a figure that the PLC can have from here alone.
const EXECUTION_NS: u64 = 123_456_000;

/// Motions that it counts for a program of its own.
const PROGRAM_MOTIONS: u32 = 7;

/// Time from one motion to the next.
const MOTION: Duration = Duration::from_millis(20);

/// Its cycle, in which it counts its life counter up, as the built-in setups have it.
const CYCLE: Duration = Duration::from_millis(4);

const RUN_PROGRAM: u8 = 17;
const READY: u8 = 1;
const RUNNING: u8 = 2;

/// How the bus orders the bytes of a number.
#[derive(Clone, Copy, Debug)]
pub enum Order {
    /// PROFINET.
    Big,
    /// EtherNet/IP.
    Little,
}

/// A robot that executes nothing and says that it does.
#[derive(Debug)]
pub struct StubRobot {
    order: Order,
    number: u16,
    /// When it was switched on: its life counter counts cycles since then.
    start: Option<Instant>,
    skill: Option<Run>,
    done: bool,
    executed: u32,
}

#[derive(Debug)]
struct Run {
    own_program: bool,
    total: u32,
    next: Instant,
    /// First coordinate of each motion's target, as it stood in its slot.
    targets: Vec<f32>,
}

impl StubRobot {
    /// A robot that was just switched on.
    pub fn new(order: Order) -> Self {
        Self { order, number: 0, start: None, skill: None, done: false, executed: 0 }
    }

    /// Takes the PLC's image over and gives the robot's. Says on standard output what the PLC wanted.
    pub fn cycle(&mut self, command: &[u8; IMAGE], now: Instant) -> [u8; IMAGE] {
        let word = |at: usize| self.number_at(&command[at..at + 2]) as u16;
        let double = |at: usize| self.number_at(&command[at..at + 4]) as u32;
        let (control, life, number, skill) = (word(0), word(2), word(4), command[6]);
        let (total, written, program) = (double(8), double(12), word(16));
        let running = now - *self.start.get_or_insert(now);
        let cycles = (running.as_nanos() / CYCLE.as_nanos()) as u16;
        if control & 2 != 0 && number != self.number && self.skill.is_none() {
            let own_program = skill == RUN_PROGRAM;
            println!("command {number}: skill {skill}, {total} motions, program {program}");
            let total = if own_program { PROGRAM_MOTIONS } else { total };
            self.skill = Some(Run { own_program, total, next: now + MOTION, targets: Vec::new() });
            (self.number, self.done, self.executed) = (number, false, 0);
        }
        if let Some(run) = &mut self.skill {
            let there = run.own_program || self.executed < written;
            if now >= run.next && there {
                let slot = 36 + 44 * (self.executed as usize % 5);
                let bits = [command[slot], command[slot + 1], command[slot + 2], command[slot + 3]];
                run.targets.push(match self.order {
                    Order::Big => f32::from_be_bytes(bits),
                    Order::Little => f32::from_le_bytes(bits),
                });
                self.executed += 1;
                run.next = now + MOTION;
            }
            if self.executed >= run.total {
                if !run.own_program {
                    println!("command {number}: targets {:.1?}", run.targets);
                }
                self.done = true;
                self.skill = None;
            }
        }
        let (state, busy) = if self.skill.is_some() { (RUNNING, 1) } else { (READY, 0) };
        let enabled = control & 1;
        let status = busy | u16::from(self.done) << 1 | (1 - busy) << 4 | enabled << 5;
        let mut feedback = [0; IMAGE];
        let mut put = |at: usize, len: usize, value: u64| match self.order {
            Order::Big => feedback[at..at + len].copy_from_slice(&value.to_be_bytes()[8 - len..]),
            Order::Little => feedback[at..at + len].copy_from_slice(&value.to_le_bytes()[..len]),
        };
        put(0, 2, status.into());
        put(2, 1, state.into());
        put(4, 2, self.number.into());
        put(8, 4, self.executed.into());
        put(12, 4, self.executed.into());
        put(22, 2, life.into());
        put(24, 2, cycles.into());
        put(36, 8, EXECUTION_NS);
        feedback
    }

    fn number_at(&self, bytes: &[u8]) -> u64 {
        let next = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        match self.order {
            Order::Big => bytes.iter().fold(0, next),
            Order::Little => bytes.iter().rev().fold(0, next),
        }
    }
}
