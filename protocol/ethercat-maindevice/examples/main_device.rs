//! ethercrab as MainDevice of the example `subdevice`, in real time: its futures run in the driver's loop, without a
//! thread or a timer of their own.
//!
//! ```console
//! $ sudo cargo run -p ethercat-maindevice --example main_device -- eth0
//! ```

use std::error::Error;
use std::ops::ControlFlow;

use embassy_time::{Duration, Instant as At, Timer};
use ethercat_maindevice::ethercrab::error::Error as EtherCrabError;
use ethercat_maindevice::ethercrab::{MainDevice, MainDeviceConfig, Timeouts};
use ethercat_maindevice::{Scripted, time, with_main_device};
use machine::Instant;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

const CYCLES: u64 = 1_000;
const CYCLE: Duration = Duration::from_millis(1);

/// What a run was like; times in nanoseconds.
struct Run {
    /// From the first frame to OP.
    to_op: u64,
    /// Of each cycle, from sending process data to receiving them.
    round_trips: Vec<u64>,
    /// Cycles without a reply in time, or in which a device was not counted.
    bad: u64,
    /// Numbers that came back.
    echoed: u64,
}

async fn run(main: &MainDevice<'_>) -> Result<Run, EtherCrabError> {
    let start = time::now_ns();
    let group = main.init_single_group::<4, 64>(time::now_ns).await?;
    for device in group.iter(main) {
        println!("{}, serial number {}", device.name(), device.identity().serial);
    }
    let group = group.into_op(main).await?;
    let mut run = Run { to_op: time::now_ns() - start, round_trips: Vec::new(), bad: 0, echoed: 0 };
    let expected = 3 * group.len() as u16;
    let mut due = At::now();
    for number in 1..=CYCLES {
        for device in group.iter(main) {
            device.outputs_raw_mut().copy_from_slice(&number.to_le_bytes());
        }
        let sent = time::now_ns();
        match group.tx_rx(main).await {
            Ok(cycle) if cycle.working_counter == expected => run.round_trips.push(time::now_ns() - sent),
            _ => run.bad += 1,
        }
        let came = |number: u64| group.iter(main).all(|device| *device.inputs_raw() == number.to_le_bytes());
        run.echoed += u64::from(came(number - 1));
        due += CYCLE;
        Timer::at(due).await;
    }
    Ok(run)
}

struct Wait;

impl<F: Future<Output = Result<Run, EtherCrabError>>> Owner<Scripted<F>> for Wait {
    fn wake(&mut self, _: Instant, _: &mut Scripted<F>, _: &Statistics) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(&mut self, _: Instant, _: &mut Scripted<F>, ended: F::Output) -> ControlFlow<()> {
        match ended {
            Ok(mut run) => {
                run.round_trips.sort_unstable();
                let at = |percent| {
                    run.round_trips.get(run.round_trips.len() * percent / 100).copied().unwrap_or(0)
                };
                println!("OP after {} us", run.to_op / 1_000);
                println!("{CYCLES} cycles, {} of them bad, {} numbers came back", run.bad, run.echoed);
                println!("round trip: p50 {} us, p99 {} us", at(50) / 1_000, at(99) / 1_000);
            }
            Err(error) => println!("no run: {error:?}"),
        }
        ControlFlow::Break(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let interface = std::env::args().nth(1).ok_or("usage: main_device INTERFACE")?;
    let config = MainDeviceConfig { dc_static_sync_iterations: 1_000, ..MainDeviceConfig::default() };
    let script = with_main_device(Timeouts::default(), config, run);
    let machine = Scripted::new(script, clock::now());
    let mut driver = Driver::new(machine, Interface::open(&interface)?, Notifier::new()?)?;
    Ok(driver.run(&mut Wait)?)
}
