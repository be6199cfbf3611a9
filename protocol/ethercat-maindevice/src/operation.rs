//! What a MainDevice does from the first frame on: it finds its devices, brings them to OP, exchanges process data, and
//! starts over when that ends.

use std::future::poll_fn;
use std::pin::pin;
use std::task::Poll;

use ethercrab::{
    Command, MainDeviceConfig, RegisterAddress, RetryBehaviour, SubDeviceState, Timeouts, TxRxResponse,
};
use machine::{Cycle, Duration, Instant};

use crate::al::{self, ACKNOWLEDGE_IN_OP, ACKNOWLEDGE_IN_SAFE_OP, REQUEST_INIT, REQUEST_OP, Status};
use crate::bring_up::{Group, bring_up};
use crate::config::{Config, MAX_DEVICES};
use crate::frames::FRAMES;
use crate::held::HeldStage;
use crate::mailbox;
use crate::problem::Problem;
use crate::process::PROCESS;
use crate::recovery::{Recovery, Step, TO_OP};
use crate::script::{Storage, exchange, with_pauses};
use crate::slot::Slot;
use crate::survey::{Quiet, survey};
use crate::{sii, time};

/// Time from a failed attempt to the next one.
pub(crate) const PAUSE: Duration = Duration::from_millis(50);

/// Time within which a device comes to INIT and to PRE-OP. Devices take up to 3 s for the latter.
const TO_PRE_OP: Duration = Duration::from_secs(5);

/// Time without any frame after which the MainDevice starts over while not all devices are in OP.
const SILENCE: Duration = Duration::from_secs(1);

/// Time that a frame may take. Hosts that run other programs as well stall for 10 to 20 ms now and then.
const FRAME: Duration = Duration::from_millis(30);

/// Frames in a row that may be lost before the watchdog expires.
const LOSSES: u32 = 3;

/// How often a frame is repeated while devices are brought up. This takes some thousand frames, and each of them must
/// come back.
const REPETITIONS: usize = 3;

type Response = TxRxResponse<MAX_DEVICES>;

/// Runs until the owner wants to end the connection.
pub(crate) async fn operate(config: Config, slot: Option<Slot>, start: Instant) {
    let storage = Storage::new();
    #[expect(clippy::expect_used, reason = "new memory was not split before")]
    let (tx, rx, pdu_loop) = storage.try_split().expect("new memory");
    let timeouts = Timeouts {
        pdu: FRAME,
        // Long enough for a frame that is sent again and again.
        eeprom: FRAME * (REPETITIONS as u32 + 1),
        mailbox_echo: FRAME * (REPETITIONS as u32 + 1),
        state_transition: TO_PRE_OP,
        ..Timeouts::default()
    };
    let settings = MainDeviceConfig {
        // Without distributed clocks nothing has to be synchronised.
        dc_static_sync_iterations: 0,
        retry_behaviour: RetryBehaviour::Count(REPETITIONS),
    };
    let main_device = ethercrab::MainDevice::new(pdu_loop, with_pauses(timeouts), settings);
    let run = pin!(start_over_and_over(&main_device, &config, slot, start));
    exchange(tx, rx, run).await;
}

async fn start_over_and_over(
    main: &ethercrab::MainDevice<'_>,
    config: &Config,
    slot: Option<Slot>,
    start: Instant,
) {
    time::wait_until(start).await;
    let mut quiet = Quiet::new(config.mac, start);
    let mut has_failed = false;
    loop {
        let ended = match survey(main, slot, &mut quiet).await {
            Ok(()) => {
                if has_failed {
                    sii::clear_errors(main).await;
                }
                let driven_from = time::now();
                let ended = unless_another_drives(drive(main, config, slot)).await;
                if ended.as_ref().is_err_and(Problem::is_conflict) {
                    quiet.disturbed(time::now().since(driven_from));
                }
                ended
            }
            Err(problem) => Err(problem),
        };
        let Err(problem) = ended else { return };
        has_failed = true;
        let is_conflict = problem.is_conflict();
        PROCESS.with_borrow_mut(|process| process.fail(time::now(), problem));
        if is_conflict {
            quiet.wait().await;
        } else {
            time::wait_until(time::now() + PAUSE).await;
        }
    }
}

