//! The node's side. Nothing that arrives is trusted, and the memory that a stream can pin is bounded.

use std::ops::Range;
use std::sync::Arc;

use bytes::Bytes;
use hull::question::{Batch, Points, Question, QuestionKind};
use hull::reach::Reach;
use hull::{Pose, Shape};

use super::super::ConvertError;
use super::super::bulk::{Field, unpack, unpack_f32x3, unpack_f64x3};
use super::super::choice::read_choice;
use super::super::packed::{unpack_at_most, unpack_exactly};
use super::super::rounded::{POSE_BYTES, from_octahedral, pose_of};
use super::{MAX_BODIES, is_kept};
use crate::{MAX_POINTS, v1};

/// Reads the questions of one stream, in their order.
#[derive(Debug, Default)]
pub struct QuestionReader {
    list: Option<List>,
}

/// Bodies, and what was asked about them last.
#[derive(Debug)]
struct List {
    bodies: Vec<Points>,
    point_count: usize,
    /// The points that questions choose from, as places in the list.
    kept: Vec<u32>,
    /// Which bodies took part, with their part of `picked`; `None`: all points of it.
    asked: Vec<(usize, Option<Range<usize>>)>,
    picked: Vec<u32>,
}

impl QuestionReader {
    /// The memory that its list of bodies holds from question to question, bytes.
    pub fn held_bytes(&self) -> usize {
        self.list.as_ref().map_or(0, List::held_bytes)
    }

    /// Reads a question into `question`, whose buffers are used again. `shape` finds registered shapes.
    /// After an error the list of bodies is forgotten.
    pub fn read(
        &mut self,
        request: v1::ProbeRequest,
        shape: impl Fn(u64) -> Option<Arc<Shape>>,
        question: &mut Question,
    ) -> Result<(), ConvertError> {
        let kind = request.kind().into();
        let v1::ProbeRequest {
            id: _,
            frame: _,
            kind: _,
            bodies,
            points,
            offsets,
            directions,
            within,
            hints,
            rounded,
            holder: _,
            cameras: _,
            traceparent: _,
        } = request;
        let known = self.list.take();
        let mut list = match bodies {
            Some(bodies) => List::read(bodies, rounded, shape)?,
            None => known.ok_or(ConvertError::UnknownList)?,
        };
        list.choose(points)?;
        question.restart(kind);
        list.ask(question);
        let count = question.len();
        if count > MAX_POINTS {
            return Err(ConvertError::TooManyPoints { found: count, limit: MAX_POINTS });
        }
        add_offsets(question, &offsets, rounded)?;
        add_directions(question, &directions, rounded, count)?;
        if !within.is_empty() {
            let codes = unpack_exactly(&within, count, field("within"))?;
            question.within.extend(codes.into_iter().map(Reach::from_code));
        }
        if !hints.is_empty() {
            let bytes = unpack_exactly(&hints, count * 2, field("hints"))?;
            question.hints = unpack(&bytes, count, field("hints"), u16::from_le_bytes)?;
        }
        if is_kept(&list.bodies) {
            self.list = Some(list);
        }
        Ok(())
    }
}

impl List {
    fn held_bytes(&self) -> usize {
        let points: usize = self.bodies.iter().map(Points::held_bytes).sum();
        points
            + size_of::<Points>() * self.bodies.capacity()
            + size_of::<u32>() * (self.kept.capacity() + self.picked.capacity())
            + size_of::<(usize, Option<Range<usize>>)>() * self.asked.capacity()
    }

    fn read(
        bodies: v1::Bodies,
        rounded: bool,
        shape: impl Fn(u64) -> Option<Arc<Shape>>,
    ) -> Result<List, ConvertError> {
        let v1::Bodies { shapes, poses, world } = bodies;
        let keys = Field("Bodies", "shapes");
        let shapes = unpack_at_most(&shapes, MAX_BODIES * 8, keys)?;
        let shapes = unpack(&shapes, shapes.len() / 8, keys, u64::from_le_bytes)?;
        let registered = shapes.iter().filter(|&&key| key != 0).count();
        let mut poses = poses_from_wire(&poses, registered, rounded)?.into_iter();
        let in_world = Field("Bodies", "world");
        if world.len() != shapes.len() - registered {
            let expected = shapes.len() - registered;
            return Err(in_world.value(format!("holds {} lists, expected {expected}", world.len())));
        }
        let mut world = world.iter();
        let mut bodies = Vec::with_capacity(shapes.len());
        let mut point_count = 0usize;
        for key in shapes {
            let points = match (key, poses.len()) {
                (0, _) => {
                    Points::World(world_from_wire(world.next().unwrap_or(&Bytes::new()), rounded, in_world)?)
                }
                (key, _) => {
                    let shape = shape(key).ok_or(ConvertError::UnknownShape(key))?;
                    Points::Body { shape, pose: poses.next().unwrap_or(Pose::IDENTITY) }
                }
            };
            point_count += points.len();
            if point_count > MAX_POINTS {
                return Err(ConvertError::TooManyPoints { found: point_count, limit: MAX_POINTS });
            }
            bodies.push(points);
        }
        Ok(List { bodies, point_count, kept: Vec::new(), asked: Vec::new(), picked: Vec::new() })
    }

