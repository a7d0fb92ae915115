//! Numbers in fewer bits, for links that are worth it: unit vectors, poses, distances. Computed with the
//! operations that every machine rounds alike.

use bytes::Bytes;
use hull::Pose;
use hull::body::BodyError;
use hull::reach::Reach;

use super::ConvertError;
use super::bulk::Field;

/// How exact numbers travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Precision {
    /// Every bit, so that answers are those of a single machine.
    #[default]
    Exact,
    /// Poses to a micrometre, normals to 0.0002 degrees (0.003 where ways are short), exits to two micrometres: a response
    /// differs by less than 0.1 mm, unless a ray grazes a pixel's corner. The pixels of
    /// edges are not sent.
    Quantised,
}

impl Precision {
    /// Its name in options and tables.
    pub fn name(self) -> &'static str {
        match self {
            Precision::Exact => "exact",
            Precision::Quantised => "quantised",
        }
    }
}

/// How finely unit vectors are rounded: two parts of so many bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum UnitBits {
    /// For short ways: a tenth of a metre along it ends a few micrometres off.
    Sixteen,
    /// With 16, the mean direction of a body that is half a metre deep is off by enough to move its response
    /// by more than a tenth of a millimetre.
    Twenty,
}

impl UnitBits {
    /// The finest first.
    const ALL: [UnitBits; 2] = [UnitBits::Twenty, UnitBits::Sixteen];

    fn bits(self) -> u32 {
        if self == UnitBits::Sixteen { 16 } else { 20 }
    }

    fn half(self) -> f64 {
        f64::from((1 << (self.bits() - 1)) - 1)
    }

    /// Bytes of a unit vector.
    fn width(self) -> usize {
        self.bits() as usize / 4
    }
}

/// Unit vectors as points of the unfolded octahedron, so finely.
pub(super) fn octahedral(units: impl Iterator<Item = [f32; 3]>, bits: UnitBits) -> Bytes {
    let bytes = |unit| code_of(unit, bits).to_le_bytes().into_iter().take(bits.width());
    units.flat_map(bytes).collect::<Vec<u8>>().into()
}

/// The same as finely as they need: in 16 bits, if they were rounded to these before.
pub(super) fn octahedral_again(units: impl Iterator<Item = [f32; 3]> + Clone) -> Bytes {
    let is_rounded = |unit: [f32; 3]| {
        unit_of(code_of(unit, UnitBits::Sixteen), UnitBits::Sixteen).map(|part| part as f32) == unit
    };
    let bits = if units.clone().all(is_rounded) { UnitBits::Sixteen } else { UnitBits::Twenty };
    octahedral(units, bits)
}

/// So many unit vectors of the unfolded octahedron; every code is one. The length says how finely.
pub(super) fn from_octahedral(
    bytes: &[u8],
    count: usize,
    field: Field,
) -> Result<Vec<[f32; 3]>, ConvertError> {
    let fits = |bits: &UnitBits| bytes.len() == count * bits.width();
    let expected = count * UnitBits::Twenty.width();
    let wrong = ConvertError::Length { message: field.0, field: field.1, found: bytes.len(), expected };
    let bits = UnitBits::ALL.into_iter().find(fits).ok_or(wrong)?;
    let code = |bytes: &[u8]| bytes.iter().rev().fold(0, |code: u64, &byte| code << 8 | u64::from(byte));
    Ok(bytes
        .chunks_exact(bits.width())
        .map(|bytes| unit_of(code(bytes), bits).map(|part| part as f32))
        .collect())
}

/// A unit vector's place on the unfolded octahedron: of the four around it that whose vector is nearest.
fn code_of(unit: [f32; 3], bits: UnitBits) -> u64 {
    let wanted = unit.map(f64::from);
    let [x, y, z] = wanted;
    let length = x.abs() + y.abs() + z.abs();
    let (u, v) = if length > 0.0 { (x / length, y / length) } else { (0.0, 0.0) };
    let (u, v) = if z < 0.0 { folded(u, v) } else { (u, v) };
    let half = bits.half();
    let low = [u, v].map(|part| ((part + 1.0) * half).floor().clamp(0.0, 2.0 * half - 1.0) as u64);
    let around = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| (low[1] + j) << bits.bits() | (low[0] + i));
    let off = |&code: &u64| {
        let found = unit_of(code, bits);
        (0..3).map(|axis| (found[axis] - wanted[axis]).powi(2)).sum::<f64>()
    };
    around.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default()
}