async fn drive(main: &ethercrab::MainDevice<'_>, config: &Config, slot: Option<Slot>) -> Result<(), Problem> {
    let (group, stage) = bring_up(main, config).await?;
    let exchange = pin!(Exchange::new(config, slot, stage).run(main, &group));
    mailbox::serve_while(main, &group, exchange).await
}

/// Runs until the future ends, or until another MainDevice is heard: then nothing more is sent.
async fn unless_another_drives(drive: impl Future<Output = Result<(), Problem>>) -> Result<(), Problem> {
    let mut drive = pin!(drive);
    poll_fn(|context| match FRAMES.with_borrow(|frames| frames.foreign.found()) {
        Some(mac) => Poll::Ready(Err(Problem::OtherMainDevice { mac })),
        None => drive.as_mut().poll(context),
    })
    .await
}

/// The cyclic exchange of process data.
struct Exchange<'a> {
    config: &'a Config,
    slot: Option<Slot>,
    cycle: Cycle,
    working_counter: u16,
    /// Working counter of a good exchange with devices that do not take outputs in SAFE-OP.
    inputs_working_counter: u16,
    /// Whether the last frame did not come back.
    frame_lost: bool,
    /// The last frame that came back; before there was one, the start.
    answered_at: Instant,
    /// The last good exchange; before there was one, the start.
    good_at: Instant,
    /// Whether there was a good exchange.
    was_up: bool,
    recovery: Recovery,
    /// State of devices that are held in SAFE-OP.
    stage: HeldStage,
}

impl<'a> Exchange<'a> {
    fn new(config: &'a Config, slot: Option<Slot>, stage: HeldStage) -> Self {
        let now = time::now();
        // The devices of one cable have their cycles together, so that they share wake-ups and frames.
        let first = slot.map_or(now, |slot| slot.grid.next_on_grid(config.cycle, now).0);
        Self {
            config,
            slot,
            cycle: Cycle::new(first, config.cycle),
            working_counter: config.working_counter(),
            inputs_working_counter: config.inputs_working_counter(),
            frame_lost: false,
            answered_at: now,
            good_at: now,
            was_up: false,
            recovery: Recovery::of_start(config.devices.len(), now),
            stage,
        }
    }

    /// Runs until the owner wants to end the connection, or until it is better to start over.
    async fn run(mut self, main: &ethercrab::MainDevice<'_>, group: &Group) -> Result<(), Problem> {
        loop {
            time::wait_until(self.cycle.next()).await;
            let Some(tick) = self.cycle.tick(time::now()) else { continue };
            let leaving = PROCESS.with_borrow_mut(|process| {
                // This host is not the cause of the cycles that passed while the MainDevice waited for a lost frame.
                let passed = if std::mem::take(&mut self.frame_lost) {
                    &mut process.counters.lost
                } else {
                    &mut process.counters.skipped
                };
                *passed += tick.skipped;
                process.leaving
            });
            if leaving {
                // The devices' answer does not matter: the MainDevice ends here.
                if self.slot.is_some() {
                    let _ = al::request(main, 0, REQUEST_INIT).await;
                } else {
                    let request = Command::bwr(RegisterAddress::AlControl.into()).ignore_wkc();
                    let _ = request.send(main, REQUEST_INIT).await;
                }
                return Ok(());
            }
            if self.stage.follow(main, self.config.devices.len()).await {
                self.recovery = Recovery::of_start(self.config.devices.len(), time::now());
            }
            write_outputs(main, group);
            PROCESS.with_borrow_mut(|process| process.counters.sent += 1);
            // ethercrab repeats a frame only after its timeout, and this wait ends no later. So old outputs are not sent again.
            match time::by(self.deadline(), group.tx_rx(main)).await {
                Some(Ok(response)) if self.is_good(&response) => {
                    self.good_at = time::now();
                    self.answered_at = self.good_at;
                    self.was_up = true;
                    self.stage.reached(&response.subdevice_states);
                    self.recovery.end();
                    read_inputs(main, group);
                }
                Some(Ok(response)) => {
                    self.answered_at = time::now();
                    self.recover(main, &response).await?;
                }
                Some(Err(_)) | None => {
                    self.frame_lost = true;
                    PROCESS.with_borrow_mut(|process| process.counters.lost += 1);
                }
            }
            self.check_time()?;
        }
    }

