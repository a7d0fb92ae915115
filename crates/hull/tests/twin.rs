//! The probes against their brute-force twin on random rigs: distortion, holes, noise, borders, ignore
//! masks, silent cameras.

mod common;

use std::sync::Arc;

use common::{Dice, random_rig};
use hull::cull::WorldBox;
use hull::merge::contains;
use hull::oracle::{DenseView, brute};
use hull::pass::{AskedBody, BodyResult, PaperResult, Pass, Reaches};
use hull::probe::exit::along;
use hull::question::{Answer, Batch, NO_EXIT_M, Points, Question, QuestionKind};
use hull::reach::Reach;
use hull::view_set::Scratch;
use hull::{
    Camera, HullRule, NormalWindow, Observer, OutOfView, ProbeSettings, Silhouette, VectorPath, View, ViewSet,
};
use nalgebra::{Matrix3, Point3, Vector3};

const MARCH_M: f64 = 5e-4;

fn settings(out_of_view: OutOfView, min_views: u32) -> ProbeSettings {
    ProbeSettings::new(HullRule { out_of_view, min_views }, NormalWindow::Auto, 1.0).expect("in range")
}

fn run(sets: &[ViewSet], settings: ProbeSettings, points: &[[f64; 3]], first: &[usize]) -> PaperResult {
    let mut pass =
        Pass::new(vec![Points::World(points.into())], Some(&WorldBox::EVERYWHERE), settings, sets.len());
    pass.ask_first(first);
    pass.ask_in_two_phases(!first.is_empty());
    let (points, reaches) = (Points::World(points.into()), &Reaches::default());
    let asked = AskedBody::plain(points, reaches);
    pass.restart([asked].into_iter(), Some(&WorldBox::EVERYWHERE));
    match finish(&mut pass, sets) {
        BodyResult::Paper(paper) => paper,
        other => panic!("expected the paper's response, found {other:?}"),
    }
}

fn finish(pass: &mut Pass, sets: &[ViewSet]) -> BodyResult {
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    while let Some(question) = pass.question().cloned() {
        let asks: Vec<bool> = (0..sets.len()).map(|group| pass.asks(group)).collect();
        for (group, set) in sets.iter().enumerate().rev().filter(|&(group, _)| asks[group]) {
            set.answer(&question, &mut scratch, &mut answer);
            pass.answer(group, &answer).expect("a fitting answer");
        }
    }
    pass.results()[0].clone()
}

/// Checks a random rig's answers and returns how many points were inside and how many exits grazed.
fn check(seed: u64, settings: ProbeSettings, with_ignored: bool) -> (usize, usize) {
    let (dense, views) = random_rig(seed, settings, with_ignored);
    let mut dice = Dice(seed ^ 0xabcdef);
    let points: Vec<[f64; 3]> = (0..150).map(|_| std::array::from_fn(|_| dice.between(-0.9, 0.9))).collect();
    let together = run(&[ViewSet::new(views.clone())], settings, &points, &[]);
    for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
        let set = ViewSet::new(views.clone()).with_path(path);
        assert_eq!(run(&[set], settings, &points, &[]), together, "{path:?}, seed {seed}");
    }
    let alone: Vec<ViewSet> = views.iter().map(|view| ViewSet::new(vec![view.clone()])).collect();
    assert_eq!(run(&alone, settings, &points, &[]), together, "one group or many, seed {seed}");
    assert_eq!(run(&alone, settings, &points, &[1]), together, "all at once or one first, seed {seed}");

    let mut grazes = 0;
    let mut inside = together.inside.iter();
    for (index, point) in points.iter().enumerate() {
        let a = Point3::from(*point);
        let is_inside = brute::is_inside(&dense, &settings, &a);
        assert_eq!(contains(&views, &a, settings.rule()), is_inside, "seed {seed} point {index}");
        let Some(twin) = brute::point(&dense, &settings, &a, MARCH_M) else { continue };
        let found = inside.next().expect("as many inside as the twin says");
        assert_eq!(found.sample as usize, index, "seed {seed}");
        let (Some(edge), Some(twin_edge)) = (found.edge, &twin.edge) else {
            assert_eq!(found.edge.is_none(), twin.edge.is_none(), "seed {seed} point {index}");
            continue;
        };
        assert!((f64::from(edge.distance_m) - twin_edge.distance_m).abs() < 5e-6);
        assert_eq!((usize::from(edge.camera), edge.pixel), (twin_edge.camera, twin_edge.pixel));
        let normal = Vector3::from(edge.normal_world.map(f64::from));
        assert!((normal - twin_edge.normal_world).norm() < 1e-6);
        grazes += usize::from(!exit_holds(&dense, &settings, &a, &normal, found.exit_m, twin.exit_m));
    }
    assert!(inside.next().is_none(), "no more inside than the twin says");
    (together.inside.len(), grazes)
}

