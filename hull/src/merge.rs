//! Group answers to one hull answer. Merging runs in rig order whatever the order of arrival.

use crate::probe::exit::Exit;
use crate::question::{Edge, Standing};
use crate::rule::HullRule;

/// The number of cameras that say inside if the point is inside the hull: nobody says outside and
/// enough say inside.
pub fn merge_standings(standings: impl Iterator<Item = Standing>, rule: HullRule) -> Option<usize> {
    let count = standings.map(Standing::inside_count).sum::<Option<usize>>()?;
    (count >= rule.min_views as usize).then_some(count)
}

/// The edge at the least 3D distance; ties go to the lower camera.
pub fn merge_edges(edges: impl Iterator<Item = Option<Edge>>) -> Option<Edge> {
    edges.flatten().min_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.camera.cmp(&b.camera)))
}

/// The first `t` at which the hull rule no longer says inside, metres: someone says outside, or, of the
/// `inside_count` cameras that said inside at the start, too few still do.
pub fn merge_exits<'a>(
    exits: impl Iterator<Item = &'a Exit>,
    inside_count: usize,
    rule: HullRule,
) -> Option<f32> {
    let mut outside_m: Option<f32> = None;
    let mut changes: Vec<(f32, i32)> = Vec::new();
    for exit in exits {
        outside_m = match (outside_m, exit.outside_m) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        changes.extend_from_slice(&exit.changes);
    }
    changes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut count = inside_count as i64;
    let mut at = 0;
    while at < changes.len() {
        let t = changes[at].0;
        if outside_m.is_some_and(|outside_m| t >= outside_m) {
            break;
        }
        while at < changes.len() && changes[at].0 == t {
            count += i64::from(changes[at].1);
            at += 1;
        }
        if count < i64::from(rule.min_views) {
            return Some(t);
        }
    }
    outside_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;

    const TWO: HullRule = HullRule { out_of_view: crate::OutOfView::Abstain, min_views: 2 };

    #[test]
    fn one_outside_rejects_and_too_few_are_not_enough() {
        let inside = Standing::inside;
        assert_eq!(merge_standings([inside(1), inside(2)].into_iter(), TWO), Some(3));
        assert_eq!(merge_standings([inside(1), inside(0)].into_iter(), TWO), None);
        assert_eq!(merge_standings([inside(5), Standing::OUTSIDE].into_iter(), TWO), None);
    }

    #[test]
    fn the_nearest_edge_wins_and_ties_go_to_the_lower_camera() {
        let edge = |distance_m, camera| {
            Some(Edge { distance_m, camera, pixel: Pixel { column: 0, row: 0 }, normal_world: [0.0; 3] })
        };
        let merged = merge_edges([edge(0.2, 0), None, edge(0.1, 7), edge(0.1, 3)].into_iter());
        assert_eq!(merged, edge(0.1, 3));
    }

    #[test]
    fn an_exit_is_an_outside_or_too_much_silence() {
        let a = Exit { outside_m: Some(0.5), changes: vec![(0.1, -1), (0.2, 1)] };
        let b = Exit { outside_m: None, changes: vec![(0.1, 1), (0.3, -1)] };
        let none = Exit::default();
        assert_eq!(merge_exits([&a, &none].into_iter(), 3, TWO), Some(0.5));
        assert_eq!(merge_exits([&a, &none].into_iter(), 2, TWO), Some(0.1), "one falls silent");
        assert_eq!(merge_exits([&a, &b].into_iter(), 2, TWO), Some(0.5), "another sees at the same t");
        assert_eq!(merge_exits([&b, &a].into_iter(), 2, TWO), Some(0.5), "in any order");
        assert_eq!(merge_exits([&none].into_iter(), 2, TWO), None);
    }
}
