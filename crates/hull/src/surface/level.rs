//! What is flat but for less than half a pixel is flat.
//!
//! Outlines run in steps of pixels, so that a level table is felt as bumps, and a body on bumps rocks from three
//! samples to three others. Samples whose normals agree feel one piece of surface: each finds it moved towards the
//! plane that fits the piece best, by half a pixel at most. What is truly round stays round but for that much.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use crate::contact::{Eye, SurfaceContact};

/// The surface is moved by so many pixels at most.
const MOST_PIXELS: f64 = 0.5;
/// Samples feel one piece if their normals are so near: cosine of 30 degrees.
const SAME_PIECE: f64 = 0.866;
/// A plane goes through three of them anyway.
const LEAST_SAMPLES: usize = 4;
/// Samples in a row do not say how the surface leans across it: so much, m², holds it to the mean of the normals.
const HELD_M2: f64 = 1e-3;

/// Where a contact finds the surface.
struct Found {
    contact: usize,
    at_world: Point3<f64>,
    normal: Vector3<f64>,
    pixel_m: f64,
}

/// Levels the surface that contacts find. `place` says where a sample is, world; `eyes` are those of the rig's cameras.
pub(super) fn level(contacts: &mut [SurfaceContact], place: impl Fn(u32) -> Point3<f64>, eyes: &[Eye]) {
    let mut pieces: Vec<Vec<Found>> = Vec::new();
    for (contact, found) in contacts.iter().enumerate() {
        let Some(eye) = eyes.get(usize::from(found.camera)) else { continue };
        let (sample, normal) = (place(found.sample), found.normal());
        let at_world = sample + normal * f64::from(found.depth_m);
        let found = Found { contact, at_world, normal, pixel_m: eye.pixel_m(&at_world) };
        match pieces.iter_mut().find(|piece| piece[0].normal.dot(&normal) > SAME_PIECE) {
            Some(piece) => piece.push(found),
            None => pieces.push(vec![found]),
        }
    }
    for piece in pieces.iter().filter(|piece| piece.len() >= LEAST_SAMPLES) {
        level_piece(contacts, piece);
    }
}

fn level_piece(contacts: &mut [SurfaceContact], piece: &[Found]) {
    let count = piece.len() as f64;
    let sum: Vector3<f64> = piece.iter().map(|found| found.normal).sum();
    let normal = sum.normalize();
    let middle = Point3::from(piece.iter().map(|found| found.at_world.coords).sum::<Vector3<f64>>() / count);
    let along = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let across = normal.cross(&along);
    let flat = |found: &Found| {
        let from_middle = found.at_world - middle;
        (Vector2::new(from_middle.dot(&along), from_middle.dot(&across)), from_middle.dot(&normal))
    };
    let (mut squares, mut heights) = (Matrix2::identity() * HELD_M2, Vector2::zeros());
    for found in piece {
        let (at, height_m) = flat(found);
        squares += at * at.transpose();
        heights += at * height_m;
    }
    let Some(inverse) = squares.try_inverse() else { return };
    let slope = inverse * heights;
    for found in piece {
        let (at, height_m) = flat(found);
        let most_m = MOST_PIXELS * found.pixel_m;
        let moved_m = (slope.dot(&at) - height_m).clamp(-most_m, most_m);
        let outward_m = moved_m / found.normal.dot(&normal);
        contacts[found.contact].depth_m += outward_m as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera 2 m from the samples, whose pixels are 4 mm there.
    const EYE: Eye = Eye { centre_world: Point3::new(0.0, 0.0, 2.0), focal_pixels: 500.0 };
    const PIXEL_M: f64 = 0.004;

    /// Sixteen samples on the lower side of a box, 5 cm apart.
    fn place(sample: u32) -> Point3<f64> {
        let [column, row] = [sample % 4, sample / 4].map(|at| 0.05 * f64::from(at) - 0.075);
        Point3::new(column, 0.0, row)
    }

    /// Contacts with a surface that faces up, at a depth for each sample, metres.
    fn contacts(depth_m: impl Fn(u32) -> f64) -> Vec<SurfaceContact> {
        let contact = |sample| SurfaceContact {
            sample,
            camera: 0,
            normal_world: [0.0, 1.0, 0.0],
            moved_m: None,
            depth_m: depth_m(sample) as f32,
            speed_m_s: None,
            slide_m_s: [0.0; 3],
        };
        (0..16).map(contact).collect()
    }

    fn levelled(mut contacts: Vec<SurfaceContact>) -> Vec<f64> {
        level(&mut contacts, place, &[EYE]);
        contacts.iter().map(|contact| f64::from(contact.depth_m)).collect()
    }

    #[test]
    fn a_table_that_is_bumpy_by_less_than_half_a_pixel_is_level() {
        let bumps = [1.0, -0.7, 0.3, -1.0, 0.6];
        let depths = levelled(contacts(|sample| 0.002 + 0.001 * bumps[sample as usize % 5]));
        let (least, most) = depths.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), &m| (a.min(m), b.max(m)));
        // What is left is the lean of the plane that fits sixteen bumps.
        assert!(most - least < 6e-4, "{depths:?}");
    }

    #[test]
    fn a_slope_stays_as_it_is() {
        let lean = |sample: u32| 0.1 * place(sample).x - 0.04 * place(sample).z + 0.001;
        for (sample, depth_m) in (0..).zip(levelled(contacts(lean))) {
            assert!((depth_m - lean(sample)).abs() < 5e-4, "{sample}: {depth_m} {}", lean(sample));
        }
    }

    #[test]
    fn a_thing_that_stands_out_stays_but_for_half_a_pixel() {
        let finger = |sample: u32| if sample == 5 { 0.03 } else { 0.0 };
        let depths = levelled(contacts(finger));
        for (sample, depth_m) in (0..).zip(&depths) {
            assert!((depth_m - finger(sample)).abs() <= 0.55 * PIXEL_M, "{depths:?}");
        }
    }

    #[test]
    fn three_samples_and_planes_of_unknown_cameras_are_left_alone() {
        let few: Vec<SurfaceContact> =
            contacts(|sample| 0.001 * f64::from(sample)).into_iter().take(3).collect();
        assert_eq!(
            levelled(few.clone()),
            few.iter().map(|contact| f64::from(contact.depth_m)).collect::<Vec<_>>()
        );
        let mut unknown = contacts(|_| 0.001);
        unknown[4].camera = 9;
        assert_eq!(levelled(unknown)[4], f64::from(0.001_f32));
    }
}
