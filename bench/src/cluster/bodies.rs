//! The bodies that a bench asks about: shapes as the simulator samples them, placed so that a known share
//! of their samples is inside the person.

use std::sync::Arc;

use hull::body::Pose;
use hull::contact::OFFSET_M;
use hull::cull::WorldBox;
use hull::faces::FaceNormals;
use hull::question::{Answer, Batch, Points, Question, QuestionKind};
use hull::view_set::Scratch;
use hull::{Shape, ViewSet};
use setup::cli::{Failure, Outcome};
use sim::Solid;
use sim::samples::normals::{face_normals, with_offset_samples};
use sim::samples::{cloud, shape};

use crate::passes::ContactBody;
use crate::random::Random;

/// Samples of every body, unless others are asked for.
pub const SAMPLES: usize = 500;
/// The share of the samples inside the person that bodies are placed for.
pub const INSIDE_SHARE: f64 = 0.05;
/// A body's own share lies so far from it at most.
const SHARE_SPREAD: f64 = 0.03;
/// How far a body is moved away from the person to touch it nowhere, metres.
const AWAY_M: f64 = 2.0;
/// Halvings of that way until the place is found.
const HALVINGS: u32 = 14;
/// Places tried for one body; the best is taken.
const TRIES: usize = 24;
/// From pass to pass a body is somewhere within so much of its place, metres,
const STRAY_M: f64 = 0.002;
/// and turned by up to about so much, radians.
const STRAY_RAD: f64 = 0.01;

/// Bodies at their places.
#[derive(Default)]
pub struct Bodies {
    placed: Vec<(Arc<BodyShape>, Pose)>,
}

/// A body's points, as worlds have them.
struct BodyShape {
    samples: Arc<Shape>,
    /// The samples, and each of them again a centimetre out.
    probes: Arc<Shape>,
    /// Points around it.
    around: Arc<Shape>,
    faces: Arc<FaceNormals>,
}

impl Bodies {
    /// Places `count` bodies of so many samples against the person, the first ones the same whatever the count.
    pub fn place(count: usize, samples: usize, views: &ViewSet, person_world: &WorldBox) -> Outcome<Bodies> {
        let shapes = shapes(samples)?;
        let mut place = Placing { views, person_world, scratch: Scratch::default() };
        let placed = (0..count).map(|index| {
            let shape = Arc::clone(&shapes[index % shapes.len()]);
            let pose = place.against_person(&shape.samples, &mut Random::new(1 + index as u64))?;
            Ok((shape, pose))
        });
        Ok(Bodies { placed: placed.collect::<Outcome<_>>()? })
    }

    /// The first `count` of them.
    pub fn first(&self, count: usize) -> Bodies {
        Bodies { placed: self.placed.iter().take(count).cloned().collect() }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.placed.len()
    }

    /// Every shape once, whatever passes ask of it.
    pub fn shapes(&self) -> Vec<Arc<Shape>> {
        let of_body = |shape: &BodyShape| [&shape.samples, &shape.probes, &shape.around].map(Arc::clone);
        let mut shapes: Vec<Arc<Shape>> = self.placed.iter().flat_map(|(shape, _)| of_body(shape)).collect();
        shapes.sort_by_key(|shape| shape.digest());
        shapes.dedup_by_key(|shape| shape.digest());
        shapes
    }

    /// Samples of all.
    pub fn samples(&self) -> usize {
        self.placed.iter().map(|(shape, _)| shape.samples.samples_body().len()).sum()
    }

    /// Where they are in a pass: every pass moves all of them a little, so that no answer is one given
    /// before.
    pub fn at_pass(&self, pass: u64) -> Vec<Points> {
        self.moved(pass).map(|(shape, pose)| points(&shape.samples, pose)).collect()
    }

