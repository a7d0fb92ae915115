//! Inside, outside or unknown (paper §4.1): one projection and one bit.

#[cfg(target_arch = "x86_64")]
mod avx512;

use nalgebra::Point3;

use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::probe::frame::Frame;
use crate::silhouette::BitMap;
use crate::vector::VectorPath;
use crate::view::{Class, View};

/// Points are classified in blocks of this many: large enough that a camera's bit map is read while it is
/// in the cache, small enough that the points stay there too.
pub const BLOCK: usize = 4096;

impl View {
    /// What this camera says of one point.
    #[inline]
    pub fn classify(&self, point_world: &Point3<f64>) -> Class {
        self.class_at(self.camera().pixel(point_world))
    }

    /// True if the point is seen on foreground.
    #[inline(always)]
    fn is_foreground(&self, point_world: &Point3<f64>) -> bool {
        let pixel = self.camera().project(point_world).map(|image| Pixel::holding(image.x, image.y));
        pixel.is_some_and(|pixel| self.foreground().map().get(pixel))
    }
}

/// A block of points that no camera has rejected yet, with the place each came from.
#[derive(Clone, Debug)]
pub struct Block {
    x: [f64; BLOCK],
    y: [f64; BLOCK],
    z: [f64; BLOCK],
    place: [u32; BLOCK],
    column: [i32; BLOCK],
    row: [i32; BLOCK],
    /// A bit for each view that has not been asked for the point's own pixel, only for its cell.
    doubts: [u32; BLOCK],
    has_doubts: bool,
    len: usize,
}

impl Default for Block {
    fn default() -> Block {
        Block {
            x: [0.0; BLOCK],
            y: [0.0; BLOCK],
            z: [0.0; BLOCK],
            place: [0; BLOCK],
            column: [0; BLOCK],
            row: [0; BLOCK],
            doubts: [0; BLOCK],
            has_doubts: false,
            len: 0,
        }
    }
}

impl Block {
    /// Fills the block from the points at `from..`, at most [`BLOCK`]; they count from `first`.
    #[inline(always)]
    pub fn load(&mut self, points_world: &Coordinates, from: usize, first: u32) {
        let end = points_world.len().min(from + BLOCK);
        self.len = end - from;
        self.doubts[..self.len].fill(0);
        self.has_doubts = false;
        self.x[..self.len].copy_from_slice(&points_world.x[from..end]);
        self.y[..self.len].copy_from_slice(&points_world.y[from..end]);
        self.z[..self.len].copy_from_slice(&points_world.z[from..end]);
        for (place, at) in self.place.iter_mut().zip(first..).take(self.len) {
            *place = at;
        }
    }

    /// The places of the points that no camera has rejected yet.
    #[inline(always)]
    pub fn places(&self) -> &[u32] {
        &self.place[..self.len]
    }

    /// Drops the points that are not on the foreground of every view, asked in this order. For views that
    /// always judge, these are the points that a camera calls outside.
    #[inline(always)]
    pub fn keep_inside(&mut self, views: &[View], order: &[usize], path: VectorPath) {
        for &view in order {
            self.keep_foreground(&views[view], view, path);
        }
        if !self.has_doubts {
            return;
        }
        let mut kept = 0;
        for index in 0..self.len {
            let point = Point3::new(self.x[index], self.y[index], self.z[index]);
            let mut doubts = self.doubts[index];
            let mut is_inside = true;
            while doubts != 0 && is_inside {
                is_inside = views[doubts.trailing_zeros() as usize].is_foreground(&point);
                doubts &= doubts - 1;
            }
            self.place[kept] = self.place[index];
            kept += usize::from(is_inside);
        }
        self.len = kept;
    }

    #[inline(always)]
    fn keep_foreground(&mut self, view: &View, number: usize, path: VectorPath) {
        let (frame, index) = (view.frame(), view.foreground());
        #[cfg(target_arch = "x86_64")]
        if path == VectorPath::Avx512 {
            #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
            unsafe {
                avx512::keep_foreground(self, frame, index, number);
            }
            return;
        }
        let _ = (path, number);
        self.keep_foreground_portable(frame, index.map());
    }

    #[inline(always)]
    fn keep_foreground_portable(&mut self, frame: &Frame, map: &BitMap) {
        // Whole vectors, but not those that hold no point any more.
        let lanes = self.len.next_multiple_of(8).min(BLOCK);
        let (x, y, z) = (&self.x[..lanes], &self.y[..lanes], &self.z[..lanes]);
        frame.pixels(x, y, z, &mut self.column[..lanes], &mut self.row[..lanes]);
        let (columns, rows) = ((map.right() - map.left()) as u32, map.rows() as u32);
        let words = map.words();
        let mut kept = 0;
        for index in 0..self.len {
            let column = self.column[index].wrapping_sub(map.left()) as u32;
            let row = self.row[index].wrapping_sub(map.top()) as u32;
            let within = (column < columns) & (row < rows);
            // Written always, counted when kept: no branch to mispredict.
            let at = if within { (column >> 5) * rows + row } else { 0 };
            let bit = words[at as usize] >> (column & 31) & 1;
            self.x[kept] = self.x[index];
            self.y[kept] = self.y[index];
            self.z[kept] = self.z[index];
            self.place[kept] = self.place[index];
            kept += usize::from(within) & bit as usize;
        }
        self.len = kept;
    }
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
            seed in any::<u64>(), bent in any::<bool>(), count in 1usize..1500, scale in 1u32..5,
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
            for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
                let mut block = Block::default();
                let mut kept = Vec::new();
                for from in (0..count).step_by(BLOCK) {
                    block.load(&coordinates, from, from as u32);
                    block.keep_inside(std::slice::from_ref(&view), &[0], path);
                    kept.extend_from_slice(block.places());
                }
                prop_assert_eq!(&kept, &inside, "{:?}", path);
            }
        }
    }
}
