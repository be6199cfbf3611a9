//! A script for ethercrab's MainDevice runs against a segment in virtual time.

use ethercat_maindevice::{Scripted, with_main_device};
use ethercat_subdevice::{DeviceId, Event as SegmentEvent, Segment};
use ethercrab::{MainDevice, MainDeviceConfig, Timeouts};
use machine::{Duration, Instant};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

use crate::faulty::{Faulty, FrameFault};

/// A script, the segment that it runs against, and the cable between them.
pub struct Stand<'s> {
    segment: &'s mut Segment,
    /// Faults by the numbers of the frames that the MainDevice sends.
    pub faults: Vec<(u64, FrameFault)>,
    /// Whether the devices copy their outputs to their inputs.
    pub echo: bool,
    pub seed: u64,
    pub cable: Impairment,
    pub timeouts: Timeouts,
    pub config: MainDeviceConfig,
    /// How long the script may take.
    pub limit: Duration,
}

/// What is left when a script has ended.
pub struct Ended<T> {
    /// What it returned, or `None` if it took too long.
    pub result: Option<T>,
    /// What the devices reported, and when.
    pub events: Vec<(Instant, DeviceId, SegmentEvent)>,
    pub at: Instant,
    /// Frames that ethercrab could not use.
    pub refused: u64,
}

impl<'s> Stand<'s> {
    pub fn new(segment: &'s mut Segment) -> Self {
        Self {
            segment,
            faults: Vec::new(),
            echo: false,
            seed: 1,
            cable: Impairment { delay: Duration::from_micros(20), ..Impairment::default() },
            timeouts: Timeouts::default(),
            config: MainDeviceConfig { dc_static_sync_iterations: 0, ..MainDeviceConfig::default() },
            limit: Duration::from_secs(20),
        }
    }

    /// Runs a script to its end.
    pub fn run<T>(self, script: impl AsyncFnOnce(&MainDevice<'_>) -> T) -> Ended<T> {
        self.run_with(script, &[] as &[(Instant, ())], |_, _, ()| ())
    }

    /// Runs a script to its end; at each of these instants something happens to the segment.
    pub fn run_with<T, E: Copy>(
        self,
        script: impl AsyncFnOnce(&MainDevice<'_>) -> T,
        happenings: &[(Instant, E)],
        happen: impl Fn(&mut Segment, Instant, E),
    ) -> Ended<T> {
        let script = with_main_device(self.timeouts, self.config, script);
        let scripted = Scripted::new(script, Instant::ZERO);
        let config = PairConfig {
            seed: self.seed,
            clocks: [Clock::default(); 2],
            links: [self.cable; 2],
            addresses: [None; 2],
        };
        let mut pair = Pair::new(scripted, Faulty::new(self.segment, self.faults, self.echo), config);
        let mut events = Vec::new();
        let mut result = None;
        let mut happenings = happenings.iter();
        'run: loop {
            let happening = happenings.next();
            let until = happening.map_or(Instant::ZERO + self.limit, |(at, _)| *at);
            while let Some(event) = pair.next_event(until) {
                match event {
                    Event::A(ended) => {
                        result = Some(ended);
                        break 'run;
                    }
                    Event::B((device, event)) => events.push((pair.now(), device, event)),
                }
            }
            let Some((_, happening)) = happening else { break };
            pair.command_b(|faulty, now| happen(faulty.segment, now, *happening));
        }
        Ended { result, events, at: pair.now(), refused: pair.a().refused() }
    }
}
