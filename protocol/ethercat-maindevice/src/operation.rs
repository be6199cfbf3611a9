//! What a MainDevice does from the first frame on: it finds its devices, brings them to OP, exchanges process data, and
//! starts over when that ends.

use std::pin::pin;

use ethercrab::error::Error;
use ethercrab::subdevice_group::{Op, PreOp, PreOpPdi};
use ethercrab::{
    Command, DefaultLock, MainDeviceConfig, RegisterAddress, RetryBehaviour, SubDevice, SubDeviceGroup,
    SubDeviceState, Timeouts, TxRxResponse,
};
use machine::{Cycle, Duration, Instant};

use crate::config::{Config, MAX_DEVICES, MAX_PROCESS_DATA};
use crate::problem::{FoundDevice, Problem};
use crate::process::PROCESS;
use crate::script::{Storage, exchange};
use crate::time;

/// Time from a failed attempt to the next one.
pub(crate) const PAUSE: Duration = Duration::from_millis(50);

/// Time within which all devices come to OP, or come back to it.
const TO_OP: Duration = Duration::from_secs(5);

/// Time that a frame may take. Hosts that run other programs as well stall for 10 to 20 ms now and then.
const FRAME: Duration = Duration::from_millis(30);

/// Frames in a row that may be lost before the watchdog expires.
const LOSSES: u32 = 3;

/// How often a frame is repeated while devices are brought up. This takes some thousand frames, and each of them must
/// come back.
const REPETITIONS: usize = 3;

/// Requests for a state in the register AL control (ETG.1000.6): the state, and bit 4 to acknowledge an error.
const REQUEST_INIT: u16 = 0x0011;
const REQUEST_OP: u16 = 0x0008;
const ACKNOWLEDGE_IN_SAFE_OP: u16 = 0x0014;

/// Watchdog divider (register 0x0400) for steps of 100 µs: 2 + 2498 periods of 25 MHz.
const WATCHDOG_DIVIDER: u16 = 2_498;
const WATCHDOG_STEP: Duration = Duration::from_micros(100);

type Group<S> = SubDeviceGroup<MAX_DEVICES, MAX_PROCESS_DATA, DefaultLock, S>;
type Response = TxRxResponse<MAX_DEVICES>;

/// Runs until the owner wants to end the connection.
pub(crate) async fn operate(config: Config, start: Instant) {
    let storage = Storage::new();
    #[expect(clippy::expect_used, reason = "new memory was not split before")]
    let (tx, rx, pdu_loop) = storage.try_split().expect("new memory");
    let timeouts = Timeouts {
        pdu: FRAME,
        // Long enough for a frame that is sent again and again.
        eeprom: FRAME * (REPETITIONS as u32 + 1),
        mailbox_echo: FRAME * (REPETITIONS as u32 + 1),
        state_transition: TO_OP,
        ..Timeouts::default()
    };
    let settings = MainDeviceConfig {
        // Without distributed clocks nothing has to be synchronised.
        dc_static_sync_iterations: 0,
        retry_behaviour: RetryBehaviour::Count(REPETITIONS),
    };
    let main_device = ethercrab::MainDevice::new(pdu_loop, timeouts, settings);
    let run = pin!(start_over_and_over(&main_device, &config, start));
    exchange(tx, rx, run).await;
}

async fn start_over_and_over(main: &ethercrab::MainDevice<'_>, config: &Config, start: Instant) {
    time::wait_until(start).await;
    loop {
        let ended = match bring_up(main, config).await {
            Ok(group) => Exchange::new(config).run(main, &group).await,
            Err(problem) => Err(problem),
        };
        match ended {
            Ok(()) => return,
            Err(problem) => PROCESS.with_borrow_mut(|process| process.fail(time::now(), problem)),
        }
        time::wait_until(time::now() + PAUSE).await;
    }
}

