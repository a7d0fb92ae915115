//! Planes of the hull's surface: ways out of what they do not face, what is around a body, and how far they moved.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use hull::cull::WorldBox;
use hull::faces::FaceNormals;
use hull::pass::{AskedBody, BodyPlanes, BodyResult, Pass, Reaches, SamplePlane};
use hull::question::{Answer, Points, Question};
use hull::rule::{HullRule, NormalWindow};
use hull::view_set::Scratch;
use hull::{Camera, Observer, Pose, ProbeSettings, Shape, Silhouette, View, ViewSet};
use nalgebra::{Matrix3, Vector3};

const SIDE: u32 = 101;

/// Two cameras at 3 m that look at the origin, along z and along x, and see a cube of half a metre, the first so many
/// pixels to the right. A pixel is 3 cm there.
fn views(right: u32) -> ViewSet {
    let k = Matrix3::new(100.0, 0.0, 50.0, 0.0, 100.0, 50.0, 0.0, 0.0, 1.0);
    let view = |(index, turn): (u16, Vector3<f64>)| {
        let camera = Camera::new("camera", (SIDE, SIDE), k, [0.0; 5], turn, Vector3::new(0.0, 0.0, 3.0));
        let settings = ProbeSettings::default();
        let observer = Observer::new(camera.expect("a camera"), index, settings, None);
        let right = if index == 0 { right } else { 0 };
        let is_seen =
            |at: u32| (42..59).contains(&(at / SIDE)) && (42 + right..59 + right).contains(&(at % SIDE));
        let mask: Vec<u8> = (0..SIDE * SIDE).map(|at| if is_seen(at) { 255 } else { 0 }).collect();
        let silhouette = Silhouette::from_mask(SIDE, SIDE, &mask).expect("a silhouette");
        View::new(Arc::new(observer), &silhouette)
    };
    let turns = [Vector3::zeros(), Vector3::new(0.0, FRAC_PI_2, 0.0)];
    ViewSet::new((0..).zip(turns).map(view).collect())
}

fn body(samples: &[[f32; 3]]) -> Points {
    let shape = Shape::new(samples.to_vec()).expect("samples");
    Points::Body { shape: Arc::new(shape), pose: Pose::IDENTITY }
}

/// Beside the cube, above it, far from it, within it, and below its top as the first camera sees it but before it as the
/// second does.
const AROUND: [[f32; 3]; 5] =
    [[0.3, 0.0, 0.0], [0.0, 0.32, 0.0], [0.9, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.22, 0.35]];

/// A body of one sample 6 cm below the cube's side to the right, with its face to `face`, and points around it.
fn ask(sets: &[ViewSet], face: Option<Vector3<f64>>) -> BodyPlanes {
    let at_once = ask_in(sets, face, false);
    assert_eq!(ask_in(sets, face, true), at_once, "some cameras first");
    at_once
}

fn ask_in(sets: &[ViewSet], face: Option<Vector3<f64>>, two_phases: bool) -> BodyPlanes {
    let mut faces = FaceNormals::default();
    faces.push(face);
    let asked = AskedBody {
        points: body(&[[0.2, 0.1, 0.0]]),
        around: Some(body(&AROUND)),
        faces: face.map(|_| Arc::new(faces)),
        back_m: None,
        reaches: &Reaches::default(),
    };
    result(sets, asked, two_phases)
}

fn result(sets: &[ViewSet], asked: AskedBody<'_>, two_phases: bool) -> BodyPlanes {
    let mut pass = Pass::new(vec![], None, ProbeSettings::default(), sets.len());
    pass.for_contacts();
    pass.ask_in_two_phases(two_phases);
    pass.restart([asked].into_iter(), Some(&WorldBox::EVERYWHERE));
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    while let Some(question) = pass.question().cloned() {
        for (group, set) in sets.iter().enumerate().filter(|&(group, _)| pass.asks(group)).collect::<Vec<_>>()
        {
            set.answer(&question, &mut scratch, &mut answer);
            pass.answer(group, &answer).expect("a fitting answer");
        }
    }
    pass.results()[0].planes().expect("planes").clone()
}

