//! The coordinator's side: a question is written once for all nodes, and each is told what it lacks.

use std::sync::Arc;

use bytes::Bytes;
use hull::question::{Batch, Kind, Points, Question};

use super::super::bulk::{pack_f32, pack_f64};
use super::super::choice::ChoiceWriter;
use super::super::packed::pack;
use super::super::rounded::{Precision, can_round, octahedral, round_pose};
use super::super::shape_key;
use super::{LISTS, is_kept};
use crate::v1;

/// Writes questions; one for all streams of a run.
#[derive(Debug, Default)]
pub struct QuestionWriter {
    precision: Precision,
    lists: [List; LISTS],
    /// Counts lists and choices, so that a stream's knowledge can be compared.
    serial: u64,
    choice: ChoiceWriter,
}

#[derive(Debug, Default)]
struct List {
    bodies: Vec<Points>,
    /// Before each body so many points stand in the list; and all of them.
    starts: Vec<usize>,
    wire: v1::Bodies,
    serial: u64,
    /// The points asked about last; `None`: all.
    picked: Option<Bytes>,
    picked_serial: u64,
}

/// What a node knows of the lists of its stream.
#[derive(Clone, Debug, Default)]
pub struct StreamKnows([(u64, u64); LISTS]);

/// A question in the form of messages.
#[derive(Clone, Debug)]
pub struct WrittenQuestion {
    request: v1::ProbeRequest,
    bodies: v1::Bodies,
    picked: Option<Bytes>,
    list: usize,
    serials: (u64, u64),
    is_kept: bool,
}

impl QuestionWriter {
    /// A writer that rounds or does not.
    pub fn new(precision: Precision) -> QuestionWriter {
        QuestionWriter { precision, ..QuestionWriter::default() }
    }

    /// Writes a question about bodies that go by one of the streams' lists, below [`LISTS`].
    pub fn write(&mut self, list: usize, question: &Question) -> WrittenQuestion {
        let whole = question.batches.iter().all(|batch| batch.picked.is_none());
        let places = self.lists[list].places(&question.batches, whole).unwrap_or_else(|| {
            self.replace(list, &question.batches);
            (0..question.batches.len()).collect()
        });
        let picked = (!whole).then(|| self.picked(list, question, &places));
        self.serial += 1;
        let held = &mut self.lists[list];
        if held.picked != picked || held.picked_serial == 0 {
            held.picked.clone_from(&picked);
            held.picked_serial = self.serial;
        }
        WrittenQuestion {
            request: self.request(list, question),
            bodies: self.lists[list].wire.clone(),
            picked,
            list,
            serials: (self.lists[list].serial, self.lists[list].picked_serial),
            is_kept: is_kept(&self.lists[list].bodies),
        }
    }

    fn replace(&mut self, list: usize, batches: &[Batch]) {
        self.serial += 1;
        let held = &mut self.lists[list];
        held.bodies.clear();
        held.bodies.extend(batches.iter().map(|batch| batch.points.clone()));
        held.starts.clear();
        held.starts.push(0);
        for points in &held.bodies {
            held.starts.push(held.starts.last().copied().unwrap_or_default() + points.len());
        }
        held.wire = bodies_to_wire(&held.bodies, self.precision);
        held.serial = self.serial;
        (held.picked, held.picked_serial) = (None, 0);
    }

    fn picked(&mut self, list: usize, question: &Question, places: &[usize]) -> Bytes {
        let starts = &self.lists[list].starts;
        for (batch, &place) in question.batches.iter().zip(places) {
            match batch.picked.clone() {
                Some(range) => {
                    let picked = &question.picked[range];
                    picked.iter().for_each(|&index| self.choice.take(starts[place] + index as usize));
                }
                None => (starts[place]..starts[place + 1]).for_each(|index| self.choice.take(index)),
            }
        }
        self.choice.finish(starts.last().copied().unwrap_or_default())
    }

