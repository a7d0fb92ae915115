//! `hulltouch-bench sync`: how exactly `sync check` finds planted offsets, and what it makes of a turned camera.

mod film;
mod rows;

use std::path::PathBuf;
use std::time::Instant;

use calib::sync::{SyncError, SyncReport, check_sync};
use clap::Args;
use hull::rotation::matrix_from_rodrigues;
use hull::{Camera, Rig};
use nalgebra::Vector3;
use setup::cli::{ArgumentError, Failure, Outcome, check_json_writable, outln, parse_size};
use stage::{Motion, UnknownMotion, studio_rig};

use self::film::{Filmed, MOMENTS_PER_S};
use self::rows::{Errors, Row, TABLE};
use super::outputs::within;
use super::random::Random;
use super::table::{Machine, Table, write_json};

/// Errors of `sync check` on film of the studio with planted offsets.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch-bench sync --motion walk,wave,idle --turn 0,1 --runs 5 --json sync.json\n\n\
    Each run renders the studio with sensor noise, segments it as nodes do, and has other offsets and \
    another seed; with --turn one camera of the rig, another in each run, is turned in the file alone. \
    `said` is the check's own uncertainty; `error / said` is 1 if that is true.")]
pub struct SyncBenchArguments {
    /// What the person does.
    #[arg(long, value_name = "MOTION,…", default_value = "walk,idle", value_delimiter = ',', value_parser = parse_motion)]
    motion: Vec<Motion>,
    /// How far a camera is turned, degrees.
    #[arg(long, value_name = "DEG,…", default_value = "0", value_delimiter = ',', value_parser = parse_turn)]
    turn: Vec<f64>,
    /// Offsets are within plus and minus this, milliseconds.
    #[arg(long, value_name = "MS", default_value = "50", value_parser = parse_offset)]
    offset: f64,
    /// Cameras of the studio.
    #[arg(long, value_name = "N", default_value = "8", value_parser = parse_cameras)]
    cameras: usize,
    /// Image size of its cameras.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = parse_size)]
    size: (u32, u32),
    /// Frames a second.
    #[arg(long, value_name = "F", default_value = "30", value_parser = parse_fps)]
    fps: f64,
    /// Length of the film.
    #[arg(long, value_name = "S", default_value = "10", value_parser = parse_seconds)]
    seconds: f64,
    /// Runs of a row.
    #[arg(long, value_name = "N", default_value = "5", value_parser = parse_runs)]
    runs: usize,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn parse_motion(text: &str) -> Result<Motion, UnknownMotion> {
    text.parse()
}

fn parse_turn(text: &str) -> Result<f64, ArgumentError> {
    within(text, -10.0, 10.0)
}

fn parse_offset(text: &str) -> Result<f64, ArgumentError> {
    within(text, 0.0, 1000.0)
}

fn parse_cameras(text: &str) -> Result<usize, ArgumentError> {
    within(text, 2, 64)
}

fn parse_fps(text: &str) -> Result<f64, ArgumentError> {
    within(text, 5.0, 240.0)
}

fn parse_seconds(text: &str) -> Result<f64, ArgumentError> {
    within(text, 0.5, 60.0)
}

fn parse_runs(text: &str) -> Result<usize, ArgumentError> {
    within(text, 1, 1000)
}

/// Runs it.
pub fn run(arguments: &SyncBenchArguments) -> Outcome {
    if let Some(path) = &arguments.json {
        check_json_writable(path)?;
    }
    let rig = studio_rig(arguments.cameras, arguments.size).map_err(Failure::input)?;
    let machine = Machine::here();
    let mut rows = Vec::new();
    let mut measure = || {
        outln!("{}", machine.line())?;
        TABLE.print_titles()?;
        for &motion in &arguments.motion {
            for &turned_deg in &arguments.turn {
                let row = row(arguments, &rig, motion, turned_deg)?;
                TABLE.print(&row)?;
                rows.push(row);
            }
        }
        Ok(())
    };
    let measured = measure();
    // What was measured is written also where measuring failed.
    let written = write_json(&Table { bench: "sync", machine, rows }, arguments.json.as_deref());
    measured.and(written)
}

fn row(arguments: &SyncBenchArguments, rig: &Rig, motion: Motion, turned_deg: f64) -> Outcome<Row> {
    let mut row = Row { motion: motion.name(), turned_deg, runs: arguments.runs, ..Row::default() };
    let mut errors = Errors::default();
    let count = rig.cameras().len();
    for run in 0..arguments.runs {
        let seed = run as u64 + 1;
        let late_s = planted(arguments, seed);
        let (fps, seconds) = (arguments.fps, arguments.seconds);
        let films = Filmed { motion, seed, fps, seconds }.films(rig, &late_s)?;
        let turned = (turned_deg != 0.0).then_some(run % count);
        let used = with_turned(rig, turned, turned_deg)?;
        let began = Instant::now();
        let found = check_sync(&used, &films);
        row.check_s += began.elapsed().as_secs_f64() / arguments.runs as f64;
        match found {
            Ok(found) => {
                row.named_rightly += usize::from(turned.is_some() && found.moved == turned);
                row.named_wrongly += usize::from(found.moved.is_some() && found.moved != turned);
                add(&mut errors, &found, &late_s);
            }
            Err(SyncError::Still { .. } | SyncError::Uncertain { .. }) => row.refused += 1,
            Err(error) => return Err(Failure::run(error)),
        }
    }
    errors.fill(&mut row);
    Ok(row)
}

/// How late each camera is, seconds.
fn planted(arguments: &SyncBenchArguments, seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    let moments = arguments.offset * 1e-3 * MOMENTS_PER_S;
    (0..arguments.cameras).map(|_| (random.signed() * moments).round() / MOMENTS_PER_S).collect()
}

/// Only differences can be found: means are taken off.
fn add(errors: &mut Errors, found: &SyncReport, late_s: &[f64]) {
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / late_s.len() as f64;
    let common_s =
        mean(&mut found.cameras.iter().map(|camera| camera.late_s)) - mean(&mut late_s.iter().copied());
    for (camera, late_s) in found.cameras.iter().zip(late_s) {
        errors.add(camera.late_s - late_s - common_s, camera.uncertainty_s);
    }
}

/// The rig with one camera turned to the side, as if it had been bumped since.
fn with_turned(rig: &Rig, turned: Option<usize>, turned_deg: f64) -> Outcome<Rig> {
    let mut cameras = rig.cameras().to_vec();
    if let Some(camera) = turned.map(|at| &mut cameras[at]) {
        let turn = matrix_from_rodrigues(&Vector3::new(0.0, turned_deg.to_radians(), 0.0));
        let rotation = turn * camera.rotation();
        let translation_m = -(rotation * camera.centre_world().coords);
        let (size, lens) = ((camera.width(), camera.height()), camera.lens().coefficients());
        *camera =
            Camera::from_matrices(camera.name(), size, *camera.intrinsics(), lens, &rotation, translation_m)
                .map_err(Failure::run)?;
    }
    Rig::new(cameras).map_err(Failure::run)
}
