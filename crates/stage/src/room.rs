//! The empty room: a grey floor of tiles, grey-green walls with a skirting board, a door and two boards.

use std::ops::Range;

use hull::Camera;
use nalgebra::Vector3;

use crate::material::{Colour, grain};
use crate::shadow::{LAMP_M, MapPlace, map_place};

/// Half the room's width and depth, and its height, metres.
const HALF_M: f64 = 4.8;
const HEIGHT_M: f64 = 4.6;

/// Normalised coordinates of every pixel's viewing ray, row-major; NaN where the lens sees nothing.
pub(crate) fn rays(camera: &Camera) -> Vec<[f32; 2]> {
    let mut rays = Vec::with_capacity(camera.width() as usize * camera.height() as usize);
    for row in 0..camera.height() {
        rays.extend(row_rays(camera, row, 0..camera.width()));
    }
    rays
}

/// The same of some pixels of a row.
pub(crate) fn row_rays(
    camera: &Camera,
    row: u32,
    columns: Range<u32>,
) -> impl Iterator<Item = [f32; 2]> + '_ {
    columns.map(move |column| {
        let ray = camera.normalised(&nalgebra::Point2::new(f64::from(column), f64::from(row)));
        ray.map_or([f32::NAN; 2], |ray| [ray.x as f32, ray.y as f32])
    })
}

/// The picture of the empty room, red green blue, and every pixel's place on the shadow map.
pub(crate) fn picture(camera: &Camera, rays: &[[f32; 2]]) -> (Vec<u8>, Vec<MapPlace>) {
    let (width, height) = (camera.width() as usize, camera.height() as usize);
    let mut rgb = Vec::with_capacity(rays.len() * 3);
    let mut places = Vec::with_capacity(rays.len());
    let centre = camera.centre_world().coords;
    let seen = |x: f32, y: f32| {
        let ray = Vector3::new(f64::from(x), f64::from(y), 1.0);
        meet(&centre, &camera.rotation().tr_mul(&ray))
    };
    for row in 0..height {
        for column in 0..width {
            let at = row * width + column;
            let [x, y] = rays[at];
            // Half the way to the neighbours, for four looks into each pixel.
            let right = rays[if column + 1 < width { at + 1 } else { at - usize::from(column > 0) }];
            let below = rays[if row + 1 < height { at + width } else { at - width * usize::from(row > 0) }];
            let (dx, dy) = (0.25 * (right[0] - x).abs(), 0.25 * (below[1] - y).abs());
            let mut sum = [0.0f32; 3];
            for (sx, sy) in [(-dx, -dy), (dx, -dy), (-dx, dy), (dx, dy)] {
                let colour = seen(x + sx, y + sy).map_or([0.0; 3], |meeting| meeting.colour());
                sum = std::array::from_fn(|channel| sum[channel] + 0.25 * colour[channel]);
            }
            rgb.extend(sum.map(|channel| (channel + 0.5) as u8));
            places.push(match seen(x, y) {
                Some(Meeting { surface: Surface::Floor, point }) => map_place(point.x, point.z),
                _ => [0, 0],
            });
        }
    }
    (rgb, places)
}

#[derive(Clone, Copy, PartialEq)]
enum Surface {
    Floor,
    Ceiling,
    /// The wall across x or z, at the negative or positive end.
    Wall {
        across_x: bool,
        positive: bool,
    },
}

struct Meeting {
    surface: Surface,
    point: Vector3<f64>,
}

