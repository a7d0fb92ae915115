//! What the hull says about a body, and the paper's answer to it (paper §3, spec §5).
//!
//! The paper's system "moves the virtual object out of the visual hull and flips its velocity over the
//! tangent plane". Read literally, and so it is here: the body is translated by its response, and the
//! part of its own velocity that points into the hull is mirrored. The mirror is a collision, and as
//! in any collision friction brakes what slides along: the paper is silent on it, but without it a box
//! “lying in rest on top of a real one” slides off the roof of a few percent that the hull has over every
//! level face (`hull_friction`, 0 for none). Nothing else changes: the spin stays, and the speed of the surface is not handed on, so a body at rest that is pushed is displaced
//! and still at rest. What it loses by that (its support, its balance) the solver finds out.
//!
//! That has two consequences that belong to the paper and not to this code. A body that the hull pushes
//! gets no torque from it, so a box on a surface of the hull keeps whatever tilt and drift
//! its neighbours give it: boxes lie well next to each other on a lifted lid, and stacks on it do not last.
//! And a body is carried by being displaced every step, so its velocity is not that of what carries it.
//!
//! A perfect mirror never lets a body come to rest; `restitution` is the share of the speed that is
//! mirrored. The paper's own picture is a restitution of 1.

use hull::Shape;
use hull::collision::BodyCollision;
use nalgebra::Vector3;

/// How a body answers the hull.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResponseMode {
    /// The paper's: translate, and mirror the velocity.
    #[default]
    Paper,
    /// Contacts with planes of the hull's surface, in the solver: bodies turn, tip and lie still.
    Contacts,
}

impl ResponseMode {
    /// Its name in options, files and messages.
    pub fn name(self) -> &'static str {
        match self {
            ResponseMode::Paper => "paper",
            ResponseMode::Contacts => "contacts",
        }
    }
}

/// A sample of a body in the hull or near its surface, and its own nearest way out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HullContact {
    /// Its index among the samples of the body's shape.
    pub sample: u32,
    /// Where it is on the body, body frame, metres.
    pub point_body_m: [f32; 3],
    /// The hull's outward unit normal at the nearest edge, world.
    pub normal_world: [f32; 3],
    /// How far the surface is along the normal, metres; negative where the sample is outside.
    pub depth_m: f32,
    /// How fast the surface moves out along its normal, m/s; `None` where nothing tells.
    pub speed_m_s: Option<f32>,
    /// How fast it moves along itself, world, m/s; nothing where it is unknown.
    pub slide_m_s: [f32; 3],
}

/// A piece of the hull's surface that a body touches, as the solver holds it after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HullPatch {
    /// The body's place in [`World::bodies`](crate::World::bodies).
    pub body: u32,
    /// The middle of what touches, on the surface, world, metres.
    pub point_m: [f32; 3],
    /// The surface's outward unit normal, world.
    pub normal_world: [f32; 3],
    /// How the surface moves there, world, m/s: out along the normal, and along itself.
    pub velocity_m_s: [f32; 3],
    /// How deep the deepest sample that holds the body is below the surface, metres; negative above it.
    pub depth_m: f32,
    /// How far from the middle the samples are that hold the body, metres; zero for one.
    pub radius_m: f32,
    /// How many samples touch.
    pub samples: u32,
}

impl HullPatch {
    /// Whether all of it are numbers.
    pub(crate) fn is_finite(&self) -> bool {
        let vectors = self.point_m.iter().chain(&self.normal_world).chain(&self.velocity_m_s);
        vectors.chain([&self.depth_m, &self.radius_m]).all(|number| number.is_finite())
    }
}

/// What a pass found for one moving body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodyResponse {
    /// The world vector that moves the body out of the hull, metres; `None` if it is outside, or has no
    /// way out. The paper's response uses this alone.
    pub response_m: Option<[f64; 3]>,
    /// How many of its samples are inside the hull.
    pub inside_samples: usize,
    /// Those of them that have a way out, and with [`ResponseMode::Contacts`] those above the surface, in the order of the
    /// samples. Recordings hold them with that mode alone.
    pub contacts: Vec<HullContact>,
    /// How fast the surface of the contacts turns, world, rad/s.
    pub spin_rad_s: [f32; 3],
}

