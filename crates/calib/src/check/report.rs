//! What a check says, and when it names a camera.

use hull::Camera;
use serde::Serialize;

use super::refine::Refined;

/// A camera is named only if its own correction takes away this share of the outline's cost …
pub const SIGNIFICANT_SHARE: f64 = 0.3;
/// … and this much of it: a root mean square gap of 0.3 pixels in an image 640 wide, over all outline
/// rays of all cameras. On real silhouettes of rigs that fit (four cameras, ten frames), moving the best
/// camera takes away 0.03 to 0.06; turning any one by 1.5° or moving it 8 cm across its axis, 0.5 to 8.
pub const SIGNIFICANT_COST: f64 = 0.1;

/// What one camera's own correction would do. The outlines fix the shift of the picture well; how much
/// of it is a turn and how much a move is only a good guess.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refinement {
    /// Mean cost of an outline ray, of all cameras, with this camera corrected (see
    /// [`CheckReport::cost`]).
    pub cost: f64,
    /// How the subject's picture would move: pixels to the right and down.
    pub shift_px: [f64; 2],
    /// Turn of the camera to the right (its picture moves left), degrees.
    pub pan_deg: f64,
    /// Turn of the camera upwards (its picture moves down), degrees.
    pub tilt_deg: f64,
    /// Turn of the picture clockwise, degrees.
    pub roll_deg: f64,
    /// Move of the camera along its own x (right), y (down) and z (ahead), metres.
    pub move_m: [f64; 3],
}

/// How one camera fits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraCheck {
    /// The camera's name.
    pub camera: String,
    /// Share of the foreground pixels looked at whose viewing ray meets the hull of all cameras, 0 to 1.
    pub explained: f64,
    /// Foreground pixels looked at, over all frames.
    pub pixels: u64,
    /// The correction of this camera alone that lowers the cost most.
    #[serde(rename = "mend")]
    pub refinement: Refinement,
}

/// How a rig fits its silhouettes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckReport {
    /// Per camera, in rig order.
    pub cameras: Vec<CameraCheck>,
    /// Mean cost of an outline ray as the rig stands: the squared gap to the others' hull, in pixels of
    /// an image 640 wide, large gaps counting linearly.
    pub cost: f64,
    /// The camera (by rig order) whose correction lowers the cost most, if that is significant: it takes away at
    /// least [`SIGNIFICANT_SHARE`] of the cost and at least [`SIGNIFICANT_COST`]. Never set for fewer than three
    /// cameras: two that disagree cannot tell which of them moved.
    pub moved: Option<usize>,
}

/// A correction in a reader's terms.
pub(crate) fn described(camera: &Camera, refined: &Refined, subject_m: f64) -> Refinement {
    let [tilt, pan, roll, right, down, ahead] = <[f64; 6]>::from(refined.correction);
    let k = camera.intrinsics();
    Refinement {
        cost: refined.cost,
        shift_px: [k[(0, 0)] * (pan - right), k[(1, 1)] * (-tilt - down)],
        pan_deg: -pan.to_degrees(),
        tilt_deg: -tilt.to_degrees(),
        roll_deg: roll.to_degrees(),
        move_m: [right * subject_m, down * subject_m, ahead * subject_m],
    }
}

/// The camera whose correction lowers the cost most, if that is significant.
pub(super) fn significant(report: &CheckReport) -> Option<usize> {
    let cost = |index: usize| report.cameras[index].refinement.cost;
    let best = (0..report.cameras.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b)))?;
    let gained = report.cost - cost(best);
    let three = report.cameras.len() >= 3;
    (three && gained >= SIGNIFICANT_COST && gained >= SIGNIFICANT_SHARE * report.cost).then_some(best)
}
