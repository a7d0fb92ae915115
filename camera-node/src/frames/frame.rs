//! A frame: the silhouettes of all cameras of the node at one instant, ready to be probed and sent.

use std::sync::Arc;

use bytes::Bytes;
use film_time::{CameraPace, CameraReport, FrameReport, Stamps};
use hull::silhouette::PixelRect;
use hull::{Observer, Silhouette, View, ViewSet};

/// One camera's part of a frame.
#[derive(Clone, Debug)]
pub struct CameraFrame {
    /// Place in the rig.
    pub rig_index: u16,
    /// The silhouette.
    pub silhouette: Arc<Silhouette>,
    /// The silhouette as compact bytes.
    pub bytes: Bytes,
    /// Least rectangle of what the camera does not reject; `None` if it rejects all it sees.
    pub admitted: Option<PixelRect>,
    /// From capture to silhouette, milliseconds.
    pub segment_ms: f64,
    /// Live: from the film time of the frame's number to when it was there, seconds.
    pub late_s: f64,
    /// By what its source knows which frame is which.
    pub stamps: Stamps,
    /// Of live cameras, once it is known.
    pub pace: Option<CameraPace>,
    pub(super) view: View,
}

impl CameraFrame {
    /// Prepares a camera's silhouette for probing and sending.
    pub fn new(observer: &Arc<Observer>, silhouette: Silhouette, segment_ms: f64) -> CameraFrame {
        CameraFrame {
            rig_index: observer.rig_index(),
            bytes: silhouette.encode().into(),
            admitted: observer.admitted(silhouette.bounds()),
            view: View::new(Arc::clone(observer), &silhouette),
            silhouette: Arc::new(silhouette),
            segment_ms,
            late_s: 0.0,
            stamps: Stamps::Index,
            pace: None,
        }
    }

    /// The same of a camera that films like this.
    pub fn stamped(self, stamps: Stamps, pace: Option<CameraPace>) -> CameraFrame {
        CameraFrame { stamps, pace, ..self }
    }
}

/// One frame over all cameras of the node.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Its number in the cluster's count.
    pub number: u64,
    /// Film time since the epoch, seconds.
    pub capture_time_s: f64,
    /// When it was captured by the wall clock, unix seconds.
    pub captured_unix_s: f64,
    /// Numbers between the frame before, or the run's begin, and this one: what a camera did not film, or gave
    /// too late.
    pub skipped: u64,
    /// Each camera's part, in rig order.
    pub cameras: Vec<CameraFrame>,
    /// The cameras ready to answer together.
    pub views: ViewSet,
}

impl Frame {
    /// The silhouettes by their cameras' places in the rig, ascending.
    pub fn silhouettes(&self) -> Vec<(u16, Arc<Silhouette>)> {
        let silhouette = |camera: &CameraFrame| (camera.rig_index, Arc::clone(&camera.silhouette));
        self.cameras.iter().map(silhouette).collect()
    }

    /// What others need to know of it, without its pixels.
    pub fn report(&self) -> FrameReport {
        let camera = |camera: &CameraFrame| CameraReport {
            rig_index: camera.rig_index,
            admitted: camera.admitted,
            area: camera.silhouette.area(),
            silhouette_bytes: camera.bytes.len() as u32,
            segment_ms: camera.segment_ms,
            late_s: camera.late_s,
            stamps: camera.stamps,
            pace: camera.pace,
        };
        FrameReport {
            frame: self.number,
            capture_time_s: self.capture_time_s,
            captured_unix_s: self.captured_unix_s,
            cameras: self.cameras.iter().map(camera).collect(),
            skipped: self.skipped,
        }
    }
}

/// Number and times of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamp {
    /// Its number.
    pub number: u64,
    /// Film time since the epoch, seconds.
    pub capture_time_s: f64,
    /// The wall clock at capture, unix seconds.
    pub captured_unix_s: f64,
}
