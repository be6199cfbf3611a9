//! From INIT to OP and back.

use ethercat_maindevice::time;
use ethercat_subdevice::{AlState, AlStatusCode, DeviceConfig, DeviceId, Event, Segment, sync_managers};
use ethercrab::error::Error;
use machine::Duration;

use crate::devices::{BRIDGE, SENSOR, SIMPLE};
use crate::main_device::Stand;
use crate::raw_main_device::{APRD, APWR, FIRST, RawMainDevice};

#[test]
fn a_device_without_mailbox_comes_to_op_and_exchanges_process_data() {
    let mut segment = Segment::new();
    let id = segment.add(&DeviceConfig { serial_number: 77, ..DeviceConfig::new(&SIMPLE) });
    segment.set_inputs(id, &[0xAB, 0xCD]).unwrap();
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        let mut last = (0, [0; 2]);
        for round in 0..10 {
            {
                let device = group.subdevice(main, 0)?;
                assert_eq!(device.name(), "SIMPLE");
                assert_eq!(device.identity().serial, 77);
                device.outputs_raw_mut().copy_from_slice(&[round, 1, 2, 3]);
            }
            let response = group.tx_rx(main).await?;
            let device = group.subdevice(main, 0)?;
            last = (response.working_counter, device.inputs_raw().as_ref().try_into().unwrap());
        }
        Ok::<_, Error>(last)
    });
    assert_eq!(ended.result, Some(Ok((3, [0xAB, 0xCD]))), "ended at {:?}", ended.at);
    assert_eq!(ended.refused, 0);
    let states: Vec<_> = ended
        .events
        .iter()
        .map(|(_, id, event)| match event {
            Event::StateChanged { state, code } => (*id, *state, code.0),
            event => panic!("{event:?}"),
        })
        .collect();
    let expected = [AlState::PreOp, AlState::SafeOp, AlState::Op].map(|state| (DeviceId(0), state, 0));
    assert_eq!(states, expected);
}

#[test]
fn a_bridge_of_256_bytes_comes_to_op_in_less_than_200_ms_and_exchanges_every_byte() {
    let mut segment = Segment::new();
    let id = segment.add(&DeviceConfig::new(&BRIDGE));
    let inputs: [u8; 256] = core::array::from_fn(|at| at as u8);
    segment.set_inputs(id, &inputs).unwrap();
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 512>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        let in_op = time::now_ns();
        group.subdevice(main, 0)?.outputs_raw_mut().fill(0xA5);
        let first = group.tx_rx(main).await?.working_counter;
        let received = group.subdevice(main, 0)?.inputs_raw().to_vec();
        Ok::<_, Error>((in_op, first, received))
    });
    let (in_op, working_counter, received) = ended.result.unwrap().unwrap();
    assert!(in_op < 200_000_000, "{in_op} ns");
    assert_eq!((working_counter, &received[..]), (3, &inputs[..]));
    assert_eq!(segment.outputs(id), Some(&[0xA5; 256][..]));
}

const BRIDGE_ID: DeviceId = DeviceId(0);

fn bridge_in_pre_op() -> RawMainDevice {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    RawMainDevice::start(segment)
}

#[test]
fn outputs_that_stay_away_for_100_ms_take_the_device_to_safe_op_until_that_is_acknowledged() {
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), None, "none have come yet");
    for _ in 0..5 {
        main_device.wait(Duration::from_millis(99));
        assert_eq!(main_device.write(0x1100, &[7; 256]), 1);
    }
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), Some(&[7; 256][..]));
    main_device.wait(Duration::from_millis(99));
    assert_eq!(main_device.al_status(), (0x08, 0));
    main_device.wait(Duration::from_millis(1));
    assert_eq!(main_device.al_status(), (0x14, 0x001B));
    assert_eq!(main_device.read(0x0440, 1).0, [0]);
    assert_eq!(main_device.read(0x0442, 1).0, [1]);
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), None);
    assert_eq!(main_device.write(0x1100, &[7; 256]), 0, "the outputs are locked");
    assert_eq!(main_device.read(0x1400, 256).1, 1, "the inputs are not");
    main_device.request_state(8);
    assert_eq!(main_device.al_status(), (0x14, 0x001B), "not acknowledged");
    main_device.request_state(0x14);
    assert_eq!(main_device.al_status(), (0x04, 0));
    main_device.request_state(8);
    assert_eq!(main_device.write(0x1100, &[8; 256]), 1);
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), Some(&[8; 256][..]));
}

