//! The studio's true solids for the solver: what a run is compared with that knows nothing of silhouettes.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

use hull::Pose;
use nalgebra::Isometry3;
use sim::Solid;
use sim::solid::ConvexHull;
use stage::{ConvexForm, ConvexSolid, StageSettings};

use setup::cli::{Failure, Outcome};

/// A ball's points lie on so many meridians, and each end of a round cone has so many circles and a pole.
const MERIDIANS: usize = 16;
const CIRCLES: usize = 7;
/// A form that changed less is the same, metres: flesh stretches as joints bend.
const SAME_M: f64 = 1e-3;

/// The solids of a studio as the solver had them last.
#[derive(Default)]
pub struct TrueSolids(Vec<(ConvexForm, Solid)>);

impl TrueSolids {
    /// All solids and where they are at a time, seconds.
    pub fn at(&mut self, stage: &StageSettings, time_s: f64) -> Outcome<Vec<(Solid, Pose)>> {
        let solids = stage.convex_solids(time_s);
        solids.iter().enumerate().map(|(index, solid)| self.placed(index, solid)).collect()
    }

    fn placed(&mut self, index: usize, solid: &ConvexSolid) -> Outcome<(Solid, Pose)> {
        let pose = pose_of(&solid.world)?;
        match self.0.get(index) {
            Some((form, made)) if is_alike(form, &solid.form) => return Ok((made.clone(), pose)),
            Some(_) => self.0[index] = (solid.form, solid_of(&solid.form)?),
            None => self.0.push((solid.form, solid_of(&solid.form)?)),
        }
        Ok((self.0[index].1.clone(), pose))
    }
}

fn pose_of(world: &Isometry3<f64>) -> Outcome<Pose> {
    let turn = world.rotation.quaternion();
    Pose::new(world.translation.vector.into(), [turn.i, turn.j, turn.k, turn.w]).map_err(Failure::run)
}

/// The numbers of a form, metres but for the last three.
fn numbers(form: &ConvexForm) -> [f64; 6] {
    match *form {
        ConvexForm::Cuboid { size_m: [x, y, z] } => [x, y, z, 0.0, 0.0, 0.0],
        ConvexForm::RoundCone { length_m, start_m, end_m, squash: [x, y, z] } => {
            [length_m, start_m, end_m, x, y, z]
        }
    }
}

fn is_alike(a: &ConvexForm, b: &ConvexForm) -> bool {
    numbers(a).iter().zip(numbers(b)).all(|(a, b)| (a - b).abs() < SAME_M)
}

fn solid_of(form: &ConvexForm) -> Outcome<Solid> {
    match *form {
        ConvexForm::Cuboid { size_m } => Ok(Solid::Box { size_m }),
        ConvexForm::RoundCone { length_m, start_m, end_m, squash } => {
            let points_m = cone_points(length_m, start_m, end_m, squash);
            Ok(Solid::Hull(Arc::new(ConvexHull::new(&points_m).map_err(Failure::run)?)))
        }
    }
}

/// Points of a squashed round cone whose convex hull is as often within the surface as beyond it.
fn cone_points(length_m: f64, start_m: f64, end_m: f64, squash: [f64; 3]) -> Vec<[f64; 3]> {
    // The chord between two meridians cuts off so much of the radius.
    let grown = 0.5 * (1.0 + 1.0 / libm::cos(0.5 * TAU / MERIDIANS as f64));
    let is_ball = length_m < 1e-6;
    // Both balls touch the cone's side at this latitude.
    let tangent = if is_ball { 0.0 } else { libm::asin((start_m - end_m) / length_m) };
    let mut points_m = Vec::with_capacity(2 * (MERIDIANS * CIRCLES + 1));
    let ends = [(0.0, start_m, -FRAC_PI_2), (length_m, end_m, FRAC_PI_2)];
    for (middle_m, radius_m, pole) in ends {
        let mut add = |latitude: f64, longitude: f64| {
            let ((up, level), (z, x)) = (libm::sincos(latitude), libm::sincos(longitude));
            let point = [level * x, up, level * z].map(|share| share * radius_m * grown);
            points_m.push([point[0] * squash[0], (point[1] + middle_m) * squash[1], point[2] * squash[2]]);
        };
        // The equator of a ball is the first end's alone.
        for circle in usize::from(is_ball && pole > 0.0)..CIRCLES {
            let latitude = tangent + (pole - tangent) * circle as f64 / CIRCLES as f64;
            (0..MERIDIANS).for_each(|place| add(latitude, TAU * place as f64 / MERIDIANS as f64));
        }
        add(pole, 0.0);
    }
    points_m
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use stage::{Motion, Prop, Truth};

    use super::*;

    #[test]
    fn every_motions_solids_are_solids_near_the_true_surface() {
        for motion in Motion::ALL {
            let props = vec![Prop::Table, Prop::LiftedBox, Prop::Tray];
            let stage = StageSettings { motion, props, ..StageSettings::default() };
            let mut solids = TrueSolids::default();
            for tenth in 0..100 {
                let time_s = 0.1 * f64::from(tenth);
                let placed = solids.at(&stage, time_s).expect("solids");
                if tenth % 25 > 0 {
                    continue;
                }
                let truth = Truth::new(&stage, time_s);
                for (solid, pose) in placed {
                    let Solid::Hull(hull) = solid else { continue };
                    let world = pose.world_from_body();
                    for triangle in hull.triangle_corners_m() {
                        let middle: Vector3<f64> = triangle.iter().sum::<Vector3<f64>>() / 3.0;
                        let off_m = truth.signed_distance_m(&world(middle.map(|c| c as f32).into()));
                        assert!(off_m < 4e-3, "{motion} at {time_s}: {off_m}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_round_cone_is_as_thick_as_it_was() {
        for (length_m, start_m, end_m) in [(0.0, 0.1, 0.1), (0.3, 0.1, 0.05), (0.3, 0.06, 0.06)] {
            let points_m = cone_points(length_m, start_m, end_m, [1.0, 1.0, 0.5]);
            let hull = ConvexHull::new(&points_m).expect("a hull");
            let reach = |axis: usize, sign: f64| {
                hull.corners_m().iter().map(|corner| sign * corner[axis]).fold(f64::NEG_INFINITY, f64::max)
            };
            for (found_m, expected_m) in [
                (reach(0, 1.0), start_m),
                (reach(2, -1.0), 0.5 * start_m),
                (reach(1, -1.0), start_m),
                (reach(1, 1.0), length_m + end_m),
            ] {
                assert!((found_m - expected_m).abs() < 0.03 * start_m, "{found_m}, expected {expected_m}");
            }
        }
    }
}
