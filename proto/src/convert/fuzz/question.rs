//! Questions, and what a node makes of them.

use std::f64::consts::TAU;
use std::sync::{Arc, OnceLock};

use hull::coordinates::Coordinates;
use hull::question::{Answer, Edge, Question, QuestionKind};
use hull::rule::ProbeSettings;
use hull::view_set::Scratch;
use hull::{
    Camera, HullRule, NormalWindow, Observer, OutOfView, Reach, Rig, Shape, Silhouette, VectorPath, View,
    ViewSet,
};
use prost::Message;

use super::super::{
    ExpectedAnswer, ExpectedCamera, Precision, ProbeAnswer, QuestionReader, QuestionWriter, StreamKnows,
    answer_from_wire, answer_to_wire, asked_world, trace_parent_from_wire,
};
use crate::codec::counts;
use crate::{MAX_POINTS, v1};

/// Questions of one stream are read up to here: more take long, and find nothing else.
const MAX_QUESTIONS: usize = 8;
/// A question of more points is not answered here, only read.
const MAX_ANSWERED: usize = 4000;
const SIZE: (u32, u32) = (64, 48);

/// The questions of one stream, each after its length (two bytes), as a node reads them: one that is accepted has no more
/// points than may be asked, comes back from the coordinator's writer as it is, and is answered, with the same bits
/// by every vector path.
pub fn question(bytes: &[u8]) {
    let mut reader = QuestionReader::default();
    let mut rest = bytes;
    for _ in 0..MAX_QUESTIONS {
        let Some((length, left)) = rest.split_first_chunk() else { return };
        let (message, left) = left.split_at(usize::from(u16::from_le_bytes(*length)).min(left.len()));
        rest = left;
        let Ok(request) = v1::ProbeRequest::decode(message) else { continue };
        let counted: Vec<usize> = counts::<v1::ProbeRequest>(message).map(|(_, found)| found).collect();
        let world = request.bodies.as_ref().map_or(0, |bodies| bodies.world.len());
        assert!(request.cameras.len() <= counted[0] && world <= counted[1], "counted {counted:?}");
        if let Some(parent) = trace_parent_from_wire(&request.traceparent) {
            assert_eq!(trace_parent_from_wire(&parent.to_string()), Some(parent));
        }
        let mut question = Question::default();
        if reader.read(request, shape, &mut question).is_ok() {
            assert!(question.len() <= MAX_POINTS, "a question of {} points", question.len());
            check(&question);
        }
    }
}

fn check(question: &Question) {
    if question.len() > MAX_ANSWERED || question.batches.len() > MAX_ANSWERED {
        return;
    }
    let written = QuestionWriter::default().write(question).message(&StreamKnows::default(), 0, 0);
    let mut again = Question::default();
    let read = QuestionReader::default().read(written, shape_of_digest, &mut again);
    assert_eq!(read, Ok(()), "what was written again");
    assert_eq!(again.len(), question.len(), "what was written again");
    for views in rooms() {
        let mut found = Answer::default();
        views.answer(question, &mut Scratch::default(), &mut found);
        assert_eq!(found.len(), question.len(), "an answer a point");
        let mut plain = Answer::default();
        views.clone().with_path(VectorPath::Portable).answer(question, &mut Scratch::default(), &mut plain);
        assert_eq!(found, plain, "the same bits on every machine");
        if !is_near(question) {
            continue;
        }
        let cameras = views.views().iter().map(|view| {
            let observer = view.observer();
            ExpectedCamera::new(observer.camera(), observer.rig_index())
        });
        let expected = ExpectedAnswer::new(question, &asked_world(question), cameras.collect());
        for precision in [Precision::Exact, Precision::Quantised] {
            let reply = answer_to_wire(0, &found, views.views().len(), precision, 0.0);
            match answer_from_wire(reply, &expected) {
                Ok((ProbeAnswer::Answer(read), _)) if precision == Precision::Exact => {
                    assert_eq!(read, as_read(&found), "the answer on the wire");
                }
                Ok((ProbeAnswer::Answer(read), _)) => {
                    assert_eq!(read.len(), found.len(), "an answer a point");
                }
                other => panic!("the coordinator refuses the answer: {other:?}"),
            }
        }
    }
}

/// Whether bodies can be where it asks: no coordinator asks about points beyond, and distances are no `f32` there.
fn is_near(question: &Question) -> bool {
    let mut points = Coordinates::default();
    question.batches.iter().for_each(|batch| question.append_world(batch, &mut points));
    [&points.x, &points.y, &points.z].into_iter().flatten().all(|part| part.abs() < 1e9)
}

