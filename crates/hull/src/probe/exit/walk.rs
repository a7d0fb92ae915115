//! A walk along the image of a ray, from pixel to pixel.

use crate::camera::Pixel;
use crate::silhouette::Index;

/// The image of a ray along the axis that it crosses more pixels of, in steps of a pixel.
pub(super) struct Track {
    /// Its first pixel, on that axis.
    pub first: i32,
    /// Which way it goes, one or its negative.
    pub sign: i32,
    /// The last step that is of interest.
    pub steps: i32,
    /// What it goes along the axis of its length, at least.
    pub shrink: f64,
}

/// How a ray's image enters a pixel.
pub(super) enum Crossing {
    /// Across an edge of the axis that it is walked along: it leaves this pixel of the axis.
    Along(i32),
    /// Across an edge of the other axis, in this step: it leaves this pixel of that axis, one up or down.
    Beside { step: i32, left: i32, down: i32 },
}

impl Track {
    /// How the image first enters background. `entered` gives the pixel of the other axis that it enters a
    /// step by. Columns are the axis if `ACROSS`, else rows. What lies deep inside is skipped.
    #[inline(always)]
    pub fn first_crossing<const ACROSS: bool>(
        &self,
        foreground: &Index,
        start: i32,
        entered: impl Fn(i32) -> i32,
    ) -> Option<Crossing> {
        let (map, depth) = (foreground.map(), foreground.depth());
        let pixel = |along: i32, beside: i32| {
            if ACROSS { Pixel { column: along, row: beside } } else { Pixel { column: beside, row: along } }
        };
        let mut step = 0;
        let mut at = start;
        while step <= self.steps {
            let here = pixel(self.first + self.sign * step, at);
            let clear = f64::from(depth.clear_pixels(here.column, here.row)) - 1.0 - 1e-6;
            let skipped = (clear * self.shrink) as i32;
            if skipped > 1 {
                step += skipped;
                at = entered(step);
                continue;
            }
            if step > 0 && !map.get(here) {
                return Some(Crossing::Along(self.first + self.sign * (step - 1)));
            }
            let next = entered(step + 1);
            while at != next {
                let down = if next > at { 1 } else { -1 };
                let left = at;
                at += down;
                if !map.get(pixel(self.first + self.sign * step, at)) {
                    return Some(Crossing::Beside { step, left, down });
                }
            }
            step += 1;
        }
        None
    }
}