/// Finds the devices, checks that they are the expected ones, and requests OP.
async fn bring_up(main: &ethercrab::MainDevice<'_>, config: &Config) -> Result<Group<Op>, Problem> {
    let in_words = |error| Problem::of_start(error, config.devices.len());
    let mut found = Vec::new();
    let group = main
        .init::<MAX_DEVICES, Group<PreOp>>(time::now_ns, Group::default(), |group, device| {
            found.push(described(device));
            Ok(group)
        })
        .await
        .map_err(in_words)?;
    check_devices(config, &found)?;
    let watchdog = config.watchdog.as_nanos().div_ceil(WATCHDOG_STEP.as_nanos());
    let watchdog = u16::try_from(watchdog).unwrap_or(u16::MAX);
    for device in group.iter(main) {
        // A chip may lack these registers; then it keeps its 100 ms.
        let _ = device.register_write(RegisterAddress::WatchdogDivider, WATCHDOG_DIVIDER).await;
        let _ = device.register_write(RegisterAddress::SyncManagerWatchdog, watchdog).await;
    }
    let group = group.into_pre_op_pdi(main).await.map_err(in_words)?;
    check_process_data(main, &group, config, &found)?;
    let group = group.into_safe_op(main).await.map_err(in_words)?;
    // Devices come to OP only once outputs reach them.
    group.request_into_op(main).await.map_err(in_words)
}

fn described(device: &SubDevice) -> FoundDevice {
    let identity = device.identity();
    FoundDevice {
        name: device.name().to_owned(),
        vendor: identity.vendor_id,
        product: identity.product_id,
        revision: identity.revision,
    }
}

fn check_devices(config: &Config, found: &[FoundDevice]) -> Result<(), Problem> {
    let expected = &config.devices;
    if found.is_empty() && !expected.is_empty() {
        return Err(Problem::NoDevice);
    }
    let are_all = found.len() == expected.len();
    if are_all && found.iter().zip(expected).all(|(found, expected)| found.is(expected)) {
        return Ok(());
    }
    Err(Problem::OtherDevices { expected: expected.clone(), found: found.to_owned() })
}

fn check_process_data(
    main: &ethercrab::MainDevice<'_>,
    group: &Group<PreOpPdi>,
    config: &Config,
    found: &[FoundDevice],
) -> Result<(), Problem> {
    for (index, (device, expected)) in group.iter(main).zip(&config.devices).enumerate() {
        let bytes = [device.outputs_raw().len(), device.inputs_raw().len()];
        let expected = [expected.output_bytes, expected.input_bytes];
        if bytes != expected
            && let Some(found) = found.get(index)
        {
            return Err(Problem::OtherProcessData {
                number: index + 1,
                found: found.clone(),
                expected,
                bytes,
            });
        }
    }
    Ok(())
}

/// The cyclic exchange of process data.
struct Exchange<'a> {
    config: &'a Config,
    cycle: Cycle,
    working_counter: u16,
    /// Whether the last frame did not come back.
    frame_lost: bool,
    /// The last good exchange; before there was one, the start.
    good_at: Instant,
    /// Since when not all devices are in OP.
    out_of_op_since: Option<Instant>,
}

impl<'a> Exchange<'a> {
    fn new(config: &'a Config) -> Self {
        let now = time::now();
        Self {
            config,
            cycle: Cycle::new(now, config.cycle),
            working_counter: config.working_counter(),
            frame_lost: false,
            good_at: now,
            out_of_op_since: Some(now),
        }
    }

