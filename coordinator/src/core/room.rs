//! A room for tests: up to four cameras around the origin that see a cube of about half a metre there, always.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use film_time::{CameraReport, FrameReport, Stamps};
use hull::silhouette::PixelRect;
use hull::{Camera, Observer, ProbeSettings, Silhouette, View, ViewSet};
use nalgebra::{Matrix3, Vector3};

const SIDE: u32 = 101;
/// What every camera sees.
pub(crate) const SEEN: PixelRect = PixelRect { left: 42, top: 42, right: 59, bottom: 59 };

/// So many cameras at 3 m that look at the origin, each a quarter turn from the one before.
pub(crate) fn observers(count: u16) -> Vec<Arc<Observer>> {
    let k = Matrix3::new(100.0, 0.0, 50.0, 0.0, 100.0, 50.0, 0.0, 0.0, 1.0);
    let observer = |index: u16| {
        let turn = Vector3::new(0.0, f64::from(index) * FRAC_PI_2, 0.0);
        let camera =
            Camera::new(format!("cam{index}"), (SIDE, SIDE), k, [0.0; 5], turn, Vector3::new(0.0, 0.0, 3.0));
        Arc::new(Observer::new(camera.expect("a camera"), index, ProbeSettings::default(), None))
    };
    (0..count).map(observer).collect()
}

/// What these cameras see.
pub(crate) fn views(observers: &[Arc<Observer>]) -> ViewSet {
    views_of(observers, SEEN)
}

/// The same where every camera sees something else.
pub(crate) fn views_of(observers: &[Arc<Observer>], seen: PixelRect) -> ViewSet {
    let rows = (0..SIDE).map(|row| {
        let inside = (seen.top..seen.bottom).contains(&row);
        (0..SIDE).map(move |column| inside && (seen.left..seen.right).contains(&column))
    });
    let mask: Vec<u8> = rows.flatten().map(|seen| if seen { 255 } else { 0 }).collect();
    let silhouette = Silhouette::from_mask(SIDE, SIDE, &mask).expect("a silhouette");
    ViewSet::new(observers.iter().map(|observer| View::new(Arc::clone(observer), &silhouette)).collect())
}

/// What a node of these cameras, by their places in the rig, reports of a frame at 30 frames/s.
pub(crate) fn report(
    frame: u64,
    cameras: impl IntoIterator<Item = u16>,
    admitted: Option<PixelRect>,
) -> FrameReport {
    let camera = |rig_index| CameraReport {
        rig_index,
        admitted,
        area: 0,
        silhouette_bytes: 0,
        segment_ms: 0.0,
        late_s: 0.0,
        stamps: Stamps::Index,
        pace: None,
    };
    let cameras = cameras.into_iter().map(camera).collect();
    FrameReport { frame, capture_time_s: frame as f64 / 30.0, captured_unix_s: 0.0, cameras, skipped: 0 }
}