/// What a pass over each camera alone finds when some are left out.
fn without(sets: &[ViewSet], left_out: &[usize], two_phases: bool, for_contacts: bool) -> BodyResult {
    let rule = HullRule { min_views: 1, ..HullRule::default() };
    let settings = ProbeSettings::new(rule, NormalWindow::Auto, 1.0).expect("settings");
    let mut pass = Pass::new(vec![], None, settings, sets.len());
    if for_contacts {
        pass.for_contacts();
    }
    pass.ask_in_two_phases(two_phases);
    if two_phases {
        pass.ask_first(&[0]);
    }
    pass.leave_out(|group| left_out.contains(&group));
    let points = body(&[[0.2, 0.1, 0.0], [0.24, 0.0, 0.9], [0.9, 0.0, 0.1], [0.4, 0.0, 0.0]]);
    let reaches = Reaches::default();
    let asked =
        AskedBody { around: for_contacts.then(|| body(&AROUND)), ..AskedBody::plain(points, &reaches) };
    pass.restart([asked].into_iter(), Some(&WorldBox::EVERYWHERE));
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    while let Some(question) = pass.question().cloned() {
        let asked: Vec<usize> = (0..sets.len()).filter(|&group| pass.asks(group)).collect();
        assert!(!asked.is_empty() && asked.iter().all(|group| !left_out.contains(group)), "{asked:?}");
        for group in asked {
            sets[group].answer(&question, &mut scratch, &mut answer);
            pass.answer(group, &answer).expect("a fitting answer");
        }
    }
    pass.into_results().remove(0)
}

#[test]
fn a_camera_that_is_left_out_is_as_if_it_were_not_there() {
    let sets = each_alone(&views(0));
    for for_contacts in [true, false] {
        let both = without(&sets, &[], false, for_contacts);
        assert_eq!(both.inside_count(), 1);
        for (left, other) in [(0, 1), (1, 0)] {
            let alone = without(&sets[other..=other], &[], false, for_contacts);
            assert!(alone.inside_count() > 1, "one camera sees more: {alone:?}");
            for two_phases in [false, true] {
                let found = without(&sets, &[left], two_phases, for_contacts);
                assert_eq!(found, alone, "{left} {two_phases}");
            }
        }
    }
}

fn normal(found: &SamplePlane) -> Vector3<f64> {
    Vector3::from(found.plane.expect("a plane").normal_world.map(f64::from))
}

fn each_alone(views: &ViewSet) -> Vec<ViewSet> {
    views.views().iter().map(|view| ViewSet::new(vec![view.clone()])).collect()
}

#[test]
fn a_sample_that_no_surface_faces_takes_the_one_at_the_end_of_its_way_out() {
    let views = views(0);
    for sets in [vec![views.clone()], each_alone(&views)] {
        let nearest = ask(&sets, None);
        assert!(normal(&nearest.samples[0]).x > 0.95, "{nearest:?}");
        let faced = ask(&sets, Some(-Vector3::x()));
        assert_eq!(faced.samples, nearest.samples, "a face that looks at it changes nothing");
        let way_out = ask(&sets, Some(-Vector3::y()));
        assert!(normal(&way_out.samples[0]).y > 0.95, "{way_out:?}");
    }
}

#[test]
fn a_body_that_came_in_fast_meets_the_surface_that_it_came_through() {
    let views = views(0);
    // The nearest surface is that to the right; it came from above, or from farther away than is looked for.
    let samples = [[0.2, 0.1, 0.0], [0.9, 0.0, 0.0]];
    let offset = samples.map(|[x, y, z]: [f32; 3]| [x, y - 0.08, z]);
    let points = body(&[samples, offset].concat());
    let mut faces = FaceNormals::default();
    samples.iter().for_each(|_| faces.push([-Vector3::x()]));
    let faces = Some(Arc::new(faces));
    for (sets, two_phases) in
        [(vec![views.clone()], false), (each_alone(&views), false), (each_alone(&views), true)]
    {
        let found = |back_m: Option<[f32; 3]>| {
            let reaches = Reaches::default();
            let asked =
                AskedBody { faces: faces.clone(), back_m, ..AskedBody::plain(points.clone(), &reaches) };
            result(&sets, asked, two_phases).samples
        };
        assert!(normal(&found(None)[0]).x > 0.95);
        let from_above = found(Some([0.0, 0.3, 0.0]));
        assert_eq!(from_above.len(), 1, "no offset sample is asked about: {from_above:?}");
        assert!(normal(&from_above[0]).y > 0.95, "{from_above:?}");
        let from_far = found(Some([0.0, 0.1, 0.0]));
        assert!(from_far[0].plane.is_none(), "{from_far:?}");
    }
}

