//! Pictures of a recording, for the page of a replay.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use coordinator::BoxError;
use futures::future::BoxFuture;
use proto::{CameraPicture, FramePictures, PictureKind, PictureRequest};
use recording::{ColourCrop, RecordedPicture, RecordedPictures};
use web_server::pictures::Pictures;

/// No frame was requested yet.
const NO_FRAME: u64 = u64::MAX;

/// A recording's pictures for a page: as they were recorded, whatever size is asked for. There are no whole
/// images.
pub struct RecordingPictures {
    pictures: Arc<RecordedPictures>,
    /// The frame that was requested last.
    newest: AtomicU64,
}

impl RecordingPictures {
    /// Pictures of a file.
    pub fn new(pictures: RecordedPictures) -> RecordingPictures {
        RecordingPictures { pictures: Arc::new(pictures), newest: AtomicU64::new(NO_FRAME) }
    }
}

impl Pictures for RecordingPictures {
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, BoxError>> {
        let frame = request.frame.unwrap_or_else(|| self.newest.load(Ordering::Relaxed));
        self.newest.store(frame, Ordering::Relaxed);
        let pictures = Arc::clone(&self.pictures);
        // Reading a file waits for a disk.
        let reading = tokio::task::spawn_blocking(move || read(&pictures, frame, &request));
        Box::pin(async move { reading.await? })
    }
}

fn read(
    pictures: &RecordedPictures,
    frame: u64,
    request: &PictureRequest,
) -> Result<FramePictures, BoxError> {
    let found = pictures.frame(frame)?;
    let found = found.ok_or_else(|| format!("frame {frame} is not in the recording"))?;
    let captured_unix_s = found.first().map_or(0.0, |picture| picture.captured_unix_s);
    let wanted = found.into_iter().filter(|picture| {
        request.kind != PictureKind::Whole
            && (request.cameras.is_empty() || request.cameras.contains(&picture.camera))
    });
    let cameras = wanted.map(|picture| shown(picture, request.kind)).collect();
    Ok(FramePictures { frame, captured_unix_s, cameras })
}

fn shown(picture: RecordedPicture, kind: PictureKind) -> CameraPicture {
    let RecordedPicture { camera, runs, colour, .. } = picture;
    let silhouette = CameraPicture { rig_index: camera, runs: runs.into(), ..CameraPicture::default() };
    match colour.filter(|_| kind == PictureKind::Crops) {
        Some(ColourCrop { crop, scale_log2, jpeg, .. }) => CameraPicture {
            // Sides are 16,384 pixels at most.
            crop: crop.map(|side| u16::try_from(side).unwrap_or(u16::MAX)),
            scale_log2: scale_log2.min(3) as u8,
            jpeg: jpeg.into(),
            ..silhouette
        },
        None => silhouette,
    }
}