/// The contract of an exit: not inside at t, inside just before, and inside at all marched points up to it.
fn exit_holds(
    dense: &[DenseView],
    settings: &ProbeSettings,
    a: &Point3<f64>,
    n: &Vector3<f64>,
    exit_m: Option<f32>,
    twin_m: Option<f64>,
) -> bool {
    let inside = |point: &Point3<f64>| brute::is_inside(dense, settings, point);
    match (exit_m, twin_m) {
        (None, None) => true,
        (Some(t), twin) => {
            let end = f64::from(t);
            !inside(&along(a, n, t))
                && inside(&(a + n * (end - 1e-6)))
                // The march may step over a sliver that the exact walk finds, never the reverse.
                && twin.is_none_or(|twin| end <= twin + 1e-6)
        }
        (None, Some(_)) => false,
    }
}

/// Checks the planes of a random rig and returns how many there are.
fn check_planes(seed: u64, settings: ProbeSettings, with_ignored: bool) -> usize {
    let (dense, views) = random_rig(seed, settings, with_ignored);
    let mut dice = Dice(seed ^ 0xabcdef);
    let points: Vec<[f64; 3]> = (0..150).map(|_| std::array::from_fn(|_| dice.between(-0.9, 0.9))).collect();
    let batches = vec![Batch::all(Points::World(points.clone().into()))];
    let ask = |kind: QuestionKind, path: VectorPath| {
        let mut answer = Answer::default();
        let question = Question { kind, batches: batches.clone(), ..Question::default() };
        ViewSet::new(views.clone()).with_path(path).answer(&question, &mut Scratch::default(), &mut answer);
        answer.edges
    };
    let planes = ask(QuestionKind::Planes, VectorPath::Portable);
    for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
        assert_eq!(ask(QuestionKind::Planes, path), planes, "{path:?}, seed {seed}");
    }
    let alone: Vec<ViewSet> = views.iter().map(|view| ViewSet::new(vec![view.clone()])).collect();
    let together = [ViewSet::new(views.clone())];
    for (sets, two_phases) in [(&together[..], false), (&alone, false), (&alone, true)] {
        let mut pass = Pass::new(
            vec![Points::World(points.clone().into())],
            Some(&WorldBox::EVERYWHERE),
            settings,
            sets.len(),
        );
        pass.for_contacts();
        pass.ask_in_two_phases(two_phases);
        let found = finish(&mut pass, sets);
        let found = found.planes().expect("planes");
        assert_eq!(pass.points_asked()[QuestionKind::Exits as usize], 0, "exits were not asked for");
        assert!(found.samples.iter().all(|of| of.plane == planes[of.sample as usize]), "seed {seed}");
    }
    let edges = ask(QuestionKind::Edges, VectorPath::Portable);
    let mut from_outside = 0;
    for ((point, plane), edge) in points.iter().zip(&planes).zip(edges) {
        let point = Point3::from(*point);
        let outside = brute::plane_from_outside(&dense, &settings, &point);
        let Some(plane) = plane else {
            assert!(edge.is_none() && outside.is_none(), "seed {seed}");
            continue;
        };
        let normal = Vector3::from(plane.normal_world.map(f64::from));
        let twin = if let Some(outside) = outside {
            let found = (usize::from(plane.camera), plane.pixel);
            let is_tie = (f64::from(plane.distance_m) - outside.distance_m).abs() < 1e-6;
            assert!(
                found == (outside.camera, outside.pixel) || is_tie,
                "seed {seed}: {found:?}, {outside:?}"
            );
            assert!(is_tie, "seed {seed}: {} m, {outside:?}", plane.distance_m);
            if found != (outside.camera, outside.pixel) {
                continue;
            }
            outside.normal_world
        } else {
            let edge = edge.expect("an edge");
            assert_eq!(
                (plane.camera, plane.pixel, plane.distance_m),
                (edge.camera, edge.pixel, edge.distance_m)
            );
            let view = &dense[usize::from(plane.camera)];
            let start = view.camera.pixel(&point).expect("on the image");
            brute::plane_normal(view, &settings, start, plane.pixel).expect("a plane")
        };
        assert!((normal - twin).norm() < 1e-6, "seed {seed}: {normal} instead of {twin}");
        from_outside += usize::from(plane.distance_m < 0.0);
    }
    assert!(from_outside > 20, "seed {seed}: only {from_outside} planes from outside");
    planes.iter().flatten().count()
}