    /// Runs until the owner wants to end the connection, or until it is better to start over.
    async fn run(mut self, main: &ethercrab::MainDevice<'_>, group: &Group<Op>) -> Result<(), Problem> {
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
                let request = Command::bwr(RegisterAddress::AlControl.into()).ignore_wkc();
                let _ = request.send(main, REQUEST_INIT).await;
                return Ok(());
            }
            write_outputs(main, group);
            PROCESS.with_borrow_mut(|process| process.counters.sent += 1);
            // ethercrab repeats a frame only after its timeout, and this wait ends no later. So old outputs are not sent again.
            match time::by(self.deadline(), group.tx_rx(main)).await {
                Some(Ok(response)) if self.is_good(&response) => {
                    self.good_at = time::now();
                    self.out_of_op_since = None;
                    read_inputs(main, group);
                }
                Some(Ok(response)) => self.recover(main, group, &response).await?,
                Some(Err(_)) | None => {
                    self.frame_lost = true;
                    PROCESS.with_borrow_mut(|process| process.counters.lost += 1);
                }
            }
            self.check_time()?;
        }
    }

    /// Returns whether all devices reported Operational. It does not use ethercrab's `all_op`, which is also true if a
    /// device does not report its state.
    fn is_good(&self, response: &Response) -> bool {
        response.working_counter == self.working_counter
            && response.subdevice_states.len() == self.config.devices.len()
            && response.subdevice_states.iter().all(|state| *state == SubDeviceState::Op)
    }

    /// Looks for devices that are not in OP, reports them, and requests OP again.
    async fn recover(
        &mut self,
        main: &ethercrab::MainDevice<'_>,
        group: &Group<Op>,
        response: &Response,
    ) -> Result<(), Problem> {
        PROCESS.with_borrow_mut(|process| process.counters.lost += u64::from(process.is_up()));
        let fallen = response.subdevice_states.iter().position(|state| *state != SubDeviceState::Op);
        let Some(index) = fallen else { return Ok(()) };
        let Ok(device) = group.subdevice(main, index) else { return Ok(()) };
        // Errors here show in the next cycle, too.
        let Ok([status, _, _, _, low, high]) =
            device.register_read::<[u8; 6]>(RegisterAddress::AlStatus).await
        else {
            return Ok(());
        };
        let (number, code) = (index + 1, u16::from_le_bytes([low, high]));
        let state = response.subdevice_states.get(index).copied().unwrap_or_default();
        let since = *self.out_of_op_since.get_or_insert_with(time::now);
        let left = Problem::LeftOperational { number, state, code };
        PROCESS.with_borrow_mut(|process| {
            if process.is_up() {
                process.fail(time::now(), left.clone());
            }
        });
        if time::now().since(since) > TO_OP {
            return Err(Problem::NotOperational { number, state, code });
        }
        match status & 0x1F {
            0x14 => drop(device.register_write(RegisterAddress::AlControl, ACKNOWLEDGE_IN_SAFE_OP).await),
            0x04 => drop(device.register_write(RegisterAddress::AlControl, REQUEST_OP).await),
            0x08 => {}
            // Below SAFE-OP it has lost its configuration.
            _ => return Err(left),
        }
        Ok(())
    }

    /// Returns the instant until which the MainDevice waits for a reply.
    fn deadline(&self) -> Instant {
        let frame = (self.config.watchdog / LOSSES).clamp(self.config.cycle.min(FRAME), FRAME);
        (time::now() + frame).min(self.good_at + self.longest_silence())
    }

    /// Returns the longest time without a good exchange: while all devices are in OP the watchdog's, otherwise the time in
    /// which they come to OP.
    fn longest_silence(&self) -> Duration {
        if self.out_of_op_since.is_some() { TO_OP } else { self.config.watchdog }
    }

    fn check_time(&self) -> Result<(), Problem> {
        if time::now().since(self.good_at) < self.longest_silence() {
            return Ok(());
        }
        Err(if self.out_of_op_since.is_some() { Problem::Silence } else { Problem::Watchdog })
    }
}

fn write_outputs(main: &ethercrab::MainDevice<'_>, group: &Group<Op>) {
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

fn read_inputs(main: &ethercrab::MainDevice<'_>, group: &Group<Op>) {
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

impl From<Error> for Problem {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}
