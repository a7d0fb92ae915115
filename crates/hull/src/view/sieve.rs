//! A camera in single precision: where on the sketch of its silhouette points lie, and when that is certain.
//!
//! A point is given relative to an origin nearby. Three sums of products give places along the sketch times
//! depth, and depth, each wrong by no more than a bound that the magnitudes tell; so a place is wrong by
//! no more than the sketch's margin for points that are deeper than some limit, which is found by solving
//! for it. Points nearer than that are in doubt. Nothing depends on how sums are rounded.

use super::bounds::Bounds;
use crate::probe::coefficients::CameraCoefficients;
use crate::silhouette::{BitMap, CODES, COLUMNS, PixelRect, ROWS, SKETCH_SIDES, Sketch, UNKNOWN, UNSEEN};

/// What a rounding to single precision may change, and to double.
const SINGLE: f64 = 1.0 / (1u64 << 24) as f64;
const DOUBLE: f64 = 1.0 / (1u64 << 53) as f64;
/// Roundings of a sum of four products, with those of its terms, and some more.
const SUM: f64 = 10.0 * SINGLE;
/// The same for all that [`crate::Camera::pixel`] rounds, and the rows below.
const TWIN: f64 = 64.0 * DOUBLE;
/// Roundings of a quotient in single precision, however it is found.
const QUOTIENT: f64 = 8.0 * SINGLE;
/// Roundings of a lens's polynomial.
const LENS: f64 = 32.0 * SINGLE;
/// Larger numbers are not trusted to single precision.
const LARGEST: f64 = 1e15;

/// One camera at one frame: a sketch of its silhouette and how points come to it.
#[derive(Clone, Debug)]
pub(crate) struct Sieve {
    pub(crate) sketch: Sketch,
    /// Along, down and depth; with a lens that bends, the first two before it.
    rows: [Row; 3],
    /// What stands beside a straight lens is not read.
    lens: SieveLens,
    straight: bool,
    /// How wrong a place may be before it is divided: see [`Sieve::about`].
    slack: [f64; 2],
    /// How far places may be from zero.
    farthest: [f64; 2],
}

/// A sum of products.
#[derive(Clone, Copy, Debug)]
struct Row {
    factors: [f64; 3],
    constant: f64,
    /// The sums of the absolute values of what the numbers above are sums of.
    whole_factors: [f64; 3],
    whole_constant: f64,
}

/// A lens in single precision.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SieveLens {
    /// k1 k2 p1 p2 k3.
    pub coefficients: [f32; 5],
    /// From bent coordinates to cells: fx, skew, cx, fy, cy.
    pub affine: [f32; 5],
    /// Up to this squared radius places are certain.
    pub certain: f32,
    /// From this squared radius on nothing is seen.
    pub unseen: f32,
}

/// A sieve about an origin.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    /// Factors of a point relative to the origin, and a constant: along, down, depth.
    pub rows: [[f32; 4]; 3],
    /// Deeper points have a certain place.
    pub certain: f32,
    /// Points of this depth or less are behind the camera. Not a number if nothing is certain.
    pub behind: f32,
    /// True if all points are deep enough.
    pub all_certain: bool,
}

