//! Chance that is the same on every machine.

/// Random numbers (splitmix64).
pub struct Random(u64);

impl Random {
    /// The numbers of a seed.
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0xd134_2543_de82_ef95))
    }

    /// From 0 up to 1.
    pub fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// From −1 up to 1.
    pub fn signed(&mut self) -> f64 {
        2.0 * self.share() - 1.0
    }

    /// A vector of unit length, every direction as likely.
    pub fn unit<const N: usize>(&mut self) -> [f64; N] {
        loop {
            let vector: [f64; N] = std::array::from_fn(|_| self.signed());
            let squared: f64 = vector.iter().map(|value| value * value).sum();
            if (1e-4..=1.0).contains(&squared) {
                return vector.map(|value| value / squared.sqrt());
            }
        }
    }
}
