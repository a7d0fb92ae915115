//! `hulltouch bench query`: points per second of one core.

use std::hint::black_box;
use std::path::PathBuf;

use clap::Args;
use hull::oracle::literal;
use hull::probe::classify::Block;
use hull::question::Points;
use hull::response::body_direction;
use hull::view_set::Scratch;
use nalgebra::{Point3, Vector3};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use super::loads::{BODY_POINTS, CAMERAS, Random, Studio};
use super::table::{Machine, Table};
use crate::demo::parse_size;
use crate::failure::{Outcome, check_writable};
use crate::rig::progress::Progress;

/// Points of the inside test.
const BOX_POINTS: usize = 1 << 18;
/// Points of the inside test done literally.
const LITERAL_BOX_POINTS: usize = 1 << 13;
/// Points of a full pass.
const PASS_POINTS: usize = 64 * BODY_POINTS;
/// Every how many-th body takes part in a full pass done literally.
const LITERAL_BODY_STEP: usize = 8;
/// A figure is the median of so many repetitions,
const REPETITIONS: usize = 7;
/// each at least so long, seconds of processor time.
const REPETITION_S: f64 = 0.15;
/// Figures of one size: three loads by two engines.
const ROWS_PER_SIZE: u64 = 6;

/// Points per second of one core: the inside test alone, and full passes.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  hulltouch bench query --size 640x480,1920x1080 --json query.json

Loads: `inside` is the inside test alone, on random points in the box of a person of the stage,
most of them outside; `contacts` are full passes over points 1 to 3 cm inside, `anywhere` over
points uniformly inside, both in bodies of 64 neighbours. Engines: `hulltouch`, and `literal`, the
paper's text done literally on masks of a byte a pixel.")]
pub struct QueryBenchArguments {
    /// Image sizes of the eight cameras.
    #[arg(long, value_name = "WxH,…", default_value = "1920x1080", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One figure.
#[derive(Debug, Serialize)]
struct Row {
    size: String,
    load: &'static str,
    engine: &'static str,
    points_per_s: f64,
}

/// Runs it.
#[allow(clippy::print_stdout, reason = "the table is the command's output")]
pub fn run(arguments: &QueryBenchArguments) -> Outcome {
    if let Some(path) = &arguments.json {
        check_writable("--json", path)?;
    }
    let machine = Machine::here();
    println!("{}; one core, {CAMERAS} cameras, million points per second", machine.line());
    println!("{:>11}  {:8}  {:>10}  {:>10}  ratio", "size", "load", "hulltouch", "literal");
    let mut rows = Vec::new();
    for &size in &arguments.size {
        let measured = measured(size)?;
        for pair in measured.chunks_exact(2) {
            let (ours, literal) = (&pair[0], &pair[1]);
            println!(
                "{:>11}  {:8}  {:10.4}  {:10.4}  {:5.0}",
                ours.size,
                ours.load,
                ours.points_per_s / 1e6,
                literal.points_per_s / 1e6,
                ours.points_per_s / literal.points_per_s
            );
        }
        rows.extend(measured);
    }
    Table { bench: "query", machine, rows }.write(arguments.json.as_deref())
}

/// The figures of one size, each load by ours and then literally.
fn measured(size: (u32, u32)) -> Outcome<Vec<Row>> {
    let studio = Studio::new(size)?;
    let mut random = Random(1);
    let in_box = world(&studio.in_box(&mut random, BOX_POINTS));
    let contacts = studio.bodies(studio.inside(&mut random, PASS_POINTS, true)?);
    let anywhere = studio.bodies(studio.inside(&mut random, PASS_POINTS, false)?);
    let mut progress = Progress::new("measuring", ROWS_PER_SIZE);
    let mut rows = Vec::new();
    let mut row = |load, engine, points_per_s| {
        rows.push(Row { size: format!("{}x{}", size.0, size.1), load, engine, points_per_s });
        progress.step();
    };
    row("inside", "hulltouch", inside_rate(&studio, &in_box));
    row("inside", "literal", literal_inside_rate(&studio, &in_box[..LITERAL_BOX_POINTS]));
    for (load, bodies) in [("contacts", &contacts), ("anywhere", &anywhere)] {
        row(load, "hulltouch", pass_rate(&studio, bodies)?);
        row(load, "literal", literal_pass_rate(&studio, bodies));
    }
    Ok(rows)
}

fn world(points_m: &[[f64; 3]]) -> Vec<Point3<f64>> {
    points_m.iter().map(|&point| Point3::from(point)).collect()
}

fn inside_rate(studio: &Studio, points_world: &[Point3<f64>]) -> f64 {
    let (mut block, mut standings) = (Block::default(), Vec::new());
    points_per_s(points_world.len(), || {
        standings.clear();
        studio.views.standings(black_box(points_world), &mut block, &mut standings);
        black_box(&standings);
    })
}

fn literal_inside_rate(studio: &Studio, points_world: &[Point3<f64>]) -> f64 {
    points_per_s(points_world.len(), || {
        let inside = |point: &&Point3<f64>| literal::is_inside(&studio.dense, point);
        black_box(black_box(points_world).iter().filter(inside).count());
    })
}

fn pass_rate(studio: &Studio, bodies: &[Points]) -> Outcome<f64> {
    let mut scratch = Scratch::default();
    let results = studio.pass(bodies.to_vec(), &mut scratch)?;
    let inside = results.iter().map(|body| body.touches.len()).sum();
    Ok(points_per_s(inside, || {
        // It went well a moment ago.
        let _ = black_box(studio.pass(black_box(bodies.to_vec()), &mut scratch));
    }))
}

/// Some of the bodies: the response of every point, and the exits along their mean.
fn literal_pass_rate(studio: &Studio, bodies: &[Points]) -> f64 {
    let world_points = |body: &Points| match body {
        Points::World(points_m) => world(points_m),
        Points::Body { .. } => Vec::new(),
    };
    let bodies: Vec<_> = bodies.iter().step_by(LITERAL_BODY_STEP).map(world_points).collect();
    let count = bodies.iter().map(Vec::len).sum();
    points_per_s(count, || {
        for points_world in &bodies {
            literal_body(studio, black_box(points_world));
        }
    })
}

fn literal_body(studio: &Studio, points_world: &[Point3<f64>]) {
    let camera = &studio.dense[0].camera;
    let window = studio.settings.normal_window().half_side_pixels(camera.width(), camera.height()) as i32;
    let depth_m = studio.settings.max_depth_m();
    let responses: Vec<[f64; 3]> = points_world
        .iter()
        .filter_map(|point| literal::response(&studio.dense, point, window, depth_m))
        .map(<[f64; 3]>::from)
        .collect();
    let Some(direction) = body_direction(&responses) else { return };
    let direction = Vector3::from(direction.map(f64::from));
    for point in points_world {
        black_box(literal::exit_along(&studio.dense, point, &direction, depth_m));
    }
}

/// The median rate of a piece of work on so many points, per second that the processor gave this thread:
/// other programs take turns with it, but do not count.
fn points_per_s(points: usize, mut work: impl FnMut()) -> f64 {
    work();
    let mut rates: Vec<f64> = (0..REPETITIONS)
        .map(|_| {
            let (began_s, mut rounds) = (thread_time_s(), 0usize);
            loop {
                work();
                rounds += 1;
                let took_s = thread_time_s() - began_s;
                if took_s >= REPETITION_S {
                    return (rounds * points) as f64 / took_s;
                }
            }
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    rates[REPETITIONS / 2]
}

fn thread_time_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