impl BodyResponse {
    /// A body that the hull does not touch.
    pub const UNTOUCHED: BodyResponse =
        BodyResponse { response_m: None, inside_samples: 0, contacts: Vec::new(), spin_rad_s: [0.0; 3] };

    /// Takes how the hull meets a body of that shape instead of what was here; the buffer of contacts is
    /// kept.
    pub fn set(&mut self, collision: &BodyCollision, shape: &Shape) {
        self.response_m = collision.response_m();
        self.inside_samples = collision.inside().count();
        self.spin_rad_s = [0.0; 3];
        self.contacts.clear();
        let point_body_m = |sample: u32| shape.samples_body()[sample as usize];
        match collision {
            BodyCollision::Paper(paper) => self.contacts.extend(paper.inside.iter().filter_map(|inside| {
                Some(HullContact {
                    sample: inside.sample,
                    point_body_m: point_body_m(inside.sample),
                    normal_world: inside.edge?.normal_world,
                    depth_m: inside.exit_m?,
                    speed_m_s: None,
                    slide_m_s: [0.0; 3],
                })
            })),
            BodyCollision::Contacts(found) => {
                self.spin_rad_s = found.spin_rad_s;
                self.contacts.extend(found.contacts.iter().map(|contact| HullContact {
                    sample: contact.sample,
                    point_body_m: point_body_m(contact.sample),
                    normal_world: contact.normal_world,
                    depth_m: contact.depth_m,
                    speed_m_s: contact.speed_m_s,
                    slide_m_s: contact.slide_m_s,
                }));
            }
        }
    }

    /// Keeps it from moving the body faster than so, m/s, in a step of `dt_s`, and from giving it more speed: the hull may
    /// have grown for no other reason than that a camera is gone.
    pub fn limit(&mut self, push_m_s: f64, dt_s: f64) {
        let most_m = push_m_s * dt_s;
        if let Some(response_m) = &mut self.response_m {
            let length_m = Vector3::from(*response_m).norm();
            if length_m > most_m {
                response_m.iter_mut().for_each(|part| *part *= most_m / length_m);
            }
        }
        let (most_m, most_m_s) = (most_m as f32, push_m_s as f32);
        for contact in &mut self.contacts {
            contact.depth_m = contact.depth_m.min(most_m);
            contact.speed_m_s = contact.speed_m_s.map(|speed_m_s| speed_m_s.min(most_m_s));
        }
    }

    /// Whether the hull touches the body.
    pub fn touches(&self) -> bool {
        self.response_m.is_some() || self.inside_samples > 0
    }
}