    fn request(&self, list: usize, question: &Question) -> v1::ProbeRequest {
        let rounded = self.precision == Precision::Quantised;
        let Question { kind, batches, picked: _, directions, within, hints } = question;
        // Bodies of which nothing is asked do not travel, so neither does what belongs to them.
        let whole = batches.iter().all(|batch| batch.picked.is_none());
        let asked = || batches.iter().enumerate().filter(move |(_, batch)| whole || !batch.is_empty());
        let offsets = || asked().flat_map(|(_, batch)| batch.offset_m);
        let shared = || asked().filter_map(|(index, _)| directions.get(index)).flatten().copied();
        let codes: Vec<u8> = within.iter().map(|reach| reach.code()).collect();
        let hints: Vec<u8> = hints.iter().flat_map(|camera| camera.to_le_bytes()).collect();
        v1::ProbeRequest {
            id: 0,
            frame: 0,
            kind: kind_to_wire(*kind).into(),
            list: list as u32,
            bodies: None,
            points: None,
            offsets: if offsets().all(|part| part.to_bits() == 0) {
                Bytes::new()
            } else if rounded {
                pack_f32(offsets().map(|part| part as f32))
            } else {
                pack_f64(offsets())
            },
            directions: match kind {
                Kind::Classes | Kind::Edges => Bytes::new(),
                Kind::SharedExits => pack_f32(shared()),
                Kind::Exits if rounded => {
                    directions.iter().flat_map(|&direction| octahedral(direction)).collect::<Vec<u8>>().into()
                }
                Kind::Exits => pack_f32(directions.iter().flatten().copied()),
            },
            within: pack(&codes),
            hints: pack(&hints),
            rounded,
        }
    }
}

impl List {
    /// The place of each batch's body in the list; `None` if the list does not serve.
    fn places(&self, batches: &[Batch], whole: bool) -> Option<Vec<usize>> {
        if self.serial == 0 || !is_kept(&self.bodies) || whole && batches.len() != self.bodies.len() {
            return None;
        }
        let mut next = 0;
        let place = |batch: &Batch| {
            let found = self.bodies[next..].iter().position(|body| is_same(body, &batch.points))?;
            next += found + 1;
            Some(next - 1)
        };
        batches.iter().map(place).collect()
    }
}

impl WrittenQuestion {
    /// The message for a node, with what its stream does not know yet.
    pub fn message(&self, knows: &StreamKnows, id: u64, frame: u64) -> v1::ProbeRequest {
        let (list, points) = knows.0[self.list];
        let has_list = list == self.serials.0;
        let has_points = has_list && points == self.serials.1;
        v1::ProbeRequest {
            id,
            frame,
            bodies: (!has_list).then(|| self.bodies.clone()),
            points: self
                .picked
                .as_ref()
                .map(|picked| v1::Points { picked: (!has_points).then(|| picked.clone()) }),
            ..self.request.clone()
        }
    }
}

impl StreamKnows {
    /// Notes that the message of a question is on its way.
    pub fn learn(&mut self, question: &WrittenQuestion) {
        self.0[question.list] = if question.is_kept { question.serials } else { (0, 0) };
    }
}

/// The same points, bit for bit.
fn is_same(a: &Points, b: &Points) -> bool {
    match (a, b) {
        (Points::Body { shape: a, pose: p }, Points::Body { shape: b, pose: q }) => {
            let bits = |pose: &hull::Pose| {
                (pose.position_m().map(f64::to_bits), pose.rotation_xyzw().map(f64::to_bits))
            };
            (Arc::ptr_eq(a, b) || a.digest() == b.digest()) && bits(p) == bits(q)
        }
        (Points::World(a), Points::World(b)) => Arc::ptr_eq(a, b),
        _ => false,
    }
}

fn bodies_to_wire(bodies: &[Points], precision: Precision) -> v1::Bodies {
    let key = |points: &Points| match points {
        Points::Body { shape, .. } => shape_key(&shape.digest()),
        Points::World(_) => 0,
    };
    let shapes: Vec<u8> = bodies.iter().flat_map(|points| key(points).to_le_bytes()).collect();
    let poses = || {
        bodies
            .iter()
            .filter_map(|points| if let Points::Body { pose, .. } = points { Some(pose) } else { None })
    };
    let rounded = precision == Precision::Quantised && poses().all(can_round);
    let world =
        bodies.iter().filter_map(|points| if let Points::World(world) = points { Some(world) } else { None });
    let numbers = |world: &Arc<[[f64; 3]]>| {
        let numbers = world.iter().flatten().copied();
        if precision == Precision::Quantised {
            pack_f32(numbers.map(|part| part as f32))
        } else {
            pack_f64(numbers)
        }
    };
    v1::Bodies {
        shapes: pack(&shapes),
        poses: if rounded {
            poses().flat_map(round_pose).collect::<Vec<u8>>().into()
        } else {
            pack_f64(poses().flat_map(|pose| pose.position_m().into_iter().chain(pose.rotation_xyzw())))
        },
        world: world.map(numbers).collect(),
    }
}

fn kind_to_wire(kind: Kind) -> v1::probe_request::Kind {
    match kind {
        Kind::Classes => v1::probe_request::Kind::Classes,
        Kind::Edges => v1::probe_request::Kind::Edges,
        Kind::Exits => v1::probe_request::Kind::Exits,
        Kind::SharedExits => v1::probe_request::Kind::BodyExits,
    }
}