    /// Notes which points are asked about.
    fn choose(&mut self, points: Option<v1::Points>) -> Result<(), ConvertError> {
        match points {
            None => {
                self.picked.clear();
                self.asked.clear();
                self.asked.extend((0..self.bodies.len()).map(|body| (body, None)));
                Ok(())
            }
            Some(v1::Points { picked, kept }) => {
                if let Some(kept) = kept {
                    self.keep(&kept)?;
                }
                picked.map_or(Ok(()), |picked| self.pick(&picked))
            }
        }
    }

    fn keep(&mut self, bytes: &[u8]) -> Result<(), ConvertError> {
        self.kept.clear();
        let kept = &mut self.kept;
        read_choice(bytes, self.point_count, Field("Points", "kept"), |run| {
            kept.extend(run.map(|index| index as u32));
        })
    }

    fn pick(&mut self, bytes: &[u8]) -> Result<(), ConvertError> {
        let List { bodies, point_count: _, kept, asked, picked } = self;
        asked.clear();
        picked.clear();
        // The body that the choice has come to, and the points before it and before its end.
        let (mut body, mut start, mut end) = (0, 0, bodies.first().map_or(0, Points::len));
        let mut pick = |index: u32| {
            let index = index as usize;
            while index >= end {
                body += 1;
                (start, end) = (end, end + bodies[body].len());
            }
            let at = picked.len();
            match asked.last_mut() {
                Some((last, Some(range))) if *last == body => range.end = at + 1,
                _ => asked.push((body, Some(at..at + 1))),
            }
            picked.push((index - start) as u32);
        };
        read_choice(bytes, kept.len(), Field("Points", "picked"), |run| {
            kept[run].iter().for_each(|&index| pick(index));
        })
    }

    fn ask(&self, question: &mut Question) {
        question.picked.extend_from_slice(&self.picked);
        question.batches.extend(self.asked.iter().map(|(body, picked)| Batch {
            picked: picked.clone(),
            ..Batch::all(self.bodies[*body].clone())
        }));
    }
}

fn field(name: &'static str) -> Field {
    Field("ProbeRequest", name)
}

fn poses_from_wire(bytes: &[u8], count: usize, rounded: bool) -> Result<Vec<Pose>, ConvertError> {
    let field = Field("Bodies", "poses");
    let refused = |error: hull::body::BodyError| field.value(error.to_string());
    if rounded && bytes.len() == count * POSE_BYTES {
        return bytes
            .as_chunks::<POSE_BYTES>()
            .0
            .iter()
            .map(|bytes| pose_of(bytes).map_err(refused))
            .collect();
    }
    let numbers = unpack(bytes, count * 7, field, f64::from_le_bytes)?;
    let pose = |p: &[f64; 7]| Pose::new([p[0], p[1], p[2]], [p[3], p[4], p[5], p[6]]).map_err(refused);
    numbers.as_chunks::<7>().0.iter().map(pose).collect()
}

fn world_from_wire(bytes: &[u8], rounded: bool, field: Field) -> Result<Arc<[[f64; 3]]>, ConvertError> {
    if rounded {
        let points = unpack_f32x3(bytes, field)?;
        return Ok(points.into_iter().map(|point| point.map(f64::from)).collect());
    }
    Ok(unpack_f64x3(bytes, field)?.into())
}

fn add_offsets(question: &mut Question, bytes: &[u8], rounded: bool) -> Result<(), ConvertError> {
    if bytes.is_empty() {
        return Ok(());
    }
    let count = question.batches.len();
    let offsets: Vec<[f64; 3]> = if rounded {
        field("offsets").check_length(bytes.len(), count * 12)?;
        unpack_f32x3(bytes, field("offsets"))?.into_iter().map(|offset| offset.map(f64::from)).collect()
    } else {
        field("offsets").check_length(bytes.len(), count * 24)?;
        unpack_f64x3(bytes, field("offsets"))?
    };
    question.batches.iter_mut().zip(offsets).for_each(|(batch, offset)| batch.offset_m = offset);
    Ok(())
}

fn add_directions(
    question: &mut Question,
    bytes: &[u8],
    rounded: bool,
    count: usize,
) -> Result<(), ConvertError> {
    let field = field("directions");
    let expected = match question.kind {
        QuestionKind::Classes | QuestionKind::Edges | QuestionKind::Planes => 0,
        QuestionKind::Exits => count,
        QuestionKind::SharedExits => question.batches.len(),
    };
    if rounded && matches!(question.kind, QuestionKind::Exits | QuestionKind::SharedExits) {
        question.directions = from_octahedral(bytes, expected, field)?;
        return Ok(());
    }
    field.check_length(bytes.len(), expected * 12)?;
    question.directions = unpack_f32x3(bytes, field)?;
    let unit = |d: &[f32; 3]| (d.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-3;
    match question.directions.iter().find(|direction| !unit(direction)) {
        Some(long) => Err(field.value(format!("holds {long:?}, expected unit vectors"))),
        None => Ok(()),
    }
}

impl From<v1::probe_request::Kind> for QuestionKind {
    fn from(kind: v1::probe_request::Kind) -> QuestionKind {
        match kind {
            v1::probe_request::Kind::Classes => QuestionKind::Classes,
            v1::probe_request::Kind::Edges => QuestionKind::Edges,
            v1::probe_request::Kind::Exits => QuestionKind::Exits,
            v1::probe_request::Kind::Planes => QuestionKind::Planes,
            v1::probe_request::Kind::BodyExits => QuestionKind::SharedExits,
        }
    }
}
