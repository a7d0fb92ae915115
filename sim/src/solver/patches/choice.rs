//! Which contacts make a patch, and which four of them hold it.

use rapier3d::prelude::Vector;

use crate::response::HullContact;

/// Points of a patch: rapier reduces more without remembering which it took.
pub(super) const MAX_POINTS: usize = 4;

/// Contacts are of one patch if their normals are no farther apart: cosine of 25 degrees.
const SAME_PATCH: f32 = 0.906;
/// Contacts are held above the surface up to here, metres: less deep ones say less of where it leans.
const LEAST_WEIGHT_M: f32 = 0.01;
/// A contact that was held before is taken for so much deeper, metres, and so much farther out.
const KEPT_DEPTH_M: f32 = 1e-3;
const KEPT_SPREAD: f32 = 1.15;
/// What a contact is less deep than the deepest, beyond so much, metres, counts so many times against its distance.
const SHALLOW_M: f32 = 1e-3;
const SHALLOW_WEIGHT: f32 = 3.0;
/// A point that widens a patch less than this does not make it steadier, metres.
const LEAST_SPREAD_M: f32 = 5e-3;

/// Whether two normals are of one patch.
pub(super) fn agree(a: Vector, b: Vector) -> bool {
    a.dot(b) > SAME_PATCH
}

fn normal_of(contact: &HullContact) -> Vector {
    Vector::from_array(contact.normal_world)
}

/// The contacts of each patch, the deepest first, at most so many patches: those of the deepest contacts.
pub(super) fn cluster(contacts: &[HullContact], most: usize) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..contacts.len()).collect();
    let deepest = |&a: &usize, &b: &usize| contacts[b].depth_m.total_cmp(&contacts[a].depth_m);
    order.sort_by(|a, b| deepest(a, b).then(contacts[*a].sample.cmp(&contacts[*b].sample)));
    let mut clusters: Vec<Vec<usize>> = Vec::new();
    for member in order {
        let normal = normal_of(&contacts[member]);
        let place = clusters.iter().position(|members| agree(normal_of(&contacts[members[0]]), normal));
        match place {
            Some(place) => clusters[place].push(member),
            None if clusters.len() < most => clusters.push(vec![member]),
            None => {}
        }
    }
    clusters
}

/// The mean of the members' normals by depth.
pub(super) fn mean_normal(contacts: &[HullContact], members: &[usize]) -> Vector {
    let weighted = members.iter().map(|&member| {
        let weight = (LEAST_WEIGHT_M + contacts[member].depth_m).max(0.01 * LEAST_WEIGHT_M);
        normal_of(&contacts[member]) * weight
    });
    let sum = weighted.fold(Vector::ZERO, |sum, normal| sum + normal);
    sum.try_normalize().unwrap_or_else(|| normal_of(&contacts[members[0]]))
}

/// How fast the members' surface moves out, m/s: the mean of the middle half of what they say; `None` if none says.
pub(super) fn mean_speed_m_s(contacts: &[HullContact], members: &[usize]) -> Option<f32> {
    let mut speeds_m_s: Vec<f32> = members.iter().filter_map(|&member| contacts[member].speed_m_s).collect();
    speeds_m_s.sort_by(f32::total_cmp);
    let middle = &speeds_m_s[speeds_m_s.len() / 4..(3 * speeds_m_s.len()).div_ceil(4)];
    (!middle.is_empty()).then(|| middle.iter().sum::<f32>() / middle.len() as f32)
}

/// How fast the members' surface moves along itself, m/s: the mean of what they say.
pub(super) fn mean_slide_m_s(contacts: &[HullContact], members: &[usize], normal: Vector) -> Vector {
    let slides = members.iter().map(|&member| Vector::from_array(contacts[member].slide_m_s));
    let mean = slides.fold(Vector::ZERO, |sum, slide| sum + slide) / members.len() as f32;
    mean - normal * mean.dot(normal)
}