/// Where a ray from inside the room meets it; `None` if the ray is not a number.
fn meet(centre: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Meeting> {
    let ends = [
        (direction.x, centre.x, -HALF_M, HALF_M),
        (direction.y, centre.y, 0.0, HEIGHT_M),
        (direction.z, centre.z, -HALF_M, HALF_M),
    ];
    let mut least: Option<(f64, Surface)> = None;
    for (axis, (d, from, low, high)) in ends.into_iter().enumerate() {
        let positive = d > 0.0;
        let t = (if positive { high } else { low } - from) / d;
        let surface = match (axis, positive) {
            (1, false) => Surface::Floor,
            (1, true) => Surface::Ceiling,
            (_, positive) => Surface::Wall { across_x: axis == 0, positive },
        };
        // A camera outside the room looks through the near wall.
        if t > 0.0 && least.is_none_or(|(nearest, _)| t < nearest) {
            least = Some((t, surface));
        }
    }
    least.map(|(t, surface)| Meeting { surface, point: centre + direction * t })
}

impl Meeting {
    fn colour(&self) -> Colour {
        let point = &self.point;
        let to_lamp = Vector3::from(LAMP_M) - point;
        let squared = to_lamp.norm_squared();
        let [x, y, z] = [point.x as f32, point.y as f32, point.z as f32];
        match self.surface {
            Surface::Floor => lit(floor(x, z), 0.62 + 8.0 / (squared as f32 + 3.0)),
            Surface::Ceiling => lit([188.0, 190.0, 184.0], 0.9),
            Surface::Wall { across_x, positive } => {
                let along = if across_x { z } else { x };
                let corner = (HALF_M as f32 - along.abs()).min(1.0);
                let light = 0.70 + 6.0 / (squared as f32 + 14.0) + 0.06 * corner;
                lit(wall(along, y, across_x, positive), light)
            }
        }
    }
}

fn lit(colour: Colour, strength: f32) -> Colour {
    colour.map(|channel| channel * strength)
}

fn floor(x: f32, z: f32) -> Colour {
    let (u, v) = (x * (1.0 / 0.6), z * (1.0 / 0.6));
    let (i, j) = (u.floor(), v.floor());
    let joint = (u - i).min(v - j);
    if joint < 0.012 {
        return [104.0, 108.0, 112.0];
    }
    let tile = 0.96 + 0.08 * grain(i as i32, j as i32);
    let mottle = 0.93 + 0.09 * cloud(x * 3.0, z * 3.0) + 0.06 * cloud(x * 17.0, z * 17.0);
    lit([140.0, 145.0, 150.0], tile * mottle)
}

fn wall(along: f32, y: f32, across_x: bool, positive: bool) -> Colour {
    let salt = i32::from(across_x) * 100 + i32::from(positive) * 37;
    if y < 0.11 {
        return if y > 0.10 { [118.0, 124.0, 118.0] } else { [170.0, 174.0, 168.0] };
    }
    let within = |x0: f32, x1: f32, y0: f32, y1: f32| along > x0 && along < x1 && y > y0 && y < y1;
    if across_x && positive && within(-2.6, -1.6, 0.0, 2.1) {
        // The door, its frame and its handle.
        let frame = !within(-2.54, -1.66, 0.0, 2.04);
        let handle = within(-1.80, -1.70, 1.02, 1.06);
        return if handle {
            [120.0, 124.0, 126.0]
        } else if frame {
            [132.0, 138.0, 132.0]
        } else {
            [172.0, 176.0, 168.0]
        };
    }
    if !across_x && !positive && within(-1.5, 0.6, 0.95, 2.15) {
        // A pin board with sheets.
        let sheet = grain((along * 2.6).floor() as i32, (y * 2.2).floor() as i32 + salt) > 0.45
            && along * 2.6 - (along * 2.6).floor() > 0.2
            && y * 2.2 - (y * 2.2).floor() > 0.25;
        return if sheet { [186.0, 190.0, 182.0] } else { [126.0, 146.0, 136.0] };
    }
    if across_x && !positive && within(-0.7, 1.9, 0.8, 2.2) {
        // A curtain in folds.
        let fold = cloud(along * 9.0, 0.3);
        return lit([150.0, 166.0, 164.0], 0.82 + 0.3 * fold);
    }
    let plaster =
        0.965 + 0.03 * cloud(along * 1.3, y * 1.3 + salt as f32) + 0.04 * cloud(along * 23.0, y * 23.0);
    lit([152.0, 164.0, 148.0], plaster)
}

/// Smooth noise in 0..1 with features of one unit.
fn cloud(x: f32, y: f32) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let bend = |u: f32| u * u * (3.0 - 2.0 * u);
    let (u, v) = (bend(x - i), bend(y - j));
    let (i, j) = (i as i32, j as i32);
    let mix = |a: f32, b: f32, share: f32| a + (b - a) * share;
    mix(mix(grain(i, j), grain(i + 1, j), u), mix(grain(i, j + 1), grain(i + 1, j + 1), u), v)
}
