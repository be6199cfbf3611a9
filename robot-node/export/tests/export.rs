//! The files of an export: whole or not at all, equal twice, and what their checkers find.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]
#![expect(clippy::disallowed_methods, reason = "the files of an export are what is tested")]

use std::fs;

use protocol::image::{Configuration, Motion, MotionKind};
use robot_export::layer::kit;
use robot_export::{
    ExportError, ExportFile, Maker, NameFault, RobotApplication, check_names, export, files, krl_check,
};

static MAKERS: [Maker; 2] = [Maker::Kuka, Maker::Abb];

fn application(setup: &str, instead: Option<&str>) -> RobotApplication {
    let (setup, found) = planning::setup_and_application(setup, instead).unwrap();
    RobotApplication::of_plan(&setup, &found.plan(&setup).unwrap())
}

#[test]
fn two_exports_are_equal_and_a_directory_with_something_in_it_is_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    for maker in MAKERS {
        let [one, other] = ["one", "other"].map(|name| directory.path().join(format!("{maker:?}-{name}")));
        fs::create_dir(&other).unwrap();
        let application = application("A", None);
        for path in [&one, &other] {
            export(&application, maker, path).unwrap();
        }
        let expected = files(&application, maker).unwrap();
        assert_eq!(fs::read_dir(&one).unwrap().count(), expected.len());
        for file in &expected {
            assert_eq!(fs::read_to_string(one.join(&file.path)).unwrap(), file.text);
            assert_eq!(fs::read_to_string(other.join(&file.path)).unwrap(), file.text);
        }
        let again = export(&application, maker, &one);
        assert!(matches!(again, Err(ExportError::NotEmpty(path)) if path == one));
    }
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 4, "nothing half written is left");
}

#[test]
fn a_motion_that_the_language_lacks_is_refused_with_its_index_and_leaves_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let a = application("A", None);
    let spline = |motion: &mut Motion| motion.kind = MotionKind::Spline;
    let force = |motion: &mut Motion| motion.kind = MotionKind::LinForceCartesian;
    let jerk = |motion: &mut Motion| motion.jerk = 7;
    let slower = |motion: &mut Motion| motion.deceleration = 1;
    let configured =
        |motion: &mut Motion| motion.configuration = Some(Configuration { status: 1, turn: None });
    type Case = (fn(&mut Motion), &'static [Maker]);
    let cases: [Case; 5] = [
        (spline, &[Maker::Abb]),
        (force, &MAKERS),
        (jerk, &MAKERS),
        (slower, &[Maker::Kuka]),
        (configured, &MAKERS),
    ];
    for (change, refusing) in cases {
        let mut changed = a.clone();
        change(&mut changed.programs[0].motions[3]);
        for maker in MAKERS {
            let path = directory.path().join("kit");
            let found = export(&changed, maker, &path);
            if refusing.contains(&maker) {
                let ExportError::Refused(refused) = found.unwrap_err() else { panic!("not refused") };
                assert_eq!((refused.program, refused.index), (1, 3), "{refused}");
                assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0, "{refused}");
            } else {
                found.unwrap();
                fs::remove_dir_all(&path).unwrap();
            }
        }
    }
}

/// Declares one more name in a file: a routine, a variable of a routine or a signal, as the maker writes them.
fn with_name(files: &[ExportFile], maker: Maker, kind: &str, name: &str) -> Vec<ExportFile> {
    let mut files = files.to_vec();
    let (at, line) = match (maker, kind) {
        (Maker::Kuka, "routine") => {
            ("SB_MAIN.src", format!("GLOBAL DEFFCT INT {name}(VALUE:IN)\n  DECL INT VALUE\nENDFCT\n"))
        }
        (Maker::Kuka, "local") => {
            ("SB_MAIN.src", format!("GLOBAL DEF SB_OTHER( )\n  DECL INT {name}\nEND\n"))
        }
        (Maker::Kuka, _) => ("SB_SIGNALS.dat", format!("GLOBAL SIGNAL {name} $IN[1] TO $IN[8]\n")),
        (Maker::Abb, "routine") => ("SB_Motion.mod", format!("  FUNC num {name}(num value)\n  ENDFUNC\n")),
        (Maker::Abb, "local") => ("SB_Cyclic.mod", format!("  PROC sb_other(dnum {name})\n  ENDPROC\n")),
        (Maker::Abb, _) => ("EIO.cfg", format!("      -Name \"{name}\" -SignalType \"DO\"\n")),
    };
    files.iter_mut().find(|file| file.path == at).unwrap().text.push_str(&line);
    files
}

