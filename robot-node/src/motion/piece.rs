//! The law of a path as a row of pieces.

use super::cell::Cell;
use super::node::Pace;

/// A place on the path, by way; a later one is greater.
#[derive(Clone, Copy, PartialEq, PartialOrd, Debug)]
pub(super) struct Spot {
    /// The number of the motion.
    pub(super) motion: u32,
    /// Whether it is in the corner after that motion.
    pub(super) in_blend: bool,
    /// In the unit of the motion's curve or of the corner.
    pub(super) way: f64,
}

/// A cell of a law, and where it is on the path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub(super) cell: Cell,
    pub(super) start: Spot,
    /// The units of its part per unit of the cell.
    pub(super) unit: f64,
}

impl Piece {
    pub(super) fn at(&self, time: f64) -> (Spot, Pace) {
        let (spot, pace, _) = self.at_with_jerk(time);
        (spot, pace)
    }

    /// Place, pace and jerk after some time, in s.
    pub(super) fn at_with_jerk(&self, time: f64) -> (Spot, Pace, f64) {
        let (way, pace) = self.cell.at(time);
        let Pace { square, acceleration } = pace;
        let spot = Spot { way: self.start.way + way * self.unit, ..self.start };
        let pace_here =
            Pace { square: square * self.unit * self.unit, acceleration: acceleration * self.unit };
        (spot, pace_here, self.unit * self.cell.jerk(&pace))
    }

    /// Whether another piece lies on the same part.
    fn is_on(&self, other: &Self) -> bool {
        (self.start.motion, self.start.in_blend) == (other.start.motion, other.start.in_blend)
    }

    /// Returns whether the acceleration falls in it, as it does before the arm slows down.
    pub(super) fn falls(&self) -> bool {
        self.cell.is_to_rest() || self.cell.jerk(&self.cell.at(0.0).1) < 0.0
    }
}

/// The law from a place on.
#[derive(Clone, Debug)]
pub(super) struct Course<I> {
    pieces: I,
    /// None behind a rest, where a ramp ends.
    pub(super) piece: Option<Piece>,
    /// Seconds since its start.
    pub(super) time: f64,
    /// Factor from figures in the unit of the course's first part to the unit of the present part.
    pub(super) unit: f64,
}

impl<I: Iterator<Item = Piece>> Course<I> {
    /// Along these pieces, from a time in the first of them.
    pub(super) fn new(mut pieces: I, time: f64) -> Self {
        let piece = pieces.next();
        Self { pieces, piece, time, unit: 1.0 }
    }

    /// Goes on to the next piece.
    pub(super) fn leave(&mut self, piece: &Piece) {
        self.time -= piece.cell.duration;
        self.piece = if piece.cell.is_to_rest() { None } else { self.pieces.next() };
        if let Some(next) = self.piece.filter(|next| !next.is_on(piece)) {
            // The speed of the tool does not change there.
            let [came, goes] = [piece.at(piece.cell.duration), next.at(0.0)].map(|(_, pace)| pace.square);
            self.unit *= if came > 0.0 { (goes / came).sqrt() } else { 1.0 };
        }
    }

    /// Advances by some of the law's seconds.
    pub(super) fn advance(&mut self, seconds: f64) {
        self.time += seconds;
        while let Some(piece) = self.piece.filter(|piece| self.time >= piece.cell.duration) {
            self.leave(&piece);
        }
    }
}