#[test]
fn a_watchdog_time_of_zero_and_a_sync_manager_without_trigger_are_no_watchdog() {
    let mut main_device = bridge_in_pre_op();
    main_device.write(0x0420, &[0, 0]);
    main_device.operate();
    main_device.wait(Duration::from_secs(10));
    assert_eq!(main_device.al_status(), (0x08, 0));
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    main_device.request_state(2);
    main_device.write(0x0816, &[0]);
    main_device.write(0x0810, &[0x00, 0x11, 0x00, 0x01, 0x24, 0, 1, 0]);
    main_device.request_state(4);
    main_device.request_state(8);
    main_device.wait(Duration::from_secs(10));
    assert_eq!(main_device.al_status(), (0x08, 0));
}

#[test]
fn sync_managers_that_do_not_fit_are_refused_with_the_code_of_the_state() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.request_state(2);
    assert_eq!(main_device.al_status(), (0x11, AlStatusCode::INVALID_MAILBOX.0));
    let mut main_device = bridge_in_pre_op();
    main_device.request_state(4);
    assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_OUTPUTS.0));
    main_device.write(0x0810, &[0x00, 0x11, 0x00, 0x01, 0x64, 0, 1, 0]);
    // 255 bytes instead of 256.
    main_device.write(0x0818, &[0x00, 0x14, 0xFF, 0x00, 0x20, 0, 1, 0]);
    main_device.request_state(0x14);
    assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_INPUTS.0));
    main_device.request_state(8);
    assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_INPUTS.0), "not acknowledged");
    main_device.request_state(0x18);
    assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_STATE_CHANGE.0));
}

#[test]
fn a_sync_manager_with_another_start_mode_or_direction_than_the_eeprom_names_is_refused() {
    const INPUTS: [u8; 8] = [0x00, 0x14, 0x00, 0x01, 0x20, 0, 1, 0];
    // A start of 0x1500, a mailbox, one that the MainDevice writes.
    for (at, value) in [(1, 0x15), (4, 0x22), (4, 0x24)] {
        let mut main_device = bridge_in_pre_op();
        main_device.write(0x0810, &[0x00, 0x11, 0x00, 0x01, 0x64, 0, 1, 0]);
        let mut wrong = INPUTS;
        wrong[at] = value;
        main_device.write(0x0818, &wrong);
        main_device.request_state(4);
        assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_INPUTS.0), "{wrong:02X?}");
        main_device.write(0x081E, &[0]);
        main_device.write(0x0818, &INPUTS);
        main_device.request_state(0x14);
        assert_eq!(main_device.al_status(), (0x04, 0));
    }
}

#[test]
fn a_sync_manager_that_is_on_without_a_length_is_none() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&SENSOR));
    let mut main_device = RawMainDevice::start_with(segment, 32);
    let [outputs, inputs] = [2, 3].map(|number| sync_managers(&SENSOR)[number].start.to_le_bytes());
    main_device.write(0x0818, &[inputs[0], inputs[1], 4, 0, 0x20, 0, 1, 0]);
    main_device.write(0x0810, &[outputs[0], outputs[1], 0, 0, 0x64, 0, 1, 0]);
    main_device.request_state(4);
    assert_eq!(main_device.al_status(), (0x04, 0));
    // One with a length is more than this device has.
    main_device.request_state(2);
    main_device.write(0x0816, &[0]);
    main_device.write(0x0810, &[outputs[0], outputs[1], 4, 0, 0x64, 0, 1, 0]);
    main_device.request_state(4);
    assert_eq!(main_device.al_status(), (0x12, AlStatusCode::INVALID_OUTPUTS.0));
}

#[test]
fn a_device_whose_outputs_never_come_does_not_stay_in_op() {
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    main_device.wait(Duration::from_micros(99_999));
    assert_eq!(main_device.al_status(), (0x08, 0));
    main_device.wait(Duration::from_micros(1));
    assert_eq!(main_device.al_status(), (0x14, AlStatusCode::WATCHDOG.0));
}

