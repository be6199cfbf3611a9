//! Frames as tshark reads them. Tests hold what our stacks send against it, field by field: a frame may be well-formed for
//! a dissector and mean something else.
#![expect(clippy::expect_used, reason = "a helper of tests fails as loudly as they do")]

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// Returns a capture of Ethernet frames, in the classic format of pcap.
fn capture(frames: &[Vec<u8>]) -> Vec<u8> {
    let mut file = Vec::new();
    // Magic number, version 2.4, time zone, accuracy, snap length, Ethernet.
    for number in [0xA1B2_C3D4_u32, 2 << 16 | 4, 0, 0, 0xFFFF, 1] {
        file.extend(number.to_be_bytes());
    }
    for frame in frames {
        let len = frame.len() as u32;
        for number in [0, 0, len, len] {
            file.extend(number.to_be_bytes());
        }
        file.extend(frame);
    }
    file
}

/// Returns what tshark reads in each Ethernet frame: all values of each of these fields, in their order.
///
/// # Panics
///
/// Without tshark, which `scripts/dev.sh setup` installs.
#[must_use]
pub fn read<'a>(frames: &[Vec<u8>], fields: impl IntoIterator<Item = &'a str>) -> Vec<Vec<String>> {
    read_by(Command::new("tshark"), frames, fields)
}

/// Returns what tshark reads in each frame with a dissector in Lua: see [`read`].
///
/// # Panics
///
/// Without tshark, which `scripts/dev.sh setup` installs.
#[must_use]
pub fn read_with<'a>(
    script: &Path,
    frames: &[Vec<u8>],
    fields: impl IntoIterator<Item = &'a str>,
) -> Vec<Vec<String>> {
    let mut tshark = Command::new("tshark");
    tshark.arg("-X").arg(format!("lua_script:{}", script.display()));
    read_by(tshark, frames, fields)
}

fn read_by<'a>(
    mut tshark: Command,
    frames: &[Vec<u8>],
    fields: impl IntoIterator<Item = &'a str>,
) -> Vec<Vec<String>> {
    tshark.args(["-n", "-r", "-", "-T", "fields", "-E", "occurrence=a", "-E", "separator=|"]);
    for field in fields {
        tshark.args(["-e", field]);
    }
    let mut tshark = tshark
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("tshark starts; `scripts/dev.sh setup` installs it");
    let mut input = tshark.stdin.take().expect("its input is a pipe");
    input.write_all(&capture(frames)).expect("tshark reads its input");
    drop(input);
    let output = tshark.wait_with_output().expect("tshark ends");
    let text = String::from_utf8(output.stdout).expect("tshark prints text");
    text.lines().map(|line| line.split('|').map(str::to_owned).collect()).collect()
}
