use std::sync::Arc;

use bytes::Bytes;
use hull::question::{Batch, Points, Question, QuestionKind};
use hull::reach::Reach;
use hull::{Pose, Shape};
use proptest::prelude::*;

use super::super::{ConvertError, Precision, shape_key};
use super::{QuestionReader, QuestionWriter, StreamKnows};
use crate::v1;

/// A question about a frame for a stream that knows nothing.
fn question_to_wire(id: u64, frame: u64, question: &Question) -> v1::ProbeRequest {
    QuestionWriter::default().write(question).message(&StreamKnows::default(), id, frame)
}

fn shape() -> Arc<Shape> {
    let samples = (0..40).map(|at| [at as f32 * 0.01, 0.5, -0.25]).collect();
    Arc::new(Shape::new(samples).expect("finite"))
}

fn find(key: u64) -> Option<Arc<Shape>> {
    Some(shape()).filter(|shape| shape_key(&shape.digest()) == key)
}

fn body(x: f64) -> Points {
    Points::Body { shape: shape(), pose: Pose::new([x, -2.0, 3.0], [0.0, 0.6, 0.0, 0.8]).expect("unit") }
}

fn all(bodies: &[Points]) -> Question {
    Question { batches: bodies.iter().cloned().map(Batch::all).collect(), ..Question::default() }
}

fn some(kind: QuestionKind, picks: &[(&Points, &[u32])]) -> Question {
    let mut question = Question { kind, ..Question::default() };
    picks.iter().for_each(|(points, picks)| question.pick(points, [0.0; 3], picks.iter().copied()));
    question
}

/// A coordinator's and a node's end of one stream.
#[derive(Default)]
struct Stream {
    writer: QuestionWriter,
    knows: StreamKnows,
    reader: QuestionReader,
}

impl Stream {
    fn message(&mut self, question: &Question) -> v1::ProbeRequest {
        let written = self.writer.write(question);
        let message = written.message(&self.knows, 7, 3);
        self.knows.learn(&written);
        message
    }

    fn pass(&mut self, question: &Question) -> Question {
        let message = self.message(question);
        self.read(message).expect("valid")
    }

    fn read(&mut self, message: v1::ProbeRequest) -> Result<Question, ConvertError> {
        let mut read = Question::default();
        self.reader.read(message, find, &mut read).map(|()| read)
    }
}

#[test]
fn questions_survive_the_wire() {
    let (one, two) = (body(0.1), body(0.2));
    let world = Points::World([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]].into());
    let picked = some(QuestionKind::Edges, &[(&one, &[0, 3, 39]), (&world, &[1])]);
    let planes = Question { kind: QuestionKind::Planes, ..picked.clone() };
    let near = Question { within: vec![Reach::covering(0.02); 4], ..picked.clone() };
    let directions = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.6, 0.8, 0.0]];
    let each = Question { kind: QuestionKind::Exits, directions, ..near.clone() };
    let directions = vec![[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]];
    let mut shared = Question { kind: QuestionKind::SharedExits, directions, ..picked.clone() };
    shared.hints = vec![1, 2, 300, 4];
    let mut moved = picked.clone();
    moved.batches[0].offset_m = [0.0, 0.25, -1e-9];
    let mut stream = Stream::default();
    let bodies = all(&[one, two, world]);
    for question in [&bodies, &picked, &planes, &near, &each, &shared, &moved, &bodies, &bodies, &all(&[])] {
        assert_eq!(stream.pass(question), *question);
        // Nor does it take a stream that knows nothing.
        let mut read = Question::default();
        let message = question_to_wire(7, 3, question);
        assert_eq!((message.id, message.frame), (7, 3));
        QuestionReader::default().read(message, find, &mut read).expect("valid");
        assert_eq!(read, *question);
    }
}

#[test]
fn bodies_and_choices_are_sent_once() {
    let bodies = [body(0.1), body(0.2)];
    let mut stream = Stream::default();
    let first = stream.message(&all(&bodies));
    assert!(first.bodies.is_some());
    let edges = some(QuestionKind::Edges, &[(&bodies[1], &[4, 5])]);
    let second = stream.message(&edges);
    assert!(second.bodies.is_none() && second.points.as_ref().is_some_and(|points| points.picked.is_some()));
    let exits = Question { kind: QuestionKind::Exits, directions: vec![[1.0, 0.0, 0.0]; 2], ..edges.clone() };
    let third = stream.message(&exits);
    assert!(third.bodies.is_none() && third.points.as_ref().is_some_and(|points| points.picked.is_none()));
    for (message, question) in [(first, &all(&bodies)), (second, &edges), (third, &exits)] {
        assert_eq!(stream.read(message).as_ref(), Ok(question));
    }
    // Bodies that rest are not sent again in the next pass, bodies that moved are.
    assert!(stream.message(&all(&bodies)).bodies.is_none());
    assert!(stream.message(&all(&[body(0.1), body(0.3)])).bodies.is_some());
}