/// An answer as the wire carries it: exits are exits, and for a point without an edge it does not matter how far one counts.
fn as_read(answer: &Answer) -> Answer {
    let mut read = answer.clone();
    if read.kind == QuestionKind::SharedExits {
        read.kind = QuestionKind::Exits;
    }
    let has_edge = |(edge, within): (&Option<Edge>, &Reach)| edge.map_or(Reach::UNBOUNDED, |_| *within);
    read.exits_within = answer.edges.iter().zip(&answer.exits_within).map(has_edge).collect();
    if answer.edges.iter().all(Option::is_none) {
        read.exits_within.clear();
    }
    read
}

/// Three registered shapes, under the keys 1 to 3.
fn shape(key: u64) -> Option<Arc<Shape>> {
    shapes().get(usize::try_from(key.checked_sub(1)?).ok()?).cloned()
}

fn shape_of_digest(key: u64) -> Option<Arc<Shape>> {
    shapes().iter().find(|shape| super::super::shape_key(&shape.digest()) == key).cloned()
}

pub(super) fn shapes() -> &'static [Arc<Shape>] {
    static SHAPES: OnceLock<Vec<Arc<Shape>>> = OnceLock::new();
    SHAPES.get_or_init(|| {
        let sample = |at: u32| [at % 7, at / 7 % 7, at / 49].map(|part| (part as f32 - 3.0) * 0.05);
        let shape = |count| Shape::new((0..count).map(sample).collect()).ok().map(Arc::new);
        [1, 40, 343].into_iter().filter_map(shape).collect()
    })
}

/// Four cameras around a ball: under "outside" at the second frame of a film, and under "abstain" with a pillar that one
/// camera ignores.
pub(super) fn rooms() -> &'static [ViewSet] {
    static ROOMS: OnceLock<Vec<ViewSet>> = OnceLock::new();
    ROOMS.get_or_init(|| {
        let outside = |moved| room(OutOfView::Outside, moved);
        vec![outside(1.0).after(&outside(0.0), 1), room(OutOfView::Abstain, 0.0)]
    })
}

fn room(out_of_view: OutOfView, moved: f64) -> ViewSet {
    let settings = ProbeSettings::new(HullRule { out_of_view, min_views: 2 }, NormalWindow::Auto, 1.0);
    let (settings, ball) = (settings.unwrap_or_default(), disc(32.0 + moved, 12.0));
    let pillar = (out_of_view == OutOfView::Abstain).then(|| disc(50.0, 4.0)).flatten();
    let cameras = ring();
    let views = cameras.iter().zip(0u16..).filter_map(|(camera, place)| {
        let ignored = pillar.as_ref().filter(|_| place == 1);
        let observer = Observer::new(camera.clone(), place, settings, ignored);
        Some(View::new(Arc::new(observer), ball.as_ref()?))
    });
    ViewSet::new(views.collect())
}

fn disc(column: f64, radius: f64) -> Option<Silhouette> {
    let (width, height) = SIZE;
    let is_in = |pixel: u32| {
        let (x, y) = (f64::from(pixel % width) - column, f64::from(pixel / width) - 24.0);
        u8::from(x * x + y * y < radius * radius)
    };
    Silhouette::from_mask(width, height, &(0..width * height).map(is_in).collect::<Vec<u8>>()).ok()
}

/// Cameras that look at the origin from two metres, level, the last one through a lens that distorts.
fn ring() -> Vec<Camera> {
    let camera = |at: usize| {
        let distortion = if at == 3 { "[ -0.2, 0.05, 0.001, 0.0, 0.0 ]" } else { "[ ]" };
        format!(
            "[cam_{at}]\nname = \"{at}\"\nsize = [ 64, 48 ]\nmatrix = [ [ 60.0, 0.0, 31.5 ], [ 0.0, 60.0, 23.5 ], \
             [ 0.0, 0.0, 1.0 ] ]\ndistortions = {distortion}\nrotation = [ 0.0, {:?}, 0.0 ]\n\
             translation = [ 0.0, 0.0, 2.0 ]\n",
            TAU * at as f64 / 4.0
        )
    };
    let text: String = (0..4).map(camera).collect();
    Rig::from_toml(&text).map(|rig| rig.cameras().to_vec()).unwrap_or_default()
}
