//! `hulltouch-bench bandwidth`: bytes at the sockets of six layouts, and where each is the best.

mod charts;
mod hosted;
mod layout;
mod measure;
mod rows;
mod verdict;

use clap::Args;
use serde::Serialize;
use setup::cli::{ArgumentError, Outcome, Progress, outln, parse_size};

use self::measure::{measured, steps};
use self::rows::{Row, print_header, print_rows};
use self::verdict::CrossingRow;
use super::cluster::film::{FPS, FilmPlan};
use super::cluster::{parse_bodies, parse_nodes};
use super::outputs::{Outputs, within};
use super::table::{Machine, Table};

/// Frames of the film: each is gathered once.
const FRAMES: u64 = 2;
const BASE_CAMERAS: usize = 8;
const SIZES: [(u32, u32); 4] = [(640, 480), (1920, 1080), (3840, 2160), (7680, 4320)];
const NOISES: [f64; 3] = [0.0, 0.01, 0.05];
const CAMERAS: [usize; 5] = [4, 8, 16, 32, 64];
/// Where the number of cameras is varied.
const CAMERAS_SIZE: (u32, u32) = (1920, 1080);
const BODIES: [usize; 5] = [1, 10, 30, 100, 200];

/// Bytes of six layouts over real sockets, and which of them wins where.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch-bench bandwidth --size 3840x2160 --cameras 8 --bodies 10,30,100 --json bandwidth.json\n\n\
    Layouts: raw_images (a byte a pixel: colour is 1.5 to 3 times that), bit_masks, runs and runs_lz4 \
    gather every camera's silhouette once a frame of film, 30 a second; raw_points and registered_bodies \
    ask every camera with every pass, 120 a second. Bodies have 500 samples, about 5 % of them inside a \
    person. Noise is the share of pixels of the silhouettes that are inverted, each independently. Every \
    camera has a node of its own, all in this process, on loopback sockets; bytes are counted where the \
    coordinator reads and writes them, protocol and all. Without --size, --cameras and --noise all sizes \
    are measured with all noises and 8 cameras, and all numbers of cameras at 1920x1080; with any of \
    them every combination of what is given.")]
pub struct BandwidthBenchArguments {
    /// Image sizes.
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// Numbers of cameras.
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse_nodes)]
    cameras: Vec<usize>,
    /// Numbers of bodies [default: 1,10,30,100,200].
    #[arg(long, value_name = "B,…", value_delimiter = ',', value_parser = parse_bodies)]
    bodies: Vec<usize>,
    /// Shares of noise, 0 to 0.5.
    #[arg(long, value_name = "SHARE,…", value_delimiter = ',', value_parser = parse_noise)]
    noise: Vec<f64>,
    /// Passes of every figure.
    #[arg(long, value_name = "N", default_value = "8", value_parser = clap::value_parser!(u64).range(1..))]
    passes: u64,
    #[command(flatten)]
    outputs: Outputs,
}

/// All that goes into the JSON file.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    table: Table<Row>,
    crossings: Vec<CrossingRow>,
}

fn parse_noise(text: &str) -> Result<f64, ArgumentError> {
    within(text, 0.0, 0.5)
}

/// Runs it.
pub fn run(arguments: &BandwidthBenchArguments) -> Outcome {
    arguments.outputs.prepare()?;
    let machine = Machine::here();
    let mut counts = if arguments.bodies.is_empty() { BODIES.to_vec() } else { arguments.bodies.clone() };
    counts.sort_unstable();
    counts.dedup();
    let (mut all, mut rows) = (Vec::new(), Vec::new());
    let mut measure = || {
        outln!("{}; every camera's node in one process, film of {FPS} frames/s", machine.line())?;
        print_header()?;
        let plans = plans(arguments);
        let mut progress = Progress::new("measuring", plans.len() as u64 * steps(&counts));
        for plan in plans {
            let measured = measured(plan, &counts, arguments.passes, &mut || progress.step())?;
            print_rows(&measured)?;
            rows.extend(rows::of(&measured));
            all.push(measured);
        }
        drop(progress);
        verdict::print(&all)
    };
    let measured = measure();
    let table = Table { bench: "bandwidth", machine, rows };
    let report = Report { table, crossings: verdict::crossings(&all) };
    arguments.outputs.write(measured, &report, |folder| charts::draw(&all, folder))
}

/// Every combination of what is given; without anything given, sizes and noises together, and cameras.
fn plans(arguments: &BandwidthBenchArguments) -> Vec<FilmPlan> {
    let BandwidthBenchArguments { size, cameras, noise, .. } = arguments;
    let plan = |size, cameras, noise| FilmPlan {
        cameras,
        nodes: cameras,
        size,
        frames: FRAMES,
        noise,
        abstain: false,
    };
    let mut plans = Vec::new();
    let mut add = |sizes: &[(u32, u32)], cameras: &[usize], noises: &[f64]| {
        for &size in sizes {
            for &noise in noises {
                for &cameras in cameras {
                    let plan = plan(size, cameras, noise);
                    if !plans.contains(&plan) {
                        plans.push(plan);
                    }
                }
            }
        }
    };
    if size.is_empty() && cameras.is_empty() && noise.is_empty() {
        add(&SIZES, &[BASE_CAMERAS], &NOISES);
        add(&[CAMERAS_SIZE], &CAMERAS, &[0.0]);
    } else {
        let sizes: &[(u32, u32)] = if size.is_empty() { &[CAMERAS_SIZE] } else { size };
        let cameras: &[usize] = if cameras.is_empty() { &[BASE_CAMERAS] } else { cameras };
        add(sizes, cameras, if noise.is_empty() { &[0.0] } else { noise });
    }
    plans
}
