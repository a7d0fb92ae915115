//! Group answers to one hull answer: the hull rule over what all groups say together.

use crate::question::{Change, NO_EXIT_M, Standing};
use crate::rule::HullRule;
use crate::view::View;
use nalgebra::Point3;

/// The number of cameras that say inside if the point is inside the hull: no camera says outside and
/// enough say inside.
pub fn inside_count(standing: Standing, rule: HullRule) -> Option<usize> {
    standing.inside_count().filter(|&count| count >= rule.min_views as usize)
}

/// Whether one point of the world is inside the hull of a frame's views. Many points are a
/// [`ViewSet`](crate::ViewSet)'s.
pub fn contains(views: &[View], point_world: &Point3<f64>, rule: HullRule) -> bool {
    let mut standing = Standing::inside(0);
    for view in views {
        standing = standing.and(view.classify(point_world).into());
        if standing == Standing::OUTSIDE {
            return false;
        }
    }
    inside_count(standing, rule).is_some()
}

/// The first `t` at which the hull rule no longer says inside, metres: a camera says outside, or, of the
/// `inside_count` cameras that said inside at the start, too few still do. `changes` are those of the
/// ray, ascending.
pub fn first_exit(outside_m: f32, changes: &[Change], inside_count: u32, rule: HullRule) -> Option<f32> {
    let mut count = i64::from(inside_count);
    for at_once in changes.chunk_by(|a, b| a.t_m == b.t_m) {
        if at_once[0].t_m >= outside_m {
            break;
        }
        count += at_once.iter().map(|change| i64::from(change.by)).sum::<i64>();
        if count < i64::from(rule.min_views) {
            return Some(at_once[0].t_m);
        }
    }
    (outside_m != NO_EXIT_M).then_some(outside_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pixel;
    use crate::question::Edge;

    const TWO: HullRule = HullRule { out_of_view: crate::OutOfView::Abstain, min_views: 2 };

    #[test]
    fn one_outside_rejects_and_too_few_are_not_enough() {
        let inside = Standing::inside;
        assert_eq!(inside_count(inside(1).and(inside(2)), TWO), Some(3));
        assert_eq!(inside_count(inside(1).and(inside(0)), TWO), None);
        assert_eq!(inside_count(inside(5).and(Standing::OUTSIDE), TWO), None);
        for cameras in [65, 128, 254, 255, 256, 1000] {
            let one_by_one = (0..cameras).fold(inside(0), |all, _| all.and(inside(1)));
            assert_eq!(inside_count(one_by_one, TWO), Some(cameras));
            assert_eq!(one_by_one, inside(cameras));
            assert_eq!(inside_count(one_by_one.and(Standing::OUTSIDE), TWO), None);
        }
    }

    #[test]
    fn the_nearest_edge_wins_and_ties_go_to_the_lower_camera() {
        let edge = |distance_m, camera| Edge {
            distance_m,
            camera,
            pixel: Pixel { column: 0, row: 0 },
            normal_world: [0.0; 3],
            moved_m: None,
        };
        assert!(edge(0.1, 7).is_nearer(&edge(0.2, 0)) && !edge(0.2, 0).is_nearer(&edge(0.1, 7)));
        assert!(edge(0.1, 3).is_nearer(&edge(0.1, 7)) && !edge(0.1, 7).is_nearer(&edge(0.1, 3)));
    }

    #[test]
    fn an_exit_is_an_outside_or_too_much_silence() {
        let changes = |changes: &[(f32, i32)]| -> Vec<Change> {
            changes.iter().map(|&(t_m, by)| Change { point: 0, t_m, by }).collect()
        };
        let one = changes(&[(0.1, -1), (0.2, 1)]);
        let both = changes(&[(0.1, -1), (0.1, 1), (0.2, 1), (0.3, -1)]);
        assert_eq!(first_exit(0.5, &one, 3, TWO), Some(0.5));
        assert_eq!(first_exit(0.5, &one, 2, TWO), Some(0.1), "one falls silent");
        assert_eq!(first_exit(0.1, &one, 2, TWO), Some(0.1), "at the same t");
        assert_eq!(first_exit(0.5, &both, 2, TWO), Some(0.5), "another sees at the same t");
        assert_eq!(first_exit(NO_EXIT_M, &[], 2, TWO), None);
    }
}