#[test]
fn an_offset_sample_is_asked_for_its_plane_where_its_sample_is_outside() {
    let views = views(0);
    // Within, outside with its offset sample within, both outside, within; offset samples lie towards the cube.
    let samples = [[0.2, 0.1, 0.0], [0.3, 0.1, 0.0], [0.4, 0.1, 0.0], [0.1, 0.1, 0.0]];
    let offset = samples.map(|[x, y, z]: [f32; 3]| [x - 0.08, y, z]);
    let points = body(&[samples, offset].concat());
    let mut faces = FaceNormals::default();
    samples.iter().for_each(|_| faces.push([-Vector3::x()]));
    let faces = Some(Arc::new(faces));
    for (sets, two_phases) in
        [(vec![views.clone()], false), (each_alone(&views), false), (each_alone(&views), true)]
    {
        let asked = AskedBody {
            points: points.clone(),
            around: None,
            faces: faces.clone(),
            back_m: None,
            reaches: &Reaches::default(),
        };
        let found = result(&sets, asked, two_phases);
        assert_eq!(found.samples.iter().map(|of| of.sample).collect::<Vec<_>>(), [0, 3, 5]);
        assert!(found.samples.iter().all(|of| of.plane.is_some()), "{found:?}");
    }
}

#[test]
fn planes_around_a_body_are_found_from_within_and_from_outside() {
    let views = views(0);
    let together = ask(std::slice::from_ref(&views), None);
    let samples: Vec<u32> = together.around.iter().map(|of| of.sample).collect();
    assert_eq!(samples, [0, 1, 3, 4], "the third is too far away");
    for (found, (is_outside, axis)) in
        together.around.iter().zip([(true, 0), (true, 1), (false, 0), (true, 2)])
    {
        assert_eq!(found.plane.expect("a plane").distance_m < 0.0, is_outside, "{found:?}");
        assert!(normal(found)[axis] > 0.95, "{found:?}");
    }
    assert_eq!(ask(&each_alone(&views), None).around, together.around);
}

#[test]
fn planes_tell_how_far_they_moved_since_the_frame_before() {
    let moved_m = |views: ViewSet| -> Vec<Option<f32>> {
        let result = ask(&[views], None);
        let found = result.samples.iter().chain(&result.around[..2]);
        found.map(|of| of.plane.expect("a plane").moved_m).collect()
    };
    assert_eq!(moved_m(views(2)), [None; 3]);
    assert_eq!(moved_m(views(2).after(&views(1), 0)), [None; 3], "not before");
    assert_eq!(moved_m(views(2).after(&views(1), 9)), [None; 3], "too long ago");
    for frames in [1, 2] {
        let found = moved_m(views(2).after(&views(0), frames));
        let expected = 0.06 / frames as f32;
        let [Some(within), Some(beside), Some(above)] = found[..] else { panic!("{found:?}") };
        assert!(
            (within - expected).abs() < 0.2 * expected && (beside - expected).abs() < 0.2 * expected,
            "{found:?}"
        );
        assert!(above.abs() < 1e-3, "{found:?}");
    }
}

/// A box of samples that reaches into the cube's side to the right.
fn block() -> Vec<[f32; 3]> {
    let at = |index: usize, count: usize| 0.02 * index as f32 - 0.01 * (count - 1) as f32;
    let samples = (0..7usize.pow(3)).map(|index| [at(index % 7, 7), at(index / 7 % 7, 7), at(index / 49, 7)]);
    samples.collect()
}

/// Passes of bodies side by side at these places, one after the other, whose samples all have the body's face: the results,
/// and the trips of each.
fn follow(
    sets: &[ViewSet],
    places_m: &[f64],
    faces: &[Option<Vector3<f64>>],
    speculates: bool,
) -> (Vec<Vec<BodyResult>>, Vec<usize>) {
    let (shape, around) = (Shape::new(block()).expect("samples"), Shape::new(AROUND.into()).expect("points"));
    let (shape, around) = (Arc::new(shape), Arc::new(around));
    let of_samples = |face: &Option<Vector3<f64>>| {
        let mut of_samples = FaceNormals::default();
        block().iter().for_each(|_| of_samples.push(*face));
        face.map(|_| Arc::new(of_samples))
    };
    let faces: Vec<Option<Arc<FaceNormals>>> = faces.iter().map(of_samples).collect();
    let mut pass = Pass::new(vec![], None, ProbeSettings::default(), sets.len());
    pass.for_contacts();
    pass.speculate(speculates);
    let (mut reaches, mut results, mut trips) = (vec![Reaches::default(); faces.len()], vec![], vec![]);
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    for &place_m in places_m {
        let asked = faces.iter().zip(&reaches).enumerate().map(|(body, (faces, reaches))| {
            let pose = Pose::IDENTITY.moved([place_m, 0.0, 0.05 * body as f64]);
            let points = |shape: &Arc<Shape>| Points::Body { shape: Arc::clone(shape), pose };
            let (around, faces) = (Some(points(&around)), faces.clone());
            AskedBody { around, faces, ..AskedBody::plain(points(&shape), reaches) }
        });
        pass.restart(asked, Some(&WorldBox::EVERYWHERE));
        trips.push(0);
        while let Some(question) = pass.question().cloned() {
            let speculative = pass.speculative_question().cloned();
            let asked: Vec<usize> = (0..sets.len()).filter(|&group| pass.asks(group)).collect();
            *trips.last_mut().expect("a pass") += 1;
            // Some groups answer the speculative question first, some last.
            for &group in &asked {
                let mut questions: Vec<&Question> = std::iter::once(&question).chain(&speculative).collect();
                if group % 2 == 0 {
                    questions.reverse();
                }
                for question in questions {
                    sets[group].answer(question, &mut scratch, &mut answer);
                    pass.answer(group, &answer).expect("a fitting answer");
                }
            }
        }
        reaches.iter_mut().zip(pass.results()).for_each(|(reaches, result)| reaches.note(result));
        results.push(pass.results().to_vec());
    }
    (results, trips)
}