#[test]
fn outputs_from_before_op_are_not_those_of_op() {
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    main_device.request_state(4);
    assert_eq!(main_device.write(0x1100, &[1; 256]), 1);
    main_device.request_state(8);
    assert_eq!(main_device.al_status(), (0x08, 0));
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), None, "they have not come in OP");
    assert_eq!(main_device.write(0x1100, &[2; 256]), 1);
    assert_eq!(main_device.segment.outputs(BRIDGE_ID), Some(&[2; 256][..]));
}

#[test]
fn a_sync_manager_that_the_maindevice_switches_off_takes_the_device_out_of_its_state() {
    const OUTPUTS: (u8, u16) = (0x12, AlStatusCode::INVALID_OUTPUTS.0);
    const INPUTS: (u8, u16) = (0x12, AlStatusCode::INVALID_INPUTS.0);
    const MAILBOX: (u8, u16) = (0x11, AlStatusCode::INVALID_MAILBOX.0);
    for in_op in [false, true] {
        for (register, fallen) in
            [(0x0806, MAILBOX), (0x080E, MAILBOX), (0x0816, OUTPUTS), (0x081E, INPUTS), (0x0826, (0x08, 0))]
        {
            let mut main_device = bridge_in_pre_op();
            main_device.operate();
            if !in_op {
                main_device.request_state(4);
            }
            assert_eq!(main_device.write(register, &[0]), 1);
            let expected = if !in_op && fallen.0 == 8 { (0x04, 0) } else { fallen };
            assert_eq!(main_device.al_status(), expected, "0x{register:04X}");
            assert_eq!(main_device.segment.outputs(BRIDGE_ID), None);
        }
    }
    // Switched on again as they have to be, they lead up again once the error is acknowledged.
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    main_device.write(0x0816, &[0]);
    main_device.write(0x0816, &[1]);
    assert_eq!(main_device.al_status(), OUTPUTS);
    main_device.request_state(0x12);
    main_device.request_state(4);
    main_device.request_state(8);
    assert_eq!(main_device.al_status(), (0x08, 0));
    assert_eq!(main_device.write(0x1100, &[1; 256]), 1);
}

#[test]
fn a_device_does_not_come_to_op_over_an_acknowledged_error_without_its_sync_managers() {
    for (register, fallen) in [
        (0x0816, (0x12, AlStatusCode::INVALID_OUTPUTS.0)),
        (0x081E, (0x12, AlStatusCode::INVALID_INPUTS.0)),
        (0x0806, (0x11, AlStatusCode::INVALID_MAILBOX.0)),
    ] {
        let mut main_device = bridge_in_pre_op();
        main_device.operate();
        main_device.wait(Duration::from_millis(100));
        assert_eq!(main_device.write(register, &[0]), 1);
        assert_eq!(main_device.al_status(), (0x14, AlStatusCode::WATCHDOG.0), "one error at a time");
        main_device.request_state(0x14);
        assert_eq!(main_device.al_status(), fallen, "0x{register:04X}");
        main_device.request_state(8);
        assert_eq!(main_device.al_status(), fallen, "0x{register:04X}");
    }
}

#[test]
fn the_watchdog_runs_on_in_safe_op_where_it_counts_without_an_error() {
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    main_device.write(0x1100, &[7; 256]);
    main_device.request_state(4);
    main_device.wait(Duration::from_millis(99));
    assert_eq!(main_device.read(0x0440, 3).0, [1, 0, 0]);
    main_device.wait(Duration::from_millis(1));
    assert_eq!(main_device.read(0x0440, 3).0, [0, 0, 1]);
    assert_eq!(main_device.al_status(), (0x04, 0));
    main_device.write(0x1100, &[7; 256]);
    assert_eq!(main_device.read(0x0440, 1).0, [1]);
}

