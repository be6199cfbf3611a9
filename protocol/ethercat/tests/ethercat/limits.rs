//! The limits of ethercrab 0.7.1, for its users: each test shows one limit, and fails once ethercrab no longer
//! has it.

use embassy_time::Timer;
use ethercat_maindevice::time;
use ethercat_subdevice::{DeviceConfig, DeviceId, Emergency, Segment};
use ethercrab::error::Error;
use ethercrab::{MainDevice, ObjectDescriptionListQuery, SubDeviceState};
use machine::{Duration, Instant};

use crate::devices::{ACTUATOR, BRIDGE, PLAIN, SIMPLE, SMART, TINY};
use crate::faulty::FrameFault;
use crate::main_device::Stand;

const MS: Duration = Duration::from_millis(1);

fn single_device(config: &DeviceConfig) -> Segment {
    let mut segment = Segment::new();
    segment.add(config);
    segment
}

/// Reads an object while the device raises an emergency with this code: the request is in the mailbox, but not yet
/// the answer.
fn read_with_an_emergency(code: u16) -> Option<Result<u32, Error>> {
    let mut segment = single_device(&DeviceConfig { answer_delay: MS * 10, ..DeviceConfig::new(&SMART) });
    let script = async |main: &MainDevice<'_>| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        Timer::at(embassy_time::Instant::from_millis(500)).await;
        group.subdevice(main, 0)?.sdo_read::<u32>(0x1000, 0).await
    };
    let happenings = [(Instant::from_millis(505), Emergency { code, ..Emergency::default() })];
    let ended = Stand::new(&mut segment).run_with(script, &happenings, |segment, _, emergency| {
        assert!(segment.raise(DeviceId(0), emergency));
    });
    ended.result
}

#[test]
#[should_panic(expected = "left != right")]
fn an_emergency_in_place_of_an_answer_is_a_panic() {
    read_with_an_emergency(0x7320);
}

#[test]
fn an_emergency_whose_code_is_no_command_of_sdos_is_an_error_that_says_nothing_of_it() {
    let read = read_with_an_emergency(0x1000);
    assert!(matches!(read, Some(Err(Error::Wire(_)))), "{read:?}");
}

#[test]
fn a_value_above_four_bytes_cannot_be_written() {
    let mut segment = single_device(&DeviceConfig::new(&BRIDGE));
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 512>(time::now_ns).await?;
        group.subdevice(main, 0)?.sdo_write(0x8000, 4, 1_u64).await
    });
    assert_eq!(ended.result, Some(Err(Error::Internal)));
}

#[test]
fn a_value_that_comes_in_segments_cannot_be_read() {
    let mut segment = single_device(&DeviceConfig::new(&BRIDGE));
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 512>(time::now_ns).await?;
        group.subdevice(main, 0)?.sdo_read::<[u8; 300]>(0x8001, 0).await
    });
    assert!(matches!(ended.result, Some(Err(Error::Wire(_)))), "{:?}", ended.result);
}

#[test]
fn a_list_of_objects_in_fragments_lacks_the_last_object_of_each_fragment_but_the_first() {
    let mut segment = single_device(&DeviceConfig::new(&TINY));
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        let device = group.subdevice(main, 0)?;
        let counts = device.sdo_info_object_quantities().await?.map(|counts| counts.all);
        let list = device.sdo_info_object_description_list(ObjectDescriptionListQuery::All).await?;
        Ok::<_, Error>((counts, list.map(|list| list.len())))
    });
    assert_eq!(ended.result, Some(Ok((Some(13), Some(12)))));
}

#[test]
fn all_op_is_true_where_a_device_does_not_answer_for_its_state() {
    let mut segment = single_device(&DeviceConfig::new(&PLAIN));
    segment.add(&DeviceConfig::new(&PLAIN));
    let ended = Stand::new(&mut segment).run(async |main: &MainDevice<'_>| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        // The second device gets another address; its process data go on.
        group.subdevice(main, 1)?.register_write(0x0010_u16, 0x5555_u16).await?;
        let cycle = group.tx_rx(main).await?;
        Ok::<_, Error>((cycle.all_op(), cycle.working_counter, cycle.subdevice_states.to_vec()))
    });
    let states = vec![SubDeviceState::Op, SubDeviceState::None];
    assert_eq!(ended.result, Some(Ok((true, 6, states))));
}

#[test]
fn a_device_with_outputs_alone_works() {
    let mut segment = single_device(&DeviceConfig::new(&ACTUATOR));
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        group.subdevice(main, 0)?.outputs_raw_mut().fill(9);
        Ok::<_, Error>(group.tx_rx(main).await?.working_counter)
    });
    assert_eq!(ended.result, Some(Ok(2)));
    assert_eq!(segment.outputs(DeviceId(0)), Some(&[9; 4][..]));
}

/// Runs cycles of one frame with two datagrams each; the reply to one is held back for `frames` others. Returns how many
/// cycles old the inputs were at most in cycles for which ethercrab returned no error.
fn age_with_a_reply_behind(frames: u32) -> u8 {
    let mut segment = single_device(&DeviceConfig::new(&PLAIN));
    let mut stand = Stand::new(&mut segment);
    (stand.echo, stand.timeouts.pdu) = (true, MS);
    stand.faults = vec![(1_000, FrameFault::HeldFor(frames))];
    let ended = stand.run(async |main: &MainDevice<'_>| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        let group = group.into_op(main).await?;
        let mut oldest = 0;
        for sent in 0..2_000_u16 {
            let sent = sent as u8;
            group.subdevice(main, 0)?.outputs_raw_mut().fill(sent);
            let Ok(cycle) = group.tx_rx(main).await else { continue };
            if cycle.working_counter == 3 && sent > 0 {
                oldest = oldest.max(sent.wrapping_sub(group.subdevice(main, 0)?.inputs_raw()[0]));
            }
            Timer::after_millis(1).await;
        }
        Ok::<_, Error>(oldest)
    });
    ended.result.unwrap().unwrap()
}

#[test]
fn a_reply_256_datagrams_late_is_taken_for_that_of_a_new_frame() {
    let ages: Vec<(u32, u8)> =
        [1, 5, 126, 127, 128, 129, 130].map(|frames| (frames, age_with_a_reply_behind(frames))).into();
    assert_eq!(ages, [(1, 1), (5, 1), (126, 1), (127, 1), (128, 129), (129, 1), (130, 1)]);
}

#[test]
fn a_line_with_a_device_whose_in_and_out_are_swapped_is_an_error_of_the_topology() {
    let mut segment = Segment::new();
    for upstream_port in [0, 1, 0] {
        segment.add(&DeviceConfig { upstream_port, ..DeviceConfig::new(&SIMPLE) });
    }
    let ended = Stand::new(&mut segment)
        .run(async |main| main.init_single_group::<4, 64>(time::now_ns).await.map(|group| group.len()));
    assert_eq!(ended.result, Some(Err(Error::Topology)));
}
