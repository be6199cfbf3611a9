//! Devices without outputs, or without process data, as other MainDevices meet them.

use ethercat_maindevice::time;
use ethercat_subdevice::{DeviceConfig, DeviceId, Segment, Usage, sync_managers};
use ethercrab::error::Error;
use machine::{Duration, Instant};

use crate::devices::{ACTUATOR, COUPLER, SENSOR, SIMPLE, TERMINAL};
use crate::main_device::Stand;
use crate::raw_main_device::{APWR, FIRST, RawMainDevice};

/// A coupler, an input terminal and a sensor in OP for a second under ethercrab, which exchanges process data each 10 ms.
#[test]
fn devices_without_outputs_stay_in_op() {
    let mut segment = Segment::new();
    for description in [&COUPLER, &TERMINAL, &SENSOR] {
        segment.add(&DeviceConfig::new(description));
    }
    segment.set_inputs(DeviceId(1), &[0x0A]).unwrap();
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        let start = time::now();
        let mut inputs = Vec::new();
        while time::now() < start + Duration::from_secs(1) {
            time::wait_until(time::now() + Duration::from_millis(10)).await;
            let cycle = group.tx_rx(main).await?;
            assert!(cycle.working_counter == 2 && cycle.all_op());
            inputs = group.subdevice(main, 1)?.inputs_raw().to_vec();
        }
        Ok::<_, Error>(inputs)
    });
    assert_eq!(ended.result, Some(Ok(vec![0x0A])));
    let last = ended.events.iter().map(|(at, ..)| *at).max();
    assert!(
        last.is_some_and(|last| ended.at.since(last) > Duration::from_millis(999)),
        "no state changed in OP"
    );
    assert!(ended.at > Instant::ZERO + Duration::from_secs(1));
}

#[test]
fn a_sync_manager_without_outputs_starts_no_watchdog_although_its_control_register_has_the_trigger() {
    for (description, unit) in [(&COUPLER, 0), (&TERMINAL, 1), (&TERMINAL, 2)] {
        let mut segment = Segment::new();
        segment.add(&DeviceConfig::new(description));
        let mut main_device = RawMainDevice::new(segment);
        main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
        for (number, layout) in (0..).zip(sync_managers(description)) {
            let [start, len] = [layout.start, layout.len].map(u16::to_le_bytes);
            let registers = [start[0], start[1], len[0], len[1], layout.control, 0, 1, 0];
            assert_eq!(main_device.write(0x0800 + 8 * number, &registers), 1);
        }
        main_device.write(0x0800 + 8 * unit, &[0, 0x18, 0, 0, 0x64, 0, 0, 0]);
        for state in [2, 4, 8] {
            main_device.request_state(state);
            assert_eq!(main_device.al_status(), (state, 0), "{}", description.name);
        }
        main_device.wait(Duration::from_secs(10));
        assert_eq!(main_device.al_status(), (8, 0), "{}", description.name);
    }
}

#[test]
fn the_sync_managers_and_fmmus_of_a_device_without_mailbox_are_those_of_its_data() {
    let usages = |description| sync_managers(description).iter().map(|unit| unit.usage).collect::<Vec<_>>();
    assert_eq!(usages(&SIMPLE), [Usage::Outputs, Usage::Inputs]);
    assert_eq!(usages(&TERMINAL), [Usage::Inputs]);
    assert_eq!(usages(&COUPLER), []);
    let with_mailbox = [Usage::MailboxReceive, Usage::MailboxSend, Usage::Outputs, Usage::Inputs];
    assert_eq!((usages(&SENSOR), usages(&ACTUATOR)), (with_mailbox.into(), with_mailbox.into()));
}
