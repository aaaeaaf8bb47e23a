//! How long an encode may take for fewer bytes.

/// What an encode of all valid entries tries. Bytes and seconds by tools/figures.py are in the README.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Effort {
    /// Two block shapes, holes filled in few steps.
    Fast,
    /// Block shapes by tile.
    #[default]
    Standard,
    /// The same with more steps wherever holes are filled.
    Thorough,
}

impl Effort {
    /// Steps of filling the holes of a block. Golden yellow, step 0.1, kB / log rms: 30 steps 59.4 / .0077, 80 steps 55.8 / .0076;
    /// paper white 28.6 / .0049, 27.0 / .0048 (9 x 9 x 60).
    pub(super) fn fill_steps(self) -> usize {
        match self {
            Effort::Fast => 8,
            Effort::Standard => 32,
            Effort::Thorough => 120,
        }
    }

    /// The same in trials of block shapes: enough to rank them.
    pub(super) fn trial_steps(self) -> usize {
        match self {
            Effort::Fast => 1,
            Effort::Standard => 3,
            Effort::Thorough => 10,
        }
    }

    /// Rounds of reweighting of the grazing profile's fit, and conjugate gradient steps in each.
    pub(super) fn profile_steps(self) -> (usize, usize) {
        match self {
            Effort::Fast => (2, 10),
            Effort::Standard => (4, 20),
            Effort::Thorough => (5, 40),
        }
    }
}
