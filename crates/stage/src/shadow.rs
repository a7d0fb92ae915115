//! The cast shadow on the floor: every solid's shadow from a lamp of some size, drawn softly into a map of
//! the floor that all pixels of the floor look up.

use nalgebra::{Matrix4x3, Vector2, Vector3};

use crate::solid::{Form, Solid};

/// The lamp, world, metres.
pub(crate) const LAMP_M: [f64; 3] = [0.9, 4.3, 1.3];
/// Half the lamp's width, which makes the rims soft.
const LAMP_RADIUS_M: f64 = 0.22;
/// The floor is this share as bright in full shadow.
pub(crate) const SHADOW_FACTOR: f64 = 0.66;
/// The map: cells a side, and their size.
const CELLS: usize = 256;
const CELL_M: f64 = 0.025;

/// How much of the lamp is hidden from each cell of the floor about the origin, 0–255.
pub(crate) struct ShadowMap {
    cells: Vec<u8>,
    touched: [usize; 4],
}

/// A place on the map in 256ths of a cell: column, row. Zero is off the map.
pub(crate) type MapPlace = [u16; 2];

/// The map place of a point of the floor.
pub(crate) fn map_place(x_m: f64, z_m: f64) -> MapPlace {
    let place = |metres: f64| (metres / CELL_M + 0.5 * CELLS as f64 - 0.5) * 256.0;
    let (column, row) = (place(x_m), place(z_m));
    let limit = (CELLS as f64 - 2.0) * 256.0;
    let inside = (256.0..limit).contains(&column) && (256.0..limit).contains(&row);
    if inside { [column as u16, row as u16] } else { [0, 0] }
}

impl ShadowMap {
    pub fn new() -> ShadowMap {
        ShadowMap { cells: vec![0; CELLS * CELLS], touched: [0; 4] }
    }

    /// Draws the shadows of all solids that cast one.
    pub fn draw(&mut self, solids: &[Solid]) {
        let [left, right, top, bottom] = self.touched;
        for row in top..bottom {
            self.cells[row * CELLS + left..row * CELLS + right].fill(0);
        }
        self.touched = [CELLS, 0, CELLS, 0];
        for solid in solids.iter().filter(|solid| solid.casts_shadow) {
            match solid.form {
                Form::RoundCone { .. } => self.draw_limb(solid),
                Form::Cuboid { .. } => self.draw_cuboid(solid),
            }
        }
        if self.touched[0] >= self.touched[1] || self.touched[2] >= self.touched[3] {
            self.touched = [0; 4];
        }
    }

    /// The corners on the floor of the part of the map that was drawn on; `None` if there is no shadow.
    pub fn corners_world(&self) -> Option<Matrix4x3<f64>> {
        let [left, right, top, bottom] = self.touched;
        let metres = |cell: usize, more: f64| (cell as f64 + more - 0.5 * CELLS as f64) * CELL_M;
        let (x0, x1) = (metres(left, -1.0), metres(right, 1.0));
        let (z0, z1) = (metres(top, -1.0), metres(bottom, 1.0));
        (left < right && top < bottom)
            .then(|| Matrix4x3::new(x0, 0.0, z0, x1, 0.0, z0, x1, 0.0, z1, x0, 0.0, z1))
    }

    /// How much of the lamp is hidden, 0–255, between the four nearest cells.
    #[inline(always)]
    pub fn hidden(&self, [column, row]: MapPlace) -> u32 {
        let (x, y) = (u32::from(column & 255), u32::from(row & 255));
        let at = usize::from(row >> 8) * CELLS + usize::from(column >> 8);
        let cells = &self.cells[at..at + CELLS + 2];
        let (a, b) = (u32::from(cells[0]), u32::from(cells[1]));
        let (c, d) = (u32::from(cells[CELLS]), u32::from(cells[CELLS + 1]));
        if a | b | c | d == 0 {
            return 0;
        }
        ((a * (256 - x) + b * x) * (256 - y) + (c * (256 - x) + d * x) * y) >> 16
    }

