//! What a pass asks of every group of cameras, and what a group answers. Plain data in flat arrays, whose
//! buffers are kept from question to question: the same in process, gathered and over the network.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use crate::body::{Pose, Shape};
use crate::camera::Pixel;
use crate::coordinates::Coordinates;
use crate::reach::Reach;
use crate::view::Class;

/// Where a batch's points come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Points {
    /// A registered shape at a pose.
    Body {
        /// The samples.
        shape: Arc<Shape>,
        /// World from body.
        pose: Pose,
    },
    /// Points of the world, metres.
    World(Arc<[[f64; 3]]>),
}

impl Points {
    /// How many points there are.
    pub fn len(&self) -> usize {
        match self {
            Points::Body { shape, .. } => shape.samples_body().len(),
            Points::World(points) => points.len(),
        }
    }

    /// The memory that keeping them alive may hold, bytes: a shape's is shared with all who use it.
    pub fn held_bytes(&self) -> usize {
        self.len()
            * match self {
                Points::Body { .. } => size_of::<[f32; 3]>(),
                Points::World(_) => size_of::<[f64; 3]>(),
            }
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How far along a direction of the world each point lies, metres.
    pub fn along(&self, direction: [f32; 3]) -> impl Fn(u32) -> f64 {
        let [x, y, z] = direction.map(f64::from);
        let world_from_body = match self {
            Points::Body { pose, .. } => pose.world_from_body(),
            Points::World(_) => Pose::IDENTITY.world_from_body(),
        };
        move |index| {
            let [px, py, pz] = match self {
                Points::Body { shape, .. } => world_from_body(shape.samples_body()[index as usize]).into(),
                Points::World(points) => points[index as usize],
            };
            x * px + y * py + z * pz
        }
    }
}

/// Some points of one body.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// All of the body's points.
    pub points: Points,
    /// How far they are moved in the world before they are asked about, metres.
    pub offset_m: [f64; 3],
    /// Where [`Question::picked`] says which of them are asked about; `None` means all.
    pub picked: Option<Range<usize>>,
}

impl Batch {
    /// All points of a body.
    pub fn all(points: Points) -> Batch {
        Batch { points, offset_m: [0.0; 3], picked: None }
    }

    /// How many points are asked about.
    pub fn len(&self) -> usize {
        self.picked.as_ref().map_or(self.points.len(), Range::len)
    }

    /// True if nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What is asked about every point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum QuestionKind {
    /// Inside, outside or unknown?
    #[default]
    Classes,
    /// The nearest edge of the cameras that say inside, and its normal?
    Edges,
    /// The same, with the normal of the plane through the camera's centre and the straightened edge: the hull's
    /// surface there. Of a point that cameras say is outside, the plane that is farthest from it among theirs, at a
    /// negative distance; cameras without foreground within 256 pixels of it do not answer.
    Planes,
    /// Where does the ray along the point's own direction leave?
    Exits,
    /// Where does the ray along its batch's direction leave?
    SharedExits,
}

impl QuestionKind {
    /// All of them, in their order.
    pub const ALL: [QuestionKind; 5] = [
        QuestionKind::Classes,
        QuestionKind::Edges,
        QuestionKind::Planes,
        QuestionKind::Exits,
        QuestionKind::SharedExits,
    ];

    /// As figures name it.
    pub fn word(self) -> &'static str {
        match self {
            QuestionKind::Classes => "classes",
            QuestionKind::Edges => "edges",
            QuestionKind::Planes => "planes",
            QuestionKind::Exits => "exits",
            QuestionKind::SharedExits => "shared_exits",
        }
    }
}

impl QuestionKind {
    /// True if an answer of this kind can be to a question of the other: exits are answered alike.
    pub fn answers(self, question: QuestionKind) -> bool {
        let plain = |kind| if kind == QuestionKind::SharedExits { QuestionKind::Exits } else { kind };
        plain(self) == plain(question)
    }
}

