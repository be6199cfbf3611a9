//! From an application file to the motions on the wire.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

fn main() {
    hot_path::main(|paths| {
        for (application, setup) in
            [("pick-and-place", "A"), ("pick-and-place", "B"), ("gluing", "A"), ("palletising", "A")]
        {
            let input =
                move || (planning::application(application, None).unwrap(), setup::setup(setup).unwrap());
            let name = format!("{application}, Setup {setup}");
            paths.add("planning of an application", name, input, |(application, setup)| {
                application.plan(&setup).unwrap().wire_motions(&setup)
            });
        }
    });
}
