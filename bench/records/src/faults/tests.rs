use super::*;
use virtual_time::LinkCounters;

fn faults(texts: &[&str]) -> Vec<Fault> {
    texts.iter().map(|text| text.parse().unwrap()).collect()
}

#[test]
fn faults_are_combined_and_can_be_limited_to_one_direction() {
    let cable = Impairment { delay: Duration::from_micros(2), ..Impairment::default() };
    let [to_robot, to_plc] =
        links(&faults(&["loss=0.1%", "to-robot:delay=0.1ms", "to-plc:reorder=0.5@2ms"]), cable);
    let lossy = Impairment { loss_ppm: 1_000, ..cable };
    assert_eq!(to_robot, Impairment { delay: Duration::from_micros(102), ..lossy });
    let by = Duration::from_millis(2);
    assert_eq!(to_plc, Impairment { reorder_ppm: 500_000, reorder_by: by, ..lossy });
    let [corrupt, _] = links(&faults(&["corrupt=0.1@memory", "to-robot:corrupt=0.2@wire"]), cable);
    let [_, struck] = links(&faults(&["to-plc:hold-frame=17@2ms"]), cable);
    assert!(struck.frame_faults.iter().eq([(17, FrameFault::Hold(Duration::from_millis(2)))]));
    let flips = ["to-plc:flip-frame=3.93@memory", "to-plc:flip-frame=4@wire"];
    let [_, struck] = links(&faults(&flips), cable);
    assert!(struck.frame_faults.iter().eq([(3, FrameFault::Flip(93)), (4, FrameFault::FlipOnWire)]));
    assert_eq!((corrupt.corrupt_ppm, corrupt.corrupt_on_wire_ppm), (100_000, 200_000));
}

#[test]
fn cuts_and_kills_come_in_order() {
    let changes = changes(&faults(&["kill-robot-at=5s", "cut-at=2s..2.1s", "loss=0.1"]));
    let ms = Duration::from_millis;
    assert_eq!(
        changes,
        [(ms(2_000), Change::Cut), (ms(2_100), Change::Mend), (ms(5_000), Change::Kill(NodeRole::Robot))]
    );
}

#[test]
fn a_shaft_is_held_for_a_time_and_only_drives_that_are_there_have_faults() {
    let block = faults(&["drive-block=2@1s..1.5s", "drive-fault=4@1.2s"]);
    let ms = Duration::from_millis;
    let expected = [
        (ms(1_000), Change::Drive(2, Disturbance::Block)),
        (ms(1_200), Change::Drive(4, Disturbance::Fault)),
        (ms(1_500), Change::Drive(2, Disturbance::Release)),
    ];
    assert_eq!(changes_of_nodes(&block), expected);
    let without = setup::setup("A").unwrap();
    let with = without.clone().with_drives(setup::Drives::Ethercat);
    assert_eq!(check(&block, &with), Ok(()));
    insta::assert_snapshot!(check(&block, &without).unwrap_err(), @"drive-fault, drive-stop and drive-block need drives, and setup A has none: add --drives ethercat");
    let fifth = faults(&["drive-stop=5@1s"]);
    insta::assert_snapshot!(check(&fifth, &with).unwrap_err(), @"there is no drive of axis 5: this arm has axes 1 to 4");
}

#[test]
fn more_faults_of_single_frames_than_there_is_room_for_are_refused() {
    let mut five = vec!["to-plc:lose-frame=1"; 4];
    let setup = setup::setup("A").unwrap();
    assert_eq!(check(&faults(&five), &setup), Ok(()));
    five.extend(["to-robot:lose-frame=1", "to-plc:flip-frame=9@wire"]);
    insta::assert_snapshot!(check(&faults(&five), &setup).unwrap_err(), @"5 faults of single frames in one direction, and there is room for 4: ask for fewer");
}

#[test]
fn a_cut_from_a_frame_on_is_for_virtual_time() {
    let cut = faults(&["to-robot:cut-frame=17@10ms"]);
    insta::assert_snapshot!(check_real(&cut).unwrap_err(), @"`to-robot:cut-frame=17@10ms` is for virtual time only: add --mode virtual, or give a time, as in cut-at=2s..2.1s");
}

