//! ethercrab as MainDevice of the example `subdevice`, in real time: its futures run in the driver's loop, without a
//! thread or a timer of their own.
//!
//! ```console
//! $ sudo cargo run -p ethercat-subdevice --example main_device -- eth0
//! ```

#![expect(clippy::expect_used, unreachable_pub, reason = "an example; it shares code with the tests")]

use std::error::Error;
use std::ops::ControlFlow;

use embassy_time::{Duration, Instant as At, Timer};
use ethercrab::{MainDevice, MainDeviceConfig, PduStorage, Timeouts};
use machine::Instant;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

#[path = "../tests/ethercat/scripted.rs"]
mod scripted;
#[path = "../tests/ethercat/time.rs"]
mod time;

use scripted::Scripted;

const CYCLES: u64 = 1_000;
const CYCLE: Duration = Duration::from_millis(1);

static STORAGE: PduStorage<16, { PduStorage::element_size(1486) }> = PduStorage::new();

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

async fn run(main: MainDevice<'_>) -> Result<Run, ethercrab::error::Error> {
    let start = time::now_ns();
    let group = main.init_single_group::<4, 64>(time::now_ns).await?;
    for device in group.iter(&main) {
        println!("{}, serial number {}", device.name(), device.identity().serial);
    }
    let group = group.into_op(&main).await?;
    let mut run = Run { to_op: time::now_ns() - start, round_trips: Vec::new(), bad: 0, echoed: 0 };
    let expected = 3 * group.len() as u16;
    let mut due = At::now();
    for number in 1..=CYCLES {
        for device in group.iter(&main) {
            device.outputs_raw_mut().copy_from_slice(&number.to_le_bytes());
        }
        let sent = time::now_ns();
        match group.tx_rx(&main).await {
            Ok(cycle) if cycle.working_counter == expected => run.round_trips.push(time::now_ns() - sent),
            _ => run.bad += 1,
        }
        let came = |number: u64| group.iter(&main).all(|device| *device.inputs_raw() == number.to_le_bytes());
        run.echoed += u64::from(came(number - 1));
        due += CYCLE;
        Timer::at(due).await;
    }
    Ok(run)
}

struct Wait;

impl<T> Owner<Scripted<'static, Result<Run, T>>> for Wait
where
    T: std::fmt::Debug,
{
    fn wake(
        &mut self,
        _: Instant,
        _: &mut Scripted<'static, Result<Run, T>>,
        _: &Statistics,
    ) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(
        &mut self,
        _: Instant,
        _: &mut Scripted<'static, Result<Run, T>>,
        ended: Result<Run, T>,
    ) -> ControlFlow<()> {
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
    let (tx, rx, pdu_loop) = STORAGE.try_split().expect("it is split once");
    let config = MainDeviceConfig { dc_static_sync_iterations: 1_000, ..MainDeviceConfig::default() };
    let main_device = MainDevice::new(pdu_loop, Timeouts::default(), config);
    let machine = Scripted::start(Box::pin(run(main_device)), tx, rx, clock::now());
    let mut driver = Driver::new(machine, Interface::open(&interface)?, Notifier::new()?)?;
    Ok(driver.run(&mut Wait)?)
}
