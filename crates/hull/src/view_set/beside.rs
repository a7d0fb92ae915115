//! What bounds the search for planes from outside: cameras that cannot have the farthest plane of a point are not searched.

use super::projections::{CHUNK, Projection};
use crate::camera::Pixel;
use crate::vector::VectorPath;
use crate::view::{Class, View};

/// How far off a view's planes of points may be that it says are outside.
#[derive(Clone, Debug)]
pub(super) struct Beside {
    /// Metres; negative where it has none.
    pub most_m: [f32; CHUNK],
    /// The foreground is no nearer than this, pixels squared.
    pub clear_squared: [i32; CHUNK],
    /// The foreground is searched so far, pixels squared.
    pub limit_squared: [i32; CHUNK],
    /// A plane's line is so much farther than the foreground, pixels.
    pub slack_pixels: f32,
}

impl Default for Beside {
    fn default() -> Beside {
        Beside {
            most_m: [-1.0; CHUNK],
            clear_squared: [0; CHUNK],
            limit_squared: [0; CHUNK],
            slack_pixels: 0.0,
        }
    }
}

impl Beside {
    /// Of the points of a chunk that are no farther from a plane than their reaches.
    #[inline(always)]
    pub fn bound(
        &mut self,
        view: &View,
        projection: &Projection,
        reaches_m: &[f32; CHUNK],
        count: usize,
        path: VectorPath,
    ) {
        let (surroundings, camera) = (view.surroundings(), view.camera());
        // From a pixel's centre to a place in it, and from an edge pixel's to its line.
        self.slack_pixels = 0.7073 + view.observer().disc_pixels() as f32;
        let (column, row) = (&projection.column, &projection.row);
        let mut within_squared = [0; CHUNK];
        surroundings.look_up(column, row, &mut self.clear_squared, &mut within_squared, path);
        projection.bounds_beside(
            (camera.width(), camera.height()),
            reaches_m,
            self.slack_pixels,
            [&self.clear_squared, &within_squared],
            (&mut self.most_m, &mut self.limit_squared),
        );
        self.most_m[count..].fill(-1.0);
        if !view.is_plain() {
            for at in 0..count {
                let start = Pixel { column: column[at], row: row[at] };
                if self.most_m[at] >= 0.0 && view.class_at(Some(start)) != Class::Outside {
                    self.most_m[at] = -1.0;
                }
            }
        }
    }
}