impl Sieve {
    /// The sieve of a camera whose foreground lies within a rectangle, and how its image stretches.
    pub fn new(
        coefficients: &CameraCoefficients,
        image: &Bounds,
        map: &BitMap,
        bounds: Option<PixelRect>,
    ) -> Sieve {
        let sketch = Sketch::new(map, bounds);
        let [fx, skew, cx, fy, cy] = coefficients.affine;
        let ([u0, v0], [su, sv]) = (sketch.origin, sketch.scale);
        let depth = Row::of(coefficients, [0.0, 0.0, 1.0], 0.0);
        let sides = SKETCH_SIDES.map(|side| side as f64 + 1.0);
        let sizes = cx.abs() + u0.abs() + cy.abs() + v0.abs() + sides[0] / su + sides[1] / sv;
        let [error_u, error_v] = sketch.margin_pixels.map(|margin| margin - TWIN * sizes);
        if coefficients.straight {
            let rows = [
                Row::of(coefficients, [su * fx, su * skew, su * (cx - u0)], su * (cx.abs() + u0.abs())),
                Row::of(coefficients, [0.0, sv * fy, sv * (cy - v0)], sv * (cy.abs() + v0.abs())),
                depth,
            ];
            let slack = [error_u * su - QUOTIENT * sides[0], error_v * sv - QUOTIENT * sides[1]];
            let lens = SieveLens::default();
            return Sieve { sketch, rows, lens, straight: true, slack, farthest: sides };
        }
        let rows =
            [Row::of(coefficients, [1.0, 0.0, 0.0], 0.0), Row::of(coefficients, [0.0, 1.0, 0.0], 0.0), depth];
        let reach = image.reach;
        let [k1, k2, p1, p2, k3] = coefficients.lens.map(f64::abs);
        let s = reach * reach;
        let bent = reach * (1.0 + s * (k1 + s * (k2 + s * k3)) + 4.0 * reach * (p1 + p2));
        let sizes = (fx + skew.abs()).max(fy) * bent + (cx - u0).abs().max((cy - v0).abs());
        // How wrong each normalised coordinate may be.
        let apart = (error_u.min(error_v) - LENS * sizes) / (3.0 * image.stretch);
        let certain = (reach - 2.0 * apart).max(0.0);
        let unseen = coefficients.max_radius_squared.sqrt() * (1.0 + 2.0 * apart / reach);
        let lens = SieveLens {
            coefficients: coefficients.lens.map(|k| k as f32),
            affine: [su * fx, su * skew, su * (cx - u0), sv * fy, sv * (cy - v0)].map(|a| a as f32),
            certain: (certain * certain * (1.0 - QUOTIENT)) as f32,
            unseen: (unseen * unseen * (1.0 + QUOTIENT)) as f32,
        };
        let slack = [apart - QUOTIENT * reach; 2];
        Sieve { sketch, rows, lens, straight: false, slack, farthest: [reach; 2] }
    }

    /// The lens if it bends.
    #[inline(always)]
    pub(crate) fn lens(&self) -> Option<&SieveLens> {
        (!self.straight).then_some(&self.lens)
    }

    /// What every cell says, and what beyond them.
    #[inline(always)]
    pub(crate) fn codes(&self) -> &[u8; CODES] {
        &self.sketch.codes
    }

    /// The sums for points whose coordinates are no farther than `largest` from the origin's.
    ///
    /// With a = A / Z and errors eA, eZ of both, and Z at least z: `|Δa| ≤ (eA + |a| eZ) / (z − eZ)`, which
    /// is to be the slack.
    #[inline(always)]
    pub(crate) fn about(&self, origin: &[f64; 3], largest: &[f64; 3]) -> Sums {
        let whole: [f64; 3] = std::array::from_fn(|axis| origin[axis].abs() + largest[axis]);
        let constants = self.rows.map(|row| dot(&row.factors, origin) + row.constant);
        let sizes = self.rows.map(|row| dot(&row.factors.map(f64::abs), largest));
        let wrong = |at: usize| {
            let row = &self.rows[at];
            let twin = dot(&row.whole_factors, &whole) + row.whole_constant;
            SUM * (sizes[at] + constants[at].abs()) + TWIN * twin + 1e-30
        };
        let depth = wrong(2);
        let limit = |at: usize| depth + (wrong(at) + self.farthest[at] * depth) / self.slack[at];
        let certain = limit(0).max(limit(1));
        let is_certain = self.slack[0] > 0.0
            && self.slack[1] > 0.0
            && certain < LARGEST
            && wrong(0).max(wrong(1)) < LARGEST;
        let unless = |number: f64| if is_certain { (number * (1.0 + QUOTIENT)) as f32 } else { f32::NAN };
        let row = |at: usize| {
            let [a, b, c] = self.rows[at].factors.map(|factor| factor as f32);
            [a, b, c, constants[at] as f32]
        };
        let least_depth = constants[2] - sizes[2] - depth;
        Sums {
            rows: std::array::from_fn(row),
            certain: unless(certain),
            behind: -unless(depth),
            all_certain: is_certain && least_depth > 1.001 * certain,
        }
    }
}

