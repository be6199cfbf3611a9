//! Each maker's files say what the neutral file says: they are read back to the same tree.

use plc_export::{
    ExportFile, ExportedApplication, Maker, Refused, br, codesys, files, siemens, structured_text,
};
use structured_text::Tree;

use crate::bed::{exported, exported_a};
use crate::read_back::{MAKERS, code_of, tree_of};

/// Returns the tree of the neutral file.
fn neutral(text: &str) -> Tree {
    tree_of(&code_of(text, Maker::St), Maker::St)
}

#[test]
fn each_makers_files_are_read_back_to_the_same_tree() {
    for application in [exported_a(), exported("B", Some("pick-and-place-gripper"))] {
        let text = structured_text(&application).unwrap();
        let neutral = neutral(&text);
        assert!(neutral.len() > 20);
        for maker in MAKERS {
            let read = tree_of(&code_of(&text, maker), maker);
            let is_same = match maker {
                Maker::Br => read == self::neutral(&br::with_short_names(&text).unwrap()),
                _ => read == neutral,
            };
            assert!(is_same, "{maker:?}");
        }
    }
}

#[test]
fn a_difference_in_a_makers_file_is_found_when_it_is_read_back() {
    let text = structured_text(&exported_a()).unwrap();
    let (neutral, short) = (neutral(&text), neutral(&br::with_short_names(&text).unwrap()));
    for (maker, from, to) in [
        (Maker::Siemens, "#waited := 0;", "#waited := 1;"),
        (Maker::Siemens, "IN := #entry, N := 1", "IN := #entry, N := 2"),
        (
            Maker::Siemens,
            "\"SB_Elapsed\"(since := #old_since, to_time := #now_us)",
            "\"SB_Elapsed\"(since := #now_us, to_time := #old_since)",
        ),
        (Maker::Br, "waited := 0;", "waited := 1;"),
        (Maker::Br, "ARRAY[0..255] OF USINT", "ARRAY[0..254] OF USINT"),
        (Maker::Codesys, "&lt;&gt; group.c_number", "= group.c_number"),
    ] {
        let mut files = code_of(&text, maker);
        let file = files.iter_mut().find(|file| file.text.contains(from)).unwrap_or_else(|| panic!("{from}"));
        file.text = file.text.replacen(from, to, 1);
        let expected = if maker == Maker::Br { &short } else { &neutral };
        assert!(tree_of(&files, maker) != *expected, "{maker:?} {from}");
    }
}

#[test]
fn a_makers_export_has_its_files_its_adapter_and_the_vectors() {
    let a = exported_a();
    for (maker, expected) in [
        (
            Maker::Siemens,
            &["SB_AxesGroup.udt", "skillbench.scl", "skillbench_adapter.scl", "vectors.jsonl"][..],
        ),
        (Maker::Codesys, &["skillbench.xml", "vectors.jsonl"]),
        (
            Maker::Br,
            &[
                "SkillBench/SkillBench.typ",
                "SkillBench/SkillBench.fun",
                "SkillBench/SkillBench.st",
                "SkillBench/IEC.lby",
                "SkillBench/SkillBench.var",
                "SBProgram/IEC.prg",
                "SBProgram/Main.st",
                "SBProgram/Types.typ",
                "SBProgram/Variables.var",
                "Package.pkg",
                "Cpu.sw.txt",
                "vectors.jsonl",
            ],
        ),
    ] {
        let found = files(&a, maker).unwrap();
        let paths: Vec<_> = found.iter().map(|file| file.path.as_str()).collect();
        assert_eq!(paths, expected);
        for ExportFile { path, text } in &found {
            assert!(!text.contains('@'), "{path} has a place that was not filled");
        }
    }
}

#[test]
fn names_of_objects_blocks_types_and_files_for_br_have_at_most_ten_characters() {
    let found = files(&exported_a(), Maker::Br).unwrap();
    let package = found.iter().find(|file| file.path == "Package.pkg").unwrap();
    let objects: Vec<_> =
        package.text.split("\">").skip(2).filter_map(|part| part.split_once("</Object>")).collect();
    assert_eq!(objects.len(), 2);
    for (name, _) in objects {
        assert!(found.iter().any(|file| file.path.starts_with(&format!("{name}/"))), "{name}");
        assert!(name.len() <= br::LONGEST_NAME, "{name}");
    }
    for file in &found {
        for part in file.path.split('/') {
            let stem = part.split('.').next().unwrap();
            assert!(stem.len() <= br::LONGEST_NAME, "{part}");
        }
    }
    // Every name of a declaration: the word after its keyword.
    let mut names = Vec::new();
    for file in found.iter().filter(|file| file.path.ends_with(".fun") || file.path.ends_with(".typ")) {
        let pieces = structured_text::pieces(&file.text).unwrap();
        for (word, name) in pieces.iter().zip(pieces.iter().skip(1)) {
            if ["FUNCTION", "FUNCTION_BLOCK", "TYPE"].iter().any(|keyword| word.is_word(keyword)) {
                names.push(name.text);
            }
        }
    }
    assert!(names.len() > 20 && names.contains(&"SB_Core"), "{names:?}");
    let long: Vec<_> = names.iter().filter(|name| name.len() > br::LONGEST_NAME).collect();
    assert!(long.is_empty(), "{long:?}");
    names.sort_unstable();
    let count = names.len();
    names.dedup();
    assert_eq!(names.len(), count, "two blocks have one name");
}