    /// The same bodies, asked about for contacts, and about what is around them if the pass is the first of its frame.
    pub fn contacts_at_pass(&self, pass: u64, is_first: bool) -> Vec<ContactBody> {
        let contact = |(shape, pose): (&BodyShape, Pose)| ContactBody {
            probes: points(&shape.probes, pose),
            around: is_first.then(|| points(&shape.around, pose)),
            faces: Some(Arc::clone(&shape.faces)),
        };
        self.moved(pass).map(contact).collect()
    }

    fn moved(&self, pass: u64) -> impl Iterator<Item = (&BodyShape, Pose)> {
        self.placed.iter().enumerate().map(move |(index, (shape, pose))| {
            let mut random = Random::new((pass << 20) + index as u64);
            (&**shape, strayed(pose, &mut random))
        })
    }

    /// The same points as [`Bodies::at_pass`], but as points of the world, not registered at nodes.
    pub fn world_at_pass(&self, pass: u64) -> Vec<Points> {
        self.at_pass(pass).into_iter().map(to_world).collect()
    }
}

/// Bodies of the demo's sizes.
fn shapes(samples: usize) -> Outcome<Vec<Arc<BodyShape>>> {
    let solids = [
        Solid::Box { size_m: [0.28, 0.28, 0.28] },
        Solid::Ball { radius_m: 0.16 },
        Solid::Cylinder { radius_m: 0.12, height_m: 0.3 },
        Solid::Capsule { radius_m: 0.1, length_m: 0.25 },
    ];
    let of_solid = |solid: &Solid| {
        let samples = Arc::new(sampled(solid, samples)?);
        let faces = face_normals(solid, &samples);
        let probes = with_offset_samples(&faces, &samples, OFFSET_M).map_err(Failure::run)?;
        let around = Shape::new(cloud(&samples).collect()).map_err(Failure::run)?;
        let (probes, around, faces) = (Arc::new(probes), Arc::new(around), Arc::new(faces));
        Ok(Arc::new(BodyShape { samples, probes, around, faces }))
    };
    solids.iter().map(of_solid).collect()
}

/// A solid with exactly so many samples: as few more as its lattice allows, thinned evenly.
fn sampled(solid: &Solid, count: usize) -> Outcome<Shape> {
    let shape = |radius_m: f64| shape(solid, radius_m).map_err(Failure::run);
    let (mut dense_m, mut sparse_m) = (0.01, 0.1);
    for _ in 0..24 {
        let middle_m = 0.5 * (dense_m + sparse_m);
        let enough = shape(middle_m)?.samples_body().len() >= count;
        *(if enough { &mut dense_m } else { &mut sparse_m }) = middle_m;
    }
    let dense = shape(dense_m)?;
    let samples = dense.samples_body();
    let thinned = (0..count).map(|index| samples[index * samples.len() / count]).collect();
    Shape::new(thinned).map_err(Failure::run)
}

fn points(shape: &Arc<Shape>, pose: Pose) -> Points {
    Points::Body { shape: Arc::clone(shape), pose }
}

/// Looks for places.
struct Placing<'a> {
    views: &'a ViewSet,
    person_world: &'a WorldBox,
    scratch: Scratch,
}