#[test]
fn a_name_that_a_controller_takes_for_something_else_is_refused_with_its_file() {
    let a = application("A", None);
    let words = [
        (Maker::Kuka, ["AXIS", "while", "Inverse", "USER_GRP", "tool_data"]),
        (Maker::Abb, ["pose", "WHILE", "Present", "TriggL", "tool0"]),
    ];
    for (maker, words) in words {
        let files = files(&a, maker).unwrap();
        assert_eq!(check_names(&files, maker), Ok(()));
        let most = if maker == Maker::Kuka { 24 } else { 32 };
        let longest = "SB_".to_owned() + &"A".repeat(most - 3);
        for kind in ["routine", "local", "signal"] {
            for word in words {
                let fault = check_names(&with_name(&files, maker, kind, word), maker).unwrap_err();
                assert!(
                    matches!(&fault, NameFault::Word { name, .. } if name == word),
                    "{kind} {word}: {fault}"
                );
            }
            assert_eq!(check_names(&with_name(&files, maker, kind, &longest), maker), Ok(()));
            let long = longest.clone() + "A";
            let fault = check_names(&with_name(&files, maker, kind, &long), maker).unwrap_err();
            assert!(matches!(&fault, NameFault::Long { len, .. } if *len == most + 1), "{kind}: {fault}");
        }
        // Both languages ignore case.
        for (kind, name) in
            [("routine", "Sb_Main"), ("signal", "SBO_state"), ("routine", "SB_test"), ("signal", "sb_Stop")]
        {
            let fault = check_names(&with_name(&files, maker, kind, name), maker).unwrap_err();
            assert!(
                matches!(&fault, NameFault::Twice { name: found, first, .. } if [found, first].contains(&&name.to_owned())),
                "{kind} {name}: {fault}"
            );
        }
        assert_eq!(check_names(&with_name(&files, maker, "local", "sb_main"), maker), Ok(()));
    }
}

#[test]
fn a_name_that_no_file_of_the_task_declares_is_refused_with_its_line() {
    let a = application("A", None);
    let cases = [
        // A name that is misspelt, one of another routine, one that is a word of the language, a component, and one of the other task.
        (Maker::Abb, "SB_Cyclic.mod", "sb_joints_before:=now_joints;", "sb_joints_before:=present;"),
        (Maker::Abb, "SB_Cyclic.mod", "RETURN way<", "RETURN share<"),
        (Maker::Abb, "SB_Cyclic.mod", "sb_self_test;", "sb_selftest;"),
        (Maker::Abb, "SB_Cyclic.mod", "reached.trans.x", "reached.trans.e"),
        (Maker::Abb, "SB_Cyclic.mod", "sb_self_test;", "sb_main;"),
        (Maker::Abb, "SB_Cyclic.mod", "SetGO sbo_echo", "SetGO sbo_echoes"),
        (Maker::Abb, "SB_Shared.sys", "IF sb_swap", "IF sb_again"),
        (Maker::Abb, "SB_Motion.mod", "frame.trans.x:=sb_row", "frames.trans.x:=sb_row"),
        (Maker::Kuka, "SB_MAIN.src", "SB_TAKE()", "SB_TAKES()"),
        (Maker::Kuka, "SB_MAIN.src", "AXES=INVERSE(", "AXES=INVERTED("),
        (Maker::Kuka, "SB_MAIN.src", "POINT=GOAL", "POINT=AT"),
        (Maker::Kuka, "SB_MAIN.src", "$AXIS_ACT.A1", "$AXIS_ACT.A7"),
        (Maker::Kuka, "SB_MAIN.src", "$VEL_ACT", "$VELOCITY"),
        (Maker::Kuka, "SB_SUBMIT.sub", "SBO_ECHO=", "SBO_ECHOES="),
    ];
    for (maker, path, from, to) in cases {
        let mut files = files(&a, maker).unwrap();
        let changed = files.iter_mut().find(|file| file.path == path).unwrap();
        let right = changed.text.clone();
        changed.text = right.replacen(from, to, 1);
        assert_ne!(right, changed.text, "{from} is not there");
        let expected = 1 + right[..right.find(from).unwrap()].matches('\n').count();
        let fault = check_names(&files, maker).unwrap_err();
        assert!(
            matches!(&fault, NameFault::Undeclared { file, line, name } if file == path && *line == expected && to.contains(name.as_str())),
            "{to}: {fault}"
        );
    }
}