fn unit_of(code: u64, bits: UnitBits) -> [f64; 3] {
    let mask = (1 << bits.bits()) - 1;
    let part = |shift: u32| ((code >> shift & mask) as f64 / bits.half() - 1.0).min(1.0);
    let (u, v) = (part(0), part(bits.bits()));
    let z = 1.0 - u.abs() - v.abs();
    let (x, y) = if z < 0.0 { folded(u, v) } else { (u, v) };
    let length = (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|part| part / length)
}

/// The outer triangles of the unfolded octahedron onto the inner ones, and back.
fn folded(u: f64, v: f64) -> (f64, f64) {
    ((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v))
}

/// Bytes of a rounded pose.
pub(super) const POSE_BYTES: usize = 20;

/// The quaternion's parts are at most this, but for the largest.
const HALF_RANGE: f64 = std::f64::consts::FRAC_1_SQRT_2;
const PART_BITS: u32 = 20;
const PART_HALF: f64 = ((1 << (PART_BITS - 1)) - 1) as f64;
const PART_MASK: u64 = (1 << PART_BITS) - 1;

/// True if rounding this pose keeps its meaning: a quaternion that is not quite of unit length would be
/// stretched by it.
pub(super) fn can_round(pose: &Pose) -> bool {
    let squared: f64 = pose.rotation_xyzw().iter().map(|q| q * q).sum();
    let reach_m = pose.position_m().iter().fold(0.0, |reach: f64, part| reach.max(part.abs()));
    (squared - 1.0).abs() < 2e-6 && reach_m < 1000.0
}

/// A pose in 20 bytes.
pub(super) fn round_pose(pose: &Pose) -> [u8; POSE_BYTES] {
    let q = pose.rotation_xyzw();
    let largest = (1..4).fold(0, |best, part| if q[part].abs() > q[best].abs() { part } else { best });
    let length = q.iter().map(|part| part * part).sum::<f64>().sqrt().copysign(q[largest]);
    let mut code = (largest as u64) << (3 * PART_BITS);
    for (place, part) in (0..4).filter(|&part| part != largest).enumerate() {
        let share = (q[part] / length / HALF_RANGE).clamp(-1.0, 1.0);
        code |= ((share * PART_HALF + PART_HALF).round() as u64) << (place as u32 * PART_BITS);
    }
    let mut bytes = [0; POSE_BYTES];
    for (bytes, part) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(pose.position_m()) {
        *bytes = (part as f32).to_le_bytes();
    }
    bytes[12..].copy_from_slice(&code.to_le_bytes());
    bytes
}

/// The pose of 20 bytes, if they are one.
pub(super) fn pose_of(bytes: &[u8; POSE_BYTES]) -> Result<Pose, BodyError> {
    let number =
        |at: usize| f64::from(f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]));
    let word = |at: usize| -> u64 {
        bytes[at..at + 8].iter().rev().fold(0, |word, &byte| word << 8 | u64::from(byte))
    };
    let code = word(12);
    let largest = (code >> (3 * PART_BITS)) as usize & 3;
    let mut q = [0.0; 4];
    let mut left = 1.0;
    for (place, part) in (0..4).filter(|&part| part != largest).enumerate() {
        let share = (code >> (place as u32 * PART_BITS) & PART_MASK) as f64;
        q[part] = (share - PART_HALF) / PART_HALF * HALF_RANGE;
        left -= q[part] * q[part];
    }
    q[largest] = left.max(0.0).sqrt();
    Pose::new([number(0), number(4), number(8)], q)
}

/// The step of a scale of so many steps up to `longest_m`; more than zero.
pub(super) fn step_m(longest_m: f32, steps: u32) -> f32 {
    // A little more, so that rounding the step cannot make the scale too short.
    let step = f64::from(longest_m) / f64::from(steps) * (1.0 + 1e-6);
    (step as f32).max(1e-12)
}

/// A distance on a scale, metres.
pub(super) fn on_scale(code: u32, step_m: f32) -> f32 {
    (f64::from(code) * f64::from(step_m)) as f32
}

/// The nearest place on a scale.
pub(super) fn nearest_code(m: f32, step_m: f32) -> u32 {
    (f64::from(m) / f64::from(step_m)).round() as u32
}

/// The first place on a scale that is not short of `m`.
pub(super) fn covering_code(m: f32, step_m: f32) -> u32 {
    let code = (f64::from(m) / f64::from(step_m)).ceil() as u32;
    if on_scale(code, step_m) < m { code + 1 } else { code }
}