#[test]
fn planes_equal_the_twin() {
    let wide = HullRule { out_of_view: OutOfView::Outside, min_views: 2 };
    let wide = ProbeSettings::new(wide, NormalWindow::Pixels(7), 1.0).expect("in range");
    let each =
        [(settings(OutOfView::Outside, 2), false), (settings(OutOfView::Abstain, 1), true), (wide, true)];
    let seeds = (1..=12).flat_map(|seed| each.map(|(settings, ignored)| (seed, settings, ignored)));
    let found: usize = seeds.map(|(seed, settings, ignored)| check_planes(seed, settings, ignored)).sum();
    assert!(found > 1000, "only {found} planes: the rigs test nothing");
}

/// Planes are kept between questions: what is kept of one frame answers for no other, and not otherwise than what is fitted.
#[test]
fn planes_that_were_kept_are_those_that_are_found() {
    let settings = settings(OutOfView::Outside, 2);
    let mut dice = Dice(7);
    let points: Vec<[f64; 3]> = (0..400).map(|_| std::array::from_fn(|_| dice.between(-0.9, 0.9))).collect();
    let batches = vec![Batch::all(Points::World(points.into()))];
    let question = Question { kind: QuestionKind::Planes, batches, ..Question::default() };
    let planes = |set: &ViewSet, scratch: &mut Scratch| {
        let mut answer = Answer::default();
        set.answer(&question, scratch, &mut answer);
        answer.edges
    };
    let mut kept = Scratch::default();
    let mut before = ViewSet::new(random_rig(1, settings, false).1);
    let mut moved = 0;
    for seed in 2..8 {
        let frame = ViewSet::new(random_rig(seed, settings, false).1).after(&before, 1);
        let few = frame.only(|place| place != 1);
        for set in [&frame, &few, &frame, &before, &frame] {
            assert_eq!(planes(set, &mut kept), planes(set, &mut Scratch::default()), "seed {seed}");
        }
        let found = planes(&frame, &mut kept);
        moved += found.iter().flatten().filter(|edge| edge.moved_m.is_some()).count();
        before = frame;
    }
    assert!(moved > 20, "only {moved} planes tell how far they moved");
}

fn check_many(settings: ProbeSettings, with_ignored: bool) {
    let (mut inside, mut grazes) = (0, 0);
    for seed in 1..=25 {
        let (more_inside, more_grazes) = check(seed, settings, with_ignored);
        inside += more_inside;
        grazes += more_grazes;
    }
    assert!(inside > 150, "only {inside} points inside: the rigs test nothing");
    assert!(grazes * 100 <= inside, "{grazes} of {inside} exits differ: more than corners can explain");
}

#[test]
fn answers_equal_the_twin_when_unseen_is_outside() {
    check_many(settings(OutOfView::Outside, 2), false);
}

#[test]
fn answers_equal_the_twin_with_ignore_masks() {
    check_many(settings(OutOfView::Outside, 2), true);
}

#[test]
fn answers_equal_the_twin_when_cameras_abstain() {
    check_many(settings(OutOfView::Abstain, 2), true);
    check_many(settings(OutOfView::Abstain, 1), false);
}