    /// Returns whether all devices reported Operational, without an error. It does not use ethercrab's `all_op`, which is
    /// also true if a device does not report its state.
    fn is_good(&self, response: &Response) -> bool {
        let is_counted = response.working_counter == self.working_counter
            || self.stage.takes_safe_op() && response.working_counter == self.inputs_working_counter;
        is_counted
            && response.subdevice_states.len() == self.config.devices.len()
            && response.subdevice_states.iter().all(|state| self.stage.is_good(*state))
            && FRAMES.with_borrow(|frames| frames.error_bits.is_empty())
    }

    /// Looks at a device that is not in OP, or indicates an error there, reports it, and requests OP again.
    async fn recover(
        &mut self,
        main: &ethercrab::MainDevice<'_>,
        response: &Response,
    ) -> Result<(), Problem> {
        PROCESS.with_borrow_mut(|process| process.counters.lost += u64::from(process.is_up()));
        let errors = FRAMES.with_borrow(|frames| frames.error_bits);
        let Some(index) = self.recovery.turn(&response.subdevice_states, errors) else { return Ok(()) };
        // Errors here show in the next cycle, too.
        let Ok(status) = Status::read(main, index).await else { return Ok(()) };
        let (number, code) = (index + 1, status.code);
        let state = response.subdevice_states.get(index).copied().unwrap_or_default();
        let left = Problem::LeftOperational { number, state, code };
        PROCESS.with_borrow_mut(|process| {
            if process.is_up() {
                process.fail(time::now(), left.clone());
            }
        });
        let step = self.recovery.step(time::now(), index, status);
        let control = match step {
            Step::Wait => return Ok(()),
            Step::Acknowledge if status.state == SubDeviceState::Op => ACKNOWLEDGE_IN_OP,
            Step::Acknowledge => ACKNOWLEDGE_IN_SAFE_OP,
            Step::RequestOp => REQUEST_OP,
            Step::StartOver if self.was_up => return Err(left),
            Step::StartOver | Step::GiveUp => {
                return Err(Problem::NotOperational { number, state: status.state, code });
            }
        };
        if al::request(main, index, control).await.is_ok() {
            self.recovery.done(time::now(), index, step);
        }
        Ok(())
    }

    /// Returns the instant until which the MainDevice waits for a reply.
    fn deadline(&self) -> Instant {
        let frame = (self.config.watchdog / LOSSES).clamp(self.config.cycle.min(FRAME), FRAME);
        let reply = time::now() + frame;
        if self.recovery.is_needed() { reply } else { reply.min(self.good_at + self.config.watchdog) }
    }

    /// Fails after too long a time without a good exchange: while all devices are in OP the watchdog's, otherwise the time in
    /// which they come to OP.
    fn check_time(&self) -> Result<(), Problem> {
        let now = time::now();
        let longest = if self.recovery.is_needed() { TO_OP + SILENCE } else { self.config.watchdog };
        if self.recovery.is_needed() && now.since(self.answered_at) >= SILENCE {
            return Err(Problem::Silence);
        }
        if now.since(self.good_at) < longest { Ok(()) } else { Err(Problem::Watchdog) }
    }
}

fn write_outputs(main: &ethercrab::MainDevice<'_>, group: &Group) {
    PROCESS.with_borrow(|process| {
        let mut rest = process.outputs.as_slice();
        for device in group.iter(main) {
            let mut outputs = device.outputs_raw_mut();
            let (own, others) = rest.split_at(outputs.len().min(rest.len()));
            outputs.iter_mut().zip(own).for_each(|(place, byte)| *place = *byte);
            rest = others;
        }
    });
}

fn read_inputs(main: &ethercrab::MainDevice<'_>, group: &Group) {
    PROCESS.with_borrow_mut(|process| {
        let mut rest = process.inputs.as_mut_slice();
        for device in group.iter(main) {
            let inputs = device.inputs_raw();
            let (own, others) = rest.split_at_mut(inputs.len().min(rest.len()));
            own.iter_mut().zip(inputs.iter()).for_each(|(place, byte)| *place = *byte);
            rest = others;
        }
        process.good();
    });
}