/// A reach as a byte; rounded it is a little longer, of a few different ones: they take half the bytes.
pub(super) fn reach_code(reach: Reach, precision: Precision) -> u8 {
    const STEP: u8 = 4;
    match precision {
        Precision::Exact => reach.code(),
        Precision::Quantised => reach.code().checked_next_multiple_of(STEP).unwrap_or(u8::MAX),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FIELD: Field = Field("Test", "field");

    fn unit() -> impl Strategy<Value = [f32; 3]> {
        [-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0]
            .prop_filter("long enough", |v| v.iter().map(|c| c * c).sum::<f64>() > 1e-3)
            .prop_map(|v| {
                let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
                v.map(|c| (c / length) as f32)
            })
    }

    proptest! {
        #[test]
        fn unit_vectors_keep_their_direction_and_are_rounded_once(v in unit()) {
            for (bits, most) in [(UnitBits::Twenty, 3e-6), (UnitBits::Sixteen, 5e-5)] {
                let bytes = octahedral([v].into_iter(), bits);
                let back = from_octahedral(&bytes, 1, FIELD).expect("valid");
                let error: f64 =
                    v.iter().zip(back[0]).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
                prop_assert!(error < most, "{error}");
                let again = octahedral_again(back.iter().copied());
                prop_assert!(again.len() == bytes.len() || bits == UnitBits::Twenty);
                prop_assert_eq!(from_octahedral(&again, 1, FIELD).expect("valid"), back);
            }
        }

        #[test]
        fn every_code_is_a_unit_vector(bytes: [u8; 5], short: bool) {
            let bytes = &bytes[..if short { 4 } else { 5 }];
            let units = from_octahedral(bytes, 1, FIELD).expect("valid");
            let squared: f32 = units[0].iter().map(|c| c * c).sum();
            prop_assert!((squared - 1.0).abs() < 1e-5);
            prop_assert!(from_octahedral(&bytes[1..], 1, FIELD).is_err() || !short);
        }

        #[test]
        fn poses_move_no_sample_by_a_micrometre(
            position in [-4.0f64..4.0, -4.0f64..4.0, -4.0f64..4.0],
            q in [-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0]
                .prop_filter("long enough", |q| q.iter().map(|c| c * c).sum::<f64>() > 1e-3),
        ) {
            let length = q.iter().map(|c| c * c).sum::<f64>().sqrt();
            let pose = Pose::new(position, q.map(|c| c / length)).expect("unit");
            prop_assert!(can_round(&pose));
            let back = pose_of(&round_pose(&pose)).expect("a pose");
            let sample = [0.2, -0.2, 0.2];
            let moved = pose.world_from_body()(sample) - back.world_from_body()(sample);
            prop_assert!(moved.norm() < 2e-6, "{}", moved.norm());
        }

        #[test]
        fn any_bytes_are_a_pose_or_an_error(bytes: [u8; POSE_BYTES]) {
            if let Ok(pose) = pose_of(&bytes) {
                prop_assert!(pose.position_m().iter().all(|part| part.is_finite()));
            }
        }

        #[test]
        fn places_on_a_scale_are_near_and_cover(m in 0.0f32..1.0, longest_m in 0.0f32..1.0) {
            let longest_m = longest_m.max(m);
            let step = step_m(longest_m, 65_535);
            let covering = covering_code(m, step);
            prop_assert!(covering <= 65_535 && on_scale(covering, step) >= m);
            prop_assert!(on_scale(covering, step) - m <= step * 1.001 + 1e-7);
            prop_assert!(nearest_code(m, step_m(longest_m, 0xff_ffff)) <= 0xff_ffff);
        }
    }

    #[test]
    fn short_ways_take_fewer_bits_than_long_ones() {
        let units = [[0.6, 0.0, 0.8], [0.0, 0.0, -1.0]];
        assert_eq!(octahedral(units.into_iter(), UnitBits::Sixteen).len(), 8);
        assert_eq!(octahedral(units.into_iter(), UnitBits::Twenty).len(), 10);
        assert!(from_octahedral(&[0; 9], 2, FIELD).is_err());
    }

    #[test]
    fn a_stretched_quaternion_is_not_rounded() {
        let pose = Pose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0004]).expect("nearly unit");
        assert!(!can_round(&pose));
    }
}
