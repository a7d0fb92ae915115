//! Ten seconds of silhouettes: from a folder, from a recorded run, or filmed now.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use calib::sync::TimedSilhouette;
use camera_node::source::{MaskFiles, usual_distance};
use coordinator::{AskEvery, MemoryUse};
use hull::{Camera, Rig};
use node_client::{Role, Sockets};
use proto::convert::{SilhouetteEncoding, silhouette_from_data};
use recording::{RecordedPicture, Recording};
use setup::ClusterFile;
use setup::cli::{Failure, Outcome, Progress, temporary_folder};
use sim::{Scene, WorldSettings};

use crate::command::query::masks;
use crate::run::options::{Outlets, RecordTo};
use crate::run::run_setup::{Setup, TransportName};
use crate::run::security::SecurityArguments;
use crate::run::{run_deployed, run_locally};

/// Where film comes from.
pub enum FilmSource<'a> {
    /// A folder of numbered silhouettes.
    Silhouettes { folder: &'a Path, rig: Rig, fps: f64 },
    /// A recorded run.
    Recording(&'a Path),
    /// The running cameras of a room.
    Cluster {
        cluster: &'a ClusterFile,
        security: &'a SecurityArguments,
        seconds: f64,
        patience: Duration,
        take_over: bool,
    },
}

/// Silhouettes and their times.
pub struct Film {
    pub rig: Rig,
    /// In rig order.
    pub cameras: Vec<Vec<TimedSilhouette>>,
}

impl FilmSource<'_> {
    /// The file or folder.
    pub fn name(&self) -> String {
        let path: &Path = match self {
            FilmSource::Silhouettes { folder, .. } => folder,
            FilmSource::Recording(path) => path,
            FilmSource::Cluster { cluster, .. } => &cluster.path,
        };
        path.display().to_string()
    }

    /// Reads or films it.
    pub fn film(&self) -> Outcome<Film> {
        match self {
            FilmSource::Silhouettes { folder, rig, fps } => of_folder(folder, rig, *fps),
            FilmSource::Recording(path) => of_recording(path),
            FilmSource::Cluster { cluster, security, seconds, patience, take_over } => {
                let folder = temporary_folder()?;
                let path = folder.path().join("sync.mcap");
                let is_deployed = cluster.is_deployed();
                let dial =
                    if is_deployed { security.sockets(cluster)? } else { Arc::new(Sockets::default()) };
                let setup = Setup { dial, ..setup(cluster, *seconds, *take_over, &path)? };
                if is_deployed {
                    run_deployed(&setup, *patience)?;
                } else {
                    run_locally(&setup)?;
                }
                of_recording(&path)
            }
        }
    }
}

fn of_folder(folder: &Path, rig: &Rig, fps: f64) -> Outcome<Film> {
    let paths = masks::paths_of_film(folder, rig)?;
    let count: usize = paths.iter().map(BTreeMap::len).sum();
    for (camera, paths) in rig.cameras().iter().zip(&paths) {
        check_numbers(folder, camera, paths, fps)?;
    }
    let mut progress = Progress::new("reading silhouettes", count as u64);
    let mut cameras = Vec::new();
    let files: Vec<Vec<&Path>> =
        paths.iter().map(|paths| paths.values().map(PathBuf::as_path).collect()).collect();
    let mut films = MaskFiles::of_room(rig.cameras(), &files);
    for (film, paths) in films.iter_mut().zip(&paths) {
        let mut frames = Vec::new();
        for (&number, path) in paths {
            let silhouette = film.read(path).map_err(Failure::input)?;
            frames.push(TimedSilhouette { time_s: number as f64 / fps, silhouette });
            progress.step();
        }
        cameras.push(frames);
    }
    Ok(Film { rig: rig.clone(), cameras })
}

/// Refuses numbers that are no frames at this rate. Where film begins is all the same.
fn check_numbers(folder: &Path, camera: &Camera, paths: &BTreeMap<u64, PathBuf>, fps: f64) -> Outcome {
    let numbers: Vec<u64> = paths.keys().copied().collect();
    let apart = usual_distance(&numbers);
    let apart_s = apart as f64 / fps;
    if apart == 1 || apart_s <= 1.0 {
        return Ok(());
    }
    let problem = format_args!(
        "image numbers are usually {apart} apart, which is {apart_s:.1} s at {fps} frames/s; expected numbers of \
         frames (if they are milliseconds: --fps 1000)"
    );
    Err(Failure::unreadable(&folder.join(camera.name()), problem))
}

/// A recorded live run knows when each frame was captured; a film goes by its numbers.
fn of_recording(path: &Path) -> Outcome<Film> {
    let recording = Recording::open(path).map_err(Failure::input)?;
    let (header, pictures) = (recording.header(), recording.pictures().map_err(Failure::input)?);
    let rig = header.rig.clone();
    let mut cameras: Vec<Vec<TimedSilhouette>> = vec![Vec::new(); rig.cameras().len()];
    for number in recording.frame_numbers() {
        let Some(frame) = pictures.frame(number).map_err(Failure::input)? else { continue };
        for RecordedPicture { camera: at, runs, captured_unix_s, .. } in frame {
            let at = usize::from(at);
            let camera = &rig.cameras()[at];
            let silhouette =
                silhouette_from_data(&runs, (camera.width(), camera.height()), SilhouetteEncoding::Runs)
                    .map_err(|error| Failure::unreadable(path, error))?;
            let time_s = match header.lock_step {
                true => number as f64 / header.fps,
                false => captured_unix_s - header.began_unix_s,
            };
            cameras[at].push(TimedSilhouette { time_s, silhouette });
        }
    }
    Ok(Film { rig, cameras })
}

/// A run in an empty world, recorded.
fn setup(cluster: &ClusterFile, seconds: f64, take_over: bool, path: &Path) -> Outcome<Setup> {
    let is_live = cluster.cameras.iter().any(|camera| camera.source.is_live());
    let mut file = cluster.clone();
    file.hold_s = 0.0;
    Ok(Setup {
        file,
        scene: Scene::from_toml("empty", "").map_err(Failure::run)?,
        world: WorldSettings::default(),
        transport: TransportName::Cluster,
        asks: AskEvery::default(),
        lock_step: !is_live,
        role: if take_over { Role::TakesOver } else { Role::Leads },
        dial: Arc::new(Sockets::default()),
        empty: false,
        seconds: Some(seconds),
        outlets: Outlets { live_line: true, silent: true, ..Outlets::default() },
        record: Some(RecordTo::checked(path.to_owned(), false, false)?),
        memory: MemoryUse::Off,
    })
}
