//! Bodies that come into the hull fast (paper §7: very fast objects). Between two frames a limb may move farther than a ball
//! is thick. When the ball is found in the limb, the nearest surface may be any side of the limb. So the body is asked about
//! once more, with ways out back along its relative velocity: it came in there.

use nalgebra::Vector3;

use crate::contact::SurfaceContact;

/// Where the surface, or the body relative to it, is slower, the body meets the nearest surface, m/s.
pub(super) const FAST_M_S: f64 = 0.5;
/// A body came in within a frame period; outlines may tell a third of the true speed, so it is looked for so much farther.
const PERIODS: f64 = 3.0;
/// And no farther away than this, metres: beyond is another limb.
const FARTHEST_M: f64 = 0.4;
/// The body came through a surface whose normal has at least this part of the way back.
const LEAST_ALONG: f64 = 0.2;
/// Samples touched together if their ways in differ by no more than this, metres.
const TOGETHER_M: f64 = 0.01;

/// The way back to where a body came in, and no farther, world, metres, from its velocity relative to the surface, m/s. `None` for
/// a slow body.
pub(super) fn back_m(relative_m_s: &Vector3<f64>, fps: f64) -> Option<[f32; 3]> {
    let speed_m_s = relative_m_s.norm();
    let farthest_m = (speed_m_s * PERIODS / fps).min(FARTHEST_M);
    let back = -relative_m_s * (farthest_m / speed_m_s);
    (speed_m_s > FAST_M_S).then(|| back.map(|part| part as f32).into())
}

/// Keeps the contacts that touched first, of a body that came in that way. The others came later, or would not have come.
pub(super) fn keep_first(contacts: &mut Vec<SurfaceContact>, back_m: [f32; 3]) {
    let Some(back) = Vector3::from(back_m.map(f64::from)).try_normalize(0.0) else { return };
    let since_m = |contact: &SurfaceContact| {
        let along = contact.normal().dot(&back);
        (along > LEAST_ALONG).then(|| f64::from(contact.depth_m) / along)
    };
    let first_m = contacts.iter().filter_map(since_m).fold(0.0, f64::max);
    contacts.retain(|contact| since_m(contact).is_some_and(|since_m| since_m > first_m - TOGETHER_M));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_body_goes_back_by_three_frames_of_its_motion_and_40_cm_at_most() {
        assert_eq!(back_m(&Vector3::new(0.0, 0.4, 0.0), 30.0), None);
        assert_eq!(back_m(&Vector3::zeros(), 30.0), None);
        assert_eq!(back_m(&Vector3::new(2.0, 0.0, 0.0), 30.0), Some([-0.2, 0.0, 0.0]));
        assert_eq!(back_m(&Vector3::new(0.0, 0.0, -80.0), 30.0), Some([0.0, 0.0, 0.4]));
    }
}
