//! Numbers that look random and are the same for the same seed and name on every machine.

/// A SplitMix64 sequence: 64 bits of state are plenty for a few hundred start poses.
pub(crate) struct Seeded {
    state: u64,
}

impl Seeded {
    /// The sequence of a seed and of what it is used for; other uses and seeds give unrelated ones.
    pub(crate) fn new(seed: u64, purpose: &str) -> Seeded {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&seed.to_le_bytes());
        hasher.update(purpose.as_bytes());
        let mut first = [0; 8];
        first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
        Seeded { state: u64::from_le_bytes(first) }
    }

    /// Evenly spread in `0..1`.
    pub(crate) fn unit(&mut self) -> f64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Evenly spread in `-1..1`.
    pub(crate) fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sequence_depends_on_seed_and_purpose_alone() {
        let first = |seed, purpose| Seeded::new(seed, purpose).unit();
        assert_eq!(first(1, "box_0"), first(1, "box_0"));
        assert_ne!(first(1, "box_0"), first(2, "box_0"));
        assert_ne!(first(1, "box_0"), first(1, "box_1"));
    }

    #[test]
    fn numbers_fill_their_range() {
        let mut seeded = Seeded::new(7, "range");
        let drawn: Vec<f64> = (0..4000).map(|_| seeded.unit()).collect();
        assert!(drawn.iter().all(|u| (0.0..1.0).contains(u)));
        let mean = drawn.iter().sum::<f64>() / 4000.0;
        assert!((mean - 0.5).abs() < 0.02, "mean {mean}");
    }
}
