//! From groups to bodies with start poses, decided by the seed.

use super::{BodySpec, Group, Place, Scene};
use crate::rotation;
use crate::seeded::Seeded;
use crate::solid::Solid;
use hull::Pose;
use nalgebra::{UnitQuaternion, Vector3};

/// How far the seed moves a body that the file placed, to either side of each level axis, metres.
const JITTER_M: f64 = 0.00035;
/// How far the seed turns it about up, to either side, degrees.
const JITTER_DEG: f64 = 0.9;
/// Bodies of piles and rain start at least this far apart, metres.
const CLEARANCE_M: f64 = 0.01;
/// How often a place in a column is drawn before the next body starts higher.
const DRAWS_PER_HEIGHT: usize = 8;
/// How much higher it then starts, metres.
const HEIGHT_STEP_M: f64 = 0.03;
/// After so many heights, 30 m, it stands above all others instead: a pile of large bodies would be looked for for
/// hours.
const MAX_HEIGHTS: usize = 1000;

/// Bodies that name no colour take these in turn, sRGB.
pub(super) const PALETTE: [[f32; 3]; 6] = [
    [0.86, 0.37, 0.25],
    [0.25, 0.56, 0.78],
    [0.93, 0.74, 0.29],
    [0.44, 0.68, 0.41],
    [0.62, 0.44, 0.71],
    [0.85, 0.54, 0.65],
];

impl Group {
    /// What its bodies are called: the group's name, numbered if there are several.
    pub(super) fn names(&self) -> impl Iterator<Item = String> + '_ {
        (0..self.count)
            .map(|index| if self.count == 1 { self.name.clone() } else { format!("{}_{index}", self.name) })
    }
}

/// Every body of a scene, in the file's order.
pub(super) fn bodies(scene: &Scene, seed: u64) -> Vec<BodySpec> {
    let mut placer = Placer { up: scene.up().into(), seed, occupied: vec![], bodies: vec![] };
    for group in &scene.groups {
        placer.group(group);
    }
    placer.bodies
}

struct Placer {
    up: Vector3<f64>,
    seed: u64,
    /// Bounding balls of the bodies so far: centre and radius, metres.
    occupied: Vec<(Vector3<f64>, f64)>,
    bodies: Vec<BodySpec>,
}

impl Placer {
    fn group(&mut self, group: &Group) {
        let (mut stack_height_m, mut is_full) = (0.0, false);
        for (index, name) in group.names().enumerate() {
            let mut seeded = Seeded::new(self.seed, &name);
            let (origin, turn) = match group.place {
                Place::At { origin_m } => {
                    let (shift, turn) = self.jittered(group, &mut seeded);
                    (Vector3::from(origin_m) + shift, turn)
                }
                Place::Stack { foot_m, gap_m } => {
                    let (shift, turn) = self.jittered(group, &mut seeded);
                    let (below, above) = self.reaches(&group.solid, &turn);
                    let origin = Vector3::from(foot_m) + self.up * (stack_height_m + below) + shift;
                    stack_height_m += below + above + gap_m;
                    (origin, turn)
                }
                Place::Column { foot_m, radius_m, spacing_m } => {
                    let turn = match group.rotation_deg {
                        Some(_) => self.upright(group),
                        None => rotation::from_units([(); 3].map(|()| seeded.unit())),
                    };
                    let low_m = spacing_m * index as f64 + self.reaches(&group.solid, &turn).0;
                    let foot = Vector3::from(foot_m) + self.up * low_m;
                    let body_radius_m = group.solid.radius_m();
                    // A column that had no place for one has none for the next.
                    let place =
                        (!is_full).then(|| self.free_place(foot, radius_m, body_radius_m, &mut seeded));
                    let place = place.flatten();
                    is_full = place.is_none();
                    (place.unwrap_or_else(|| self.above_all(foot, body_radius_m)), turn)
                }
            };
            self.push(group, name, origin, &turn);
        }
    }

