//! Applications for several arms that are refused, above all those whose arms would wait for each other for ever.

#![expect(clippy::unwrap_used, reason = "an application that is not refused fails the test")]

use planning::{APPLICATIONS, ARMS_APPLICATIONS, Application, ArmsApplication, application};

fn shipped(name: &str) -> &'static str {
    ARMS_APPLICATIONS.iter().find(|(known, _)| *known == name).unwrap().1
}

fn refused(text: &str) -> String {
    ArmsApplication::parse("my.toml", text).map(|_| ()).unwrap_err().to_string()
}

fn changed(name: &str, from: &str, to: &str) -> String {
    let text = shipped(name);
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1)
}

/// Makes a minimal application: each arm has a motion, and then these marks with a motion after each.
fn arms(arms: &[(&str, &[u32])], together: &[u32]) -> String {
    let mut text = "schema = 3\nname = \"m\"\ntitle = \"m\"\n[frames]\n\
        f0 = { mm_deg = [0.0, 0.0, 50.0, 0.0, 0.0, 180.0] }\n\
        f1 = { mm_deg = [50.0, 0.0, 50.0, 0.0, 0.0, 180.0] }\n"
        .to_owned();
    let numbers: std::collections::BTreeSet<_> = arms.iter().flat_map(|(_, marks)| *marks).collect();
    for number in numbers {
        let together = together.contains(number);
        text += &format!("[[mark]]\nnumber = {number}\nname = \"m{number}\"\ntogether = {together}\n");
    }
    for (name, marks) in arms {
        text += &format!(
            "[[arm]]\nname = \"{name}\"\ntool = \"t\"\nbase = \"b\"\nstart = \"f0\"\ntools = {{ t = 0 }}\nbases = {{ b = 1 }}\n"
        );
        let step = |at: usize| {
            let (label, frame) = ("labels = [\"blending\", \"accurate-stop\"]", ["f1", "f0"][at % 2]);
            format!("[[arm.step]]\nname = \"s\"\n{label}\nreach = \"{frame}\"\n")
        };
        text += &step(0);
        for (index, mark) in marks.iter().enumerate() {
            text += &format!("[[arm.step]]\nmark = {mark}\n{}", step(index + 1));
        }
    }
    text
}

