//! Hot paths, defined once, run by criterion and by callgrind.
//!
//! `cargo bench` times them by criterion. `cargo run -p hot-path` counts their instructions by callgrind, which on a
//! shared host says more: the same program takes the same number, where its time is ± 17 %. A bench program is
//! [`main`] with its paths:
//!
//! ```no_run
//! hot_path::main(|paths| {
//!     paths.add("vectors", "sort 1000 numbers", || (0..1_000).rev().collect::<Vec<_>>(), |mut numbers: Vec<i32>| {
//!         numbers.sort_unstable();
//!         numbers
//!     });
//! });
//! ```

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BatchSize, Criterion};

/// Option that lists the paths whose instructions are counted, one per line.
pub const LIST: &str = "--list-hot-paths";

/// Option that runs the path named after it, once cold and once in [`COUNTED`].
pub const RUN: &str = "--run-hot-path";

/// The function in which callgrind counts: the start of its symbol.
pub const COUNTED: &str = "hot_path_counted";

/// Number of inputs that are prepared, and of results that are kept, at a time: enough that reading the clock costs
/// nothing, and few enough that they stay in the cache, as the one path or controller of a robot does.
const BATCH: BatchSize = BatchSize::NumIterations(16);

type Timed = Box<dyn FnOnce(&mut Criterion)>;
type Once = Box<dyn FnOnce() + Send>;

/// The hot paths of a bench program.
#[derive(Default)]
pub struct HotPaths {
    timed: Vec<Timed>,
    counted: Vec<(String, Once)>,
}

impl HotPaths {
    /// Adds a path: `input` prepares its input outside of the measurement, and `run` is measured. The result of `run`
    /// is also dropped outside of the measurement.
    pub fn add<I: 'static, O: 'static>(
        &mut self,
        group: &'static str,
        name: impl Into<String>,
        input: impl Fn() -> I + Clone + Send + 'static,
        run: impl Fn(I) -> O + Clone + Send + 'static,
    ) {
        let name = name.into();
        let (make, measured) = (input.clone(), run.clone());
        self.counted.push((
            format!("{group}/{name}"),
            Box::new(move || {
                // Work that is done only the first time, such as resolving a symbol, is not part of the path.
                drop(black_box(measured(black_box(make()))));
                let input = black_box(make());
                drop(black_box(hot_path_counted(&measured, input)));
            }),
        ));
        self.add_timed(group, name, input, run);
    }

    /// Adds a path that is only timed, because it is too long for valgrind.
    pub fn add_timed<I: 'static, O: 'static>(
        &mut self,
        group: &'static str,
        name: impl Into<String>,
        input: impl Fn() -> I + 'static,
        run: impl Fn(I) -> O + 'static,
    ) {
        let name = name.into();
        self.timed.push(Box::new(move |criterion| {
            let mut group = criterion.benchmark_group(group);
            group.bench_function(name, |bencher| bencher.iter_batched(&input, &run, BATCH));
            group.finish();
        }));
    }
}

/// Runs once, in a function of its own that callgrind can identify.
#[inline(never)]
fn hot_path_counted<I, O>(run: &dyn Fn(I) -> O, input: I) -> O {
    run(input)
}

/// Finds the slowest step of a repeated sequence, without the influence of the host on single passes.
#[derive(Default, Debug)]
pub struct Steps {
    /// The fastest time of each step.
    fastest: Vec<Duration>,
    next: usize,
}

impl Steps {
    /// Begins a pass.
    pub const fn begin(&mut self) {
        self.next = 0;
    }

    /// Times the next step of the pass.
    pub fn time<R>(&mut self, step: impl FnOnce() -> R) -> R {
        let start = Instant::now();
        let result = black_box(step());
        let took = start.elapsed();
        match self.fastest.get_mut(self.next) {
            Some(fastest) => *fastest = (*fastest).min(took),
            None => self.fastest.push(took),
        }
        self.next += 1;
        result
    }

    /// Returns the fastest time of each step.
    #[must_use]
    pub fn fastest(&self) -> &[Duration] {
        &self.fastest
    }

    /// Returns the index of the step whose fastest time is the longest; `None` before the first step.
    #[must_use]
    pub fn slowest(&self) -> Option<usize> {
        let steps = self.fastest.iter().enumerate();
        steps.max_by_key(|(_, took)| **took).map(|(index, _)| index)
    }
}

/// Runs a bench program: times all paths, or does what [`LIST`] or [`RUN`] asks for.
pub fn main(register: impl FnOnce(&mut HotPaths)) {
    let mut paths = HotPaths::default();
    register(&mut paths);
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.first().map(String::as_str) {
        Some(LIST) => paths.counted.iter().for_each(|(name, _)| println!("{name}")),
        Some(RUN) => {
            let named = |(name, _): &(String, Once)| Some(name) == arguments.get(1);
            let found = paths.counted.into_iter().find(named);
            let Some((_, run)) = found else {
                eprintln!("error: {RUN} wants the name of a path; {LIST} lists them");
                std::process::exit(2);
            };
            // The main thread's stack begins behind arguments and environment, so their size would change the
            // alignment and thus the cost of copies. Another thread's stack begins at a page.
            let counted = std::thread::scope(|scope| scope.spawn(run).join());
            if let Err(panic) = counted {
                std::panic::resume_unwind(panic);
            }
        }
        _ => {
            let mut criterion = Criterion::default().configure_from_args();
            for timed in paths.timed {
                timed(&mut criterion);
            }
            criterion.final_summary();
        }
    }
}