    fn push(&mut self, group: &Group, name: String, origin: Vector3<f64>, turn: &UnitQuaternion<f64>) {
        self.occupied.push((origin, group.solid.radius_m()));
        let q = turn.quaternion();
        // Checked positions and unit quaternions always make a pose.
        let pose = Pose::new(origin.into(), [q.i, q.j, q.k, q.w]).unwrap_or(Pose::IDENTITY);
        self.bodies.push(BodySpec {
            name,
            solid: group.solid.clone(),
            pose,
            velocity_m_s: [0.0; 3],
            mass: group.mass,
            friction: group.friction,
            restitution: group.restitution,
            fixed: group.fixed,
            color: group.color.unwrap_or(PALETTE[self.bodies.len() % PALETTE.len()]),
        });
    }

    /// The rotation that the file gives, on a solid whose axis stands along up.
    fn upright(&self, group: &Group) -> UnitQuaternion<f64> {
        let stand = if group.solid.has_axis() { rotation::y_to(self.up) } else { UnitQuaternion::identity() };
        group.rotation_deg.map_or(stand, |vector_deg| rotation::from_rodrigues_deg(vector_deg) * stand)
    }

    /// The seed's small shift and turn of a body that the file placed; none of a fixed one.
    fn jittered(&self, group: &Group, seeded: &mut Seeded) -> (Vector3<f64>, UnitQuaternion<f64>) {
        let upright = self.upright(group);
        if group.fixed {
            return (Vector3::zeros(), upright);
        }
        let [a, b] = rotation::level_axes(self.up).map(|axis| axis * (JITTER_M * seeded.signed()));
        let yaw = rotation::about(self.up, (JITTER_DEG * seeded.signed()).to_radians());
        (a + b, yaw * upright)
    }

    /// How far a turned solid reaches below and above its origin, metres.
    fn reaches(&self, solid: &Solid, turn: &UnitQuaternion<f64>) -> (f64, f64) {
        let up_body = turn.inverse_transform_vector(&self.up);
        (solid.reach_m(-up_body), solid.reach_m(up_body))
    }

    /// A place over the foot, higher than every body.
    fn above_all(&self, foot: Vector3<f64>, body_radius_m: f64) -> Vector3<f64> {
        let top_m = |(centre, radius_m): &(Vector3<f64>, f64)| {
            (centre - foot).dot(&self.up) + radius_m + body_radius_m + CLEARANCE_M
        };
        foot + self.up * self.occupied.iter().map(top_m).fold(0.0, f64::max)
    }

