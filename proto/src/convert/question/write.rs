//! The coordinator's side: a question is written once for all nodes, and each is sent what it lacks.

use std::sync::Arc;

use bytes::Bytes;
use hull::coordinates::Coordinates;
use hull::question::{Batch, Points, Question, QuestionKind};

use super::super::answer::asked_world;
use super::super::bulk::{pack_f32, pack_f64};
use super::super::choice::ChoiceWriter;
use super::super::packed::pack;
use super::super::rounded::{
    Precision, UnitBits, can_round, octahedral, octahedral_again, reach_code, round_pose,
};
use super::super::shape_key;
use super::is_kept;
use crate::v1;

/// Writes questions; one for all streams of a run.
#[derive(Debug, Default)]
pub struct QuestionWriter {
    precision: Precision,
    list: List,
    /// Counts lists and choices, so that what a stream holds can be compared.
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
    /// The points that later questions choose from, as places in the list, and as a choice.
    kept: Vec<usize>,
    kept_wire: Bytes,
    kept_serial: u64,
    /// Those of them asked about last; `None`: all of the list.
    picked: Option<Bytes>,
    picked_serial: u64,
}

/// The serials of a list, of the points kept of it, and of those asked about last.
type Serials = [u64; 3];

/// What a node knows of the list of its stream.
#[derive(Clone, Debug, Default)]
pub struct StreamKnows(Serials);

/// A question in the form of messages.
#[derive(Clone, Debug)]
pub struct WrittenQuestion {
    request: v1::ProbeRequest,
    bodies: v1::Bodies,
    kept: Bytes,
    picked: Option<Bytes>,
    serials: Serials,
    is_kept: bool,
    points_world: Arc<Coordinates>,
}

impl QuestionWriter {
    /// A writer that rounds or does not.
    pub fn new(precision: Precision) -> QuestionWriter {
        QuestionWriter { precision, ..QuestionWriter::default() }
    }

    /// Whether it rounds.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Writes a question. Bodies that the list holds already, in their order, are not written again.
    pub fn write(&mut self, question: &Question) -> WrittenQuestion {
        let whole = question.batches.iter().all(|batch| batch.picked.is_none());
        let places = self.list.places(&question.batches, whole).unwrap_or_else(|| {
            self.replace(&question.batches);
            (0..question.batches.len()).collect()
        });
        let picked = (!whole).then(|| self.picked(question, &places));
        self.serial += 1;
        let request = self.request(question);
        let list = &mut self.list;
        if list.picked != picked || list.picked_serial == 0 {
            list.picked.clone_from(&picked);
            list.picked_serial = self.serial;
        }
        WrittenQuestion {
            request,
            bodies: list.wire.clone(),
            kept: list.kept_wire.clone(),
            picked,
            serials: list.serials(),
            is_kept: is_kept(&list.bodies),
            points_world: asked_world(question),
        }
    }

    fn replace(&mut self, batches: &[Batch]) {
        self.serial += 1;
        let list = &mut self.list;
        list.bodies.clear();
        list.bodies.extend(batches.iter().map(|batch| batch.points.clone()));
        list.starts.clear();
        list.starts.push(0);
        for points in &list.bodies {
            list.starts.push(list.starts.last().copied().unwrap_or_default() + points.len());
        }
        list.wire = bodies_to_wire(&list.bodies, self.precision);
        list.serial = self.serial;
        list.kept.clear();
        (list.kept_serial, list.picked, list.picked_serial) = (0, None, 0);
    }

    /// The question's points as a choice out of those that are kept; keeps others if it asks about others.
    fn picked(&mut self, question: &Question, places: &[usize]) -> Bytes {
        let List { starts, kept, .. } = &self.list;
        let points = || {
            question.batches.iter().zip(places).flat_map(|(batch, &place)| {
                let (start, all) = (starts[place], 0..(starts[place + 1] - starts[place]) as u32);
                let picked = batch.picked.clone().map_or(&[][..], |range| &question.picked[range]);
                let all = if batch.picked.is_none() { all } else { 0..0 };
                picked.iter().copied().chain(all).map(move |index| start + index as usize)
            })
        };
        let mut at = 0;
        let are_kept = points().all(|point| {
            at += kept[at..].iter().take_while(|&&kept| kept < point).count();
            kept.get(at) == Some(&point)
        });
        if !are_kept {
            let kept: Vec<usize> = points().collect();
            kept.iter().for_each(|&point| self.choice.take(point));
            let wire = self.choice.finish(starts.last().copied().unwrap_or_default());
            self.serial += 1;
            let list = &mut self.list;
            (list.kept, list.kept_wire, list.kept_serial) = (kept, wire, self.serial);
            (0..list.kept.len()).for_each(|place| self.choice.take(place));
            return self.choice.finish(list.kept.len());
        }
        let mut at = 0;
        for point in points() {
            at += kept[at..].iter().take_while(|&&kept| kept < point).count();
            self.choice.take(at);
        }
        self.choice.finish(kept.len())
    }