impl Placing<'_> {
    /// Draws a share, a point inside the person and a way out, and goes that way until about so much of the
    /// body is inside.
    fn against_person(&mut self, shape: &Arc<Shape>, random: &mut Random) -> Outcome<Pose> {
        let wanted = INSIDE_SHARE + SHARE_SPREAD * random.signed();
        let mut best: Option<(f64, Pose)> = None;
        for _ in 0..TRIES {
            let from_m = self.point_inside(random)?;
            let (way, turn): ([f64; 3], [f64; 4]) = (random.unit(), random.unit());
            let (mut near_m, mut far_m) = (0.0, AWAY_M);
            for _ in 0..HALVINGS {
                let middle_m = 0.5 * (near_m + far_m);
                let position_m = std::array::from_fn(|axis| from_m[axis] + middle_m * way[axis]);
                let pose = Pose::new(position_m, turn).map_err(Failure::run)?;
                let share = self.inside(Points::Body { shape: Arc::clone(shape), pose }) as f64
                    / shape.samples_body().len() as f64;
                let off = (share - wanted).abs();
                if best.is_none_or(|(least, _)| off < least) {
                    best = Some((off, pose));
                }
                *(if share > wanted { &mut near_m } else { &mut far_m }) = middle_m;
            }
            if best.is_some_and(|(off, _)| off < 0.2 * SHARE_SPREAD) {
                break;
            }
        }
        best.map(|(_, pose)| pose).ok_or_else(|| Failure::run("no place for a body"))
    }

    fn point_inside(&mut self, random: &mut Random) -> Outcome<[f64; 3]> {
        let WorldBox { min, max } = *self.person_world;
        for _ in 0..100_000 {
            let point_m: [f64; 3] =
                std::array::from_fn(|axis| min[axis] + (max[axis] - min[axis]) * random.share());
            if self.inside(Points::World([point_m].into())) == 1 {
                return Ok(point_m);
            }
        }
        Err(Failure::run("found no point inside the person"))
    }

    fn inside(&mut self, points: Points) -> usize {
        inside_count(self.views, points, &mut self.scratch)
    }
}

/// A pose a little beside another.
fn strayed(pose: &Pose, random: &mut Random) -> Pose {
    let position_m = pose.position_m().map(|value| value + STRAY_M * random.signed());
    let turned = pose.rotation_xyzw().map(|value| value + 0.5 * STRAY_RAD * random.signed());
    let length = turned.iter().map(|value| value * value).sum::<f64>().sqrt();
    // Next to a unit quaternion there is another.
    Pose::new(position_m, turned.map(|value| value / length)).unwrap_or(*pose)
}

/// How many of the points all cameras of a group see as foreground.
fn inside_count(views: &ViewSet, points: Points, scratch: &mut Scratch) -> usize {
    let question =
        Question { kind: QuestionKind::Classes, batches: vec![Batch::all(points)], ..Question::default() };
    let mut answer = Answer::default();
    views.answer(&question, scratch, &mut answer);
    answer.standings.iter().filter(|standing| standing.inside_count().is_some()).count()
}

/// The same points, as points of the world, not registered at nodes.
fn to_world(points: Points) -> Points {
    let Points::Body { shape, pose } = points else { return points };
    let world_from_body = pose.world_from_body();
    Points::World(shape.samples_body().iter().map(|&sample| world_from_body(sample).into()).collect())
}

#[cfg(test)]
mod tests {
    use super::super::film::{Film, FilmPlan};
    use super::*;

    #[test]
    fn about_a_twentieth_of_the_samples_is_inside_and_every_pass_is_another() {
        let plan = FilmPlan { cameras: 8, nodes: 8, size: (320, 240), frames: 1, noise: 0.0, abstain: false };
        let film = Film::make(plan).expect("a film");
        let views = film.views();
        let bodies = Bodies::place(12, SAMPLES, &views, &film.person_world).expect("places");
        assert_eq!(bodies.samples(), 12 * SAMPLES);
        let mut placing =
            Placing { views: &views, person_world: &film.person_world, scratch: Scratch::default() };
        let inside: usize = bodies.at_pass(3).into_iter().map(|points| placing.inside(points)).sum();
        let share = inside as f64 / bodies.samples() as f64;
        assert!((0.03..0.07).contains(&share), "{share}");
        let again: usize = bodies.world_at_pass(3).into_iter().map(|points| placing.inside(points)).sum();
        assert_eq!(again, inside, "raw points are the same points");
        assert_ne!(bodies.at_pass(3), bodies.at_pass(4));
        assert_eq!(bodies.first(5).at_pass(9), bodies.at_pass(9)[..5]);
    }
}
