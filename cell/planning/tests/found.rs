//! Where applications are looked for, and what is said about one that is not there or does not fit.

use std::fs;

use planning::{APPLICATIONS, application, setup_with_application};

#[test]
fn an_unknown_application_is_answered_by_those_there_are() {
    insta::assert_snapshot!(application("juggle", None).unwrap_err(), @"there is no application `juggle`: built in are pick-and-place, pick-and-place-gripper, gluing, palletising, engraving, insertion-with-force; or give the path of a .toml file");
    insta::assert_snapshot!(application("no/such.toml", None).unwrap_err(), @"cannot read the application file no/such.toml: No such file or directory (os error 2)");
}

#[test]
fn an_application_is_looked_for_beside_the_setup_that_names_it() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    fs::write(&path, setup::SETUPS[0].1.replace("\"pick-and-place\"", "\"jobs/wave.toml\"")).unwrap();
    fs::create_dir(directory.path().join("jobs")).unwrap();
    let wave = APPLICATIONS[0].1.replace("name = \"pick-and-place\"", "name = \"wave\"");
    fs::write(directory.path().join("jobs/wave.toml"), &wave).unwrap();
    let (_, found) = setup_with_application(path.to_str().unwrap()).unwrap();
    assert_eq!((found.application.name.as_str(), found.text), ("wave", wave));
}

#[test]
fn every_application_that_is_built_in_can_be_named_in_a_setup() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("my.toml");
    for (name, _) in APPLICATIONS {
        let named = format!("application = \"{name}\"");
        let text = setup::SETUPS[0].1.replace("application = \"pick-and-place\"", &named);
        fs::write(&path, text).unwrap();
        let (setup, found) = setup_with_application(path.to_str().unwrap()).unwrap();
        assert_eq!(found.application.name, *name);
        assert!(!found.plan(&setup).unwrap().motions.is_empty());
    }
}

#[test]
fn what_is_built_in_fits_together() {
    for (name, _) in setup::SETUPS {
        let (setup, found) = setup_with_application(name).unwrap();
        assert!(!found.plan(&setup).unwrap().wire_motions(&setup).is_empty());
    }
}

#[test]
fn an_application_that_does_not_fit_its_setup_is_refused_by_both_their_names() {
    let (mut setup, found) = setup_with_application("A").unwrap();
    setup.robot.bases.clear();
    insta::assert_snapshot!(found.plan(&setup).expect_err("base 1 is gone"), @"built-in application pick-and-place on setup A: step `A`, motion 1: the setup's robot has no base 1; it has 0");
}
