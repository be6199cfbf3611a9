//! Figures that the last round of a law found. A round changes the limits at a few knots, and with them the law beside these: elsewhere the next
//! round asks the same once more.

/// A figure of a cell, and what it was found from.
#[derive(Clone, Copy, Debug)]
struct Recalled<const FROM: usize, T> {
    /// The number of the law that it was found for.
    law: u64,
    /// Compared bit by bit, so that what is found again would be the same bits.
    from: [u64; FROM],
    found: T,
}

impl<const FROM: usize, T: Copy> Recalled<FROM, T> {
    const fn nothing(found: T) -> Self {
        Self { law: 0, from: [0; FROM], found }
    }

    fn of(law: u64, from: [f64; FROM], found: T) -> Self {
        Self { law, from: from.map(f64::to_bits), found }
    }

    fn found_from(&self, law: u64, from: [f64; FROM]) -> Option<T> {
        (self.law == law && self.from == from.map(f64::to_bits)).then_some(self.found)
    }
}

/// A pass over the cells, by the direction in which it goes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pass {
    Backward,
    Forward,
}

impl Pass {
    /// The sign of the acceleration from a known cell to the next one of the pass.
    pub(super) const fn sign(self) -> f64 {
        match self {
            Self::Backward => -1.0,
            Self::Forward => 1.0,
        }
    }
}

/// Shares of the limits that a law uses in a cell: accelerations and jerks at its start, in between and at its end.
pub(super) type Loads = [[f64; 2]; 3];

/// Figures found for a cell; by the passes, in their order.
#[derive(Clone, Copy, Debug)]
struct CellFound {
    reaches: [Recalled<3, f64>; 2],
    rooms: [Recalled<4, f64>; 2],
    loads: Recalled<4, Loads>,
}

/// Figures found for the cells of a law. What was found from other figures is not returned.
#[derive(Debug)]
pub(super) struct LastRound {
    cells: Vec<CellFound>,
    /// The number of the present law, from 1.
    law: u64,
}

impl LastRound {
    pub(super) fn with_room(cells: usize) -> Self {
        Self { cells: Vec::with_capacity(cells), law: 0 }
    }

    /// Forgets everything: the law gets other knots.
    pub(super) fn forget(&mut self, cells: usize) {
        const NOTHING: CellFound = CellFound {
            reaches: [Recalled::nothing(0.0); 2],
            rooms: [Recalled::nothing(0.0); 2],
            loads: Recalled::nothing([[0.0; 2]; 3]),
        };
        self.law += 1;
        if cells > self.cells.len() {
            self.cells.resize(cells, NOTHING);
        }
    }

    /// Returns the highest value of a cell, from the value known and the shares of the limits at the knot between both cells.
    pub(super) fn reach(&self, pass: Pass, cell: usize, from: [f64; 3]) -> Option<f64> {
        self.cells[cell].reaches[pass as usize].found_from(self.law, from)
    }

    pub(super) fn note_reach(&mut self, pass: Pass, cell: usize, from: [f64; 3], found: f64) {
        self.cells[cell].reaches[pass as usize] = Recalled::of(self.law, from, found);
    }

    /// Returns by how much the acceleration may grow over a cell, from the pace and the shares of the jerk at both ends of the cell.
    pub(super) fn room(&self, pass: Pass, cell: usize, from: [f64; 4]) -> Option<f64> {
        self.cells[cell].rooms[pass as usize].found_from(self.law, from)
    }

    pub(super) fn note_room(&mut self, pass: Pass, cell: usize, from: [f64; 4], found: f64) {
        self.cells[cell].rooms[pass as usize] = Recalled::of(self.law, from, found);
    }

    /// Returns the loads of a cell, from the paces at its ends.
    pub(super) fn loads(&self, cell: usize, from: [f64; 4]) -> Option<Loads> {
        self.cells[cell].loads.found_from(self.law, from)
    }

    pub(super) fn note_loads(&mut self, cell: usize, from: [f64; 4], found: Loads) {
        self.cells[cell].loads = Recalled::of(self.law, from, found);
    }
}