    /// Raises cells in the box about `low` to `high` (metres on the floor) to `hidden(place)` of 0..=1.
    fn raise(&mut self, low: Vector2<f64>, high: Vector2<f64>, hidden: impl Fn(f32, f32) -> f32) {
        let cell = |metres: f64| (metres / CELL_M + 0.5 * CELLS as f64).clamp(2.0, CELLS as f64 - 3.0);
        let (left, right) = (cell(low.x) as usize, cell(high.x) as usize + 1);
        let (top, bottom) = (cell(low.y) as usize, cell(high.y) as usize + 1);
        let [l, r, t, b] = self.touched;
        self.touched = [l.min(left), r.max(right), t.min(top), b.max(bottom)];
        let metres = |cell: usize| ((cell as f64 + 0.5 - 0.5 * CELLS as f64) * CELL_M) as f32;
        for row in top..bottom {
            let z = metres(row);
            for column in left..right {
                let value = (hidden(metres(column), z) * 255.0) as u8;
                let cell = &mut self.cells[row * CELLS + column];
                *cell = value.max(*cell);
            }
        }
    }

    fn draw_limb(&mut self, solid: &Solid) {
        let Form::RoundCone { length_m, start_m, end_m } = solid.form else { return };
        let mean_squash = 0.5 * (solid.squash.x + solid.squash.z);
        let end = solid.world(&Vector3::new(0.0, length_m, 0.0));
        let (a, spread_a, soft_a) = cast(&solid.origin);
        let (b, spread_b, soft_b) = cast(&end);
        let (ra, rb) = (start_m * mean_squash * spread_a, end_m * mean_squash * spread_b);
        let reach_a = Vector2::repeat(ra + soft_a);
        let reach_b = Vector2::repeat(rb + soft_b);
        let (low, high) = ((a - reach_a).inf(&(b - reach_b)), (a + reach_a).sup(&(b + reach_b)));
        let along = b - a;
        let per_squared = if along.norm_squared() > 1e-9 { 1.0 / along.norm_squared() } else { 0.0 };
        let [ax, az, dx, dz, per, ra, dr, sa, ds] =
            [a.x, a.y, along.x, along.y, per_squared, ra, rb - ra, soft_a, soft_b - soft_a]
                .map(|number| number as f32);
        self.raise(low, high, |x, z| {
            let (px, pz) = (x - ax, z - az);
            let share = ((px * dx + pz * dz) * per).clamp(0.0, 1.0);
            let (ox, oz) = (px - dx * share, pz - dz * share);
            let outside = (ox * ox + oz * oz).sqrt() - (ra + dr * share);
            rim(outside, sa + ds * share)
        });
    }

    fn draw_cuboid(&mut self, solid: &Solid) {
        let Form::Cuboid { half_m } = solid.form else { return };
        let corners = Solid::corners(&half_m).map(|corner| cast(&solid.world(&corner)).0);
        let soft_m = cast(&solid.origin).2;
        let lines = outline(&corners);
        let reach = Vector2::repeat(soft_m);
        let low = corners.iter().fold(corners[0], |low, corner| low.inf(corner)) - reach;
        let high = corners.iter().fold(corners[0], |high, corner| high.sup(corner)) + reach;
        self.raise(low, high, |x, z| {
            let outside = lines
                .iter()
                .fold(f32::NEG_INFINITY, |most, line| most.max(line[0] * x + line[1] * z - line[2]));
            rim(outside, soft_m as f32)
        });
    }
}

/// From 1 well inside the shadow to 0 outside, over `soft_m` on both sides of its edge.
#[inline(always)]
fn rim(outside_m: f32, soft_m: f32) -> f32 {
    let u = (0.5 - 0.5 * outside_m / soft_m).clamp(0.0, 1.0);
    u * u * (3.0 - 2.0 * u)
}

/// Where the lamp throws a point on the floor, how much larger things are there, and half the rim's width.
fn cast(point: &Vector3<f64>) -> (Vector2<f64>, f64, f64) {
    let lamp = Vector3::from(LAMP_M);
    let height_m = point.y.clamp(0.0, lamp.y - 0.5);
    let spread = lamp.y / (lamp.y - height_m);
    let place = lamp + (Vector3::new(point.x, height_m, point.z) - lamp) * spread;
    (Vector2::new(place.x, place.z), spread, 0.02 + LAMP_RADIUS_M * height_m / (lamp.y - height_m))
}

/// The lines around the points, `[nx, nz, offset]`, normals outward: from each point of the hull to the
/// next, always the one that leaves all others on one side.
fn outline(points: &[Vector2<f64>]) -> Vec<[f32; 3]> {
    let mut lines = Vec::new();
    for a in points {
        for b in points {
            let along = b - a;
            if along.norm() < 1e-9 {
                continue;
            }
            let normal = Vector2::new(along.y, -along.x).normalize();
            let offset = normal.dot(a);
            if points.iter().all(|point| normal.dot(point) <= offset + 1e-9) {
                lines.push([normal.x as f32, normal.y as f32, offset as f32]);
            }
        }
    }
    lines
}
