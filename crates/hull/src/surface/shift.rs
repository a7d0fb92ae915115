//! How far what is near a place moved since the frame before, where outlines tell too little: a limb that moved farther than it is
//! thick has other edges in every image (paper §7: very fast objects). The shift is found that explains best which places of a
//! grid are inside the hull by which were in the frame before.

use std::sync::{Arc, LazyLock};

use nalgebra::Vector3;

use crate::body::Shape;

/// Neighbours in the grid are so far apart, metres.
const CELL_M: f64 = 0.03;
/// What lies within so many cells of the middle is looked for in the frame before,
const NEAR: i32 = 5;
/// and is taken to have moved by so many cells at most.
const FARTHEST: i32 = 7;
/// The middle of a row of cells, and the cells in it.
const MIDDLE: i32 = NEAR + FARTHEST;
const SIDE: usize = 2 * MIDDLE as usize + 1;
/// So many cells farther, a shift must explain this share of the places more: a limb may have slid along itself.
const COST_OF_CELL: f64 = 4.5e-4;
/// A shift that explains a smaller share of the places explains nothing.
const LEAST_EXPLAINED: f64 = 0.8;
/// For each cell that it is long a shift must explain so many places more than none does: a hull of few cameras changes its form
/// where nothing moves.
const LEAST_GAIN: f64 = 3.0;

type Cell = [i32; 3];

/// The cells within reach of the middle, in the order of the grid's samples.
static CELLS: LazyLock<Vec<Cell>> = LazyLock::new(|| {
    let along = || -MIDDLE..=MIDDLE;
    let all = along().flat_map(|z| along().flat_map(move |y| along().map(move |x| [x, y, z])));
    all.filter(|&cell| is_within(cell, MIDDLE)).collect()
});

static GRID: LazyLock<Arc<Shape>> = LazyLock::new(|| {
    let sample = |cell: &Cell| cell.map(|at| (f64::from(at) * CELL_M) as f32);
    Arc::new(Shape::new(CELLS.iter().map(sample).collect()).expect("some, and finite"))
});

/// The grid, about its middle: a body of which all samples are asked about in both frames.
pub fn grid() -> Arc<Shape> {
    Arc::clone(&GRID)
}

fn is_within(cell: Cell, reach: i32) -> bool {
    cell.iter().map(|at| at * at).sum::<i32>() <= reach * reach
}

/// Which places of the grid are inside the hull.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Occupancy {
    /// A bit a cell along x, for each z and y.
    rows: [[u32; SIDE]; SIDE],
}

impl Occupancy {
    /// From the grid's samples that are inside.
    pub fn of(inside: &[u32]) -> Occupancy {
        let mut rows = [[0; SIDE]; SIDE];
        for [x, y, z] in inside.iter().filter_map(|&sample| CELLS.get(sample as usize)) {
            rows[row(*z)][row(*y)] |= 1 << (x + MIDDLE);
        }
        Occupancy { rows }
    }
}

/// Where a row of cells stands in its list.
fn row(at: i32) -> usize {
    (at + MIDDLE) as usize
}

/// The cells near the middle in each row, as bits.
static NEAR_ROWS: LazyLock<Vec<(i32, i32, u32)>> = LazyLock::new(|| {
    let along = || -NEAR..=NEAR;
    let bits =
        |y, z| along().filter(|&x| is_within([x, y, z], NEAR)).fold(0, |bits, x| bits | 1 << (x + MIDDLE));
    along().flat_map(|z| along().map(move |y| (y, z, bits(y, z)))).filter(|(.., bits)| *bits != 0).collect()
});

/// How many places near the middle are now as they were in the frame before, a shift away.
fn explained(before: &Occupancy, now: &Occupancy, [dx, dy, dz]: Cell) -> u32 {
    let same = |&(y, z, bits): &(i32, i32, u32)| {
        let was = before.rows[row(z - dz)][row(y - dy)];
        let was = if dx >= 0 { was << dx } else { was >> -dx };
        (!(was ^ now.rows[row(z)][row(y)]) & bits).count_ones()
    };
    NEAR_ROWS.iter().map(same).sum()
}

