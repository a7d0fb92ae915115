//! How far an answer matters, coarsely: a byte on the wire.

use std::sync::LazyLock;

/// A distance on a scale of twelve steps an octave, or no bound. What a group leaves out because it lies
/// beyond a reach is asked again when nothing within it was found, so reaches decide what is searched and
/// sent, never what is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reach(u8);

/// The shortest reach, metres.
const LEAST_M: f64 = 1e-4;
const STEPS_PER_OCTAVE: f64 = 12.0;

/// Of each code.
static METRES: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| match code {
        255 => f32::INFINITY,
        _ => (LEAST_M * libm::exp2(code as f64 / STEPS_PER_OCTAVE)) as f32,
    })
});

impl Reach {
    /// Every distance matters.
    pub const UNBOUNDED: Reach = Reach(u8::MAX);

    /// The shortest reach on the scale that is not shorter than `distance_m`.
    pub fn covering(distance_m: f64) -> Reach {
        // The last is infinite.
        Reach(METRES.partition_point(|&m| f64::from(m) < distance_m) as u8)
    }

    /// The next longer of four steps an octave: many reaches that differ little are fewer bytes alike.
    pub fn coarse(self) -> Reach {
        Reach(self.0.next_multiple_of(3))
    }

    /// The reach, metres; infinite if unbounded.
    pub fn m(self) -> f32 {
        METRES[usize::from(self.0)]
    }

    /// Its place on the scale.
    pub fn code(self) -> u8 {
        self.0
    }

    /// The reach at a place of the scale.
    pub const fn from_code(code: u8) -> Reach {
        Reach(code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_reach_covers_its_distance_tightly(distance_m in 1.1e-4..200.0f64) {
            let m = f64::from(Reach::covering(distance_m).m());
            prop_assert!(m >= distance_m && m <= distance_m * 1.07, "{m} for {distance_m}");
            let coarse = f64::from(Reach::covering(distance_m).coarse().m());
            prop_assert!(coarse >= m && coarse <= m * 1.13, "{coarse} for {m}");
        }
    }

    #[test]
    fn nothing_is_beyond_the_scale() {
        assert_eq!(Reach::covering(1e9), Reach::UNBOUNDED);
        assert_eq!(Reach::covering(0.0).m(), 1e-4);
        assert_eq!(Reach::UNBOUNDED.coarse().m(), f32::INFINITY);
    }
}
