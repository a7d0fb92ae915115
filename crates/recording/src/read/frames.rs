//! The silhouettes of a recording as the frames of a coordinator.

use std::collections::VecDeque;
use std::sync::Arc;

use coordinator::{BoxError, LocalFrames, Silhouettes};
use film_time::{CameraReport, FilmState, FrameReport, Pace, Stamps};
use hull::{Observer, Silhouette, View, ViewSet};
use parking_lot::{Mutex, MutexGuard};
use proto::convert::{SilhouetteEncoding, silhouette_from_data};
use tokio::sync::watch;

use super::unpack::Unpacker;
use super::{Index, NO_CHUNK, ReadError};
use crate::convert::RunHeader;

/// Frames kept ready: as many as a node keeps.
const KEPT_FRAMES: usize = 8;

/// The frames of a recording, read when they are wanted.
pub struct RecordedFrames {
    index: Arc<Index>,
    observers: Vec<Arc<Observer>>,
    fps: f64,
    inner: Mutex<Inner>,
    version: watch::Sender<u64>,
}

struct Inner {
    unpacker: Unpacker,
    frames: VecDeque<Arc<Frame>>,
    state: FilmState,
    epoch_unix_s: f64,
    /// The run may use frames up to this.
    credited: u64,
}

/// A camera's observer and silhouette, that one's bytes, and how long it took to segment, milliseconds.
type Part<'a> = (&'a Arc<Observer>, Silhouette, u32, f64);

struct Frame {
    number: u64,
    views: ViewSet,
    silhouettes: Silhouettes,
    report: FrameReport,
}

impl RecordedFrames {
    pub(super) fn begin(header: &RunHeader, index: Arc<Index>) -> Result<RecordedFrames, ReadError> {
        let inner = Inner {
            unpacker: Unpacker::begin(Arc::clone(&index), false)?,
            frames: VecDeque::new(),
            state: FilmState::Running,
            epoch_unix_s: header.began_unix_s,
            credited: 0,
        };
        let (observers, fps) = (header.observers(), header.fps);
        Ok(RecordedFrames { index, observers, fps, inner: Mutex::new(inner), version: watch::Sender::new(0) })
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing between two statements that can panic is half done.
        self.inner.lock()
    }

    /// A frame, read if need be; `None` if the recording has it not.
    fn frame(&self, number: u64) -> Option<Arc<Frame>> {
        let mut inner = self.lock();
        if let Some(frame) = inner.frames.iter().find(|frame| frame.number == number) {
            return Some(Arc::clone(frame));
        }
        let cameras = self.index.frames.get(&number)?;
        match self.read(&mut inner, number, cameras) {
            Ok(frame) => {
                let frame = Arc::new(frame);
                if inner.frames.len() == KEPT_FRAMES {
                    inner.frames.pop_front();
                }
                inner.frames.push_back(Arc::clone(&frame));
                Some(frame)
            }
            Err(error) => {
                inner.state = FilmState::Failed(error.to_string());
                None
            }
        }
    }

    fn read(&self, inner: &mut Inner, number: u64, cameras: &[u32]) -> Result<Frame, ReadError> {
        let mut parts = Vec::with_capacity(cameras.len());
        for (camera, &chunk) in cameras.iter().enumerate().filter(|(_, chunk)| **chunk != NO_CHUNK) {
            let found = inner.unpacker.silhouette(chunk, camera, number)?;
            let observer = &self.observers[camera];
            let size = (observer.camera().width(), observer.camera().height());
            let silhouette = silhouette_from_data(&found.runs, size, SilhouetteEncoding::Runs)
                .map_err(|error| self.index.refused(error))?;
            parts.push((observer, silhouette, found.runs.len() as u32, found.segment_ms));
        }
        let view = |(observer, silhouette, ..): &Part| View::new(Arc::clone(observer), silhouette);
        let views = ViewSet::new(parts.iter().map(view).collect());
        let views = match inner.frames.back() {
            Some(before) => views.after(&before.views, number.saturating_sub(before.number)),
            None => views,
        };
        let report = |(observer, silhouette, silhouette_bytes, segment_ms): &Part| CameraReport {
            rig_index: observer.rig_index(),
            admitted: observer.admitted(silhouette.bounds()),
            area: silhouette.area(),
            silhouette_bytes: *silhouette_bytes,
            segment_ms: *segment_ms,
            late_s: 0.0,
            stamps: Stamps::Index,
            pace: None,
        };
        let cameras = parts.iter().map(report).collect();
        let capture_time_s = number as f64 / self.fps;
        let report = FrameReport {
            frame: number,
            capture_time_s,
            captured_unix_s: inner.epoch_unix_s + capture_time_s,
            cameras,
            skipped: 0,
        };
        let silhouette = |(observer, silhouette, ..): Part| (observer.rig_index(), Arc::new(silhouette));
        let silhouettes = parts.into_iter().map(silhouette).collect();
        Ok(Frame { number, views, silhouettes, report })
    }
}

impl LocalFrames for RecordedFrames {
    /// A run that begins again reads its frames in the same order: what a frame before was is part of them.
    fn start(&self, pace: Pace) -> Result<(), BoxError> {
        let mut inner = self.lock();
        inner.frames.clear();
        (inner.epoch_unix_s, inner.credited) = (pace.epoch_unix_s, 0);
        Ok(())
    }

    fn credit(&self, up_to_frame: u64) {
        self.lock().credited = up_to_frame;
        self.version.send_modify(|version| *version += 1);
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.version.subscribe()
    }

    /// The last of those up to where the run may go. They are read when they are asked for.
    fn frames(&self) -> Vec<u64> {
        let credited = self.lock().credited;
        let mut numbers: Vec<u64> =
            self.index.frames.range(..=credited).rev().map(|(&frame, _)| frame).take(KEPT_FRAMES).collect();
        numbers.reverse();
        numbers
    }

    fn report(&self, frame: u64) -> Option<FrameReport> {
        self.frame(frame).map(|frame| frame.report.clone())
    }

    fn film(&self) -> FilmState {
        self.lock().state.clone()
    }

    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool {
        let found = self.frame(frame);
        found.is_some_and(|frame| {
            use_views(&frame.views);
            true
        })
    }

    fn silhouettes(&self, frame: u64) -> Option<Silhouettes> {
        self.frame(frame).map(|frame| frame.silhouettes.clone())
    }
}
