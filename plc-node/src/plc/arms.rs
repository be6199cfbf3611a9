//! Arms in step, and arms that are suspended.

use protocol::fieldbus::ControllerBus;
use protocol::image::Control;

use super::PlcNode;
use crate::PlcProgram;
use crate::arm_in_step::ArmInStep;

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Keeps these arms in step, one for each station: they start at one instant, and move together where they are to.
    #[must_use]
    pub fn in_step(mut self, arms: Vec<ArmInStep>) -> Self {
        if arms.len() > 1 {
            for (station, arm) in self.stations.iter_mut().zip(&arms) {
                station.estimate_clock(arm.stamp);
            }
        }
        self.program.keep_in_step(arms);
        self
    }

    /// Has a robot stop on its path and keep its skill, until it is [resumed](Self::resume). An arm that moves together with others
    /// does so with them.
    pub fn suspend(&mut self, station: usize) {
        if let Some(station) = self.stations.get_mut(station) {
            station.group_mut().set_control(Control::SUSPEND, true);
        }
    }

    /// Has a robot that was [suspended](Self::suspend) go on.
    pub fn resume(&mut self, station: usize) {
        if let Some(station) = self.stations.get_mut(station) {
            station.group_mut().set_control(Control::SUSPEND, false);
            station.group_mut().set_control(Control::RESUME, true);
        }
    }
}