/// One round's question, the same to every group that is asked. Answers come in the order of batches and
/// points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Question {
    /// What is asked.
    pub kind: QuestionKind,
    /// Of which points.
    pub batches: Vec<Batch>,
    /// The points of the batches that pick some, ascending within each batch.
    pub picked: Vec<u32>,
    /// Unit vectors of the world: one a point for [`QuestionKind::Exits`], one a batch for [`QuestionKind::SharedExits`].
    pub directions: Vec<[f32; 3]>,
    /// How far each point's edge or exit matters: one farther away need not be found and is not answered.
    /// Empty: every one matters.
    pub within: Vec<Reach>,
    /// The camera whose edge each direction came from: worth trying first. May be empty.
    pub hints: Vec<u16>,
}

impl Question {
    /// How many points are asked about.
    pub fn len(&self) -> usize {
        self.batches.iter().map(Batch::len).sum()
    }

    /// The memory that it holds, bytes, with the points that it refers to.
    pub fn held_bytes(&self) -> usize {
        let points: usize = self.batches.iter().map(|batch| batch.points.held_bytes()).sum();
        points
            + size_of::<Batch>() * self.batches.capacity()
            + size_of::<u32>() * self.picked.capacity()
            + size_of::<[f32; 3]>() * self.directions.capacity()
            + size_of::<Reach>() * self.within.capacity()
            + size_of::<u16>() * self.hints.capacity()
    }

    /// True if nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.batches.iter().all(Batch::is_empty)
    }

    /// Empties it for a question of another kind and keeps its buffers.
    pub fn restart(&mut self, kind: QuestionKind) {
        let Question { kind: old, batches, picked, directions, within, hints } = self;
        *old = kind;
        batches.clear();
        picked.clear();
        directions.clear();
        within.clear();
        hints.clear();
    }

    /// Adds a batch of the points that `picks` yields, ascending.
    pub fn pick(&mut self, points: &Points, offset_m: [f64; 3], picks: impl Iterator<Item = u32>) {
        let first = self.picked.len();
        self.picked.extend(picks);
        let picked = Some(first..self.picked.len());
        self.batches.push(Batch { points: points.clone(), offset_m, picked });
    }

    /// Appends the asked points of a batch in the world, metres.
    #[inline(always)]
    pub fn append_world(&self, batch: &Batch, points_world: &mut Coordinates) {
        let picked = batch.picked.clone().map(|range| &self.picked[range]);
        match &batch.points {
            Points::Body { shape, pose } => {
                let world_from_body = pose.moved(batch.offset_m).world_from_body();
                let placed = |sample| world_from_body(sample).into();
                let samples = shape.samples_body();
                match picked {
                    None => points_world.extend(samples.iter().map(|&sample| placed(sample))),
                    Some(picked) => {
                        points_world.extend(picked.iter().map(|&index| placed(samples[index as usize])));
                    }
                }
            }
            Points::World(points) => {
                let moved = |p: &[f64; 3]| std::array::from_fn(|axis| p[axis] + batch.offset_m[axis]);
                match picked {
                    None => points_world.extend(points.iter().map(moved)),
                    Some(picked) => {
                        points_world.extend(picked.iter().map(|&index| moved(&points[index as usize])));
                    }
                }
            }
        }
    }
}

/// What a group of cameras says of a point: how many say inside, or that one says outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing(u16);

impl Standing {
    /// Some camera says outside.
    pub const OUTSIDE: Standing = Standing(u16::MAX);
    /// More cameras than a rig can have: their places are 16 bits.
    const MOST: u16 = u16::MAX - 1;

    /// No camera says outside and `count` say inside.
    pub fn inside(count: usize) -> Standing {
        Standing(count.min(usize::from(Standing::MOST)) as u16)
    }

    /// How many cameras say inside; `None` if one says outside.
    pub fn inside_count(self) -> Option<usize> {
        (self != Standing::OUTSIDE).then_some(usize::from(self.0))
    }

    /// What two groups say together.
    #[inline]
    pub fn and(self, other: Standing) -> Standing {
        // Without branches: many are merged at once.
        let is_outside = (self == Standing::OUTSIDE) | (other == Standing::OUTSIDE);
        let count = self.0.saturating_add(other.0).min(Standing::MOST);
        if is_outside { Standing::OUTSIDE } else { Standing(count) }
    }
}

impl From<Class> for Standing {
    fn from(class: Class) -> Standing {
        match class {
            Class::Inside => Standing::inside(1),
            Class::Outside => Standing::OUTSIDE,
            Class::Unknown => Standing::inside(0),
        }
    }
}

