//! Recording a run.

use std::sync::Arc;

use camera_node::NodeConfig;
use film_time::unix_now_s;
use proto::convert::Precision;
use proto::{CameraPicture, PictureKind, PictureRequest};
use recording::{ColourCrop, ColourSource, RecordingFile, RunHeader, RunRecorder, WriteError};
use setup::cli::{Failure, Outcome};
use web_server::pictures::Pictures;

use super::options::RecordTo;
use super::run_setup::{Setup, TransportName};

/// Finer than what a page asks for: recorded once, it is looked at again.
const JPEG_QUALITY: u8 = 85;

/// Begins the recording of a run of these cameras.
pub fn begin(
    setup: &Setup,
    to: &RecordTo,
    cameras: &NodeConfig,
    colours: Option<ColourSource>,
) -> Outcome<(RunRecorder, RecordingFile)> {
    let header = RunHeader {
        program: env!("CARGO_PKG_VERSION").to_owned(),
        began_unix_s: unix_now_s(),
        rig: setup.file.rig.clone(),
        ignored: cameras.cameras.iter().map(|camera| camera.ignored.clone()).collect(),
        fps: setup.file.fps,
        latency_s: setup.file.latency_s.unwrap_or_default(),
        hold_s: setup.file.hold_s,
        probes: setup.file.probes,
        scene: setup.scene.clone(),
        world: setup.world,
        // Only questions to nodes are ever rounded.
        precision: match setup.transport {
            TransportName::Auto | TransportName::Cluster => setup.file.precision,
            TransportName::Gather | TransportName::Inprocess => Precision::Exact,
        },
        asks: setup.asks,
        transport: setup.transport.name().to_owned(),
        lock_step: setup.lock_step,
    };
    recording::record(&to.path, to.overwrites, &header, colours).map_err(failure)
}

/// A recording that failed.
pub fn failure(error: WriteError) -> Failure {
    match error {
        WriteError::Exists(_) => Failure::input(error),
        WriteError::Unwritable { .. } => Failure::run(error),
    }
}

/// The source of a recording's colours: crops from the pictures that `make` gives.
pub fn colour_source<P: Pictures + 'static>(make: impl FnOnce() -> Arc<P> + Send + 'static) -> ColourSource {
    Box::new(move || {
        let pictures = make();
        Box::new(move |frame| {
            let fetching = pictures.fetch(PictureRequest {
                frame: Some(frame),
                kind: PictureKind::Crops,
                scale_log2: 0,
                jpeg_quality: JPEG_QUALITY,
                cameras: Vec::new(),
            });
            Box::pin(async move {
                let found = fetching.await?.cameras.into_iter();
                Ok(found.filter(|picture| !picture.jpeg.is_empty()).map(|picture| crop(&picture)).collect())
            })
        })
    })
}

fn crop(picture: &CameraPicture) -> ColourCrop {
    ColourCrop {
        camera: picture.rig_index,
        crop: picture.crop.map(u32::from),
        scale_log2: picture.scale_log2.into(),
        jpeg: picture.jpeg.to_vec(),
    }
}
