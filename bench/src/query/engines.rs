//! Who answers: ours in its variants, and the paper's text done literally.

use std::cell::RefCell;
use std::hint::black_box;

use hull::coordinates::Coordinates;
use hull::cull::WorldBox;
use hull::oracle::literal;
use hull::probe::classify::Block;
use hull::question::Points;
use hull::response::BodyDirection;
use hull::{VectorPath, ViewSet};
use nalgebra::{Point3, Vector3};

use super::lanes::Lane;
use super::opponent::{Opponent, TOUCHING};
use crate::loads::Studio;
use crate::passes::{Asked, ContactBody, Passes, world_points};

/// Ours, on the best vectors of this machine, every camera in one group.
pub const HULLTOUCH: &str = "hulltouch";
/// Ours, without vector instructions that not every machine has.
pub const PORTABLE: &str = "hulltouch_portable";
/// Ours, every camera in a group of its own: what nodes of one camera cost together.
pub const UNPRUNED: &str = "hulltouch_unpruned";
/// The paper's text on dense masks.
pub const LITERAL: &str = "literal";
/// OpenCV and NumPy, in double precision as ours.
pub const OPENCV: &str = "opencv";
/// The same in single precision.
pub const OPENCV_SINGLE: &str = "opencv_single_precision";
/// The same with the distance transform that it needs for every frame.
pub const OPENCV_TRANSFORM: &str = "opencv_with_transform";
/// The same where the transform is made of the silhouette's rectangle alone.
pub const OPENCV_CROPPED: &str = "opencv_with_cropped_transform";

/// Points of the inside test done literally.
const LITERAL_BOX_POINTS: usize = 1 << 13;
/// So many bodies, evenly chosen, take part in a full pass done literally.
const LITERAL_BODIES: usize = 40;

/// Our sets of views of one studio.
pub struct Sets {
    /// Each name with its groups.
    ours: Vec<(&'static str, Vec<ViewSet>)>,
    hull_box: WorldBox,
}

impl Sets {
    /// Of a studio; bodies are culled against `hull_box`.
    pub fn new(studio: &Studio, hull_box: WorldBox) -> Sets {
        let portable = studio.views.clone().with_path(VectorPath::Portable);
        let ours = vec![
            (HULLTOUCH, vec![studio.views.clone()]),
            (PORTABLE, vec![portable]),
            (UNPRUNED, studio.alone()),
        ];
        Sets { ours, hull_box }
    }

    /// All cameras in one group, and each in its own.
    pub fn together_and_alone(&self) -> impl Iterator<Item = (&'static str, &[ViewSet])> {
        let wanted = self.ours.iter().filter(|(engine, _)| *engine != PORTABLE);
        wanted.map(|(engine, groups)| (*engine, &groups[..]))
    }
}

/// All engines that do the inside test.
pub fn inside_lanes<'a>(
    studio: &'a Studio,
    sets: &'a Sets,
    points_world: &'a Coordinates,
    opponent: Option<&'a RefCell<Opponent>>,
) -> Vec<Lane<'a>> {
    let mut lanes: Vec<Lane> =
        sets.ours.iter().map(|(engine, groups)| inside_lane(engine, groups, points_world)).collect();
    let count = LITERAL_BOX_POINTS.min(points_world.len());
    let some: Vec<Point3<f64>> = (0..count).map(|at| points_world.point(at)).collect();
    lanes.push(Lane::of_work(LITERAL, count, move || {
        let inside = |point: &&Point3<f64>| literal::is_inside(&studio.dense, point);
        black_box(black_box(&some).iter().filter(inside).count());
        Ok(())
    }));
    let theirs = |opponent| [OPENCV, OPENCV_SINGLE].map(|engine| Opponent::lane(opponent, engine, "inside"));
    lanes.extend(opponent.into_iter().flat_map(theirs));
    lanes
}

