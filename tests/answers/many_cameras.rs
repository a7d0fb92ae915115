//! Rigs of 65, 128 and 256 cameras, which no bound of 64 or of a byte may cut: divided over nodes that answer over the
//! wire's messages they find what one machine finds, and every camera counts.

use std::sync::Arc;

use hull::cull::WorldBox;
use hull::pass::{BodyResult, Pass};
use hull::question::{Answer, Points};
use hull::view_set::Scratch;
use hull::{HullRule, NormalWindow, Observer, OutOfView, ProbeSettings, View, ViewSet};
use proto::convert::{
    ExpectedAnswer, ExpectedCamera, Precision, ProbeAnswer, answer_from_wire, answer_to_wire, asked_world,
};
use stage::{StageSettings, studio_rig, true_silhouette};

/// Width and height of every camera's images, pixels.
const SIZE: (u32, u32) = (64, 48);
/// Points along each side of the box around the person.
const GRID: usize = 14;

/// Cameras that abstain about what they do not see.
fn settings() -> ProbeSettings {
    let rule = HullRule { out_of_view: OutOfView::Abstain, min_views: 2 };
    ProbeSettings::new(rule, NormalWindow::default(), 1.0).expect("settings")
}

/// A person who stands in the studio, seen by so many cameras.
fn views(cameras: usize) -> Vec<View> {
    let rig = studio_rig(cameras, SIZE).expect("a rig");
    let view = |(index, camera): (usize, &hull::Camera)| {
        let silhouette = true_silhouette(&StageSettings::default(), camera, 2.0).expect("a size");
        View::new(Arc::new(Observer::new(camera.clone(), index as u16, settings(), None)), &silhouette)
    };
    rig.cameras().iter().enumerate().map(view).collect()
}

/// Points evenly over the person's box.
fn points() -> Points {
    let (low, high) = StageSettings::default().bounds_world(2.0).expect("a person");
    let at = |index: usize, axis: usize| {
        let share = (index / GRID.pow(axis as u32) % GRID) as f64 / (GRID - 1) as f64;
        low[axis] + share * (high[axis] - low[axis])
    };
    let points = (0..GRID.pow(3)).map(|index| std::array::from_fn(|axis| at(index, axis)));
    Points::World(points.collect())
}

/// A pass over nodes, whose answers travel.
fn over_nodes(nodes: &[ViewSet]) -> Vec<BodyResult> {
    let mut pass = Pass::new(vec![points()], Some(&WorldBox::EVERYWHERE), settings(), nodes.len());
    let (mut scratch, mut answer) = (Scratch::default(), Answer::default());
    while let Some(question) = pass.question().cloned() {
        // The last is the first to answer.
        for (node, views) in
            nodes.iter().enumerate().rev().filter(|(node, _)| pass.asks(*node)).collect::<Vec<_>>()
        {
            views.answer(&question, &mut scratch, &mut answer);
            let observers = views.views().iter().map(View::observer);
            let cameras =
                observers.map(|observer| ExpectedCamera::new(observer.camera(), observer.rig_index()));
            let expected = ExpectedAnswer::new(&question, &asked_world(&question), cameras.collect());
            let wire = answer_to_wire(1, &answer, views.views().len(), Precision::Exact, 0.0);
            match answer_from_wire(wire, &expected).expect("valid").0 {
                ProbeAnswer::Answer(found) => pass.answer(node, &found).expect("answers the question"),
                ProbeAnswer::Refused(reason, why) => panic!("refused, {reason:?}: {why}"),
            }
        }
    }
    pass.into_results()
}

#[test]
fn every_camera_of_a_large_rig_counts_however_they_are_divided() {
    for cameras in [65, 128, 256] {
        let views = views(cameras);
        let one = over_nodes(&[ViewSet::new(views.clone())]);
        let most =
            one[0].paper().and_then(|paper| paper.inside.iter().map(|inside| inside.inside_count).max());
        assert_eq!(most, Some(cameras as u32), "points that all cameras see within the person");
        for a_node in [1, 8, cameras - 1] {
            let nodes: Vec<ViewSet> =
                views.chunks(a_node).map(|views| ViewSet::new(views.to_vec())).collect();
            assert_eq!(over_nodes(&nodes), one, "{cameras} cameras, {a_node} a node");
        }
    }
}
