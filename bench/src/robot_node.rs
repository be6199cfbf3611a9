//! Stands in for the robot node until that is merged: every motion takes the same time.
#![allow(missing_docs, dead_code)]
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::*;
use protocol::*;
#[derive(Debug)]
pub struct RobotConfig {
    cycle: Duration,
    overhead: Duration,
    quantum: Duration,
}
impl RobotConfig {
    pub fn from_setup(s: &setup::Setup) -> anyhow::Result<Self> {
        let m = |v: u32| Duration::from_micros(v.into());
        Ok(Self {
            cycle: m(s.robot.cycle_us.value),
            overhead: m(s.robot.skill_overhead_us.value),
            quantum: m(s.robot.interpreter_quantum_us.value),
        })
    }
}
#[derive(Debug)]
pub enum RobotEvent {
    Link(LinkEvent),
}
#[derive(Debug)]
pub struct RobotNode<B> {
    bus: B,
    cycle: Cycle,
    late: Lateness,
    cfg: RobotConfig,
    fb: Feedback,
    until: Option<(Instant, u32)>,
    n: u64,
}
impl<B: Fieldbus> RobotNode<B> {
    pub fn new(cfg: RobotConfig, bus: B, start: Instant) -> Self {
        Self {
            bus,
            cycle: Cycle::new(start, cfg.cycle),
            late: Lateness::default(),
            cfg,
            fb: Feedback::default(),
            until: None,
            n: 0,
        }
    }
    pub fn lateness(&self) -> &Lateness {
        &self.late
    }
    pub fn bus(&self) -> &B {
        &self.bus
    }
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }
}
impl<B: Fieldbus> Machine for RobotNode<B> {
    type Event = RobotEvent;
    fn handle_frame(&mut self, now: Instant, from: Source, f: &[u8]) {
        self.bus.handle_frame(now, from, f)
    }
    fn handle_timeout(&mut self, now: Instant) {
        self.bus.handle_timeout(now);
        if let Some(t) = self.cycle.tick(now) {
            self.late.record(&t);
            self.fb.life = self.fb.life.wrapping_add(1);
            if let Some(c) = self.bus.input().and_then(|i| Command::parse::<B::Order>(i).ok()) {
                self.fb.life_echo = c.life;
                self.fb.status.set(Status::ENABLED, c.control.contains(Control::ENABLE));
                if c.control.contains(Control::RESET) && self.until.is_none() {
                    self.fb.state = State::Ready;
                    self.fb.error = ErrorNumber::None;
                }
                if c.control.contains(Control::EXECUTE) && c.number != self.fb.number && self.until.is_none()
                {
                    self.n = self.n.wrapping_mul(6364136223846793005).wrapping_add(now.as_nanos() | 1);
                    let q = self.cfg.quantum.as_nanos() as u64;
                    let q = Duration::from_nanos(if q == 0 { 0 } else { now.as_nanos() % q });
                    let motions = match c.skill {
                        Skill::RunProgram => 13,
                        Skill::MoveContinuous => c.total,
                        _ => 1,
                    };
                    self.fb.number = c.number;
                    self.fb.executed = 0;
                    self.fb.accepted = 0;
                    self.fb.status.set(Status::DONE, false);
                    self.fb.status.set(Status::BUSY, true);
                    self.fb.state = State::Running;
                    let per = Duration::from_millis(280);
                    self.until = Some((now + self.cfg.overhead + q + per * motions, motions));
                }
                if let Some((at, m)) = self.until {
                    if self.fb.accepted < c.written {
                        self.fb.accepted = c.written;
                        self.fb.executed = c.written.min(m).saturating_sub(1);
                    }
                    if now >= at {
                        self.until = None;
                        self.fb.executed = m;
                        self.fb.accepted = m;
                        self.fb.status.set(Status::DONE, true);
                        self.fb.status.set(Status::BUSY, false);
                        self.fb.state = State::Ready;
                    }
                }
            }
            let mut im = [0; IMAGE_LEN];
            self.fb.emit::<B::Order>(&mut im);
            self.bus.set_output(&im);
        }
    }
    fn poll_transmit(&mut self, now: Instant, b: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, b)
    }
    fn poll_event(&mut self) -> Option<RobotEvent> {
        self.bus.poll_event().map(RobotEvent::Link)
    }
    fn poll_timeout(&self) -> Option<Instant> {
        let n = self.cycle.next();
        Some(self.bus.poll_timeout().map_or(n, |b| b.min(n)))
    }
}