/// The nearest edge of a group of cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// From the point to the viewing ray through the edge pixel, metres; of a [plane from outside](Edge::is_from_outside)
    /// [`Edge::distance_from_outside_m`].
    pub distance_m: f32,
    /// The camera's place in the rig.
    pub camera: u16,
    /// The edge pixel.
    pub pixel: Pixel,
    /// The visual hull's outward unit normal there, in the world: of a plane through the camera's centre.
    pub normal_world: [f32; 3],
    /// To [`QuestionKind::Planes`]: how far the plane moves out in a frame, metres, where the frame before tells.
    pub moved_m: Option<f32>,
}

impl Edge {
    /// True if it is the nearer of two; ties go to the lower camera.
    pub fn is_nearer(&self, other: &Edge) -> bool {
        // Almost never equal, and never not a number.
        if self.distance_m != other.distance_m {
            return self.distance_m < other.distance_m;
        }
        self.camera < other.camera
    }

    /// To [`QuestionKind::Planes`]: whether its camera says that the point is outside.
    pub fn is_from_outside(&self) -> bool {
        self.distance_m.is_sign_negative()
    }

    /// From a plane through a camera's centre to a point that the camera says is outside, metres, negated: less than zero,
    /// or -0.0 of a point behind the plane. Nodes and the coordinator compute the same bits.
    #[inline(always)]
    pub fn distance_from_outside_m(
        normal_world: [f32; 3],
        centre_world: &Point3<f64>,
        point_world: &Point3<f64>,
    ) -> f32 {
        let inward_m = Vector3::from(normal_world.map(f64::from)).dot(&(centre_world - point_world));
        -((-inward_m).max(0.0).abs() as f32)
    }
}

/// A camera falls silent, or sees again, on a point's ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Which point of the question.
    pub point: u32,
    /// Where on the ray, metres.
    pub t_m: f32,
    /// By how much the number of cameras that say inside changes.
    pub by: i32,
}

/// The exit of a ray that has none within the depth or the reach that was asked for.
pub const NO_EXIT_M: f32 = f32::INFINITY;

/// A group's answer to a [`Question`]. Only the arrays of its kind are filled, one value a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// What was asked.
    pub kind: QuestionKind,
    /// To [`QuestionKind::Classes`].
    pub standings: Vec<Standing>,
    /// To [`QuestionKind::Edges`] and [`QuestionKind::Planes`]; `None` where no camera has an edge within reach.
    pub edges: Vec<Option<Edge>>,
    /// To [`QuestionKind::Edges`] asked within reaches, of cameras that are never silent: the reach within which the edge's own
    /// camera leaves the silhouette along the edge's normal, so that no camera need search for an exit beyond.
    pub exits_within: Vec<Reach>,
    /// To [`QuestionKind::Exits`] and [`QuestionKind::SharedExits`]: the first `t` outside, metres, or [`NO_EXIT_M`].
    pub exits_m: Vec<f32>,
    /// What happens on the rays before, by point and then by `t`. Empty unless cameras may be silent.
    pub changes: Vec<Change>,
}

impl Answer {
    /// Empties it for an answer to a question of that kind and keeps its buffers.
    pub fn restart(&mut self, kind: QuestionKind) {
        self.kind = kind;
        self.standings.clear();
        self.edges.clear();
        self.exits_within.clear();
        self.exits_m.clear();
        self.changes.clear();
    }

    /// How many points it answers.
    pub fn len(&self) -> usize {
        match self.kind {
            QuestionKind::Classes => self.standings.len(),
            QuestionKind::Edges | QuestionKind::Planes => self.edges.len(),
            QuestionKind::Exits | QuestionKind::SharedExits => self.exits_m.len(),
        }
    }

    /// True if it answers nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends the answer about the points that follow.
    pub fn append(&mut self, next: &Answer) {
        self.standings.extend_from_slice(&next.standings);
        self.edges.extend_from_slice(&next.edges);
        self.exits_within.extend_from_slice(&next.exits_within);
        self.exits_m.extend_from_slice(&next.exits_m);
        self.changes.extend_from_slice(&next.changes);
    }
}