#[test]
fn a_node_that_joins_late_is_sent_what_it_lacks() {
    let bodies = [body(0.1), body(0.2)];
    let mut stream = Stream::default();
    let first = stream.writer.write(&all(&bodies));
    // The first question went to other nodes alone.
    drop(first);
    let left = some(QuestionKind::Classes, &[(&bodies[0], &[7]), (&bodies[1], &[1, 2, 3])]);
    assert_eq!(stream.pass(&left), left);
    let edges = some(QuestionKind::Edges, &[(&bodies[0], &[7]), (&bodies[1], &[1, 2, 3])]);
    assert!(stream.message(&edges).points.is_some_and(|points| points.picked.is_none()));
}

#[test]
fn a_node_that_was_not_asked_is_sent_the_choice_though_the_bodies_came_again() {
    let bodies = [body(0.1), body(0.2)];
    let edges = some(QuestionKind::Edges, &[(&bodies[1], &[4, 5])]);
    for knows_another_choice in [false, true] {
        let mut stream = Stream::default();
        if knows_another_choice {
            let other = some(QuestionKind::Edges, &[(&bodies[0], &[1, 2, 3])]);
            assert_eq!(stream.pass(&all(&bodies)), all(&bodies));
            assert_eq!(stream.pass(&other), other);
        }
        // A pass that other nodes alone are asked, and the next about the same bodies.
        drop(stream.writer.write(&all(&bodies)));
        drop(stream.writer.write(&edges));
        assert_eq!(stream.pass(&all(&bodies)), all(&bodies));
        let message = stream.message(&edges);
        assert_eq!(stream.read(message).as_ref(), Ok(&edges), "knows another: {knows_another_choice}");
    }
}

#[test]
fn other_bodies_take_the_place_of_the_list() {
    let mut stream = Stream::default();
    let (a, b) = ([body(0.1)], [body(0.2)]);
    for bodies in [&a, &b, &a] {
        let message = stream.message(&all(bodies));
        assert!(message.bodies.is_some());
        assert_eq!(stream.read(message), Ok(all(bodies)));
    }
    // A question that was written before the last ones brings its bodies again.
    let question = some(QuestionKind::Edges, &[(&b[0], &[2])]);
    let written = stream.writer.write(&question);
    stream.pass(&all(&a));
    let late = written.message(&stream.knows, 8, 3);
    assert!(late.bodies.is_some());
    assert_eq!(stream.read(late), Ok(question));
}

#[test]
fn a_list_that_is_not_there_is_refused() {
    let mut stream = Stream::default();
    let question = all(&[body(0.1)]);
    drop(stream.message(&question));
    let message = stream.message(&question);
    assert_eq!(stream.read(message), Err(ConvertError::UnknownList));
    stream.knows = StreamKnows::default();
    assert_eq!(stream.pass(&question), question);
}

#[test]
fn many_raw_points_are_not_kept() {
    let mut stream = Stream::default();
    let question = all(&[Points::World(vec![[0.5; 3]; 70_000].into())]);
    for _ in 0..2 {
        let message = stream.message(&question);
        assert!(message.bodies.is_some());
        assert_eq!(stream.read(message).as_ref(), Ok(&question));
    }
    assert_eq!(stream.read(v1::ProbeRequest::default()), Err(ConvertError::UnknownList));
}

#[test]
fn rounded_questions_are_small_and_near() {
    let mut stream = Stream { writer: QuestionWriter::new(Precision::Quantised), ..Stream::default() };
    let bodies = [body(0.1), body(0.2)];
    let message = stream.message(&all(&bodies));
    assert_eq!(message.bodies.as_ref().expect("bodies").poses.len(), 40);
    let read = stream.read(message).expect("valid");
    for (body, read) in bodies.iter().zip(&read.batches) {
        let (Points::Body { pose, .. }, Points::Body { pose: near, .. }) = (body, &read.points) else {
            panic!("expected bodies")
        };
        let apart = pose.world_from_body()([0.3, 0.5, 0.2]) - near.world_from_body()([0.3, 0.5, 0.2]);
        assert!(apart.norm() < 2e-6, "{}", apart.norm());
    }
    let mut exits = some(QuestionKind::Exits, &[(&bodies[1], &[4, 5])]);
    exits.directions = vec![[0.6, 0.0, -0.8], [0.0, 1.0, 0.0]];
    let read = stream.pass(&exits);
    let off = exits.directions.iter().flatten().zip(read.directions.iter().flatten());
    assert!(off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 3e-6);
    assert_eq!(read.batches[0].picked, Some(0..2), "the poses were the same, so the list was");
}