    fn request(&self, question: &Question) -> v1::ProbeRequest {
        let rounded = self.precision == Precision::Quantised;
        let Question { kind, batches, picked: _, directions, within, hints } = question;
        // Bodies of which nothing is asked do not travel, so neither does what belongs to them.
        let whole = batches.iter().all(|batch| batch.picked.is_none());
        let asked = || batches.iter().enumerate().filter(move |(_, batch)| whole || !batch.is_empty());
        let offsets = || asked().flat_map(|(_, batch)| batch.offset_m);
        let shared = || asked().filter_map(|(index, _)| directions.get(index)).copied();
        let codes: Vec<u8> = within.iter().map(|&reach| reach_code(reach, self.precision)).collect();
        let hints: Vec<u8> = hints.iter().flat_map(|camera| camera.to_le_bytes()).collect();
        v1::ProbeRequest {
            id: 0,
            frame: 0,
            cameras: Vec::new(),
            traceparent: String::new(),
            kind: kind_to_wire(*kind).into(),
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
                QuestionKind::Classes | QuestionKind::Edges | QuestionKind::Planes => Bytes::new(),
                QuestionKind::SharedExits if rounded => octahedral(shared(), UnitBits::Twenty),
                QuestionKind::SharedExits => pack_f32(shared().flatten()),
                QuestionKind::Exits if rounded => octahedral_again(directions.iter().copied()),
                QuestionKind::Exits => pack_f32(directions.iter().flatten().copied()),
            },
            within: pack(&codes),
            hints: pack(&hints),
            rounded,
            holder: 0,
        }
    }
}

impl List {
    fn serials(&self) -> Serials {
        [self.serial, self.kept_serial, self.picked_serial]
    }

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
    /// The question's points as the answers to it need them.
    pub fn points_world(&self) -> &Arc<Coordinates> {
        &self.points_world
    }

    /// The message for a node, with what its stream does not know yet.
    pub fn message(&self, knows: &StreamKnows, id: u64, frame: u64) -> v1::ProbeRequest {
        let [list, kept, picked] = knows.0;
        let has_list = list == self.serials[0];
        let has_kept = has_list && kept == self.serials[1];
        let has_picked = has_kept && picked == self.serials[2];
        v1::ProbeRequest {
            id,
            frame,
            bodies: (!has_list).then(|| self.bodies.clone()),
            points: self.picked.as_ref().map(|picked| v1::Points {
                picked: (!has_picked).then(|| picked.clone()),
                kept: (!has_kept).then(|| self.kept.clone()),
            }),
            ..self.request.clone()
        }
    }
}

impl StreamKnows {
    /// Notes that the message of a question is on its way. One about whole bodies carries no points to choose from: the
    /// stream still knows those of this list that it was sent before, if any.
    pub fn learn(&mut self, question: &WrittenQuestion) {
        let ([list, kept, picked], [known_list, known_kept, _]) = (question.serials, self.0);
        let kept = match &question.picked {
            Some(_) => kept,
            None if known_list == list => known_kept,
            None => 0,
        };
        self.0 = if question.is_kept { [list, kept, picked] } else { [0; 3] };
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

fn kind_to_wire(kind: QuestionKind) -> v1::probe_request::Kind {
    match kind {
        QuestionKind::Classes => v1::probe_request::Kind::Classes,
        QuestionKind::Edges => v1::probe_request::Kind::Edges,
        QuestionKind::Planes => v1::probe_request::Kind::Planes,
        QuestionKind::Exits => v1::probe_request::Kind::Exits,
        QuestionKind::SharedExits => v1::probe_request::Kind::BodyExits,
    }
}
