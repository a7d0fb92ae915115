//! Inside, outside or unknown (paper §4.1): one projection and one bit. Of many points a sketch of the
//! silhouette decides most, in single precision, and the others are looked up in double precision: the answers
//! are those of the latter alone.

#[cfg(target_arch = "x86_64")]
mod avx512;
mod doubts;

use std::ops::Range;

use nalgebra::Point3;

use crate::coordinates::Coordinates;
use crate::silhouette::{CODES, NONE};
use crate::vector::VectorPath;
use crate::view::sieve::Sums;
use crate::view::{Class, View};
use doubts::Lookup;

/// Points are classified in blocks of this many: as many as stay in the nearest cache.
pub const BLOCK: usize = 2048;

/// Room for that, and so much more that neighbours of a point do not lie at like addresses, which some
/// processors take for the same.
const ROOM: usize = BLOCK + 80;
/// Binary digits of a place in a block.
const PLACE: u32 = BLOCK.ilog2();
/// Views whose doubts are noted before they are resolved: the digits that are left.
const GROUP: usize = (u32::BITS - PLACE) as usize;
/// Points whose cells are found before one is looked up.
const CHUNK: usize = 256;
/// Views whose sketches are asked together before points are dropped, the first of a group and all others.
const FIRST_STAGE: usize = 2;
const STAGE: usize = 6;

impl View {
    /// What this camera says of one point.
    #[inline]
    pub fn classify(&self, point_world: &Point3<f64>) -> Class {
        self.class_at(self.camera().pixel(point_world))
    }
}

/// A block of points that no camera has rejected yet.
#[derive(Clone, Debug)]
pub struct Block {
    /// Relative to an origin.
    x: [f32; ROOM],
    y: [f32; ROOM],
    z: [f32; ROOM],
    /// The place in the block and, above it, a bit for each view of a group whose sketch does not decide.
    tag: [u32; ROOM],
    /// The next point with a doubt about the same view.
    next: [u32; ROOM],
    /// The points with doubts.
    doubtful: [u32; ROOM],
    /// Where on a view's sketch some of the points lie.
    cells: [[u32; CHUNK]; STAGE],
    lookup: Lookup,
    len: usize,
    origin: [f64; 3],
    /// How far points are from it, along each axis.
    largest: [f64; 3],
}

impl Default for Block {
    fn default() -> Block {
        Block {
            x: [0.0; ROOM],
            y: [0.0; ROOM],
            z: [0.0; ROOM],
            tag: [0; ROOM],
            next: [0; ROOM],
            doubtful: [0; ROOM],
            cells: [[0; CHUNK]; STAGE],
            lookup: Lookup::default(),
            len: 0,
            origin: [0.0; 3],
            largest: [0.0; 3],
        }
    }
}

impl Block {
    /// Finds the points, of at most [`BLOCK`] at `from..`, that are on the foreground of every view, asked
    /// in this order. For views that are never silent, these are the points that no camera calls outside.
    #[inline(always)]
    pub fn keep_inside(
        &mut self,
        points_world: &Coordinates,
        from: usize,
        views: &[View],
        order: &[usize],
        path: VectorPath,
    ) {
        self.load(points_world, from);
        for group in order.chunks(GROUP) {
            let is_last = group.len() < GROUP;
            self.sift(views, group, is_last, path);
            self.resolve(points_world, from, views, group, is_last);
        }
    }

    /// The places, counted from the block's first, of the points that no camera has rejected, in their order.
    #[inline(always)]
    pub fn places(&self) -> &[u32] {
        &self.tag[..self.len]
    }

    #[inline(always)]
    fn load(&mut self, points_world: &Coordinates, from: usize) {
        let end = points_world.len().min(from + BLOCK);
        self.len = end - from;
        self.origin = points_world.point(from).into();
        for (axis, (all, near)) in
            [(&points_world.x, &mut self.x), (&points_world.y, &mut self.y), (&points_world.z, &mut self.z)]
                .into_iter()
                .enumerate()
        {
            self.largest[axis] = load_axis(&all[from..end], self.origin[axis], near);
        }
        for (tag, at) in self.tag[..self.len].iter_mut().zip(0..) {
            *tag = at;
        }
    }

