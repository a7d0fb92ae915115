//! Cameras that are filmed in this process, instead of by node processes.

use std::io;
use std::sync::Arc;

use camera_node::NodeConfig;
use camera_node::capture::{CaptureError, Film, Filming as _};
use camera_node::frames::FrameRing;
use camera_node::pictures::PictureEncoder;
use coordinator::BoxError;
use film_time::{BackgroundFilm, Pace, RunStart, ring_frames};
use futures::future::BoxFuture;
use node_client::FETCH_TIMEOUT;
use proto::{FramePictures, Picture, PictureRequest};
use tokio::sync::mpsc;
use web_server::pictures::Pictures;

use crate::ring_frames::{RingFilm, RingFrames};

/// Cameras filmed in this process.
pub type InProcess = RingFrames<LocalFilm>;

/// The film of cameras of this process, and the ring that it fills.
pub struct LocalFilm {
    film: Film,
    ring: Arc<FrameRing>,
}

impl InProcess {
    /// Opens the cameras and learns their backgrounds.
    pub fn prepare(config: &NodeConfig) -> Result<InProcess, CaptureError> {
        let ring = Arc::new(FrameRing::new(config.cameras.len()).keeping(ring_frames(config.fps)));
        Ok(RingFrames(LocalFilm { film: Film::prepare(config, Arc::clone(&ring))?, ring }))
    }

    /// What makes pictures of its frames, on a thread of its own.
    pub fn pictures(&self, config: &NodeConfig) -> io::Result<LocalPictures> {
        let LocalFilm { film, ring } = &self.0;
        PictureEncoder::new(Arc::clone(ring), film.colours(), config.rig_indices()).map(LocalPictures)
    }
}

/// Pictures of cameras filmed in this process.
pub struct LocalPictures(PictureEncoder);

impl Pictures for LocalPictures {
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, BoxError>> {
        // More cameras than any rig has.
        let (sender, mut pictures) = mpsc::channel(usize::from(u16::MAX));
        let deliver = move |picture: Picture| {
            // The request may have been dropped.
            let _ = sender.try_send(picture);
        };
        let requested = self.0.request(request, deliver);
        Box::pin(async move {
            requested?;
            let (mut frame, mut captured_unix_s, mut cameras) = (0, 0.0, Vec::new());
            let deadline = tokio::time::Instant::now() + FETCH_TIMEOUT;
            loop {
                let picture = tokio::time::timeout_at(deadline, pictures.recv()).await;
                let Some(picture) = picture.map_err(|_| "no pictures in time")? else { break };
                (frame, captured_unix_s) = (picture.frame, picture.captured_unix_s);
                cameras.push(picture.camera);
            }
            if cameras.is_empty() {
                return Err("no camera has this frame".into());
            }
            Ok(FramePictures { frame, captured_unix_s, cameras })
        })
    }
}

impl RingFilm for LocalFilm {
    fn ring(&self) -> &FrameRing {
        &self.ring
    }

    fn start(&self, pace: Pace) -> Result<(), BoxError> {
        Ok(self.film.start(RunStart::of_this_process(pace))?)
    }

    fn credit(&self, up_to_frame: u64) {
        self.film.credit(up_to_frame);
    }

    fn cut_at(&self, phase: f64) {
        self.film.cut_here(phase);
    }

    fn take_background(&self, film: BackgroundFilm) -> BoxFuture<'static, Result<(), BoxError>> {
        let learning = self.film.take_background(film);
        Box::pin(async move { Ok(learning?.finished().await?) })
    }

    fn restore_background(&self, id: u64) {
        self.film.restore_background(id);
    }
}