#[test]
fn the_reach_told_with_an_edge_covers_its_exit_tightly() {
    let settings = settings(OutOfView::Outside, 1);
    let mut told = 0;
    for seed in 1..=8 {
        let (_, views) = random_rig(seed, settings, false);
        let set = ViewSet::new(vec![views[0].clone()]);
        let mut dice = Dice(seed);
        let points: Vec<[f64; 3]> =
            (0..90).map(|_| std::array::from_fn(|_| dice.between(-0.6, 0.6))).collect();
        let batches = vec![Batch::all(Points::World(points.into()))];
        let within = vec![Reach::covering(50.0); 90];
        let mut edges = Question { kind: QuestionKind::Edges, batches, within, ..Question::default() };
        let (mut scratch, mut found, mut exits) = (Scratch::default(), Answer::default(), Answer::default());
        set.answer(&edges, &mut scratch, &mut found);
        assert_eq!(found.exits_within.len(), 90);
        let normals = found.edges.iter().map(|edge| edge.map_or([1.0, 0.0, 0.0], |edge| edge.normal_world));
        edges.directions = normals.collect();
        edges.kind = QuestionKind::Exits;
        edges.within.clear();
        set.answer(&edges, &mut scratch, &mut exits);
        for (at, within) in found.exits_within.iter().enumerate().filter(|&(at, _)| found.edges[at].is_some())
        {
            let exit_m = exits.exits_m[at];
            assert_eq!(exit_m == NO_EXIT_M, *within == Reach::UNBOUNDED, "seed {seed} point {at}");
            let fits = exit_m == NO_EXIT_M || exit_m <= within.m() && within.m() <= 1.07 * exit_m + 2e-4;
            assert!(fits, "seed {seed} point {at}: {exit_m} within {}", within.m());
            told += 1;
        }
    }
    assert!(told > 50, "{told}");
}

#[test]
fn rays_that_pass_beside_or_behind_a_camera_leave_before_it() {
    let settings = settings(OutOfView::Outside, 1);
    for lens in [[0.0; 5], [-0.2, 0.02, 0.001, -0.001, 0.0]] {
        let k = Matrix3::new(100.0, 0.0, 60.0, 0.0, 100.0, 45.0, 0.0, 0.0, 1.0);
        let camera =
            Camera::new("near", (120, 90), k, lens, Vector3::zeros(), Vector3::zeros()).expect("valid");
        let mask = vec![255; 120 * 90];
        let silhouette = Silhouette::from_mask(120, 90, &mask).expect("size");
        let observer = Observer::new(camera.clone(), 0, settings, None);
        let views = vec![View::new(Arc::new(observer), &silhouette)];
        let dense = [DenseView { camera, mask, ignored: None }];
        let mut dice = Dice(77);
        let mut ray = || {
            let depth_m = dice.between(0.1, 0.7);
            let point = [depth_m * dice.between(-0.3, 0.3), depth_m * dice.between(-0.3, 0.3), depth_m];
            let [x, y] = [(); 2].map(|()| dice.between(-0.6, 0.6));
            (point, Vector3::new(x, y, -1.0).normalize().map(|part| part as f32))
        };
        let rays: Vec<_> = (0..200).map(|_| ray()).collect();
        let points: Vec<[f64; 3]> = rays.iter().map(|(point, _)| *point).collect();
        let question = Question {
            kind: QuestionKind::Exits,
            batches: vec![Batch::all(Points::World(points.into()))],
            directions: rays.iter().map(|(_, direction)| (*direction).into()).collect(),
            ..Question::default()
        };
        for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
            let set = ViewSet::new(views.clone()).with_path(path);
            for reach_m in [None, Some(0.9)] {
                let within = reach_m.map_or(vec![], |reach_m| vec![Reach::covering(reach_m); rays.len()]);
                let question = Question { within, ..question.clone() };
                let mut answer = Answer::default();
                set.answer(&question, &mut Scratch::default(), &mut answer);
                for ((point, direction), &exit_m) in rays.iter().zip(&answer.exits_m) {
                    let (a, n) = (Point3::from(*point), direction.map(f64::from));
                    let found = (exit_m != NO_EXIT_M).then_some(exit_m);
                    let twin_m = brute::exit(&dense, &settings, &a, &n, MARCH_M);
                    assert!(twin_m.is_some(), "every ray leaves");
                    assert!(exit_holds(&dense, &settings, &a, &n, found, twin_m), "{point:?} {n:?} {path:?}");
                }
            }
        }
    }
}
