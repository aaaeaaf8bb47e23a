//! How long an encode may take for fewer bytes.

/// What an encode of all valid entries tries. Bytes and seconds by tools/figures.py are in docs/results.md.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Effort {
    /// A few block shapes, holes filled in few steps.
    Fast,
    /// Block shapes by tile.
    #[default]
    Standard,
    /// The same with more steps wherever holes are filled.
    Thorough,
}

/// A part of the grazing profile's fit.
#[derive(Clone, Copy)]
pub(super) struct ProfileStage {
    /// Every n-th bin of theta_h takes part.
    pub(super) stride: usize,
    /// Rounds of reweighting.
    pub(super) rounds: usize,
    /// Conjugate gradient steps in each.
    pub(super) steps: usize,
}

impl Effort {
    /// Steps of filling the holes of a block. Step 0.1, kB / log rms with 8, 16, 24, 32, 48 steps: golden yellow 65.4 /
    /// .0080, 57.3 / .0075, 54.2 / .0074, 52.6 / .0073, 51.1 / .0073; paper white 28.7 / .0046, 25.5 / .0044, 24.2 / .0043, 23.4 /
    /// .0042, 22.6 / .0042; alum-bronze 31.0 / .0064 to 29.4 / .0063.
    pub(super) fn fill_steps(self) -> usize {
        match self {
            Effort::Fast => 16,
            Effort::Standard => 32,
            Effort::Thorough => 120,
        }
    }

    /// The same in trials of block shapes: enough to rank them. Golden yellow with 1, 2, 3, 5 steps: 55.6, 55.3, 52.6, 52.6 kB.
    pub(super) fn trial_steps(self) -> usize {
        match self {
            Effort::Fast => 1,
            Effort::Standard => 3,
            Effort::Thorough => 10,
        }
    }

    /// Shapes that go with a tiling are tried in a tile where it costs at most this many times the other one, both uncut. Seven tables, share
    /// of the trials' time saved / bits and error lost at most: 1 40 % / .6 %, 1.05 33 % / .6 % (paper white; others .1 %), 1.1 25 %
    /// / .1 %.
    pub(super) fn tile_margin(self) -> f64 {
        match self {
            Effort::Fast => 1.0,
            Effort::Standard => 1.05,
            Effort::Thorough => f64::INFINITY,
        }
    }

    /// How the grazing profile is fitted. kB with strides of 2 and of 1, 80 conjugate gradient steps in all: chrome-steel 32.7, 29.1,
    /// noisy green-fabric 42.0, 37.1. With 39 steps: 37.6, 48.6; in less time, 40 on a quarter
    /// of the bins and then 10 on all: 33.3, 42.7.
    pub(super) fn profile_stages(self) -> &'static [ProfileStage] {
        const fn stage(stride: usize, rounds: usize, steps: usize) -> ProfileStage {
            ProfileStage { stride, rounds, steps }
        }
        const FAST: [ProfileStage; 2] = [stage(4, 2, 20), stage(1, 1, 10)];
        const STANDARD: [ProfileStage; 1] = [stage(1, 4, 20)];
        const THOROUGH: [ProfileStage; 1] = [stage(1, 5, 40)];
        match self {
            Effort::Fast => &FAST,
            Effort::Standard => &STANDARD,
            Effort::Thorough => &THOROUGH,
        }
    }
}
