//! Recording a run.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use camera_node::NodeConfig;
use clap::Args;
use cli::{Failure, Outcome};
use feed::pictures::{CameraPicture, PictureKind, PictureRequest, Pictures};
use proto::convert::Precision;
use proto::unix_now_s;
use recording::{ColourCrop, ColourSource, Overwrites, RecordingFile, RunHeader, RunRecorder, WriteError};

use super::setup::{Setup, TransportName};

/// Finer than what a page asks for: recorded once, it is looked at again.
const JPEG_QUALITY: u8 = 85;

/// Recording beside whatever else a run does.
#[derive(Debug, Args)]
pub struct RecordOptions {
    /// Record the run in an MCAP file, for `hulltouch replay` and other tools.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Keep the colours around the foreground, too.
    #[arg(long = "record-colour", requires = "record")]
    colour: bool,
    /// Replace the file of --record if it is there.
    #[arg(long, requires = "record")]
    force: bool,
}

impl RecordOptions {
    /// Where the run is recorded, if it is to be.
    pub fn checked(&self) -> Outcome<Option<RecordTo>> {
        self.record.clone().map(|path| RecordTo::checked(path, self.force, self.colour)).transpose()
    }
}

/// Where a run is recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordTo {
    /// The file.
    pub path: PathBuf,
    /// Whether it may take the place of another.
    pub overwrites: Overwrites,
    /// With colours.
    pub colour: bool,
}

impl RecordTo {
    /// Refuses, before anything starts, a file that is there and one that cannot be written.
    pub fn checked(path: PathBuf, force: bool, colour: bool) -> Outcome<RecordTo> {
        if path.is_dir() {
            return Err(Failure::unreadable(&path, "found a folder, expected a file to write"));
        }
        if path.exists() && !force {
            return Err(Failure::input(WriteError::Exists(path)));
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // Without a name, so that nothing is left and nothing overwritten.
        tempfile::tempfile_in(folder)
            .map_err(|error| Failure::input(format_args!("cannot write {}: {error}", path.display())))?;
        let overwrites = if force { Overwrites::AtTheEnd } else { Overwrites::Never };
        Ok(RecordTo { path, overwrites, colour })
    }
}

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
        latency_s: setup.file.latency_s,
        hold_s: setup.file.hold_s,
        probes: setup.file.probes,
        scene: setup.scene.clone(),
        world: setup.world,
        // Only questions to nodes are ever rounded.
        precision: match setup.transport {
            TransportName::Cluster => setup.file.precision,
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
        camera: picture.camera,
        crop: picture.crop.map(u32::from),
        scale_log2: picture.scale_log2.into(),
        jpeg: picture.jpeg.to_vec(),
    }
}