/// How far what is near the middle of the grid moved since the frame before, world, metres; `None` if nothing explains it.
pub fn shift_m(before: &Occupancy, now: &Occupancy) -> Option<Vector3<f64>> {
    let all: u32 = NEAR_ROWS.iter().map(|(.., bits)| bits.count_ones()).sum();
    let is_inside = |&(y, z, bits): &(i32, i32, u32)| (now.rows[row(z)][row(y)] & bits).count_ones();
    let inside: u32 = NEAR_ROWS.iter().map(is_inside).sum();
    if inside == 0 || inside == all {
        return None;
    }
    let score = |shift: Cell| {
        let squared: i32 = shift.iter().map(|at| at * at).sum();
        f64::from(explained(before, now, shift)) / f64::from(all) - COST_OF_CELL * f64::from(squared)
    };
    let mut best = (score([0; 3]), [0; 3]);
    let along = || -FARTHEST..=FARTHEST;
    for shift in along().flat_map(|z| along().flat_map(move |y| along().map(move |x| [x, y, z]))) {
        if is_within(shift, FARTHEST) {
            let found = score(shift);
            if found > best.0 {
                best = (found, shift);
            }
        }
    }
    let (highest, shift) = best;
    let (explains, still_explains) = (explained(before, now, shift), explained(before, now, [0; 3]));
    let length = f64::from(shift.iter().map(|at| at * at).sum::<i32>()).sqrt();
    let gains = f64::from(explains) - f64::from(still_explains);
    if f64::from(explains) < LEAST_EXPLAINED * f64::from(all) || gains < LEAST_GAIN * length {
        return None;
    }
    // The top of the parabola through the neighbours along each axis.
    let exact = |axis: usize| {
        let beside = |step: i32| {
            let mut beside = shift;
            beside[axis] += step;
            is_within(beside, FARTHEST).then(|| score(beside))
        };
        let (Some(less), Some(more)) = (beside(-1), beside(1)) else { return f64::from(shift[axis]) };
        let bend = less + more - 2.0 * highest;
        let off = if bend < 0.0 { (less - more) / (2.0 * bend) } else { 0.0 };
        f64::from(shift[axis]) + off.clamp(-0.5, 0.5)
    };
    Some(Vector3::from_fn(|axis, _| exact(axis) * CELL_M))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn is_inside(occupancy: &Occupancy, [x, y, z]: Cell) -> bool {
        occupancy.rows[row(z)][row(y)] >> (x + MIDDLE) & 1 == 1
    }

    fn occupancy(is_inside: impl Fn(Vector3<f64>) -> bool) -> Occupancy {
        let grid = grid();
        let place = |sample: &[f32; 3]| Vector3::from(sample.map(f64::from));
        let inside = grid.samples_body().iter().enumerate().filter(|(_, sample)| is_inside(place(sample)));
        Occupancy::of(&inside.map(|(at, _)| at as u32).collect::<Vec<_>>())
    }

    /// A forearm of 4.5 cm radius with a fist of 6 cm at its end, the end at a place.
    fn forearm(end: Vector3<f64>) -> Occupancy {
        occupancy(|place| {
            let along = (end - place).y.clamp(0.0, 0.5);
            let from_bone = place - (end - Vector3::y() * along);
            from_bone.norm() < 0.045 || (place - end).norm() < 0.06
        })
    }

    #[test]
    fn a_limb_that_moved_by_more_than_it_is_thick_is_found_again() {
        let now = Vector3::new(0.03, 0.05, -0.02);
        let off_m = |moved: [f64; 3]| {
            let moved = Vector3::from(moved);
            (shift_m(&forearm(now - moved), &forearm(now)).expect("a shift") - moved).norm()
        };
        for moved in [[0.13, 0.02, -0.05], [-0.06, 0.0, 0.12], [0.0; 3], [0.1, -0.1, 0.1], [0.0, 0.0, -0.15]]
        {
            assert!(off_m(moved) < 0.01, "moved by {moved:?}, found {} m beside", off_m(moved));
        }
        // By as much as is looked for no neighbour tells where between two cells it was.
        assert!(off_m([0.2, 0.0, 0.0]) < CELL_M);
    }

    #[test]
    fn what_was_not_there_before_has_no_shift() {
        let (empty, full) = (occupancy(|_| false), occupancy(|_| true));
        let limb = forearm(Vector3::zeros());
        assert_eq!(shift_m(&limb, &empty), None);
        assert_eq!(shift_m(&limb, &full), None);
        let body = occupancy(|place| place.x < 0.0);
        assert_eq!(shift_m(&empty, &body), None);
    }

    proptest! {
        #[test]
        fn places_are_compared_as_one_by_one(
            before in proptest::collection::vec(any::<bool>(), CELLS.len()),
            now in proptest::collection::vec(any::<bool>(), CELLS.len()),
            shift in proptest::array::uniform3(-4..=4),
        ) {
            let of = |places: &[bool]| {
                let inside = places.iter().enumerate().filter(|(_, is_inside)| **is_inside);
                Occupancy::of(&inside.map(|(at, _)| at as u32).collect::<Vec<_>>())
            };
            let (before, now) = (of(&before), of(&now));
            let is_same = |cell: &&Cell| {
                let was = std::array::from_fn(|axis| cell[axis] - shift[axis]);
                is_inside(&before, was) == is_inside(&now, **cell)
            };
            let near = CELLS.iter().filter(|cell| is_within(**cell, NEAR));
            prop_assert_eq!(explained(&before, &now, shift) as usize, near.filter(is_same).count());
        }
    }
}