#[test]
fn arms_that_would_wait_for_ever_are_refused_with_the_ring_of_who_waits_for_whom() {
    let said = [
        arms(&[("a", &[1, 2]), ("b", &[2, 1])], &[]),
        arms(&[("a", &[1, 3]), ("b", &[2, 1]), ("c", &[3, 2])], &[]),
        arms(&[("a", &[4, 1, 3]), ("b", &[4, 2, 1]), ("c", &[3, 2])], &[]),
        arms(&[("a", &[1]), ("b", &[])], &[]),
        arms(&[("a", &[1, 2]), ("b", &[1, 2]), ("c", &[3])], &[]),
    ];
    insta::assert_snapshot!(said.map(|text| refused(&text)).join("\n"), @"
    my.toml:7: mark 1: arm `a` waits at mark 1 for `b`, arm `b` waits at mark 2 for `a`: give them one order in all arms
    my.toml:7: mark 1: arm `a` waits at mark 1 for `b`, arm `b` waits at mark 2 for `c`, arm `c` waits at mark 3 for `a`: give them one order in all arms
    my.toml:7: mark 1: arm `a` waits at mark 1 for `b`, arm `b` waits at mark 2 for `c`, arm `c` waits at mark 3 for `a`: give them one order in all arms
    my.toml:7: mark 1: only arm `a` waits there, and nobody comes; add { mark = 1 } to another arm, or remove it
    my.toml:15: mark 3: only arm `c` waits there, and nobody comes; add { mark = 3 } to another arm, or remove it
    ");
    for fine in [
        arms(&[("a", &[1, 2, 3]), ("b", &[1, 2, 3])], &[]),
        arms(&[("a", &[1, 3]), ("b", &[2, 1]), ("c", &[2, 3])], &[]),
        arms(&[("a", &[7, 1]), ("b", &[7, 1]), ("c", &[7])], &[]),
    ] {
        ArmsApplication::parse("fine", &fine).unwrap();
    }
}

/// Runs arms that come to their marks in any order, each as soon as a draw lets it. Returns whether all reach their ends.
fn all_arrive(arms: &[Vec<u32>], mut draw: impl FnMut() -> usize) -> bool {
    let mut at = vec![0; arms.len()];
    let mut arrived = vec![false; arms.len()];
    let mut idle = 0;
    while at.iter().zip(arms).any(|(at, marks)| *at < marks.len()) && idle < 64 * arms.len() {
        let arm = draw() % arms.len();
        let Some(mark) = arms[arm].get(at[arm]) else { continue };
        arrived[arm] = true;
        let others: Vec<_> = (0..arms.len()).filter(|other| arms[*other].contains(mark)).collect();
        idle += 1;
        if others.iter().all(|other| arrived[*other] && arms[*other].get(at[*other]) == Some(mark)) {
            idle = 0;
            for other in others {
                (at[other], arrived[other]) = (at[other] + 1, false);
            }
        }
    }
    at.iter().zip(arms).all(|(at, marks)| *at == marks.len())
}

#[test]
fn planning_accepts_just_those_orders_of_marks_that_random_arms_come_through() {
    let mut state = 1_u64;
    let mut draw = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    let (mut accepted, mut rings) = (0, 0);
    for _ in 0..400 {
        let count = 2 + draw() % 3;
        let mut lists = vec![Vec::new(); count];
        for mark in 1..=(1 + draw() % 4) as u32 {
            let first = draw() % count;
            for (arm, list) in lists.iter_mut().enumerate() {
                if arm == first || arm == (first + 1) % count || draw() % 3 == 0 {
                    let place = if draw() % 4 == 0 { draw() % (list.len() + 1) } else { list.len() };
                    list.insert(place, mark);
                }
            }
        }
        let names: Vec<_> = (0..count).map(|arm| format!("arm{arm}")).collect();
        let listed: Vec<_> =
            names.iter().zip(&lists).map(|(name, marks)| (name.as_str(), marks.as_slice())).collect();
        let read = ArmsApplication::parse("random", &arms(&listed, &[]));
        assert_eq!(read.is_ok(), all_arrive(&lists, &mut draw), "{lists:?}");
        accepted += u32::from(read.is_ok());
        rings += u32::from(read.is_err_and(|error| error.to_string().contains(" waits at mark ")));
    }
    assert!(accepted > 50 && rings > 50 && accepted + rings == 400, "{accepted} accepted, {rings} rings");
}

#[test]
fn arms_that_move_together_have_one_next_mark() {
    ArmsApplication::parse("fine", &arms(&[("a", &[1, 2]), ("b", &[1, 2]), ("c", &[2])], &[1])).unwrap();
    let said = [
        arms(&[("a", &[1, 2]), ("b", &[1, 2])], &[2]),
        arms(&[("a", &[1, 3, 2]), ("b", &[1, 2]), ("c", &[3, 2])], &[1]),
    ];
    insta::assert_snapshot!(said.map(|text| refused(&text)).join("\n"), @"
    my.toml:11: mark 2: its arms move together to their next mark, which must be the same: `a` has none, `b` has none
    my.toml:7: mark 1: its arms move together to their next mark, which must be the same: `a` has mark 3, `b` has mark 2
    ");
}

#[test]
fn a_mistake_in_an_application_for_several_arms_is_named_with_its_line() {
    let said = [
        changed("hand-over", "schema = 3", "schema = 2"),
        changed("hand-over", "number = 2", "number = 1"),
        changed("hand-over", "number = 2", "number = 0"),
        changed("hand-over", "mark = 2", "mark = 9"),
        changed("hand-over", "mark = 2", "mark = 1"),
        changed("hand-over", "mark = 1", "mark = 1\nreach = \"offered\""),
        changed("hand-over", "mark = 3\n", "mark = 3\nthen = \"grip\"\n"),
        changed("hand-over", "labels = [\"blending\"]\n", ""),
        changed("hand-over", "name = \"offer\"\n", ""),
        changed("hand-over", "name = \"taker\"", "name = \"giver\""),
        changed("hand-over", "reach = \"offered\"", "reach = \"ofered\""),
        changed("hand-over", "name = \"come\"", "mark = 1\nthen = \"grip\"\n[[arm.step]]\nname = \"come\""),
        changed("carry-plate", "together = true # to mark 3", "together = 1"),
        arms(&[], &[]),
        "schema = 3\nname = \"m\"\ntitle = \"m\"\narm = []\n[frames]\n".to_owned(),
    ];
    insta::assert_snapshot!(said.map(|text| refused(&text)).join("\n"), @"
    my.toml:6: schema: is 2; an application with [[arm]] has 3
    my.toml:30: mark 1: is listed twice; give each mark a number of its own
    my.toml:30: mark 0: its number must be 1 to 65535
    my.toml:80: mark: 9 is not listed; add [[mark]] with number = 9
    my.toml:76: mark: arm `giver` has mark 1 twice; give each wait a mark of its own
    my.toml:76: mark: mark 1 does not move the arm: write reach in a step of its own
    my.toml:86: then: `release` and `grip` at one stop; put a motion between them
    my.toml:69: labels: step `offer` needs labels, or a mark
    my.toml:69: name: a step that moves needs a name
    my.toml:99: name: two arms are named `giver`; a setup could not tell them apart
    my.toml:73: reach: there is no frame `ofered`; did you mean `offered`?
    my.toml:111: mark: arm `taker` has mark 1 twice; give each wait a mark of its own
    my.toml:32: in `mark[1].together`: invalid type: integer `1`, expected a boolean
       32 | together = 1
    my.toml:1: missing key `arm`
        1 | schema = 3
    my.toml:2: arm: lists no arm; an application needs one [[arm]] for each robot
    ");
}

#[test]
fn an_application_for_several_arms_is_refused_where_one_arm_works_alone() {
    let said = [
        application("hand-over", None).unwrap_err().to_string(),
        Application::parse("my.toml", &changed("hand-over", "mark = 2", "mark = 9")).unwrap_err().to_string(),
        Application::parse(
            "my.toml",
            &APPLICATIONS[0].1.replacen("name = \"A\"", "name = \"A\"\nmark = 1", 1),
        )
        .unwrap_err()
        .to_string(),
    ];
    insta::assert_snapshot!(said.join("\n"), @r#"
    built-in application hand-over:42: arm: is for 2 arms (giver, taker): it needs a setup with [[station]], and `application = "giver"` there
    my.toml:80: mark: 9 is not listed; add [[mark]] with number = 9
    my.toml:39: in `step[0].mark`: unknown key `mark`, expected one of `name`, `does`, `labels`, `tool`, `base`, `reach`, `from`, `path`, `approach_mm`, `retreat_mm`, `speed_mm_s`, `speed_percent`, `then`
       39 | mark = 1
    "#);
}