#[test]
fn a_program_with_the_number_of_another_one_is_refused() {
    let mut a = application("A", None);
    let again = a.programs[0].clone();
    a.programs.push(again);
    for maker in MAKERS {
        let error = files(&a, maker).unwrap_err();
        assert!(matches!(error, ExportError::Name(NameFault::Twice { .. })), "{error}");
    }
}

#[test]
fn the_form_declares_all_names_and_each_statement_is_one_instant() {
    let a = application("A", None);
    for maker in MAKERS {
        assert_eq!(kit(&a.served(maker).unwrap(), None).faults(), Vec::<String>::new());
    }
}

#[test]
fn every_application_that_a_language_has_passes_the_checker_of_krl_and_says_what_was_checked() {
    for name in [None, Some("pick-and-place-gripper"), Some("palletising")] {
        let application = application("A", name);
        for maker in MAKERS {
            for file in files(&application, maker).unwrap() {
                assert!(file.text.contains("not tried on the maker's controller"), "{}", file.path);
                assert!(file.text.is_ascii(), "{}", file.path);
                if maker == Maker::Kuka {
                    krl_check::check(&file.text).unwrap_or_else(|fault| panic!("{}: {fault}", file.path));
                }
            }
        }
    }
}

#[test]
fn the_checker_of_krl_finds_mistakes() {
    let files = files(&application("A", None), Maker::Kuka).unwrap();
    let text = |name: &str| files.iter().find(|file| file.path == name).unwrap().text.clone();
    for (file, from, to) in [
        ("SB_MAIN.src", "ENDIF\n", "\n"),
        ("SB_MAIN.src", " THEN\n", "\n"),
        ("SB_MAIN.src", "ENDFCT", "END"),
        ("SB_MAIN.src", "==", "== =="),
        ("SB_MAIN.src", "SB_WORD(SBI_NUMBER)", "SB_WORD(SBI_NUMBER"),
        ("SB_SUBMIT.sub", "ENDLOOP", ""),
        ("SB_DATA.dat", "SB_ASKED_NUMBER", "SB_ASKED_NUMBER_OF_A_COMMAND"),
        ("SB_SIGNALS.dat", " TO ", " "),
    ] {
        let right = text(file);
        let wrong = right.replacen(from, to, 1);
        assert_ne!(right, wrong, "{from} is not there");
        assert!(krl_check::check(&wrong).is_err(), "{from} as {to} is not found");
    }
}

#[test]
fn a_read_of_a_signal_does_not_stop_the_advance_run() {
    let files = files(&application("A", None), Maker::Kuka).unwrap();
    let main = files.iter().find(|file| file.path == "SB_MAIN.src").unwrap();
    let (layer, _) = main.text.split_once("GLOBAL DEFFCT INT SB_WORD").unwrap();
    let lines: Vec<_> = layer.lines().map(str::trim).collect();
    let reads = lines.windows(2).filter(|pair| pair[1].contains("SBI_")).collect::<Vec<_>>();
    assert!(reads.len() > 90, "{}", reads.len());
    assert!(reads.iter().all(|pair| pair[0] == "CONTINUE"));
    assert!(!layer.contains("WAIT FOR"));
}