#[test]
fn speculation_changes_no_result_and_spares_trips_where_the_same_samples_touch() {
    let sets = each_alone(&views(0));
    // Far away, touching, still, a little deeper, away again, and at once deep.
    let places_m = [1.0, 0.3, 0.3, 0.29, 0.29, 1.0, 0.2, 0.2];
    let (plain, plain_trips) = follow(&sets, &places_m, &[None], false);
    let (speculative, trips) = follow(&sets, &places_m, &[None], true);
    assert_eq!(speculative, plain);
    assert_eq!(
        plain_trips,
        [1, 2, 2, 2, 2, 1, 3, 2],
        "two rounds where it touches, three where it is deep at once"
    );
    assert_eq!(trips, [1, 2, 1, 2, 1, 1, 2, 1], "one where the same samples touch");
    let touching = plain[1][0].planes().expect("planes");
    assert!(!touching.samples.is_empty() && !touching.around.is_empty());
}

#[test]
fn ways_out_are_asked_for_together_with_planes_and_end_a_pass_in_three_trips() {
    let sets = each_alone(&views(0));
    let places_m = [1.0, 0.2, 0.2, 0.19, 1.0, 0.22];
    let (faced, unfaced) = (Some(-Vector3::x()), Some(-Vector3::y()));
    for (faces, expected) in [
        (&[unfaced][..], [1, 3, 3, 3, 1, 3]),
        (&[faced], [1, 2, 1, 2, 1, 2]),
        (&[faced, unfaced, faced, unfaced], [1, 3, 3, 3, 1, 3]),
    ] {
        let (plain, plain_trips) = follow(&sets, &places_m, faces, false);
        let (speculative, trips) = follow(&sets, &places_m, faces, true);
        assert_eq!(speculative, plain);
        assert_eq!(trips, expected, "not {plain_trips:?}");
        for (result, face) in plain[1].iter().zip(faces) {
            let samples = &result.planes().expect("planes").samples;
            let ends_above = |of: &SamplePlane| of.plane.is_some() && normal(of).y > 0.95;
            assert_eq!(samples.iter().any(ends_above), *face == unfaced, "{samples:?}");
        }
    }
}

#[test]
fn a_pass_may_ask_for_one_response_and_then_for_the_other() {
    let sets = each_alone(&views(0));
    let shape = Arc::new(Shape::new(block()).expect("samples"));
    let ask = |pass: &mut Pass| {
        let points = Points::Body { shape: Arc::clone(&shape), pose: Pose::IDENTITY.moved([0.25, 0.0, 0.0]) };
        let reaches = Reaches::default();
        pass.restart([AskedBody::plain(points, &reaches)].into_iter(), Some(&WorldBox::EVERYWHERE));
        let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
        while let Some(question) = pass.question().cloned() {
            let speculative = pass.speculative_question().cloned();
            for group in (0..sets.len()).filter(|&group| pass.asks(group)).collect::<Vec<_>>() {
                for question in std::iter::once(&question).chain(&speculative) {
                    sets[group].answer(question, &mut scratch, &mut answer);
                    pass.answer(group, &answer).expect("a fitting answer");
                }
            }
        }
        pass.results().to_vec()
    };
    let new = || Pass::new(vec![], None, ProbeSettings::default(), sets.len());
    let paper = ask(&mut new());
    let mut pass = new();
    // Before it asks for contacts.
    pass.speculate(true);
    pass.for_contacts();
    let planes = ask(&mut pass);
    assert!(paper[0].paper().is_some_and(|paper| paper.response_m.is_ok()), "{paper:?}");
    assert!(planes[0].planes().is_some_and(|planes| !planes.samples.is_empty()), "{planes:?}");
    for _ in 0..2 {
        pass.for_response();
        assert_eq!(ask(&mut pass), paper);
        pass.for_contacts();
        assert_eq!(ask(&mut pass), planes);
    }
}
