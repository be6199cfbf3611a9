//! The skill process image: what both nodes write and read every cycle.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use hot_path::HotPaths;
use machine::wire::{BigEndian, ByteOrder, LittleEndian};
use protocol::image::{Command, Feedback, IMAGE_LEN, Motion, MotionKind, SLOTS, Slots};

const GROUP: &str = "process image";

fn main() {
    hot_path::main(|paths| {
        add::<BigEndian>(paths, "PROFINET");
        add::<LittleEndian>(paths, "EtherNet/IP");
    });
}

fn add<O: ByteOrder>(paths: &mut HotPaths, bus: &str) {
    paths.add(GROUP, format!("encode command, {bus}"), command, |command| {
        let mut image = [0; IMAGE_LEN];
        command.emit::<O>(&mut image);
        image
    });
    let image = || {
        let mut image = [0; IMAGE_LEN];
        command().emit::<O>(&mut image);
        image
    };
    paths.add(GROUP, format!("decode command, {bus}"), image, |image| Command::parse::<O>(&image).unwrap());
    paths.add(GROUP, format!("encode feedback, {bus}"), Feedback::default, |feedback| {
        let mut image = [0; IMAGE_LEN];
        feedback.emit::<O>(&mut image);
        image
    });
    let image = || {
        let mut image = [0; IMAGE_LEN];
        Feedback::default().emit::<O>(&mut image);
        image
    };
    paths.add(GROUP, format!("decode feedback, {bus}"), image, |image| Feedback::parse::<O>(&image).unwrap());
}

fn command() -> Command {
    let motion = Motion { kind: MotionKind::LinCartesian, target: [300.0; 6], ..Motion::EMPTY };
    Command { total: 13, written: 5, slots: Slots::Motions([motion; SLOTS]), ..Command::default() }
}
