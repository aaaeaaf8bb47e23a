//! Point sampling: from a seed to the sampled positions of a block (spec section 4.3).

/// SplitMix64 (Steele, Lea, Flood 2014), the generator that the format defines.
#[derive(Clone, Debug)]
pub struct SplitMix64(pub u64);

impl SplitMix64 {
    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

/// Most doublings of the ratio that a record can state.
pub const MAX_DOUBLINGS: u8 = 31;

/// How the valid entries of a file's blocks were sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sampling {
    /// Every valid entry is a sample.
    Every,
    /// Each position is drawn with probability `threshold / 2^32`.
    Bernoulli {
        /// Sampling ratio times 2^32, at least 1.
        threshold: u32,
    },
}

impl Sampling {
    /// The sampling of the given ratio in (0, 1]; 1 samples every valid entry. `None` for other ratios.
    pub fn from_ratio(ratio: f64) -> Option<Sampling> {
        if !(ratio > 0.0 && ratio <= 1.0) {
            return None;
        }
        let threshold = (ratio * 4294967296.0).round();
        Some(if threshold >= 4294967296.0 {
            Sampling::Every
        } else {
            Sampling::Bernoulli { threshold: (threshold as u32).max(1) }
        })
    }

    /// The sampling of a block whose record states this many doublings of the file's ratio; every entry where that reaches 1.
    pub fn doubled(self, doublings: u8) -> Sampling {
        let Sampling::Bernoulli { threshold } = self else {
            return self;
        };
        match u64::from(threshold) << doublings.min(MAX_DOUBLINGS) {
            threshold if threshold >> 32 == 0 => Sampling::Bernoulli { threshold: threshold as u32 },
            _ => Sampling::Every,
        }
    }

    /// The sampling ratio, in (0, 1].
    pub fn ratio(&self) -> f64 {
        match self {
            Sampling::Every => 1.0,
            Sampling::Bernoulli { threshold } => f64::from(*threshold) / 4294967296.0,
        }
    }
}

/// Seed of a block, derived from the file's seed: the first output of a generator started at their mix.
pub fn block_seed(file_seed: u64, block: u32) -> u64 {
    SplitMix64(file_seed ^ u64::from(block).wrapping_mul(0xD129_0B26_9C8B_8C2D)).next_u64()
}

/// Sampled positions of a block, in the order drawn; `valid` in block order.
///
/// Every position is drawn independently. A drawn position that is missing or already taken is skipped and the
/// next available one is taken, past the end from the start again; when none is left, drawing ends.
pub fn sample_positions(seed: u64, sampling: Sampling, valid: &[bool]) -> Vec<u32> {
    let available = || (0..valid.len() as u32).filter(|&i| valid[i as usize]);
    let Sampling::Bernoulli { threshold } = sampling else {
        return available().collect();
    };
    // Small by a constant: eight bytes a position, of which a block has 2^21 at most.
    // next[i] leads to the first available position at or after i; taken ones are linked past (union-find).
    let n = valid.len();
    let mut next: Vec<u32> = (0..=n as u32).collect();
    for i in 0..n {
        if !valid[i] {
            next[i] = i as u32 + 1;
        }
    }
    let mut left = available().count();
    let mut random = SplitMix64(seed);
    let mut positions = Vec::new();
    for i in 0..n {
        if (random.next_u64() >> 32) as u32 >= threshold {
            continue;
        }
        if left == 0 {
            break;
        }
        let mut at = find(&mut next, i);
        if at == n {
            at = find(&mut next, 0);
        }
        positions.push(at as u32);
        next[at] = at as u32 + 1;
        left -= 1;
    }
    positions
}

fn find(next: &mut [u32], from: usize) -> usize {
    let mut root = from;
    while next[root] as usize != root {
        root = next[root] as usize;
    }
    let mut at = from;
    while next[at] as usize != root {
        at = std::mem::replace(&mut next[at], root as u32) as usize;
    }
    root
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn generator_gives_the_published_values() {
        // Reference outputs of splitmix64.c for seed 1234567.
        let mut random = SplitMix64(1234567);
        let expected = [6457827717110365317u64, 3203168211198807973, 9817491932198370423, 4593380528125082431];
        assert_eq!(expected.map(|_| random.next_u64()), expected);
    }

    #[test]
    fn ratio_is_met_on_average() {
        let valid = vec![true; if cfg!(miri) { 2000 } else { 100_000 }];
        let entries = valid.len() as f64;
        for ratio in [0.01, 0.05, 0.5] {
            let n = sample_positions(7, Sampling::from_ratio(ratio).unwrap(), &valid).len() as f64;
            let sigma = (entries * ratio * (1.0 - ratio)).sqrt();
            assert!((n - entries * ratio).abs() < 4.0 * sigma, "{ratio}: {n}");
        }
    }

    /// The rule as the spec words it, without the union-find.
    fn by_the_letter(seed: u64, threshold: u32, valid: &[bool]) -> Vec<u32> {
        let mut free = valid.to_vec();
        let mut random = SplitMix64(seed);
        let mut positions = Vec::new();
        for i in 0..valid.len() {
            if (random.next_u64() >> 32) as u32 >= threshold {
                continue;
            }
            let Some(at) = (i..valid.len()).chain(0..i).find(|&j| free[j]) else { break };
            free[at] = false;
            positions.push(at as u32);
        }
        positions
    }

    proptest! {
        #[test]
        fn missing_positions_are_skipped_to_the_next(
            valid in prop::collection::vec(any::<bool>(), 1..if cfg!(miri) { 40 } else { 300 }), seed in any::<u64>(), ratio in 0.001f64..1.0
        ) {
            let sampling = Sampling::from_ratio(ratio).unwrap();
            let positions = sample_positions(seed, sampling, &valid);
            if let Sampling::Bernoulli { threshold } = sampling {
                prop_assert_eq!(&positions, &by_the_letter(seed, threshold, &valid));
            }
            prop_assert!(positions.iter().all(|&p| valid[p as usize]));
        }
    }

    #[test]
    fn doublings_end_at_every_entry() {
        let start = Sampling::Bernoulli { threshold: 3 << 28 };
        assert_eq!(start.doubled(0), start);
        assert_eq!(start.doubled(2), Sampling::Bernoulli { threshold: 3 << 30 });
        for doublings in [3, 31, 255] {
            assert_eq!(start.doubled(doublings), Sampling::Every);
        }
        assert_eq!(Sampling::Bernoulli { threshold: 1 }.doubled(31), Sampling::Bernoulli { threshold: 1 << 31 });
        assert_eq!(Sampling::Every.doubled(3), Sampling::Every);
    }

    #[test]
    fn ratios_outside_the_range_are_refused() {
        for ratio in [0.0, -0.1, 1.1, f64::NAN] {
            assert_eq!(Sampling::from_ratio(ratio), None);
        }
        assert_eq!(Sampling::from_ratio(1.0), Some(Sampling::Every));
    }
}
