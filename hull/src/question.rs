//! What a pass asks of every group of cameras, and what a group answers. Plain data: the same in
//! process, gathered and over the network.

use std::sync::Arc;

use nalgebra::Point3;

use crate::body::{Pose, Shape};
use crate::camera::Pixel;
use crate::probe::exit::Exit;

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

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The points moved by `offset_m`, metres.
    pub fn moved(&self, offset_m: [f64; 3]) -> Points {
        match self {
            Points::Body { shape, pose } => {
                Points::Body { shape: Arc::clone(shape), pose: pose.moved(offset_m) }
            }
            Points::World(points) => Points::World(
                points.iter().map(|p| std::array::from_fn(|axis| p[axis] + offset_m[axis])).collect(),
            ),
        }
    }
}

/// Some points of one body.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// All of the body's points.
    pub points: Points,
    /// Which of them are asked about, ascending; `None` means all.
    pub picked: Option<Vec<u32>>,
}

impl Batch {
    /// How many points are asked about.
    pub fn len(&self) -> usize {
        self.picked.as_ref().map_or(self.points.len(), Vec::len)
    }

    /// True if nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends the asked points in the world, metres.
    pub fn append_world(&self, points_world: &mut Vec<Point3<f64>>) {
        match (&self.points, &self.picked) {
            (Points::Body { shape, pose }, None) => {
                let world_from_body = pose.world_from_body();
                points_world.extend(shape.samples_body().iter().map(|&sample| world_from_body(sample)));
            }
            (Points::Body { shape, pose }, Some(picked)) => {
                let world_from_body = pose.world_from_body();
                let samples = shape.samples_body();
                points_world.extend(picked.iter().map(|&index| world_from_body(samples[index as usize])));
            }
            (Points::World(points), None) => points_world.extend(points.iter().map(|&p| Point3::from(p))),
            (Points::World(points), Some(picked)) => {
                points_world.extend(picked.iter().map(|&index| Point3::from(points[index as usize])));
            }
        }
    }
}

/// The directions of a batch's exits: unit vectors of the world.
#[derive(Clone, Debug, PartialEq)]
pub enum Directions {
    /// One a point: its normal.
    Each(Vec<[f32; 3]>),
    /// One for all points of the batch: the body's mean response.
    Shared([f32; 3]),
}

impl Directions {
    /// The direction of a point of the batch.
    pub fn of(&self, index: usize) -> [f32; 3] {
        match self {
            Directions::Each(each) => each[index],
            Directions::Shared(shared) => *shared,
        }
    }
}

/// One round's question, the same to every group. Answers come in the order of batches and points.
#[derive(Clone, Debug, PartialEq)]
pub enum Question {
    /// Inside, outside or unknown?
    Classes(Vec<Batch>),
    /// The nearest edge of the cameras that say inside, and its normal?
    Edges(Vec<Batch>),
    /// Where does the ray leave?
    Exits(Vec<(Batch, Directions)>),
}

impl Question {
    /// How many points are asked about.
    pub fn len(&self) -> usize {
        match self {
            Question::Classes(batches) | Question::Edges(batches) => batches.iter().map(Batch::len).sum(),
            Question::Exits(batches) => batches.iter().map(|(batch, _)| batch.len()).sum(),
        }
    }

    /// True if nothing is asked.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What a group of cameras says of a point: how many say inside, or that one says outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing(u8);

impl Standing {
    /// Some camera says outside.
    pub const OUTSIDE: Standing = Standing(u8::MAX);

    /// No camera says outside and `count` say inside.
    pub fn inside(count: usize) -> Standing {
        Standing(count.min(254) as u8)
    }

    /// How many cameras say inside; `None` if one says outside.
    pub fn inside_count(self) -> Option<usize> {
        (self != Standing::OUTSIDE).then_some(usize::from(self.0))
    }
}

/// The nearest edge of a group of cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// From the point to the viewing ray through the edge pixel, metres.
    pub distance_m: f32,
    /// The camera's place in the rig.
    pub camera: u16,
    /// The edge pixel.
    pub pixel: Pixel,
    /// The visual hull's outward unit normal there, in the world.
    pub normal_world: [f32; 3],
}

/// A group's answer to a [`Question`].
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// To [`Question::Classes`].
    Classes(Vec<Standing>),
    /// To [`Question::Edges`]; `None` where no camera says inside or none has an edge.
    Edges(Vec<Option<Edge>>),
    /// To [`Question::Exits`].
    Exits(Vec<Exit>),
}

impl Answer {
    /// How many points it answers.
    pub fn len(&self) -> usize {
        match self {
            Answer::Classes(standings) => standings.len(),
            Answer::Edges(edges) => edges.len(),
            Answer::Exits(exits) => exits.len(),
        }
    }

    /// True if it answers nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The standings, if it has these.
    pub fn classes(&self) -> Option<&[Standing]> {
        if let Answer::Classes(standings) = self { Some(standings) } else { None }
    }

    /// The edges, if it has these.
    pub fn edges(&self) -> Option<&[Option<Edge>]> {
        if let Answer::Edges(edges) = self { Some(edges) } else { None }
    }

    /// The exits, if it has these.
    pub fn exits(&self) -> Option<&[Exit]> {
        if let Answer::Exits(exits) = self { Some(exits) } else { None }
    }
}
