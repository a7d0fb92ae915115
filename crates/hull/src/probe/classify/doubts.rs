//! Points that a sketch leaves undecided are looked up by pixel, in double precision.

use super::{BLOCK, Block, GROUP, PLACE, ROOM};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::view::View;

/// Points that are looked up together.
const CHUNK: usize = 256;
/// No point.
const NONE: u32 = u32::MAX;
/// The digits of a tag that are the place.
const PLACES: u32 = BLOCK as u32 - 1;

/// Points in doubt, in lists by the first view to look them up in; the last list holds those that are rejected.
struct Lists {
    first: [u32; GROUP + 1],
}

/// Points that are looked up in a view.
#[derive(Clone, Debug)]
pub(super) struct Lookup {
    point: [u32; CHUNK],
    x: [f64; CHUNK],
    y: [f64; CHUNK],
    z: [f64; CHUNK],
    column: [i32; CHUNK],
    row: [i32; CHUNK],
}

impl Default for Lookup {
    fn default() -> Lookup {
        Lookup {
            point: [0; CHUNK],
            x: [0.0; CHUNK],
            y: [0.0; CHUNK],
            z: [0.0; CHUNK],
            column: [0; CHUNK],
            row: [0; CHUNK],
        }
    }
}

impl Block {
    /// Drops the points with a noted doubt that a view of the group rejects.
    #[inline(always)]
    pub(super) fn resolve(
        &mut self,
        points_world: &Coordinates,
        from: usize,
        views: &[View],
        group: &[usize],
        is_last: bool,
    ) {
        let mut lists = Lists { first: [NONE; GROUP + 1] };
        let mut doubtful = 0;
        for at in 0..self.len {
            self.doubtful[doubtful % BLOCK] = at as u32;
            doubtful += usize::from(self.tag[at % BLOCK] > PLACES);
        }
        for &at in &self.doubtful[..doubtful] {
            lists.push(
                (self.tag[at as usize % BLOCK] >> PLACE).trailing_zeros() as usize,
                at,
                &mut self.next,
            );
        }
        for (number, &view) in group.iter().enumerate() {
            self.look_up(points_world, from, &views[view], number, &mut lists);
        }
        if is_last {
            self.retain(|block, at, to| block.tag[to] = block.tag[at]);
        } else {
            self.retain(|block, at, to| {
                block.x[to] = block.x[at];
                block.y[to] = block.y[at];
                block.z[to] = block.z[at];
                block.tag[to] = block.tag[at];
            });
        }
    }

    /// Keeps the points without doubts.
    #[inline(always)]
    fn retain(&mut self, copy: impl Fn(&mut Block, usize, usize)) {
        let mut kept = 0;
        for at in 0..self.len {
            let (at, to) = (at % BLOCK, kept % BLOCK);
            let is_kept = self.tag[at] <= PLACES;
            copy(self, at, to);
            kept += usize::from(is_kept);
        }
        self.len = kept;
    }

    /// Looks up the points of a view's list, and moves them to that of the next view.
    #[inline(always)]
    fn look_up(
        &mut self,
        points_world: &Coordinates,
        from: usize,
        view: &View,
        number: usize,
        lists: &mut Lists,
    ) {
        let map = view.foreground().map();
        let end = points_world.len().min(from + BLOCK);
        let (all_x, all_y, all_z) =
            (&points_world.x[from..end], &points_world.y[from..end], &points_world.z[from..end]);
        let Lookup { point, x, y, z, column, row } = &mut self.lookup;
        let mut next = lists.first[number];
        while next != NONE {
            let mut count = 0;
            while next != NONE && count < CHUNK {
                let at = next as usize % BLOCK;
                point[count] = at as u32;
                let place = (self.tag[at] & PLACES) as usize;
                (x[count], y[count], z[count]) = (all_x[place], all_y[place], all_z[place]);
                next = self.next[at];
                count += 1;
            }
            // Whole vectors.
            let lanes = count.next_multiple_of(8);
            view.coefficients().pixels(x, y, z, &mut column[..lanes], &mut row[..lanes]);
            for ((&at, &column), &row) in point[..count].iter().zip(column.iter()).zip(row.iter()) {
                let at = at as usize;
                let is_foreground = u32::from(map.get(Pixel { column, row }));
                let tag = self.tag[at % BLOCK] & !(is_foreground << PLACE << number);
                self.tag[at % BLOCK] = tag;
                let list = if is_foreground == 1 { (tag >> PLACE).trailing_zeros() as usize } else { GROUP };
                lists.push(list, at as u32, &mut self.next);
            }
        }
    }
}

impl Lists {
    #[inline(always)]
    fn push(&mut self, list: usize, at: u32, next: &mut [u32; ROOM]) {
        let list = list.min(GROUP);
        next[at as usize % BLOCK] = self.first[list];
        self.first[list] = at;
    }
}