    /// A place over the disc, at the foot's height or as little above as bodies leave room; `None` if that is far above.
    fn free_place(
        &self,
        foot: Vector3<f64>,
        disc_radius_m: f64,
        body_radius_m: f64,
        seeded: &mut Seeded,
    ) -> Option<Vector3<f64>> {
        let [a, b] = rotation::level_axes(self.up);
        let (mut height_m, mut in_way) = (0.0, 0);
        for _ in 0..MAX_HEIGHTS {
            for _ in 0..DRAWS_PER_HEIGHT {
                let (sine, cosine) = libm::sincos(core::f64::consts::TAU * seeded.unit());
                let distance_m = disc_radius_m * seeded.unit().sqrt();
                let place = foot + (a * cosine + b * sine) * distance_m + self.up * height_m;
                let is_in_way = |(centre, radius_m): &(Vector3<f64>, f64)| {
                    (centre - place).norm() < radius_m + body_radius_m + CLEARANCE_M
                };
                // What was in the way is the likeliest to be it again.
                if self.occupied.get(in_way).is_some_and(is_in_way) {
                    continue;
                }
                match self.occupied.iter().position(is_in_way) {
                    Some(found) => in_way = found,
                    None => return Some(place),
                }
            }
            height_m += HEIGHT_STEP_M;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bodies_of(text: &str, seed: u64) -> Vec<BodySpec> {
        Scene::from_toml("test", text).expect("a scene").bodies(seed)
    }

    #[test]
    fn a_pile_of_many_large_bodies_is_placed_at_once() {
        let text = "[[bodies]]
            name = 'house'
            shape.box.size = [5.0, 5.0, 5.0]
            count = 1000
            place.pile = { foot = [0.0, 0.0, 0.0], radius = 0.0 }";
        let bodies = bodies_of(text, 1);
        for (index, body) in bodies.iter().enumerate() {
            let above = |other: &BodySpec| body.pose.position_m()[1] - other.pose.position_m()[1];
            assert!(bodies[..index].last().is_none_or(|other| above(other) >= 2.0 * body.solid.radius_m()));
        }
    }

    const STACK: &str = "
        [[bodies]]
        name = 'box'
        shape.box.size = [0.3, 0.2, 0.4]
        count = 3
        place.stack = { foot = [1.0, 0.5, 2.0] }";

    #[test]
    fn a_stack_stands_upon_itself_along_up() {
        for (index, body) in bodies_of(STACK, 1).iter().enumerate() {
            assert_eq!(body.name, format!("box_{index}"));
            let [x, y, z] = body.pose.position_m();
            assert!((y - (0.6 + 0.2 * index as f64)).abs() < 1e-12, "{y}");
            assert!(libm::hypot(x - 1.0, z - 2.0) <= 0.0005, "{x} {z}");
        }
        let z_up = format!("gravity = [0.0, 0.0, -9.81]\n{STACK}");
        let heights: Vec<_> = bodies_of(&z_up, 1).iter().map(|b| b.pose.position_m()[2]).collect();
        for (found, expected) in heights.iter().zip([2.2, 2.6, 3.0]) {
            assert!((found - expected).abs() < 1e-12, "{heights:?}");
        }
    }

    #[test]
    fn a_cylinder_stands_along_up_whatever_up_is() {
        let text = "gravity = [0.0, 0.0, -9.81]
            [[bodies]]
            name = 'can'
            shape.cylinder = { radius = 0.1, height = 0.3 }
            place.stack.foot = [0.0, 0.0, 0.0]";
        let can = &bodies_of(text, 4)[0];
        assert!((can.pose.position_m()[2] - 0.15).abs() < 1e-9);
        assert!((can.pose.rotation() * Vector3::y() - Vector3::z()).norm() < 1e-9);
    }

    #[test]
    fn the_seed_moves_bodies_a_little_and_fixed_ones_not_at_all() {
        let fixed = STACK.replace("count = 3", "count = 3\nfixed = true");
        assert_eq!(bodies_of(&fixed, 1), bodies_of(&fixed, 2));
        assert_eq!(bodies_of(STACK, 1), bodies_of(STACK, 1));
        for (a, b) in bodies_of(STACK, 1).iter().zip(bodies_of(STACK, 2)) {
            assert_ne!(a.pose, b.pose);
            let front = |body: &BodySpec| body.pose.rotation() * Vector3::z();
            assert!(rotation::angle_deg(front(a), Vector3::z()) < 1.0);
            assert!(rotation::angle_deg(front(&b), Vector3::z()) < 1.0);
        }
    }

    #[test]
    fn rain_starts_apart_above_its_foot_and_higher_and_higher() {
        let text = "[[bodies]]
            name = 'drop'
            shape.box.size = [0.2, 0.2, 0.2]
            count = 30
            place.rain = { foot = [0.0, 2.0, 0.0], radius = 0.4, spacing = 0.05 }
            [[bodies]]
            name = 'ball'
            shape.ball.radius = 0.1
            count = 10
            place.pile = { foot = [0.0, 2.0, 0.0], radius = 0.4 }";
        let bodies = bodies_of(text, 9);
        assert_eq!(bodies.len(), 40);
        for (index, body) in bodies.iter().enumerate() {
            let position = Vector3::from(body.pose.position_m());
            let least = if index < 30 { 2.1 + 0.05 * index as f64 } else { 2.1 };
            assert!(position.y >= least - 1e-9 && libm::hypot(position.x, position.z) <= 0.4, "{position}");
            for other in &bodies[..index] {
                let apart = (position - Vector3::from(other.pose.position_m())).norm();
                assert!(apart > body.solid.radius_m() + other.solid.radius_m());
            }
        }
        assert_ne!(bodies[5].pose, bodies_of(text, 10)[5].pose);
    }
}
