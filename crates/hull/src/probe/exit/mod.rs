//! Where a ray from inside leaves the silhouette (paper §4.2, point c; spec §3.3).
//!
//! The ray's image is walked from pixel edge to pixel edge: without distortion it is a line and all is in
//! closed form; with distortion it is walked in spans that are nearly parabolas, and the crossing is found to
//! 1e-9 pixels.
//! When cameras can fall silent it is followed in steps under a pixel, and every change of class is bisected
//! to 1e-8 m.

mod bent;
mod changes;
mod parabola;
mod ray;
mod span;
mod straight;
mod walk;

use nalgebra::{Point3, Vector3};

use crate::question::{Change, NO_EXIT_M};
use crate::view::{Class, View};
use ray::OutOfSight;

/// The point `a + t n`; every machine must form it alike.
#[inline]
pub fn along(a_world: &Point3<f64>, n_world: &Vector3<f64>, t_m: f32) -> Point3<f64> {
    let t = f64::from(t_m);
    Point3::new(a_world.x + t * n_world.x, a_world.y + t * n_world.y, a_world.z + t * n_world.z)
}

impl View {
    /// The first `t` in `(0, limit_m]` at which this camera calls `a + t n` outside. `a` must be inside
    /// here, and the camera must never be silent.
    #[inline(always)]
    pub fn first_outside(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f32> {
        self.crossing(a, n, limit_m).map(|t| self.settled(a, n, t))
    }

    /// The same but for the last rounding.
    #[inline(always)]
    pub fn crossing(&self, a: &Point3<f64>, n: &Vector3<f64>, limit_m: f64) -> Option<f64> {
        if self.camera().lens().is_straight() {
            self.walk(a, n, limit_m)
        } else {
            self.trace(a, n, limit_m).unwrap_or_else(|OutOfSight| {
                let mut found = None;
                self.follow(a, n, limit_m, &mut |t, _, to| {
                    found = (to == Class::Outside).then_some(t);
                    found.is_none()
                });
                found.filter(|&t| t < limit_m)
            })
        }
    }

    /// All that this camera knows of the ray when cameras may be silent: the first outside, and in
    /// `changes` where the camera falls silent (−1) or sees again (+1) before it.
    pub fn exit_with_silence(
        &self,
        a: &Point3<f64>,
        n: &Vector3<f64>,
        limit_m: f64,
        point: u32,
        changes: &mut Vec<Change>,
    ) -> f32 {
        let mut outside_m = NO_EXIT_M;
        self.follow(a, n, limit_m, &mut |t, from, to| {
            let t_m = round_up(t);
            match (from, to) {
                (_, Class::Outside) => {
                    outside_m = t_m;
                    return false;
                }
                (Class::Inside, _) => changes.push(Change { point, t_m, by: -1 }),
                (_, Class::Inside) => changes.push(Change { point, t_m, by: 1 }),
                _ => {}
            }
            true
        });
        outside_m
    }

    /// `t` in single precision, not before the crossing: rounded up, and nudged until the point there
    /// is outside by the same arithmetic that classifies.
    fn settled(&self, a: &Point3<f64>, n: &Vector3<f64>, t: f64) -> f32 {
        let mut t = round_up(t);
        for _ in 0..4 {
            if self.classify(&along(a, n, t)) != Class::Inside {
                break;
            }
            t = t.next_up();
        }
        t
    }
}

/// The least single-precision number that is not less.
fn round_up(t: f64) -> f32 {
    let near = t as f32;
    if f64::from(near) < t { near.next_up() } else { near }
}