    /// Drops the points that a view's sketch rejects, and notes those that it does not decide.
    #[inline(always)]
    fn sift(&mut self, views: &[View], group: &[usize], is_last: bool, path: VectorPath) {
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            for (number, &view) in group.iter().enumerate() {
                let sieve = views[view].sieve();
                let sums = sieve.about(&self.origin, &self.largest);
                #[allow(
                    unsafe_code,
                    reason = "the path was asked whether it is available when it was chosen"
                )]
                unsafe {
                    avx512::sift(self, sieve, &sums, 1 << (PLACE + number as u32));
                }
            }
            return;
        }
        let _ = path;
        let mut first = 0;
        while first < group.len() {
            let width = if first == 0 { FIRST_STAGE } else { STAGE };
            let stage = &group[first..group.len().min(first + width)];
            self.stage(views, stage, first, is_last && first + stage.len() == group.len());
            first += stage.len();
        }
    }

    /// The same for some views of a group, whose sketches are all asked before points are dropped.
    #[inline(always)]
    fn stage(&mut self, views: &[View], stage: &[usize], number: usize, is_last: bool) {
        let nothing = (views[stage[0]].sieve(), Sums::default());
        let mut asked = [nothing; STAGE];
        for (asked, &view) in asked.iter_mut().zip(stage) {
            let sieve = views[view].sieve();
            *asked = (sieve, sieve.about(&self.origin, &self.largest));
        }
        let codes = asked.map(|(sieve, _)| sieve.codes());
        let doubts = PLACE + number as u32;
        let mut kept = 0;
        let mut from = 0;
        while from < self.len {
            let count = (self.len - from).min(CHUNK);
            // Whole vectors, but not those that hold no point any more.
            let lanes = count.next_multiple_of(8).min(BLOCK - from);
            let (x, y, z) = (&self.x[from..][..lanes], &self.y[from..][..lanes], &self.z[from..][..lanes]);
            for ((cells, (sieve, sums)), _) in self.cells.iter_mut().zip(&asked).zip(stage) {
                sums.cells(sieve, (x, y, z), cells);
            }
            let range = from..from + count;
            kept = match stage.len() {
                1 => self.keep::<1>(range, kept, &codes, doubts, is_last),
                2 => self.keep::<2>(range, kept, &codes, doubts, is_last),
                3 => self.keep::<3>(range, kept, &codes, doubts, is_last),
                4 => self.keep::<4>(range, kept, &codes, doubts, is_last),
                5 => self.keep::<5>(range, kept, &codes, doubts, is_last),
                _ => self.keep::<6>(range, kept, &codes, doubts, is_last),
            };
            from += count;
        }
        self.len = kept;
    }

    /// Moves the points of a range that no sketch of a stage rejects to those kept before, and returns how many
    /// are kept then. Of the last stage's points only the tag is read later.
    #[inline(always)]
    fn keep<const VIEWS: usize>(
        &mut self,
        range: Range<usize>,
        kept: usize,
        codes: &[&[u8; CODES]; STAGE],
        doubts: u32,
        is_last: bool,
    ) -> usize {
        if is_last {
            self.keep_some::<VIEWS, false>(range, kept, codes, doubts)
        } else {
            self.keep_some::<VIEWS, true>(range, kept, codes, doubts)
        }
    }

    #[inline(always)]
    fn keep_some<const VIEWS: usize, const ALL: bool>(
        &mut self,
        range: Range<usize>,
        mut kept: usize,
        codes: &[&[u8; CODES]; STAGE],
        doubts: u32,
    ) -> usize {
        let first = range.start;
        for at in range {
            let mut told = 0;
            for view in (0..VIEWS).rev() {
                let cell = self.cells[view][(at - first) % CHUNK];
                told = 2 * told + u32::from(codes[view][cell as usize % CODES]);
            }
            // Written always, counted when kept: no branch to mispredict.
            let (at, to) = (at % BLOCK, kept % BLOCK);
            if ALL {
                self.x[to] = self.x[at];
                self.y[to] = self.y[at];
                self.z[to] = self.z[at];
            }
            self.tag[to] = self.tag[at] | told << doubts;
            kept += usize::from(told < u32::from(NONE));
        }
        kept
    }
}