#[test]
fn a_real_cable_holds_no_frame_for_longer_than_a_second() {
    assert_eq!(
        check_real(&faults(&["to-plc:delay=600ms", "to-robot:jitter=600ms", "cut-at=1s..9s"])),
        Ok(())
    );
    let said = check_real(&faults(&["delay=600ms", "reorder=0.1@500ms"])).unwrap_err().to_string();
    assert!(said.starts_with("these faults hold frames for up to 1.1s, and a cable"), "{said}");
}

#[test]
fn the_error_for_a_wrong_fault_shows_correct_ones() {
    let said = |text: &str| text.parse::<Fault>().unwrap_err().to_string();
    assert!(said("lag=2ms").starts_with("unknown fault `lag=2ms`: "));
    assert_eq!(
        said("loss=2"),
        "invalid share of frames `2`: write a number from 0 to 1, such as 0.001, or 0.1%"
    );
    assert_eq!(said("delay=3"), "invalid time `3`: write a number with its unit, such as 100us, 2.5ms or 2s");
    assert!(said("cut-at=2s..1s").starts_with("`cut-at=2s..1s` ends before it begins"));
    assert!(said("drive-block=1@2s..1s").starts_with("`1@2s..1s` ends before it begins"));
    for wrong in ["drive-fault=0@1s", "drive-fault=1", "drive-stop=x@1s"] {
        assert!(said(wrong).starts_with("invalid axis and time"), "{wrong}");
    }
    assert!(said("drive-fault=1@1s..2s").starts_with("invalid time"));
    for wrong in [
        "to-robot:cut-at=1s..2s",
        "to-plc:drive-fault=1@1s",
        "to-plc:flip-frame=1",
        "to-plc:flip-frame=1@memory",
        "cut-frame=1@1ms",
        "to-plc:cut-frame=1",
    ] {
        assert!(said(wrong).starts_with("invalid fault"), "{wrong}");
    }
    assert!(said("to-plc:restart-plc=0@1ms").starts_with("invalid frame number `0`"));
}

#[test]
fn what_sets_the_same_number_of_a_direction_twice_is_refused() {
    let setup = setup::setup("A").unwrap();
    let refused = |texts: &[&str]| check(&faults(texts), &setup).err().map(|error| error.to_string());
    insta::assert_snapshot!(refused(&["loss=0.1", "jitter=1ms", "loss=0.2"]).unwrap(), @"`loss=0.1` and `loss=0.2` both set the loss of one direction: leave one out, or limit each to a direction of its own, as in to-robot:loss=0.001 and to-plc:loss=0.01");
    let whole_cable = refused(&["to-robot:reorder=0.1@1ms", "reorder=0.1@2ms"]).unwrap();
    assert!(whole_cable.contains("both set the reordering of one direction"), "{whole_cable}");
    for beside_each_other in [
        ["to-robot:loss=0.1", "to-plc:loss=0.2"],
        ["corrupt=0.1@memory", "corrupt=0.1@wire"],
        ["delay=1ms", "to-plc:delay=2ms"],
        ["to-plc:lose-frame=3", "to-plc:lose-frame=4"],
        ["cut-at=1s..2s", "cut-at=3s..4s"],
    ] {
        assert_eq!(refused(&beside_each_other), None);
    }
}

#[test]
fn a_fault_that_the_run_ended_before_never_came_to_pass() {
    let asked = [
        "loss=0.1",
        "cut-at=2s..3s",
        "kill-robot-at=3000s",
        "drive-stop=1@3000s",
        "to-robot:lose-frame=100",
        "to-plc:lose-frame=100",
        "to-plc:cut-frame=99@1ms",
        "to-robot:restart-plc=101@1ms",
    ];
    let counters = |sent| LinkCounters { sent, lost: 5, ..LinkCounters::default() };
    let links = [counters(100), counters(99)];
    let report = FaultReport::new(&faults(&asked), links, Some(Duration::from_secs(2)));
    insta::assert_snapshot!(report, @"Faults put in (loss=0.1, cut-at=2s..3s, to-robot:lose-frame=100, to-plc:cut-frame=99@1ms): 10 frames lost, 0 twice, 0 held back, 0 corrupted after the checksums of Ethernet and UDP. Never came to pass, because the run ended before: kill-robot-at=3000s, drive-stop=1@3000s, to-plc:lose-frame=100, to-robot:restart-plc=101@1ms.");
    let before_ready = FaultReport::new(&faults(&["cut-at=0s..3s"]), links, None);
    insta::assert_snapshot!(before_ready, @"Never came to pass, because the run ended before: cut-at=0s..3s.");
}
