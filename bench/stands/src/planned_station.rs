//! A station of a planned cell: what its robot executes, section by section, and where it waits for others.

use planning::{Stop, WaitAt};
use protocol::image::Motion;
use setup::Setup;

use crate::planned_cell::PlannedCell;

/// A station of a cell and its motions.
#[derive(Clone, Debug)]
pub struct PlannedStation {
    /// Its name in the setup.
    pub name: String,
    /// The station as a setup of its own.
    pub setup: Setup,
    /// Its robot and motions.
    pub planned: PlannedCell,
    /// Where its arm waits for others, in order.
    pub waits: Vec<WaitAt>,
}

/// A program of the robot: the motions of a section between two marks, and where it stops within.
pub type SectionProgram = (Vec<Motion>, Vec<Stop>);

impl PlannedStation {
    /// Takes the stations of a planned cell.
    ///
    /// # Errors
    ///
    /// A setup describes no robot, or an arm does not reach its start.
    pub fn all(cell: &planning::PlannedCell) -> anyhow::Result<Vec<Self>> {
        let one = |station: &planning::PlannedStation| {
            let planning::PlannedStation { name, setup, application, plan, .. } = station;
            let planned = PlannedCell::of_plan(setup, application, plan)?;
            Ok(Self { name: name.clone(), setup: setup.clone(), planned, waits: plan.waits.clone() })
        };
        cell.stations.iter().map(one).collect()
    }

    /// Returns the programs that RC runs one after the other. Without marks it is one program with all its stops. With marks each
    /// section between two of them is one, and what is switched at the end of a section is the PLC's.
    #[must_use]
    pub fn programs(&self) -> Vec<SectionProgram> {
        let PlannedCell { motions, stops, .. } = &self.planned;
        if self.waits.is_empty() {
            return vec![(motions.clone(), stops.clone())];
        }
        let mut ends: Vec<usize> = self.waits.iter().map(|wait| wait.after).collect();
        ends.push(motions.len());
        ends.dedup();
        let mut begin = 0;
        let mut programs = Vec::with_capacity(ends.len());
        for end in ends {
            let Some(section) = motions.get(begin..end).filter(|section| !section.is_empty()) else {
                continue;
            };
            let within = |stop: &&Stop| (begin + 1..end).contains(&(stop.after as usize));
            let stops = stops.iter().filter(within);
            let shifted = stops.map(|stop| Stop { after: stop.after - begin as u32, ..*stop });
            programs.push((section.to_vec(), shifted.collect()));
            begin = end;
        }
        programs
    }
}