/// The test alone: every group answers for itself about every point.
fn inside_lane<'a>(engine: &'static str, groups: &'a [ViewSet], points_world: &'a Coordinates) -> Lane<'a> {
    let (mut block, mut standings) = (Block::default(), Vec::new());
    Lane::of_work(engine, points_world.len(), move || {
        for group in groups {
            standings.clear();
            group.standings(black_box(points_world), &mut block, &mut standings);
            black_box(&standings);
        }
        Ok(())
    })
}

/// All engines that do full passes; the rate counts `counted` points.
pub fn pass_lanes<'a>(
    studio: &'a Studio,
    sets: &'a Sets,
    bodies: &'a [Points],
    counted: usize,
    opponent: Option<(&'a RefCell<Opponent>, &'static str)>,
) -> Vec<Lane<'a>> {
    let mut lanes = our_passes(studio, sets, bodies, counted);
    lanes.push(literal_lane(studio, bodies, counted));
    if let Some((opponent, load)) = opponent {
        let engines = [OPENCV, OPENCV_SINGLE, OPENCV_TRANSFORM, OPENCV_CROPPED];
        lanes.extend(engines.map(|engine| Opponent::lane(opponent, engine, load)));
    }
    lanes
}

/// All engines that do contact passes; the rate counts samples and their offset samples.
pub fn contact_lanes<'a>(
    studio: &'a Studio,
    sets: &'a Sets,
    bodies: &'a [ContactBody],
    opponent: Option<&'a RefCell<Opponent>>,
) -> Vec<Lane<'a>> {
    let mut lanes = our_passes(studio, sets, bodies, bodies.iter().map(Asked::point_count).sum());
    let theirs = |opponent| {
        [OPENCV, OPENCV_SINGLE, OPENCV_CROPPED].map(|engine| Opponent::lane(opponent, engine, TOUCHING))
    };
    lanes.extend(opponent.into_iter().flat_map(theirs));
    lanes
}

fn our_passes<'a, B: Asked>(
    studio: &'a Studio,
    sets: &'a Sets,
    bodies: &'a [B],
    counted: usize,
) -> Vec<Lane<'a>> {
    let pass = |(engine, groups): &'a (&'static str, Vec<ViewSet>)| {
        let mut asked = Passes::new(studio.settings, groups.len());
        // As in a run, each pass is of another frame than the one before: what is kept of a frame is of no use to the next.
        let mut frames = [groups.clone(), groups.iter().map(|group| group.clone().after(group, 0)).collect()];
        Lane::of_work(engine, counted, move || {
            frames.swap(0, 1);
            asked.ask(black_box(bodies), &frames[0], &sets.hull_box)?;
            black_box(asked.pass.results());
            Ok(())
        })
    };
    sets.ours.iter().map(pass).collect()
}

/// Some of the bodies: the response of every point, and the exits along their mean.
fn literal_lane<'a>(studio: &'a Studio, bodies: &[Points], counted: usize) -> Lane<'a> {
    let total: usize = bodies.iter().map(Points::len).sum();
    let step = (bodies.len() / LITERAL_BODIES).max(1);
    let bodies: Vec<_> = bodies.iter().step_by(step).map(world_points).collect();
    let done: usize = bodies.iter().map(Vec::len).sum();
    Lane::of_work(LITERAL, done * counted / total.max(1), move || {
        for points_world in &bodies {
            literal_body(studio, black_box(points_world));
        }
        Ok(())
    })
}

fn literal_body(studio: &Studio, points_world: &[Point3<f64>]) {
    let window = studio.window_pixels() as i32;
    let depth_m = studio.settings.max_depth_m();
    let mut direction = BodyDirection::default();
    let mut inside: Vec<&Point3<f64>> = Vec::new();
    for point in points_world {
        if let Some(response) = literal::response(&studio.dense, point, window, depth_m) {
            direction.add(response.into());
            inside.push(point);
        }
    }
    let Some(direction) = direction.unit() else { return };
    let direction = Vector3::from(direction.map(f64::from));
    for point in inside {
        black_box(literal::exit_along(&studio.dense, point, &direction, depth_m));
    }
}
