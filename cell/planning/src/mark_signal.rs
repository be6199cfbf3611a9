//! The digital signal by which a stored program meets others at a mark.

/// Digital outputs of an image.
pub(crate) const OUTPUTS: u8 = 16;

/// Returns a digital output as a bit; none for one that the image does not have.
pub(crate) const fn output_bit(output: u8) -> u16 {
    match 1_u16.checked_shl(output as u32) {
        Some(bit) => bit,
        None => 0,
    }
}

/// Action of a stored program at a mark: it switches an output of its robot, and waits for inputs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct MarkSignal {
    /// Bit of the robot's digital outputs, 0..=15.
    pub output: u8,
    /// State of that output, and of the inputs for which the program waits.
    pub set: bool,
    /// Bits of the PLC's digital outputs for which the program waits: the outputs of the other arms.
    pub inputs: u16,
}

impl MarkSignal {
    /// Returns the output as a bit.
    #[must_use]
    pub const fn mask(self) -> u16 {
        output_bit(self.output)
    }

    /// Switches the output in `outputs` and returns the result.
    #[must_use]
    pub const fn applied_to(self, outputs: u16) -> u16 {
        if self.set { outputs | self.mask() } else { outputs & !self.mask() }
    }

    /// Returns whether these outputs of the robot show that its arm has come to the mark.
    #[must_use]
    pub const fn is_shown_by(self, outputs: u16) -> bool {
        outputs & self.mask() == self.applied_to(0)
    }

    /// Returns whether these inputs let the arm pass.
    #[must_use]
    pub const fn is_met_by(self, inputs: u16) -> bool {
        inputs & self.inputs == if self.set { self.inputs } else { 0 }
    }

    /// Returns the signal of an arm that works alone: it waits for nobody.
    #[must_use]
    pub const fn alone(self) -> Self {
        Self { inputs: 0, ..self }
    }
}