#[test]
fn the_adapter_for_br_calls_blocks_by_the_names_that_the_library_has() {
    let found = files(&exported_a(), Maker::Br).unwrap();
    let text = |end: &str| &found.iter().find(|file| file.path.ends_with(end)).unwrap().text;
    let declared = text("SkillBench.fun");
    for file in ["Main.st", "Variables.var"] {
        let pieces = structured_text::pieces(text(file)).unwrap();
        for piece in pieces.iter().filter(|piece| piece.text.starts_with("SB_")) {
            assert!(declared.contains(&format!(" {}", piece.text)), "{file}: {}", piece.text);
        }
    }
}

/// Returns why a dialect refuses the code with one of its names replaced.
fn refused(maker: &str, from: &str, to: &str) -> Option<Refused> {
    let text = structured_text(&exported_a()).unwrap();
    let changed = text.replace(from, to);
    assert_ne!(text, changed, "{from} is not there");
    match maker {
        "Siemens" => siemens::rewritten(&changed).err(),
        "CODESYS" => codesys::xml_of(&changed).err(),
        _ => br::library(&changed).err(),
    }
}

#[test]
fn a_name_that_is_a_word_of_the_maker_is_refused() {
    let own = [
        ("Siemens", ["region", "Variant", "DATA_BLOCK"]),
        ("CODESYS", ["Method", "super", "BITADR"]),
        ("B&R", ["volatile", "Signed", "TASKNAME"]),
    ];
    for (maker, words) in own {
        // Of a variable, and standard functions, which every compiler has, and macros of C, which some have.
        for word in words.into_iter().chain(["limit", "Ton", "LREAL", "Big_Endian", "overflow"]) {
            assert_eq!(refused(maker, "begins_way", word), Some(Refused::Word { name: word.into(), maker }));
        }
    }
}

#[test]
fn two_names_that_differ_in_case_or_become_equal_when_shortened_are_refused() {
    for maker in ["Siemens", "CODESYS", "B&R"] {
        let found = refused(maker, "SB_TestWords", "sb_selftest");
        assert!(matches!(found, Some(Refused::SameName { .. })), "{maker}: {found:?}");
        // Two variables of one block.
        let found = refused(maker, "begins_way", "Feedback_Bytes");
        assert!(matches!(found, Some(Refused::SameName { .. })), "{maker}: {found:?}");
    }
    // It is what another name is shortened to.
    let found = refused("B&R", "SB_Core", "SB_SelfTst");
    assert!(matches!(&found, Some(Refused::SameName { name, .. }) if name == "SB_SelfTst"), "{found:?}");
    let found = refused("B&R", "SB_Core", "SB_CoreMain");
    assert!(
        matches!(&found, Some(Refused::LongName { name, most: 10, .. }) if name == "SB_CoreMain"),
        "{found:?}"
    );
}

#[test]
fn an_application_beyond_the_makers_memory_is_refused_with_what_fits() {
    let a = exported_a();
    let motions = a.motions.iter().copied().cycle().take(1_000).collect();
    let most_motions = Maker::most_motions(256 + 40);
    assert_eq!(most_motions, 930);
    let too_long = ExportedApplication { motions, most_motions, ..a };
    for maker in [Maker::St, Maker::Siemens, Maker::Codesys, Maker::Br] {
        let error = files(&too_long, maker).unwrap_err().to_string();
        assert!(error.contains("holds at most 930"), "{error}");
    }
    assert_eq!(Maker::most_motions(1), 0);
}

#[test]
fn functions_of_a_siemens_plc_write_each_temporary_variable_before_they_read_it() {
    // Temporary variables have no initial value there.
    let files = code_of(&structured_text(&exported_a()).unwrap(), Maker::Siemens);
    let scl = &files.iter().find(|file| file.path == siemens::SCL_FILE).unwrap().text;
    let mut seen = 0;
    for function in scl.split("\nFUNCTION \"").skip(1) {
        let function = function.split("END_FUNCTION").next().unwrap();
        let Some((_, variables)) = function.split_once("VAR_TEMP") else { continue };
        let (variables, body) = variables.split_once("END_VAR").unwrap();
        for variable in variables.lines().filter_map(|line| line.split_once(" : ")) {
            let name = format!("#{}", variable.0.trim());
            let at = body.find(&format!("{name} ")).unwrap();
            assert!(body[at + name.len()..].starts_with(" :="), "{name}");
            seen += 1;
        }
    }
    assert!(seen >= 6, "{seen}");
}
