//! Films of this process that fill a ring of frames, as the frames of a coordinator.

use std::borrow::Cow;

use camera_node::frames::{Frame, FrameRing};
use coordinator::{BoxError, LocalFrames, Silhouettes};
use film_time::{BackgroundFilm, FilmState, FrameReport, Pace};
use futures::future::BoxFuture;
use hull::ViewSet;
use tokio::sync::watch;

/// A film of this process whose frames go into a ring; [`RingFrames`] hands them to a coordinator.
pub trait RingFilm: Send {
    /// The ring that the film fills.
    fn ring(&self) -> &FrameRing;
    /// As [`LocalFrames::start`].
    fn start(&self, pace: Pace) -> Result<(), BoxError>;
    /// As [`LocalFrames::credit`].
    fn credit(&self, up_to_frame: u64);
    /// Called before the ring's frames are listed: a film without threads of its own puts due frames into the ring here.
    fn poll(&self) {}
    /// The views that answer for a frame; `None` if the film withholds them.
    fn views<'a>(&self, frame: &'a Frame) -> Option<Cow<'a, ViewSet>> {
        Some(Cow::Borrowed(&frame.views))
    }
    /// As [`LocalFrames::cut_at`].
    fn cut_at(&self, phase: f64) {
        let _ = phase;
    }
    /// As [`LocalFrames::take_background`].
    fn take_background(&self, film: BackgroundFilm) -> BoxFuture<'static, Result<(), BoxError>> {
        let _ = film;
        Box::pin(futures::future::ready(Err("these cameras learn no background".into())))
    }
    /// As [`LocalFrames::restore_background`].
    fn restore_background(&self, id: u64) {
        let _ = id;
    }
}

/// The frames of a film, from the ring that it fills.
pub struct RingFrames<F>(pub F);

impl<F: RingFilm> LocalFrames for RingFrames<F> {
    fn start(&self, pace: Pace) -> Result<(), BoxError> {
        self.0.start(pace)
    }

    fn credit(&self, up_to_frame: u64) {
        self.0.credit(up_to_frame);
    }

    fn use_frame(&self, frame: u64) {
        self.0.ring().hold(frame);
    }

    fn cut_at(&self, phase: f64) {
        self.0.cut_at(phase);
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.0.ring().watch()
    }

    fn frames(&self) -> Vec<u64> {
        self.0.poll();
        self.0.ring().since(None).frames.iter().map(|frame| frame.number).collect()
    }

    fn report(&self, frame: u64) -> Option<FrameReport> {
        Some(self.0.ring().get(frame).ok()?.report())
    }

    fn film(&self) -> FilmState {
        self.0.ring().state()
    }

    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool {
        let Ok(frame) = self.0.ring().get(frame) else { return false };
        let views = self.0.views(&frame);
        views.is_some_and(|views| {
            use_views(&views);
            true
        })
    }

    fn silhouettes(&self, frame: u64) -> Option<Silhouettes> {
        Some(self.0.ring().get(frame).ok()?.silhouettes())
    }

    fn take_background(&self, film: BackgroundFilm) -> BoxFuture<'static, Result<(), BoxError>> {
        self.0.take_background(film)
    }

    fn restore_background(&self, id: u64) {
        self.0.restore_background(id);
    }
}