#[test]
fn invalid_messages_are_refused_by_field() {
    let question = all(&[body(0.0)]);
    let read = |message, find: fn(u64) -> Option<Arc<Shape>>| {
        QuestionReader::default().read(message, find, &mut Question::default()).expect_err("a lie")
    };
    let error = read(question_to_wire(1, 1, &question), |_| None);
    assert!(matches!(error, ConvertError::UnknownShape(_)));
    let nan = all(&[Points::World([[f64::NAN, 0.0, 0.0]].into())]);
    let error = read(question_to_wire(1, 1, &nan), find);
    assert_eq!(error.to_string(), "Bodies.world: holds NaN, expected finite numbers");
    let mut long = some(QuestionKind::Exits, &[(&body(0.0), &[1])]);
    long.directions = vec![[2.0, 0.0, 0.0]];
    let error = read(question_to_wire(1, 1, &long), find);
    let expected = "ProbeRequest.directions: holds [2.0, 0.0, 0.0], expected unit vectors";
    assert_eq!(error.to_string(), expected);
    let many = all(&[Points::World(vec![[0.0; 3]; 1_000_001].into())]);
    assert!(matches!(read(question_to_wire(1, 1, &many), find), ConvertError::TooManyPoints { .. }));
}

/// A question of a pass: all of its bodies, or so many of each body's samples, of the second at least one.
fn of_pass(bodies: usize, sizes: &Option<[u32; 2]>) -> Question {
    let bodies = [body(bodies as f64), body(0.2)];
    let Some(sizes) = sizes else { return all(&bodies) };
    let picks = sizes.map(|size| (0..size).map(|at| at * 3).collect::<Vec<u32>>());
    let picks = [(&bodies[0], &picks[0][..]), (&bodies[1], &picks[1][..])];
    // A pass leaves out bodies of which it asks nothing.
    let first = if picks[0].1.is_empty() { 1 } else { 0 };
    some(QuestionKind::Edges, &picks[first..])
}

proptest! {
    /// Whichever nodes are asked, as nodes leave, come back and are asked in phases, each reads what was asked.
    #[test]
    fn every_node_reads_the_question_whatever_questions_it_was_not_asked(
        questions in proptest::collection::vec(
            (0usize..2, proptest::option::of([0u32..4, 1u32..4]), 0u8..8, 0u8..24), 1..30,
        ),
    ) {
        let mut writer = QuestionWriter::default();
        let mut nodes: [(StreamKnows, QuestionReader); 3] = Default::default();
        for (bodies, sizes, asked, lost) in questions {
            let question = of_pass(bodies, &sizes);
            let written = writer.write(&question);
            for (index, (knows, reader)) in nodes.iter_mut().enumerate() {
                // A node that is lost begins another stream.
                if usize::from(lost) == index {
                    (*knows, *reader) = Default::default();
                }
                if asked & (1 << index) != 0 {
                    let message = written.message(knows, 7, 3);
                    knows.learn(&written);
                    let mut read = Question::default();
                    prop_assert_eq!(reader.read(message, find, &mut read).map(|()| &read), Ok(&question));
                }
            }
        }
    }

    #[test]
    fn any_message_is_a_question_or_an_error(
        kind in 0..5, rounded: bool,
        has_bodies: bool, known: bool, mode in 0..4,
        fields in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..50), 7),
        plain: bool,
    ) {
        let mut stream = Stream::default();
        let bodies = [body(0.1), body(0.2)];
        if known {
            stream.pass(&all(&bodies));
        }
        let mut fields = fields.into_iter().map(|mut bytes| {
            // Most noise is no way to pack.
            if plain && let Some(first) = bytes.first_mut() { *first %= 4; }
            Bytes::from(bytes)
        });
        let mut field = || fields.next().expect("enough");
        let bodies = v1::Bodies { shapes: field(), poses: field(), world: vec![] };
        let message = v1::ProbeRequest {
            id: 0, frame: 0, kind,
            bodies: has_bodies.then_some(bodies),
            points: (mode > 0).then(|| v1::Points { picked: (mode % 2 == 1).then(&mut field), kept: (mode > 1).then(&mut field) }),
            offsets: field(), directions: Bytes::new(), within: field(), hints: field(), rounded, holder: 0, cameras: vec![],
            traceparent: String::new(),
        };
        if let Ok(question) = stream.read(message) {
            prop_assert!(question.len() <= crate::MAX_POINTS);
            let sizes = question.batches.iter().filter_map(|batch| batch.picked.clone().map(|range| (batch, range)));
            for (batch, range) in sizes {
                let picked = &question.picked[range];
                prop_assert!(picked.is_sorted_by(|a, b| a < b));
                prop_assert!(picked.iter().all(|&index| (index as usize) < batch.points.len()));
            }
        }
    }
}
