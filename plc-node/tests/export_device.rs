//! `plc-node export --device`: the robot's own device file, its modules to plug, and files that do not carry the image.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use std::path::Path;
use std::process::{Command, Output};

const MODULE: &str = "<ModuleItem ID=\"ID_Module1\"";

/// Exports for a robot of this file; returns the output, and whether the directory was written.
fn export(place: &Path, setup: &str, name: &str, text: &str) -> (Output, String, bool) {
    let (file, out) = (place.join(name), place.join("kit"));
    std::fs::write(&file, text).unwrap();
    let _ = std::fs::remove_dir_all(&out);
    let output = Command::new(env!("CARGO_BIN_EXE_plc-node"))
        .args(["export", "--for", "st", "--setup", setup, "--device"])
        .args([&file, Path::new("--out"), &out])
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr.clone()).unwrap();
    (output, said, out.exists())
}

fn file_of(kind: &str) -> (String, String) {
    devices::files().into_iter().find(|(name, _)| name.contains(kind)).unwrap()
}

/// Our GSDML with the data of one direction of its module cut out.
fn one_way(text: &str, cut: &str) -> String {
    let at = text.find(MODULE).unwrap();
    let (before, module) = text.split_at(at);
    let (start, end) = (format!("<{cut} "), format!("</{cut}>"));
    let (start, end) = (module.find(&start).unwrap(), module.find(&end).unwrap() + end.len());
    format!("{before}{}{}", &module[..start], &module[end..])
}

#[test]
fn the_modules_to_plug_are_printed_where_a_module_carries_the_image() {
    let place = tempfile::tempdir().unwrap();
    for (setup, kind, expected) in [
        ("A", "GSDML", "slot 1: `"),
        ("D", "GSDML", "module 0x00000100, submodule 0x00000101"),
        (
            "B",
            ".eds",
            "connection 1 `Exclusive Owner`, path 20 04 24 97 2C 96 2C 64: 256 bytes from and 256 to the robot",
        ),
    ] {
        let (name, text) = file_of(kind);
        let (output, said, is_written) = export(place.path(), setup, &name, &text);
        assert!(output.status.success() && is_written, "{said}");
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn what_the_user_corrects_ends_with_the_exit_code_of_usage_and_writes_nothing() {
    let place = tempfile::tempdir().unwrap();
    let filled = place.path().join("filled");
    std::fs::create_dir(&filled).unwrap();
    std::fs::write(filled.join("a"), "").unwrap();
    let new = place.path().join("kit");
    for (out, options, reason) in [
        (&new, ["--for", "twincat"], "possible values: st, siemens, codesys, br"),
        (&new, ["--application", "nothing"], "nothing"),
        (&new, ["--memory", "1"], "the PLC's memory holds at most"),
        (&filled, ["--setup", "A"], "not empty; name a new or an empty directory"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_plc-node"));
        command.args(["export", "--out"]).arg(out).args(options);
        if options[0] != "--for" {
            command.args(["--for", "st"]);
        }
        let output = command.output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains(reason), "{options:?}: {said}");
        assert_eq!(output.status.code(), Some(2), "{options:?}: {said}");
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 1, "{options:?}");
    }
}

#[test]
fn a_pair_of_modules_carries_the_image_where_no_module_has_both_directions() {
    let place = tempfile::tempdir().unwrap();
    let (name, text) = file_of("GSDML");
    let at = text.find(MODULE).unwrap();
    let end = text.find("</ModuleItem>").unwrap() + "</ModuleItem>".len();
    let whole = &text[at..end];
    let [from, to] =
        [("Output", "ID_From", "0x00000A01"), ("Input", "ID_To", "0x00000A02")].map(|(cut, id, ident)| {
            let module = one_way(whole, cut).replace("ID_Module1", id).replace("0x00000100", ident);
            module.replace("ID_Submodule1_1\"", &format!("{id}_S\""))
        });
    let text = text.replace(whole, &format!("{from}{to}"));
    let reference =
        text.lines().find(|line| line.contains("ModuleItemTarget=\"ID_Module1\"")).unwrap().to_owned();
    let both = ["ID_From", "ID_To"].map(|id| reference.replace("ID_Module1", id)).join("\n");
    let (output, said, is_written) = export(place.path(), "A", &name, &text.replace(&reference, &both));
    assert!(output.status.success() && is_written, "{said}");
    assert!(
        said.contains("0x00000A01") && said.contains("; and slot") && said.contains("0x00000A02"),
        "{said}"
    );
}

#[test]
fn a_file_that_does_not_carry_the_image_or_is_of_another_bus_is_refused_and_nothing_is_written() {
    let place = tempfile::tempdir().unwrap();
    let ((gsdml, gsdml_text), (eds, eds_text)) = (file_of("GSDML"), file_of(".eds"));
    let float = "<DataItem DataType=\"Float32\" TextId=\"IDT_Submodule1_1_Input_28\"/>";
    assert!(gsdml_text.contains(float));
    let cases = [
        (
            "A",
            &*gsdml,
            gsdml_text.replace(float, ""),
            "no module carries 256 bytes each way: at most 252 from and 256 to the robot",
        ),
        ("A", &gsdml, one_way(&gsdml_text, "Input"), "at most 0 from and 256 to the robot"),
        (
            "A",
            &gsdml,
            gsdml_text.replace("MaxInputLength=\"", "MaxInputLength=\"1\" Was=\""),
            "no module carries",
        ),
        (
            "B",
            &eds,
            eds_text.replace("Param1, 256, Assem150", "Param1, 128, Assem150"),
            "at most 256 from and 128 to the robot",
        ),
        (
            "A",
            &eds,
            eds_text.clone(),
            "the file describes a device of EtherNet/IP, and the setup has profinet",
        ),
        (
            "C",
            &gsdml,
            gsdml_text.clone(),
            "the file describes a device of PROFINET, and the setup has ethercat",
        ),
        ("A", "notes.xml", "no file of a device".to_owned(), "notes.xml"),
    ];
    for (setup, name, text, expected) in cases {
        let (output, said, is_written) = export(place.path(), setup, name, &text);
        assert!(said.contains(expected), "{said}");
        assert_eq!((output.status.code(), is_written), (Some(2), false), "{said}");
    }
}