/// The members that hold the patch: the deepest, the one farthest from it, and the farthest on either side of the line
/// between them. Those held before are preferred, so that they change only where that steadies the body.
pub(super) fn spread(
    contacts: &[HullContact],
    members: &[usize],
    normal: Vector,
    world: impl Fn(usize) -> Vector,
    is_kept: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let depth_m = |member: usize| contacts[member].depth_m;
    let deepest_m = members.iter().map(|&member| depth_m(member)).fold(f32::NEG_INFINITY, f32::max);
    let kept_depth_m = |member: usize| depth_m(member) + if is_kept(member) { KEPT_DEPTH_M } else { 0.0 };
    // Of equals the first wins: members come in one order always.
    let best = |score: &dyn Fn(usize) -> f32, chosen: &[usize]| {
        let free = members.iter().copied().filter(|member| !chosen.contains(member));
        free.map(|member| (score(member), member))
            .reduce(|best, next| if next.0 > best.0 { next } else { best })
    };
    let Some((_, first)) = best(&kept_depth_m, &[]) else { return Vec::new() };
    let mut chosen = vec![first];
    let origin = world(first);
    while chosen.len() < MAX_POINTS {
        let away_m = |member: usize| match chosen[1..] {
            [] => (world(member) - origin).length(),
            [second, ref third @ ..] => {
                let side = (world(second) - origin).cross(normal).normalize_or_zero();
                let across_m = (world(member) - origin).dot(side);
                match third {
                    [] => across_m.abs(),
                    [third, ..] => -across_m * (world(*third) - origin).dot(side).signum(),
                }
            }
        };
        let score = |member: usize| {
            let shallow_m = (deepest_m - depth_m(member) - SHALLOW_M).max(0.0);
            away_m(member) * if is_kept(member) { KEPT_SPREAD } else { 1.0 } - SHALLOW_WEIGHT * shallow_m
        };
        match best(&score, &chosen) {
            Some((spread_m, member)) if spread_m > LEAST_SPREAD_M => chosen.push(member),
            _ => break,
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact(sample: u32, at: [f32; 3], normal_world: [f32; 3], depth_m: f32) -> HullContact {
        HullContact { sample, point_body_m: at, normal_world, depth_m, speed_m_s: None, slide_m_s: [0.0; 3] }
    }

    /// The samples of a square lattice of `side` by `side` points, 5 cm apart, on a level surface.
    fn level(side: u32) -> Vec<HullContact> {
        let places = (0..side).flat_map(|z| (0..side).map(move |x| (x, z)));
        let at = |(x, z): (u32, u32)| [0.05 * x as f32, 0.0, 0.05 * z as f32];
        places.zip(0..).map(|(place, sample)| contact(sample, at(place), [0.0, 1.0, 0.0], 1e-4)).collect()
    }

    fn chosen(contacts: &[HullContact], kept: &[u32]) -> Vec<u32> {
        let members: Vec<usize> = (0..contacts.len()).collect();
        let world = |member: usize| Vector::from_array(contacts[member].point_body_m);
        let is_kept = |member: usize| kept.contains(&contacts[member].sample);
        let mut found: Vec<u32> = spread(contacts, &members, Vector::Y, world, is_kept)
            .into_iter()
            .map(|member| contacts[member].sample)
            .collect();
        found.sort_unstable();
        found
    }

    #[test]
    fn a_level_face_is_held_at_its_corners() {
        assert_eq!(chosen(&level(5), &[]), [0, 4, 20, 24]);
    }

    #[test]
    fn points_are_kept_while_others_are_hardly_better() {
        let contacts = level(5);
        // Not quite the corners.
        let kept = [1, 9, 15, 23];
        let again = chosen(&contacts, &kept);
        assert!(again.iter().filter(|sample| kept.contains(sample)).count() >= 2, "{again:?}");
        assert_eq!(chosen(&contacts, &again), again, "and then they stay");
    }

    #[test]
    fn what_is_far_above_the_surface_holds_nothing() {
        let mut contacts = level(3);
        contacts[8].depth_m = -0.05;
        assert!(!chosen(&contacts, &[]).contains(&8));
    }

    #[test]
    fn two_hands_are_two_patches() {
        let left = (0..3).map(|sample| contact(sample, [-0.1, 0.0, 0.0], [1.0, 0.0, 0.0], 0.002));
        let right = (3..6).map(|sample| contact(sample, [0.1, 0.0, 0.0], [-1.0, 0.0, 0.0], 0.001));
        let contacts: Vec<HullContact> = left.chain(right).collect();
        let clusters = cluster(&contacts, 4);
        assert_eq!(clusters, [vec![0, 1, 2], vec![3, 4, 5]]);
        assert!((mean_normal(&contacts, &clusters[1]) - Vector::NEG_X).length() < 1e-6);
        assert_eq!(cluster(&contacts, 1).len(), 1);
    }
}
