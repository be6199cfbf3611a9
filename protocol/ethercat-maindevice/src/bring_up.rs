//! The way up: from the first frame to the request for OP.

use ethercrab::error::{Error, TimeoutError};
use ethercrab::subdevice_group::{PreOp, PreOpPdi};
use ethercrab::{DefaultLock, MainDevice, RegisterAddress, SubDevice, SubDeviceGroup, SubDeviceState};
use machine::{Duration, Instant};

use crate::al::{self, REQUEST_INIT, REQUEST_OP, REQUEST_SAFE_OP, Status};
use crate::coe::SdoObject;
use crate::commissioning::{ModuleList, StartupWrite};
use crate::config::{Config, MAX_DEVICES, MAX_PROCESS_DATA};
use crate::held::HeldStage;
use crate::module_list;
use crate::problem::{FoundDevice, Problem};
use crate::process::{PROCESS, Process};
use crate::recovery::TO_OP;
use crate::sdo::access;
use crate::sdo_fault::SdoFault;
use crate::time;

/// Watchdog divider (register 0x0400) for steps of 100 µs: 2 + 2498 periods of 25 MHz.
const WATCHDOG_DIVIDER: u16 = 2_498;
const WATCHDOG_STEP: Duration = Duration::from_micros(100);

/// Time from one look at the state of a device to the next.
const LOOK: Duration = Duration::from_millis(1);

type GroupIn<S> = SubDeviceGroup<MAX_DEVICES, MAX_PROCESS_DATA, DefaultLock, S>;

/// The devices, with their places in the process data.
pub(crate) type Group = GroupIn<PreOpPdi>;

/// Finds the devices, checks that they are the expected ones, brings them to SAFE-OP and requests OP, unless they are held.
/// Returns which of the two it was: the owner may hold them while OP is being requested.
///
/// The group stays in ethercrab's state for PRE-OP: ethercrab waits to the end for a device that has refused SAFE-OP.
pub(crate) async fn bring_up(main: &MainDevice<'_>, config: &Config) -> Result<(Group, HeldStage), Problem> {
    let mut found = Vec::new();
    let group = main
        .init::<MAX_DEVICES, GroupIn<PreOp>>(time::now_ns, GroupIn::default(), |group, device| {
            found.push(described(device));
            Ok(group)
        })
        .await;
    let group = match group {
        Ok(group) => group,
        Err(error) => return Err(of_start(main, config, error).await),
    };
    check_devices(config, &found)?;
    PROCESS.with_borrow_mut(|process| process.describe(found.first().cloned()));
    let watchdog = config.watchdog.as_nanos().div_ceil(WATCHDOG_STEP.as_nanos());
    let watchdog = u16::try_from(watchdog).unwrap_or(u16::MAX);
    for device in group.iter(main) {
        // A chip may lack these registers; then it keeps its 100 ms.
        let _ = device.register_write(RegisterAddress::WatchdogDivider, WATCHDOG_DIVIDER).await;
        let _ = device.register_write(RegisterAddress::SyncManagerWatchdog, watchdog).await;
    }
    if PROCESS.with_borrow_mut(|process| matches!(process.commissioning().modules, ModuleList::Wanted)) {
        read_modules(main, &group).await?;
    }
    write_startup(main, &group).await?;
    let in_words = |error| Problem::of_start(error, config.devices.len());
    let group = group.into_pre_op_pdi(main).await.map_err(in_words)?;
    check_process_data(main, &group, config, &found)?;
    for index in 0..group.len() {
        al::request(main, index, REQUEST_SAFE_OP).await.map_err(in_words)?;
    }
    let until = time::now() + TO_OP;
    for index in 0..group.len() {
        wait_for_safe_op(main, config, index, until).await?;
    }
    if PROCESS.with_borrow(Process::holds_safe_op) {
        return Ok((group, HeldStage::Held));
    }
    // Devices come to OP only once outputs reach them.
    for index in 0..group.len() {
        al::request(main, index, REQUEST_OP).await.map_err(in_words)?;
    }
    Ok((group, HeldStage::Op))
}

/// Reads the modules of the first device for an owner who wants only these, takes it to INIT, and waits for the owner to end.
async fn read_modules(main: &MainDevice<'_>, group: &GroupIn<PreOp>) -> Result<(), Problem> {
    let device = group.subdevice(main, 0).map_err(|error| Problem::of_start(error, 1))?;
    let found = match module_list::read(main, device.configured_address()).await {
        // A lost frame is not an answer of the device.
        Err(SdoFault::Cable(error)) => return Err(Problem::of_start(error, 1)),
        found => found.map_err(|fault| fault.to_string()),
    };
    PROCESS.with_borrow_mut(|process| process.commissioning().modules = ModuleList::Read(found));
    // Whether it arrives does not matter: the next MainDevice takes the device to INIT, too.
    let _ = al::request(main, 0, REQUEST_INIT).await;
    std::future::pending().await
}

/// Writes what the owner wants in PRE-OP to the first device.
async fn write_startup(main: &MainDevice<'_>, group: &GroupIn<PreOp>) -> Result<(), Problem> {
    let writes = PROCESS.with_borrow_mut(|process| process.commissioning().startup.clone());
    for StartupWrite { index, subindex, is_complete, data } in writes {
        let refused = |fault| match fault {
            // A lost frame is not an answer of the device.
            SdoFault::Cable(error @ (Error::Timeout(_) | Error::WorkingCounter { .. })) => {
                Problem::of_start(error, 1)
            }
            fault => Problem::Startup { index, subindex, fault },
        };
        let device = group.subdevice(main, 0).map_err(|error| refused(error.into()))?;
        let object = SdoObject { index, subindex, is_complete };
        access(main, device.configured_address(), object, Some(&data)).await.map_err(refused)?;
    }
    Ok(())
}

/// Waits until a device is in SAFE-OP. Fails at once if the device refuses that.
async fn wait_for_safe_op(
    main: &MainDevice<'_>,
    config: &Config,
    index: usize,
    until: Instant,
) -> Result<(), Problem> {
    loop {
        let status = Status::read(main, index).await;
        let status = status.map_err(|error| Problem::of_start(error, config.devices.len()))?;
        if status.is_error || time::now() > until {
            return Err(not_operational(index, status));
        }
        if status.state == SubDeviceState::SafeOp {
            return Ok(());
        }
        time::wait_until(time::now() + LOOK).await;
    }
}

const fn not_operational(index: usize, status: Status) -> Problem {
    Problem::NotOperational { number: index + 1, state: status.state, code: status.code }
}

/// Returns what an error of ethercrab means before the devices are in PRE-OP. Where a state was waited for in vain, that
/// is the answer of the device that has refused it, or of the first one that is behind the others.
async fn of_start(main: &MainDevice<'_>, config: &Config, error: Error) -> Problem {
    let mut behind: Option<(usize, Status)> = None;
    if matches!(error, Error::StateTransition | Error::Timeout(TimeoutError::StateTransition)) {
        for index in 0..main.num_subdevices() {
            let Ok(status) = Status::read(main, index).await else { continue };
            if status.is_error {
                return not_operational(index, status);
            }
            let rank = |status: Status| u8::from(status.state != SubDeviceState::Init);
            if behind.is_none_or(|(_, before)| rank(status) < rank(before)) {
                behind = Some((index, status));
            }
        }
    }
    match behind {
        Some((index, status)) => not_operational(index, status),
        None => Problem::of_start(error, config.devices.len()),
    }
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
    main: &MainDevice<'_>,
    group: &Group,
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
