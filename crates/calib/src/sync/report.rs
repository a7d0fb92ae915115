//! What a check of times says.

use serde::Serialize;

use crate::check::Refinement;

/// One camera's time against the others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraSync {
    /// The camera's name.
    pub camera: String,
    /// How much older its frames are than they say, seconds, against those cameras that agree best; negative:
    /// younger.
    pub late_s: f64,
    /// One standard deviation of it, seconds.
    pub uncertainty_s: f64,
    /// The cost (as [`SyncReport::cost`]) if this camera alone were not late.
    pub cost_in_time: f64,
    /// The correction of this camera's place that lowers the cost most, all times being as found.
    #[serde(rename = "mend")]
    pub refinement: Refinement,
}

/// The cameras' times against each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SyncReport {
    /// Per camera, in rig order.
    pub cameras: Vec<CameraSync>,
    /// Mean cost of an outline ray with the times as they are said to be: the squared gap to the others' hull, in
    /// pixels of an image 640 wide, large gaps counting linearly.
    pub cost_as_said: f64,
    /// The same with the times found.
    pub cost: f64,
    /// The camera (by rig order) that is out of its place, if one clearly is; times are then those that fit with it put
    /// right.
    pub moved: Option<usize>,
    /// How fast outlines move, root mean square, pixels of an image 640 wide a second.
    pub motion_px_per_s: f64,
    /// The usual time from frame to frame, seconds.
    pub interval_s: f64,
}