impl Row {
    /// `factors` of a point in the camera; what of the last cancelled out is added to `whole`.
    fn of(coefficients: &CameraCoefficients, factors: [f64; 3], whole: f64) -> Row {
        let (r, t) = (&coefficients.rotation, &coefficients.translation);
        let whole_factors = [factors[0].abs(), factors[1].abs(), factors[2].abs() + whole];
        let products: [f64; 3] =
            std::array::from_fn(|axis| (0..3).map(|row| factors[row] * r[row][axis]).sum());
        let wholes: [f64; 3] =
            std::array::from_fn(|axis| (0..3).map(|row| whole_factors[row] * r[row][axis].abs()).sum());
        Row {
            factors: products,
            constant: (0..3).map(|row| factors[row] * t[row]).sum(),
            whole_factors: wholes,
            whole_constant: (0..3).map(|row| whole_factors[row] * t[row].abs()).sum(),
        }
    }
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Sums {
    /// The cells of points.
    #[inline(always)]
    pub fn cells(&self, sieve: &Sieve, points: (&[f32], &[f32], &[f32]), cells: &mut [u32]) {
        if !sieve.straight {
            self.cells_of::<false, false>(sieve, points, cells);
        } else if self.all_certain {
            self.cells_of::<true, true>(sieve, points, cells);
        } else {
            self.cells_of::<true, false>(sieve, points, cells);
        }
    }

    #[inline(always)]
    fn cells_of<const STRAIGHT: bool, const CERTAIN: bool>(
        &self,
        sieve: &Sieve,
        (x, y, z): (&[f32], &[f32], &[f32]),
        cells: &mut [u32],
    ) {
        for (((cell, &x), &y), &z) in cells.iter_mut().zip(x).zip(y).zip(z) {
            *cell = self.cell::<STRAIGHT, CERTAIN>(sieve, x, y, z);
        }
    }

    /// The cell of a point, or one of the two codes beyond the cells.
    #[inline(always)]
    pub fn cell<const STRAIGHT: bool, const CERTAIN: bool>(
        &self,
        sieve: &Sieve,
        x: f32,
        y: f32,
        z: f32,
    ) -> u32 {
        let (s, t, certain, unseen) = self.place::<STRAIGHT>(sieve, x, y, z);
        let cell = cell(s, t);
        if CERTAIN {
            return cell;
        }
        let doubtful = if unseen { UNSEEN } else { UNKNOWN };
        if certain { cell } else { doubtful }
    }

    /// Where a point is on the sketch, whether that is certain, and whether the point is unseen at all.
    #[inline(always)]
    fn place<const STRAIGHT: bool>(&self, sieve: &Sieve, x: f32, y: f32, z: f32) -> (f32, f32, bool, bool) {
        let [along, down, depth] = self.rows;
        let depth = depth[0] * x + depth[1] * y + depth[2] * z + depth[3];
        let inverse = 1.0 / depth;
        let mut s = (along[0] * x + along[1] * y + along[2] * z + along[3]) * inverse;
        let mut t = (down[0] * x + down[1] * y + down[2] * z + down[3]) * inverse;
        let mut certain = depth > self.certain;
        let mut unseen = depth <= self.behind;
        if !STRAIGHT {
            let lens = &sieve.lens;
            let squared = s * s + t * t;
            certain &= squared < lens.certain;
            unseen |= squared > lens.unseen;
            (s, t) = lens.bent(s, t, squared);
        }
        (s, t, certain, unseen)
    }
}

impl SieveLens {
    #[inline(always)]
    fn bent(&self, x: f32, y: f32, squared: f32) -> (f32, f32) {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let [fx, skew, cx, fy, cy] = self.affine;
        let c = 1.0 + squared * (k1 + squared * (k2 + squared * k3));
        let xy = x * y;
        let across = c * x + 2.0 * p1 * xy + p2 * (squared + 2.0 * x * x);
        let down = c * y + p1 * (squared + 2.0 * y * y) + 2.0 * p2 * xy;
        (fx * across + skew * down + cx, fy * down + cy)
    }
}

/// The cell of a place. Places beyond are taken for ones in the border's cells, which say the same. Done with
/// sums alone, so that loops around it vectorise on every processor; a whole number along may be taken for a
/// little less.
#[inline(always)]
fn cell(s: f32, t: f32) -> u32 {
    /// In singles of this size, and half, the last binary digit is one.
    const UNIT_LESS_HALF: f32 = 8_388_607.5;
    /// The same for digits that stand where a row's columns end.
    const ROW_LESS_HALF: f32 = UNIT_LESS_HALF / COLUMNS as f32;
    const COLUMN: u32 = COLUMNS as u32 - 1;
    digits(t, ROWS, ROW_LESS_HALF) & ((ROWS as u32 - 1) * COLUMNS as u32)
        | digits(s, COLUMNS, UNIT_LESS_HALF) & COLUMN
}

/// The digits of a number from zero to less than the end, or the nearest that is, added to another.
#[inline(always)]
fn digits(number: f32, end: usize, sum: f32) -> u32 {
    let last = end as f32 - 0.5;
    let number = if number > 0.5 { number } else { 0.5 };
    let number = if number < last { number } else { last };
    (number + sum).to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::tests::plain_camera;
    use crate::silhouette::tests::random_mask;
    use crate::{Observer, ProbeSettings, Silhouette, View};
    use nalgebra::{Point3, Vector3};
    use proptest::prelude::*;
    use std::sync::Arc;

    fn far_camera(bent: bool, scale: u32, offset_m: f64) -> crate::Camera {
        let camera = plain_camera(if bent { [-0.3, 0.1, 0.002, -0.002, 0.01] } else { [0.0; 5] });
        let size = (640 * scale, 480 * scale);
        let mut k = camera.intrinsics().scale(f64::from(scale));
        k[(2, 2)] = 1.0;
        let translation = camera.translation_m() - camera.rotation() * Vector3::repeat(offset_m);
        let lens = camera.lens().coefficients();
        crate::Camera::new("far", size, k, lens, *camera.rotation_rad(), translation).expect("valid")
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn a_certain_place_is_within_the_margin(
            seed in any::<u64>(), bent in any::<bool>(), scale in 1u32..13, spread in 0i32..7,
            offset in prop_oneof![Just(0.0), Just(30.0), Just(-1e4), Just(1e7)],
            shares in prop::collection::vec([-1.0f64..1.0, -1.0..1.0, -1.0..1.0], 1..60),
        ) {
            let camera = far_camera(bent, scale, offset);
            let (width, height) = (camera.width(), camera.height());
            let mask = random_mask(64, 64, seed);
            let mut all = vec![0; (width * height) as usize];
            for (row, pixels) in mask.chunks(64).enumerate() {
                let first = (row + (seed % u64::from(height - 64)) as usize) * width as usize;
                all[first + (seed >> 20) as usize % (width as usize - 64)..][..64].copy_from_slice(pixels);
            }
            let silhouette = Silhouette::from_mask(width, height, &all).expect("size");
            let observer = Observer::new(camera.clone(), 0, ProbeSettings::default(), None);
            let view = View::new(Arc::new(observer), &silhouette);
            let sieve = view.sieve();
            let spread = 10f64.powi(spread - 4);
            let centre = Point3::new(0.1, -0.2, 3.0) + Vector3::repeat(offset);
            let points: Vec<Point3<f64>> =
                shares.iter().map(|&share| centre + Vector3::from(share) * spread).collect();
            let origin: [f64; 3] = points[0].into();
            let near = |point: &Point3<f64>| -> [f32; 3] {
                std::array::from_fn(|axis| (point[axis] - origin[axis]) as f32)
            };
            let largest = std::array::from_fn(|axis| {
                points.iter().map(|point| f64::from(near(point)[axis].abs())).fold(0.0, f64::max)
            });
            let sums = sieve.about(&origin, &largest);
            for point in &points {
                let [x, y, z] = near(point);
                let (s, t, certain, unseen) = match sieve.lens() {
                    Some(_) => sums.place::<false>(sieve, x, y, z),
                    None => sums.place::<true>(sieve, x, y, z),
                };
                let exact = camera.project(point);
                prop_assert!(!(unseen && exact.is_some()), "seen at {point}");
                prop_assert!(!sums.all_certain || bent || certain, "{point} is not deep");
                let Some(exact) = exact.filter(|_| certain) else {
                    prop_assert!(!certain, "unseen at {point}");
                    continue;
                };
                let sketch = &sieve.sketch;
                let place = [(s, exact.x), (t, exact.y)];
                for (axis, (place, exact)) in place.into_iter().enumerate() {
                    let side = SKETCH_SIDES[axis] as f64;
                    let cells = (exact - sketch.origin[axis]) * sketch.scale[axis];
                    let apart = (f64::from(place) - cells).abs() / sketch.scale[axis];
                    // Beyond the cells it need not be near, only beyond.
                    let beyond = |cells: f64| !(0.0..=side).contains(&cells);
                    let both = beyond(cells) && beyond(f64::from(place));
                    prop_assert!(both || apart < sketch.margin_pixels[axis], "{point}: {apart} pixels");
                }
            }
        }
    }

    #[test]
    fn a_cell_is_that_of_the_whole_parts() {
        let whole = |number: f32, end: usize| (number.floor() as i32).clamp(0, end as i32 - 1) as u32;
        let numbers = |end: usize| (-2..end as i32 + 3).map(|number| number as f32);
        for (s, t) in numbers(COLUMNS).flat_map(|s| numbers(ROWS).map(move |t| (s, t))) {
            for (s, t) in [(s.next_up(), t.next_down()), (s.next_down(), t.next_up()), (s + 0.5, t + 0.98)] {
                assert_eq!(cell(s, t), whole(t, ROWS) * COLUMNS as u32 + whole(s, COLUMNS), "{s} {t}");
            }
        }
        assert_eq!(cell(1e30, -1e30), COLUMNS as u32 - 1);
    }

    #[test]
    fn near_points_about_a_near_origin_are_certain() {
        for scale in [1, 4, 12] {
            let camera = far_camera(false, scale, 1000.0);
            let mask = vec![1; (camera.width() * camera.height()) as usize];
            let silhouette = Silhouette::from_mask(camera.width(), camera.height(), &mask).expect("size");
            let observer = Observer::new(camera.clone(), 0, ProbeSettings::default(), None);
            let view = View::new(Arc::new(observer), &silhouette);
            let origin = camera.centre_world() + camera.rotation().row(2).transpose() * 3.0;
            let sums = view.sieve().about(&origin.into(), &[1.0; 3]);
            assert!(sums.certain > 0.0 && sums.certain < 0.1 * scale as f32, "{sums:?}");
            assert!(sums.all_certain, "{sums:?}");
            assert!(view.sieve().about(&origin.into(), &[f64::NAN, 1.0, 1.0]).certain.is_nan());
        }
    }
}