/// A velocity mirrored at a surface whose outward normal is `outward` (of any length): `None` if it
/// does not point into the surface. `friction` (Coulomb's coefficient) takes from the velocity along
/// the surface at most that share of what the mirror turned round.
pub fn mirrored(velocity: [f64; 3], outward: [f64; 3], restitution: f64, friction: f64) -> Option<[f64; 3]> {
    let velocity = Vector3::from(velocity);
    let normal = Vector3::from(outward).try_normalize(0.0)?;
    let speed_out = velocity.dot(&normal);
    if speed_out >= 0.0 {
        return None;
    }
    let along = velocity - normal * speed_out;
    let braked = friction * (1.0 + restitution) * -speed_out;
    let kept = along.try_normalize(0.0).map_or(along, |unit| unit * (along.norm() - braked).max(0.0));
    Some((kept - normal * restitution * speed_out).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hull::camera::Pixel;
    use hull::pass::{InsideSample, PaperResult};
    use hull::question::Edge;

    #[test]
    fn samples_with_a_way_out_are_contacts() {
        let shape = Shape::new(vec![[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]).expect("samples");
        let edge = Edge {
            distance_m: 0.02,
            camera: 1,
            pixel: Pixel { column: 3, row: 4 },
            normal_world: [0.0, 1.0, 0.0],
            moved_m: None,
        };
        let sample = |sample, edge, exit_m| InsideSample { sample, inside_count: 3, edge, exit_m };
        let inside =
            vec![sample(0, None, None), sample(1, Some(edge), None), sample(2, Some(edge), Some(0.05))];
        let found = PaperResult { inside, response_m: Ok([0.0, 0.05, 0.0]), ..PaperResult::default() };
        let found = BodyCollision::Paper(found);
        let mut response = BodyResponse::default();
        for _ in 0..2 {
            response.set(&found, &shape);
            assert_eq!((response.response_m, response.inside_samples), (Some([0.0, 0.05, 0.0]), 3));
            let (point_body_m, normal_world) = ([0.0, 0.2, 0.0], [0.0, 1.0, 0.0]);
            let expected = HullContact {
                sample: 2,
                point_body_m,
                normal_world,
                depth_m: 0.05,
                speed_m_s: None,
                slide_m_s: [0.0; 3],
            };
            assert_eq!(response.contacts, [expected]);
        }
        response.set(&BodyCollision::Paper(PaperResult::default()), &shape);
        assert_eq!(response, BodyResponse::UNTOUCHED);
    }

    #[test]
    fn a_limited_response_keeps_its_way_and_moves_no_faster() {
        let contact = |depth_m, speed_m_s| HullContact {
            sample: 0,
            point_body_m: [0.0; 3],
            normal_world: [0.0, 1.0, 0.0],
            depth_m,
            speed_m_s,
            slide_m_s: [0.0; 3],
        };
        let contacts = vec![contact(0.2, Some(4.0)), contact(-0.01, Some(-3.0)), contact(0.01, None)];
        let mut response =
            BodyResponse { response_m: Some([0.3, -0.4, 0.0]), contacts, ..BodyResponse::default() };
        response.limit(1.5, 0.01);
        let [x_m, y_m, z_m] = response.response_m.expect("kept");
        assert!((x_m - 0.009).abs() < 1e-12 && (y_m + 0.012).abs() < 1e-12 && z_m == 0.0);
        let limited: Vec<_> = response.contacts.iter().map(|at| (at.depth_m, at.speed_m_s)).collect();
        assert_eq!(limited, [(0.015, Some(1.5)), (-0.01, Some(-3.0)), (0.01, None)]);
        let before = response.clone();
        response.limit(2.0, 0.01);
        assert_eq!(response, before, "what is slow enough stays");
    }

    #[test]
    fn only_the_part_that_points_in_is_mirrored() {
        assert_eq!(mirrored([1.0, -2.0, 3.0], [0.0, 0.1, 0.0], 1.0, 0.0), Some([1.0, 2.0, 3.0]));
        assert_eq!(mirrored([1.0, -2.0, 3.0], [0.0, 5.0, 0.0], 0.5, 0.0), Some([1.0, 1.0, 3.0]));
        assert_eq!(mirrored([1.0, -2.0, 3.0], [0.0, 1.0, 0.0], 0.0, 0.0), Some([1.0, 0.0, 3.0]));
    }

    #[test]
    fn a_velocity_that_points_out_or_along_stays() {
        assert_eq!(mirrored([1.0, 2.0, 3.0], [0.0, 1.0, 0.0], 1.0, 0.5), None);
        assert_eq!(mirrored([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0, 0.5), None);
        assert_eq!(mirrored([1.0, 0.0, 0.0], [0.0, 0.0, 0.0], 1.0, 0.5), None);
    }

    #[test]
    fn friction_brakes_along_the_surface_and_never_turns_round() {
        assert_eq!(mirrored([3.0, -2.0, 0.0], [0.0, 1.0, 0.0], 0.0, 0.5), Some([2.0, 0.0, 0.0]));
        assert_eq!(mirrored([0.5, -2.0, 0.0], [0.0, 1.0, 0.0], 1.0, 0.5), Some([0.0, 2.0, 0.0]));
    }
}
