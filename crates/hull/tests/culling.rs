//! Culling never changes an answer, and literal growing windows find nearly the same surface.

mod common;

use std::sync::Arc;

use common::{Dice, random_rig};
use hull::cull::{WorldBox, hull_box};
use hull::oracle::literal;
use hull::pass::{PaperResult, Pass};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use hull::{HullRule, NormalWindow, OutOfView, Pose, ProbeSettings, Shape, View, ViewSet};
use nalgebra::Point3;

fn settings(out_of_view: OutOfView) -> ProbeSettings {
    ProbeSettings::new(HullRule { out_of_view, min_views: 2 }, NormalWindow::Auto, 1.0).expect("in range")
}

fn run(views: &[View], bodies: Vec<Points>, bounds: Option<&WorldBox>) -> Vec<PaperResult> {
    let set = ViewSet::new(views.to_vec());
    let mut pass = Pass::new(bodies, bounds, *views[0].observer().settings(), 1);
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    while let Some(question) = pass.question() {
        set.answer(question, &mut scratch, &mut answer);
        pass.answer(0, &answer).expect("a fitting answer");
    }
    pass.results().iter().filter_map(|result| result.paper().cloned()).collect()
}

/// A hollow box of samples.
fn shape() -> Arc<Shape> {
    let steps = || (-3..=3).map(|step| step as f32 * 0.03);
    let samples = steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])));
    Arc::new(Shape::new(samples.collect()).expect("finite"))
}

fn random_pose(dice: &mut Dice) -> Pose {
    let quaternion: [f64; 4] = std::array::from_fn(|_| dice.between(-1.0, 1.0));
    let length = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt().max(0.1);
    let place = std::array::from_fn(|_| dice.between(-1.6, 1.6));
    Pose::new(place, quaternion.map(|q| q / length)).expect("unit")
}

fn check_many(out_of_view: OutOfView, with_ignored: bool) {
    let shape = shape();
    let (mut touched, mut clear) = (0, 0);
    for seed in 1..=20 {
        let (_, views) = random_rig(seed, settings(out_of_view), with_ignored);
        let mut dice = Dice(seed);
        let poses: Vec<Pose> = (0..12).map(|_| random_pose(&mut dice)).collect();
        let body = |pose: &Pose| Points::Body { shape: Arc::clone(&shape), pose: *pose };
        let loose = |pose: &Pose| {
            let world = shape.samples_body().iter().map(|&sample| pose.world_from_body()(sample).into());
            Points::World(world.collect())
        };
        let frusta: Vec<_> = views.iter().map(|view| view.frustum().cloned()).collect();
        let bounds = hull_box(&frusta, views[0].observer().settings().rule());
        let culled = run(&views, poses.iter().map(body).collect(), bounds.as_ref());
        let everything = run(&views, poses.iter().map(loose).collect(), Some(&WorldBox::EVERYWHERE));
        assert_eq!(culled, everything, "seed {seed}");
        touched += culled.iter().filter(|result| !result.inside.is_empty()).count();
        clear += culled.iter().filter(|result| result.inside.is_empty()).count();
    }
    assert!(touched > 10 && clear > 10, "{touched} touched, {clear} clear: the rigs test nothing");
}

#[test]
fn culling_changes_no_answer_when_unseen_is_outside() {
    check_many(OutOfView::Outside, false);
    check_many(OutOfView::Outside, true);
}

#[test]
fn culling_changes_no_answer_when_cameras_abstain() {
    check_many(OutOfView::Abstain, true);
}

#[test]
fn a_response_frees_the_samples_that_it_says_it_frees() {
    let shape = shape();
    let mut freed = 0;
    for seed in 1..=60 {
        let (_, views) = random_rig(seed, settings(OutOfView::Outside), false);
        let place = Dice(seed).between(-0.3, 0.3);
        let pose = Pose::new([place, 0.2, -place], [0.0, 0.0, 0.0, 1.0]).expect("unit");
        let body = |pose: Pose| vec![Points::Body { shape: Arc::clone(&shape), pose }];
        let result = run(&views, body(pose), Some(&WorldBox::EVERYWHERE)).remove(0);
        let Ok(response_m) = result.response_m else { continue };
        let after = run(&views, body(pose.moved(response_m)), Some(&WorldBox::EVERYWHERE)).remove(0);
        let inside_before: Vec<u32> = result.inside.iter().map(|inside| inside.sample).collect();
        let left = after.inside.iter().filter(|inside| inside_before.contains(&inside.sample)).count();
        assert_eq!(left, result.left_inside, "seed {seed}");
        freed += inside_before.len() - left;
    }
    assert!(freed > 100, "only {freed} samples freed");
}

#[test]
fn the_literal_paper_finds_nearly_the_same_responses() {
    let (mut near, mut all) = (0, 0);
    for seed in 1..=20 {
        let (dense, views) = random_rig(seed, settings(OutOfView::Outside), false);
        let mut dice = Dice(seed);
        let points: Vec<[f64; 3]> =
            (0..60).map(|_| std::array::from_fn(|_| dice.between(-0.6, 0.6))).collect();
        let found = run(&views, vec![Points::World(points.clone().into())], Some(&WorldBox::EVERYWHERE));
        for inside in &found[0].inside {
            let a = Point3::from(points[inside.sample as usize]);
            assert!(literal::is_inside(&dense, &a));
            let (Some(ours), Some(theirs)) = (inside.response_m(), literal::response(&dense, &a, 2, 1.0))
            else {
                continue;
            };
            all += 1;
            // A pixel is about 3 cm at these rigs' distance.
            let apart = (nalgebra::Vector3::from(ours) - theirs).norm();
            near += usize::from(apart < 0.06 + 0.3 * theirs.norm());
        }
    }
    assert!(all > 100 && near * 10 > all * 8, "{near} of {all} responses are near");
}