/// Coordinates relative to an origin, and how far the farthest is; not a number if one is none.
#[inline(always)]
fn load_axis(all: &[f64], origin: f64, near: &mut [f32; ROOM]) -> f64 {
    let near = &mut near[..all.len()];
    for (near, number) in near.iter_mut().zip(all) {
        *near = (number - origin) as f32;
    }
    // Positive numbers are in the order of their bits, and what is none comes last.
    let bits = near.iter().map(|near| (near.to_bits() & 0x7fff_ffff) as i32);
    f64::from(f32::from_bits(bits.fold(0, i32::max) as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::tests::plain_camera;
    use crate::silhouette::tests::random_mask;
    use crate::{Observer, ProbeSettings, Silhouette};
    use proptest::prelude::*;
    use std::sync::Arc;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn every_path_keeps_the_points_that_are_inside(
            seed in any::<u64>(), bent in any::<bool>(), count in 1usize..3000, scale in 1u32..5,
            // More views than a group holds, too.
            views in prop_oneof![Just(1), Just(2), Just(2 * GROUP + 1)],
            strange in prop_oneof![Just(f64::MAX), Just(-1e300), Just(-3.0), Just(0.0), Just(f64::MIN_POSITIVE)],
        ) {
            let camera = plain_camera(if bent { [-0.3, 0.1, 0.002, -0.002, 0.01] } else { [0.0; 5] });
            let size = (640 * scale, 480 * scale);
            let k = camera.intrinsics().scale(f64::from(scale)) - nalgebra::Matrix3::from_diagonal(
                &nalgebra::Vector3::new(0.0, 0.0, f64::from(scale) - 1.0),
            );
            let (rotation, translation) = (*camera.rotation_rad(), *camera.translation_m());
            let lens = camera.lens().coefficients();
            let camera = crate::Camera::new("large", size, k, lens, rotation, translation).expect("valid");
            let mask = random_mask(size.0, size.1, seed);
            let silhouette = Silhouette::from_mask(size.0, size.1, &mask).expect("size");
            let observer = Observer::new(camera, 0, ProbeSettings::default(), None);
            let view = View::new(Arc::new(observer), &silhouette);
            let mut state = seed | 1;
            let mut share = || {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 33) as f64 / (1u64 << 31) as f64
            };
            let mut points: Vec<Point3<f64>> = (0..count)
                .map(|_| Point3::new(4.0 * share() - 2.0, 3.0 * share() - 1.5, 6.0 * share() - 4.0))
                .collect();
            points[count / 2] = Point3::new(strange, 0.0, strange);
            points[count - 1] = Point3::new(0.0, strange, -3.0 + strange.abs().min(1e-310));
            let inside: Vec<u32> = (0..)
                .zip(&points)
                .filter(|(_, point)| view.classify(point) == Class::Inside)
                .map(|(place, _)| place)
                .collect();
            let coordinates: Coordinates = points.iter().copied().collect();
            let views = vec![view; views];
            let order: Vec<usize> = (0..views.len()).collect();
            for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                let mut block = Box::new(Block::default());
                let mut kept = Vec::new();
                for from in (0..count).step_by(BLOCK) {
                    block.keep_inside(&coordinates, from, &views, &order, path);
                    kept.extend(block.places().iter().map(|&place| from as u32 + place));
                }
                prop_assert_eq!(&kept, &inside, "{:?}", path);
            }
        }
    }
}
