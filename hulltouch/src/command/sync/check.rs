//! `hulltouch sync check`.

use std::path::{Path, PathBuf};

use calib::sync::{SyncReport, check_sync};
use clap::Args;
use setup::cli::{Failure, Outcome, check_json_writable, check_writable, out, while_working, write_whole};
use setup::{ClusterFile, LatencyChange};

use super::film::{Film, FilmSource};
use super::report;
use crate::command::query::masks::warn_if_uniform;
use crate::command::query::read_rig;
use crate::run::run_setup::checked_seconds;
use crate::run::security::SecurityArguments;

/// Says how late each camera is against the others, from film of a person who moves.
///
/// Let one person walk about for ten seconds where all cameras see them. Times come with one standard
/// deviation. A camera that is out of its place is told from one that is late: both are fitted.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples:\n  \
    hulltouch sync check studio.cluster.toml --certs /etc/hulltouch/certs --write\n  \
    hulltouch sync check --recording run.mcap\n  \
    hulltouch sync check --rig rig.toml --silhouettes masks --fps 30\n\n\
    A cluster file is filmed for --seconds: by its nodes, if it names where they are, else on this \
    machine. masks/NAME/*.png with numbers for names are the frames of the camera NAME, of the rig's \
    size (docs/film.md says what is a mask).")]
pub struct SyncCheckArguments {
    /// The cluster file: what to film, unless there is film, and what --write changes.
    #[arg(value_name = "CLUSTER.toml", required_unless_present_any = ["recording", "silhouettes"])]
    cluster: Option<PathBuf>,
    /// Film from a recorded run.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["silhouettes", "rig", "fps"])]
    recording: Option<PathBuf>,
    /// Film as a folder of silhouettes.
    #[arg(long, value_name = "DIR")]
    silhouettes: Option<PathBuf>,
    /// The calibrated cameras of the silhouettes [default: the cluster file's].
    #[arg(long, value_name = "FILE", requires = "silhouettes", required_unless_present_any = ["cluster", "recording"])]
    rig: Option<PathBuf>,
    /// Silhouettes a second [default: the cluster file's].
    #[arg(long, value_name = "F", requires = "silhouettes", required_unless_present_any = ["cluster", "recording"])]
    fps: Option<f64>,
    /// How much is filmed.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds: f64,
    /// How long to wait for nodes at the beginning, seconds.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    patience: f64,
    #[command(flatten)]
    security: SecurityArguments,
    /// Displace another coordinator that leads the nodes.
    #[arg(long)]
    take_over: bool,
    /// Change `latency_s` in the cluster file, of cameras that are late or early. All else in it stays.
    #[arg(long, requires = "cluster")]
    write: bool,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs it.
pub fn run(arguments: &SyncCheckArguments) -> Outcome {
    let cluster = arguments.cluster.as_deref().map(ClusterFile::open).transpose()?;
    if let Some(path) = &arguments.json {
        check_json_writable(path)?;
    }
    let to_write = cluster.as_ref().filter(|_| arguments.write);
    if let Some(cluster) = to_write {
        // Whether there is anything to change is known before anything is filmed.
        cluster.change_latencies(|_| 0.0)?;
        check_writable("--write", &cluster.path)?;
    }
    let source = source(arguments, cluster.as_ref())?;
    let film = source.film()?;
    let found = while_working("comparing times", || check_sync(&film.rig, &film.cameras));
    let found = found.map_err(|error| Failure::input(format_args!("{}: {error}", source.name())))?;
    for (camera, frames) in film.rig.cameras().iter().zip(&film.cameras) {
        warn_if_uniform(Path::new(&source.name()), camera, frames.iter().map(|frame| &frame.silhouette));
    }
    if let Some(path) = &arguments.json {
        let mut text = serde_json::to_vec_pretty(&report::figures(&found, &film)).map_err(Failure::run)?;
        text.push(b'\n');
        write_whole(path, &text)?;
    }
    let written = to_write.map(|cluster| written(cluster, &found, &film)).transpose()?.unwrap_or_default();
    out!(
        "{}{}\n{}\n{written}",
        report::table(&found),
        report::summary(&found, &film),
        report::verdict(&found)
    )
}

fn source<'a>(
    arguments: &'a SyncCheckArguments,
    cluster: Option<&'a ClusterFile>,
) -> Outcome<FilmSource<'a>> {
    if let Some(path) = &arguments.recording {
        return Ok(FilmSource::Recording(path));
    }
    if let Some(folder) = &arguments.silhouettes {
        let rig = match (&arguments.rig, cluster) {
            (Some(path), _) => read_rig(path)?,
            (None, Some(cluster)) => cluster.rig.clone(),
            (None, None) => return Err(Failure::input("found neither --rig nor a cluster file")),
        };
        let fps = arguments.fps.or(cluster.map(|cluster| cluster.fps)).unwrap_or(0.0);
        if !(0.01..=1000.0).contains(&fps) {
            return Err(Failure::input(format_args!("--fps is {fps}, expected 0.01 to 1000")));
        }
        return Ok(FilmSource::Silhouettes { folder, rig, fps });
    }
    let cluster = cluster.ok_or_else(|| Failure::input("found no cluster file and no film"))?;
    let patience = std::time::Duration::try_from_secs_f64(arguments.patience)
        .map_err(|error| Failure::input(format_args!("--patience {}: {error}", arguments.patience)))?;
    let seconds = checked_seconds(Some(arguments.seconds))?.unwrap_or_default();
    Ok(FilmSource::Cluster {
        cluster,
        security: &arguments.security,
        seconds,
        patience,
        take_over: arguments.take_over,
    })
}

/// Writes the cluster file; what was changed, a line a camera.
fn written(cluster: &ClusterFile, found: &SyncReport, film: &Film) -> Outcome<String> {
    let late_s = |name: &str| {
        let camera = film.rig.index_of(name).and_then(|at| found.cameras.get(at));
        camera.filter(|camera| report::is_late(camera)).map_or(0.0, |camera| camera.late_s)
    };
    let (text, changes) = cluster.change_latencies(late_s)?;
    write_whole(&cluster.path, text.as_bytes())?;
    let line = |change: &LatencyChange| {
        format!("{}: latency_s {:.4} becomes {:.4}\n", change.camera, change.from_s, change.to_s)
    };
    Ok(changes.iter().filter(|change| change.from_s != change.to_s).map(line).collect())
}
