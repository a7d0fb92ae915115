//! `hulltouch rig check`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use calib::check::{CameraCheck, CheckReport, PreparedFrames};
use camera_node::source::MaskFiles;
use clap::Args;
use hull::{Rig, Silhouette};
use serde::Serialize;
use setup::cli::{Failure, Outcome, Progress, check_json_writable, out, outln, while_working, write_whole};

use crate::command::query::{masks, read_rig};

/// Says how well a rig fits silhouettes, and which camera, moved, would mend most.
///
/// Explained is the share of a camera's foreground pixels whose viewing ray meets the hull of all cameras.
/// The misfit is measured at the outlines, in pixels of an image 640 wide, squared.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch rig check --rig rig.toml --silhouettes masks\n\n\
    masks/NAME/*.png with numbers for names are the frames of the camera NAME, or masks/NAME.png is its \
    only one, of the rig's size (docs/film.md says what is a mask). Frames that some camera lacks are \
    left out.")]
pub struct CheckArguments {
    /// The rig: calibrated cameras.
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Where the silhouettes are.
    #[arg(long, value_name = "DIR")]
    silhouettes: PathBuf,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The figures' JSON form.
#[derive(Serialize)]
struct Figures<'a> {
    /// Frames looked at.
    frames: usize,
    /// Frames that some camera lacks.
    frames_left_out: usize,
    /// The camera that is out of its place, if one clearly is.
    moved: Option<&'a str>,
    /// The misfit as the rig stands.
    cost: f64,
    /// In rig order.
    cameras: &'a [CameraCheck],
}

/// The silhouettes of all frames that all cameras have, in rig order.
struct Film {
    frames: Vec<Vec<Silhouette>>,
    left_out: usize,
}

/// Runs it.
pub fn run(arguments: &CheckArguments) -> Outcome {
    let rig = read_rig(&arguments.rig)?;
    if let Some(path) = &arguments.json {
        check_json_writable(path)?;
    }
    let film = Film::read(&arguments.silhouettes, &rig)?;
    let report = while_working("checking", || PreparedFrames::new(&film.frames)?.check(&rig))
        .map_err(|error| Failure::unreadable(&arguments.silhouettes, error))?;
    for (index, camera) in rig.cameras().iter().enumerate() {
        masks::warn_if_uniform(&arguments.silhouettes, camera, film.frames.iter().map(|frame| &frame[index]));
    }
    if let Some(path) = &arguments.json {
        let figures = Figures {
            frames: film.frames.len(),
            frames_left_out: film.left_out,
            moved: report.moved.map(|index| report.cameras[index].camera.as_str()),
            cost: report.cost,
            cameras: &report.cameras,
        };
        let mut text = serde_json::to_vec_pretty(&figures).map_err(Failure::run)?;
        text.push(b'\n');
        write_whole(path, &text)?;
    }
    out!("{}", table(&report))?;
    let left_out = match film.left_out {
        0 => String::new(),
        count => format!(", {count} left out because a camera lacks them"),
    };
    outln!("{} frames{left_out}; misfit {:.3}", film.frames.len(), report.cost)?;
    outln!("{}", verdict(&report))
}

impl Film {
    fn read(folder: &Path, rig: &Rig) -> Outcome<Film> {
        let paths = masks::paths_of_film(folder, rig)?;
        let common = common_frames(&paths);
        let most = paths.iter().map(BTreeMap::len).max().unwrap_or(0);
        if common.is_empty() {
            let problem =
                "found no frame that all cameras of the rig have, expected NAME/NUMBER.png or NAME.png";
            return Err(Failure::unreadable(folder, problem));
        }
        let mut progress = Progress::new("reading silhouettes", common.len() as u64);
        let mut frames = Vec::new();
        let files: Vec<Vec<&Path>> =
            paths.iter().map(|paths| paths.values().map(PathBuf::as_path).collect()).collect();
        let mut films = MaskFiles::of_room(rig.cameras(), &files);
        for frame in &common {
            let cameras = films.iter_mut().zip(&paths);
            frames.push(
                cameras
                    .map(|(film, paths)| film.read(&paths[frame]).map_err(Failure::input))
                    .collect::<Outcome<Vec<_>>>()?,
            );
            progress.step();
        }
        Ok(Film { left_out: most - frames.len(), frames })
    }
}

/// The numbers that all cameras have.
fn common_frames(paths: &[BTreeMap<u64, PathBuf>]) -> Vec<u64> {
    let Some((first, others)) = paths.split_first() else { return Vec::new() };
    let has_all = |frame: &u64| others.iter().all(|paths| paths.contains_key(frame));
    first.keys().copied().filter(has_all).collect()
}

fn table(report: &CheckReport) -> String {
    let names = report.cameras.iter().map(|camera| camera.camera.chars().count());
    let width = names.max().unwrap_or(0).max("camera".len());
    let mut text = format!("{:width$}             if it alone were moved:\n", "");
    text +=
        &format!("{:width$}  explained  misfit  less  right  down, px    pan   tilt   roll, deg\n", "camera");
    for camera in &report.cameras {
        let refinement = &camera.refinement;
        let [right, down] = refinement.shift_px;
        text += &format!(
            "{:width$}  {:9.3}  {:6.3}  {:>4} {right:6.1}  {down:8.1} {:6.2} {:6.2}  {:10.2}\n",
            camera.camera,
            camera.explained,
            refinement.cost,
            share(report, camera),
            refinement.pan_deg,
            refinement.tilt_deg,
            refinement.roll_deg
        );
    }
    text
}

/// How much of the misfit a camera's correction takes away.
fn share(report: &CheckReport, camera: &CameraCheck) -> String {
    let share = if report.cost > 0.0 { 1.0 - camera.refinement.cost / report.cost } else { 0.0 };
    format!("{:.0} %", 100.0 * share.max(0.0))
}

fn verdict(report: &CheckReport) -> String {
    let named = report.moved.and_then(|index| report.cameras.get(index));
    if let Some(camera) = named {
        let refinement = &camera.refinement;
        let ([right, down], [x, y, z]) = (refinement.shift_px, refinement.move_m);
        return format!(
            "{} is out of its place: moved, it would mend most ({} less misfit). Its picture would move {right:.1} px \
             right and {down:.1} px down; the camera would turn {:.2}° right, {:.2}° up, {:.2}° clockwise and \
             move {x:.3} m right, {y:.3} m down, {z:.3} m ahead",
            camera.camera,
            share(report, camera),
            refinement.pan_deg,
            refinement.tilt_deg,
            refinement.roll_deg
        );
    }
    let best = report.cameras.iter().min_by(|a, b| a.refinement.cost.total_cmp(&b.refinement.cost));
    best.map_or_else(String::new, |camera| {
        format!(
            "no camera is clearly out of its place: moving {} would mend most ({} less misfit)",
            camera.camera,
            share(report, camera)
        )
    })
}
