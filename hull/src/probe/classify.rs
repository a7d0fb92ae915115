//! Inside, outside or unknown (paper §4.1): one projection and one bit.

use multiversion::multiversion;
use nalgebra::Point3;

use crate::camera::floor;
use crate::view::{Class, View};

/// Points are classified in blocks of this many: large enough that a camera's bit map is read while it is
/// in the cache, small enough that the points stay there too.
pub const BLOCK: usize = 1024;

/// Points per vector of the widest instructions there are, twice.
const LANES: usize = 16;

const MISSED: u32 = u32::MAX;

impl View {
    /// What this camera says of one point.
    pub fn classify(&self, point_world: &Point3<f64>) -> Class {
        self.class_at(self.camera().pixel(point_world))
    }
}

/// A block of points as structure of arrays, with the place each came from.
#[derive(Clone, Debug)]
pub struct Block {
    x: [f64; BLOCK],
    y: [f64; BLOCK],
    z: [f64; BLOCK],
    place: [u32; BLOCK],
    address: [u32; BLOCK],
    len: usize,
}

impl Default for Block {
    fn default() -> Block {
        Block {
            x: [0.0; BLOCK],
            y: [0.0; BLOCK],
            z: [0.0; BLOCK],
            place: [0; BLOCK],
            address: [0; BLOCK],
            len: 0,
        }
    }
}

impl Block {
    /// Fills the block from up to [`BLOCK`] points; they count from `first`.
    pub fn load(&mut self, points_world: &[Point3<f64>], first: u32) {
        self.len = points_world.len().min(BLOCK);
        for (index, point) in points_world.iter().take(BLOCK).enumerate() {
            self.x[index] = point.x;
            self.y[index] = point.y;
            self.z[index] = point.z;
            self.place[index] = first + index as u32;
        }
    }

    /// The places of the points that no camera has rejected yet.
    pub fn places(&self) -> &[u32] {
        &self.place[..self.len]
    }

    /// Drops the points that are not on the view's foreground. For views that always judge, these are
    /// the points that the camera calls outside.
    pub fn keep_foreground(&mut self, view: &View) {
        let map = view.foreground().map();
        let frame = Frame::of(view);
        // Whole vectors, but not those that hold no point any more.
        let lanes = self.len.next_multiple_of(LANES);
        let (x, y, z) = (&self.x[..lanes], &self.y[..lanes], &self.z[..lanes]);
        addresses(&frame, x, y, z, &mut self.address[..lanes]);
        let mut kept = 0;
        for index in 0..self.len {
            let address = self.address[index];
            // Written always, counted when kept: no branch to mispredict.
            self.x[kept] = self.x[index];
            self.y[kept] = self.y[index];
            self.z[kept] = self.z[index];
            self.place[kept] = self.place[index];
            kept += usize::from(
                address != MISSED && map.words()[(address >> 5) as usize] >> (address & 31) & 1 != 0,
            );
        }
        self.len = kept;
    }
}

/// A view's numbers for the inner loop.
struct Frame {
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    affine: [f64; 5],
    lens: [f64; 5],
    straight: bool,
    max_radius_squared: f64,
    left: i32,
    top: i32,
    columns: u32,
    rows: u32,
    width: u32,
    height: u32,
}

impl Frame {
    fn of(view: &View) -> Frame {
        let (camera, map) = (view.camera(), view.foreground().map());
        let (r, t, k) = (camera.rotation(), camera.translation_m(), camera.intrinsics());
        Frame {
            rotation: std::array::from_fn(|row| std::array::from_fn(|column| r[(row, column)])),
            translation: [t.x, t.y, t.z],
            affine: [k[(0, 0)], k[(0, 1)], k[(0, 2)], k[(1, 1)], k[(1, 2)]],
            lens: camera.lens().coefficients(),
            straight: camera.lens().is_straight(),
            max_radius_squared: camera.lens().max_radius_squared(),
            left: map.left(),
            top: map.top(),
            columns: (map.right() - map.left()) as u32,
            rows: map.rows() as u32,
            width: camera.width(),
            height: camera.height(),
        }
    }
}

/// The address of each point's pixel in the view's bit map, or [`MISSED`]. The same operations in the
/// same order as [`crate::Camera::pixel`], so the same bits.
#[multiversion(targets("x86_64+avx512f+avx512dq+avx512vl+avx512bw+avx2", "x86_64+avx2"))]
fn addresses(frame: &Frame, x: &[f64], y: &[f64], z: &[f64], address: &mut [u32]) {
    let count = address.len();
    let (x, y, z) = (&x[..count], &y[..count], &z[..count]);
    let [r0, r1, r2] = frame.rotation;
    let [tx, ty, tz] = frame.translation;
    let [fx, skew, cx, fy, cy] = frame.affine;
    let [k1, k2, p1, p2, k3] = frame.lens;
    for i in 0..count {
        let xc = r0[0] * x[i] + r0[1] * y[i] + r0[2] * z[i] + tx;
        let yc = r1[0] * x[i] + r1[1] * y[i] + r1[2] * z[i] + ty;
        let zc = r2[0] * x[i] + r2[1] * y[i] + r2[2] * z[i] + tz;
        let inverse_depth = 1.0 / zc;
        let (mut xn, mut yn) = (xc * inverse_depth, yc * inverse_depth);
        let mut seen = zc > 0.0;
        if !frame.straight {
            let radius_squared = xn * xn + yn * yn;
            seen &= radius_squared < frame.max_radius_squared;
            let c = 1.0 + radius_squared * (k1 + radius_squared * (k2 + radius_squared * k3));
            let xy = xn * yn;
            let bent = (
                c * xn + 2.0 * p1 * xy + p2 * (radius_squared + 2.0 * xn * xn),
                c * yn + p1 * (radius_squared + 2.0 * yn * yn) + 2.0 * p2 * xy,
            );
            (xn, yn) = bent;
        }
        let column = floor(fx * xn + skew * yn + cx + 0.5);
        let row = floor(fy * yn + cy + 0.5);
        seen &= (column as u32) < frame.width && (row as u32) < frame.height;
        let column = column.wrapping_sub(frame.left) as u32;
        let row = row.wrapping_sub(frame.top) as u32;
        seen &= column < frame.columns && row < frame.rows;
        let at = ((column >> 5) * frame.rows + row) << 5 | (column & 31);
        address[i] = if seen { at } else { MISSED };
    }
}