#[test]
fn a_request_that_is_refused_in_op_stops_the_outputs_until_it_is_acknowledged() {
    for (request, code) in [(0, 0x0012), (3, 0x0011), (5, 0x0012), (0x13, 0x0011)] {
        let mut main_device = bridge_in_pre_op();
        main_device.operate();
        main_device.write(0x1100, &[7; 256]);
        assert_eq!(main_device.segment.outputs(BRIDGE_ID), Some(&[7; 256][..]));
        main_device.request_state(request);
        assert_eq!(main_device.al_status(), (0x14, code), "request {request}");
        assert_eq!(main_device.segment.outputs(BRIDGE_ID), None);
        assert_eq!(main_device.write(0x1100, &[8; 256]), 0, "the outputs are closed");
        assert_eq!(main_device.read(0x1400, 256).1, 1, "the inputs are not");
        // Another wrong request, acknowledged or not, does not open them.
        for again in [8, 5, 0x13, 0x15] {
            main_device.request_state(again);
            assert_eq!(main_device.al_status().0, 0x14);
            assert_eq!(main_device.write(0x1100, &[8; 256]), 0);
        }
        let fallen = Event::StateChanged { state: AlState::SafeOp, code: AlStatusCode(code) };
        assert!(main_device.events.contains(&(BRIDGE_ID, fallen)));
        main_device.request_state(0x14);
        assert_eq!(main_device.al_status(), (0x04, 0));
        main_device.request_state(8);
        assert_eq!(main_device.write(0x1100, &[9; 256]), 1);
        assert_eq!(main_device.segment.outputs(BRIDGE_ID), Some(&[9; 256][..]));
    }
}

#[test]
fn a_device_without_outputs_shows_its_error_by_the_working_counter_of_its_inputs() {
    let mut segment = Segment::new();
    let id = segment.add(&DeviceConfig::new(&SENSOR));
    segment.set_inputs(id, &[1, 2, 3, 4]).unwrap();
    let mut main_device = RawMainDevice::start_with(segment, 32);
    let inputs = sync_managers(&SENSOR)[3];
    let [low, high] = inputs.start.to_le_bytes();
    main_device.write(0x0818, &[low, high, 4, 0, 0x20, 0, 1, 0]);
    main_device.request_state(4);
    main_device.request_state(8);
    assert_eq!(main_device.read(inputs.start, 4), (vec![1, 2, 3, 4], 1));
    main_device.segment.fail(id, AlStatusCode::UNSPECIFIED_ERROR);
    assert_eq!(main_device.al_status(), (0x14, 0x0001));
    assert_eq!(main_device.read(inputs.start, 4).1, 0);
    main_device.segment.set_inputs(id, &[1, 2, 3, 4]).unwrap();
    assert_eq!(main_device.read(0x081D, 1).0, [0x30], "nothing comes into a closed buffer");
    main_device.request_state(0x14);
    assert_eq!(main_device.al_status(), (0x04, 0));
    assert_eq!(main_device.read(inputs.start, 4), (vec![1, 2, 3, 4], 1), "they are there again at once");
}

#[test]
fn an_application_that_takes_its_time_shows_the_old_state_until_then() {
    let mut segment = Segment::new();
    let slow = DeviceConfig { answer_delay: Duration::from_millis(3), ..DeviceConfig::new(&SIMPLE) };
    segment.add(&slow);
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.request_state(2);
    main_device.wait(Duration::from_micros(2_999));
    assert_eq!(main_device.al_status(), (0x01, 0));
    main_device.wait(Duration::from_micros(1));
    assert_eq!(main_device.al_status(), (0x02, 0));
}

#[test]
fn a_request_that_is_repeated_in_each_cycle_is_followed_once_the_application_has_had_its_time() {
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    main_device.request_state(4);
    main_device.segment.set_answer_delay(BRIDGE_ID, Duration::from_millis(5));
    for cycle in 0..=5 {
        assert_eq!(main_device.al_status().0, if cycle < 5 { 0x04 } else { 0x08 }, "cycle {cycle}");
        main_device.request_state(8);
        main_device.wait(Duration::from_millis(1));
    }
}

#[test]
fn a_reset_by_the_maindevice_is_a_power_on() {
    let mut main_device = bridge_in_pre_op();
    main_device.operate();
    for letter in *b"RES" {
        main_device.write(0x0040, &[letter]);
    }
    assert_eq!(main_device.exchange(APRD, 0, 0x0010, &[0; 2]), (vec![0, 0], 1));
    assert_eq!(main_device.exchange(APRD, 0, 0x0130, &[0; 2]).0, [1, 0]);
    assert_eq!(
        main_device.events.last().unwrap().1,
        Event::StateChanged { state: AlState::Init, code: AlStatusCode::NO_ERROR }
    );
}
