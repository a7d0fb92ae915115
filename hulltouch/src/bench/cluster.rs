//! `hulltouch bench cluster`: what a pass takes over real node processes of this machine.

pub mod asked;
pub mod bodies;
mod charts;
pub mod film;
mod model;
pub mod probing;
mod random;
mod rows;
pub mod usage;

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;

use self::asked::{Answered, Asked, Connected, PassCosts};
use self::bodies::{Bodies, SAMPLES};
use self::film::{Film, FilmPlan};
use self::model::model_of;
use self::rows::{Row, print_header, print_row, print_stages};
use self::usage::{process_cpu_s, process_memory_mb};
use super::plot;
use super::scale::report::{ScaleReport, report};
use super::table::{Machine, Table};
use crate::demo::parse_size;
use crate::failure::{Failure, Outcome, check_writable, write_whole};
use crate::local::{LocalCluster, Sockets};

/// Frames of the film: the ring of every node is full.
const FRAMES: u64 = camera_node::frames::RING_FRAMES as u64;
/// Fewer cameras would be another hull: they are spread over the nodes instead.
const LEAST_CAMERAS: usize = 8;
const BASE_NODES: usize = 8;
const BASE_BODIES: usize = 30;
const BASE_SIZE: (u32, u32) = (3840, 2160);
const NODES: [usize; 5] = [1, 2, 4, 8, 16];
const BODIES: [usize; 5] = [1, 10, 30, 100, 200];
const SIZES: [(u32, u32); 4] = [(640, 480), (1920, 1080), (3840, 2160), (7680, 4320)];

/// Time and bytes of a pass over node processes on this machine, and a model of larger clusters.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  hulltouch bench cluster --nodes 8 --bodies 30 --size 3840x2160 --json cluster.json

Each node is a process with a ring full of silhouettes; the coordinator is this process. Bodies of 500
samples stand against a person, about 5 % of the samples inside, and move a little with every pass.
Without --nodes, --bodies and --size each of them is varied about 8 nodes, 30 bodies, 3840x2160; with
any of them every combination of what is given is measured. Up to 8 nodes share 8 cameras; more have one
each. The tables of scale are a model that starts from the figures of this run.")]
pub struct ClusterBenchArguments {
    /// Numbers of node processes.
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse_nodes)]
    nodes: Vec<usize>,
    /// Numbers of bodies.
    #[arg(long, value_name = "B,…", value_delimiter = ',', value_parser = parse_bodies)]
    bodies: Vec<usize>,
    /// Image sizes of the cameras.
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// Over which sockets nodes are asked.
    #[arg(long, value_name = "KIND,…", value_delimiter = ',', default_value = "unix")]
    sockets: Vec<SocketName>,
    /// Passes of every figure.
    #[arg(long, value_name = "N", default_value = "400", value_parser = clap::value_parser!(u64).range(1..))]
    passes: u64,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Draw charts into a folder.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

/// Sockets by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SocketName {
    Tcp,
    Unix,
}

impl SocketName {
    fn name(self) -> &'static str {
        match self {
            SocketName::Tcp => "tcp",
            SocketName::Unix => "unix",
        }
    }

    fn sockets(self) -> Sockets {
        match self {
            SocketName::Tcp => Sockets::Tcp,
            SocketName::Unix => Sockets::Unix,
        }
    }
}

/// What is measured once nodes run.
struct Setting {
    nodes: usize,
    size: (u32, u32),
    bodies: Vec<usize>,
}

/// A film and bodies in it.
struct Scene {
    film: Film,
    bodies: Bodies,
}

/// All that goes into the JSON file.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    table: Table<Row>,
    scale: Option<ScaleReport>,
}

/// A whole number from 1 to 64.
pub fn parse_nodes(text: &str) -> Result<usize, String> {
    within(text, 64)
}

/// A whole number from 1 to 1000.
pub fn parse_bodies(text: &str) -> Result<usize, String> {
    within(text, 1000)
}

fn within(text: &str, most: usize) -> Result<usize, String> {
    let wrong = || format!("found {text:?}, expected 1 to {most}");
    text.parse().ok().filter(|count| (1..=most).contains(count)).ok_or_else(wrong)
}

/// Runs it.
#[allow(clippy::print_stdout, reason = "the table is the command's output")]
pub fn run(arguments: &ClusterBenchArguments) -> Outcome {
    if let Some(path) = &arguments.json {
        check_writable("--json", path)?;
    }
    if let Some(folder) = &arguments.plot {
        plot::make_folder(folder)?;
    }
    let machine = Machine::here();
    println!("{}; nodes and coordinator share its cores", machine.line());
    println!("bodies of {SAMPLES} samples, {} passes each, milliseconds", arguments.passes);
    print_header();
    let mut rows = Vec::new();
    let mut scene: Option<Scene> = None;
    for setting in settings(arguments) {
        let scene = Scene::prepared(&mut scene, &setting)?;
        for &sockets in &arguments.sockets {
            let measured = measured(scene, &setting, sockets, arguments.passes)?;
            measured.iter().for_each(print_row);
            rows.extend(measured);
        }
    }
    print_stages(&rows);
    let scale = model_of(&rows).map(|measured| report(&measured, cores()));
    if let Some(scale) = &scale {
        scale.print();
    }
    if let Some(folder) = &arguments.plot {
        charts::draw(&rows, folder)?;
    }
    let report = Report { table: Table { bench: "cluster", machine, rows }, scale };
    let Some(path) = &arguments.json else { return Ok(()) };
    let mut text = serde_json::to_vec_pretty(&report).map_err(Failure::run)?;
    text.push(b'\n');
    write_whole(path, &text)
}

/// Every combination of what is given; without anything given, the base with one thing varied at a time.
fn settings(arguments: &ClusterBenchArguments) -> Vec<Setting> {
    let ClusterBenchArguments { nodes, bodies, size, .. } = arguments;
    if nodes.is_empty() && bodies.is_empty() && size.is_empty() {
        let one = |nodes, size| Setting { nodes, size, bodies: vec![BASE_BODIES] };
        let sizes = SIZES.into_iter().filter(|&size| size != BASE_SIZE).map(|size| one(BASE_NODES, size));
        let spread = NODES.into_iter().map(|nodes| match nodes {
            BASE_NODES => Setting { nodes, size: BASE_SIZE, bodies: BODIES.to_vec() },
            other => one(other, BASE_SIZE),
        });
        return sizes.chain(spread).collect();
    }
    let or_base = |given: &Vec<usize>, base| if given.is_empty() { vec![base] } else { given.clone() };
    let (nodes, bodies) = (or_base(nodes, BASE_NODES), or_base(bodies, BASE_BODIES));
    let sizes = if size.is_empty() { vec![BASE_SIZE] } else { size.clone() };
    let of_size = |&size: &(u32, u32)| {
        let nodes = nodes.iter();
        nodes.map(|&nodes| Setting { nodes, size, bodies: bodies.clone() }).collect::<Vec<_>>()
    };
    sizes.iter().flat_map(of_size).collect()
}

impl Scene {
    /// The scene of a setting: the one before if it has the same cameras, for filming takes long.
    fn prepared<'a>(before: &'a mut Option<Scene>, setting: &Setting) -> Outcome<&'a Scene> {
        let cameras = setting.nodes.max(LEAST_CAMERAS);
        let plan = FilmPlan { cameras, nodes: setting.nodes, size: setting.size, frames: FRAMES, noise: 0.0 };
        let most = setting.bodies.iter().copied().max().unwrap_or_default();
        let mut scene = match before.take() {
            Some(scene) if (FilmPlan { nodes: plan.nodes, ..scene.film.plan }) == plan => scene,
            _ => Scene { film: Film::make(plan)?, bodies: Bodies::default() },
        };
        scene.film.spread_over(plan.nodes)?;
        if scene.bodies.len() < most {
            scene.bodies = Bodies::place(most, &scene.film.views(), &scene.film.person_world)?;
        }
        Ok(before.insert(scene))
    }
}

/// The rows of one cluster.
fn measured(
    Scene { film, bodies }: &Scene,
    setting: &Setting,
    sockets: SocketName,
    passes: u64,
) -> Outcome<Vec<Row>> {
    let cluster = LocalCluster::start_over(sockets.sockets(), &film.file, false)?;
    let mut connected = Connected::to(film, cluster.nodes().to_vec(), bodies, Answered::ByNodes)?;
    let mut rows = Vec::new();
    for &count in &setting.bodies {
        let before = cpu_s(&cluster);
        let costs = connected.passes(&bodies.first(count), Asked::Registered, passes)?;
        let node_cpu_ms = cpu_s(&cluster).zip(before).map(|(after, before)| {
            (after - before) * 1e3 / (costs.passes_with_warm_up() * setting.nodes as u64) as f64
        });
        let memory_mb = memory_mb(&cluster);
        rows.push(Row { sockets: sockets.name(), ..row(film, count, &costs, node_cpu_ms, memory_mb) });
    }
    Ok(rows)
}

fn row(
    film: &Film,
    bodies: usize,
    costs: &PassCosts,
    node_cpu_ms: Option<f64>,
    memory_mb: Option<(f64, f64)>,
) -> Row {
    let FilmPlan { cameras, nodes, size, .. } = film.plan;
    let (to_nodes, from_nodes) = costs.bytes_per_node_pass(nodes);
    let ms = |share| costs.pass_ms.at(share).unwrap_or_default();
    Row {
        nodes,
        cameras,
        bodies,
        samples: bodies * SAMPLES,
        width: size.0,
        height: size.1,
        precision: "exact",
        sockets: "",
        passes: costs.passes,
        p50_ms: ms(0.5),
        p99_ms: ms(0.99),
        max_ms: costs.pass_ms.max().unwrap_or_default(),
        bytes_per_node_pass: to_nodes + from_nodes,
        bytes_to_node_pass: to_nodes,
        bytes_from_node_pass: from_nodes,
        inside_share: costs.inside_share,
        node_cpu_ms,
        coordinator_cpu_ms: costs.coordinator_cpu_ms,
        node_rss_mb: memory_mb.map(|(now_mb, _)| now_mb),
        node_peak_rss_mb: memory_mb.map(|(_, most_mb)| most_mb),
        stages: rows::stages(&costs.stages),
    }
}

/// Processor time of all nodes so far.
fn cpu_s(cluster: &LocalCluster) -> Option<f64> {
    cluster.process_ids().map(process_cpu_s).sum()
}

/// The largest node's memory, now and at most.
fn memory_mb(cluster: &LocalCluster) -> Option<(f64, f64)> {
    let told = cluster.process_ids().filter_map(process_memory_mb);
    told.reduce(|a, b| (a.0.max(b.0), a.1.max(b.1)))
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_the_command_line_are_bounded() {
        assert_eq!(parse_nodes("16"), Ok(16));
        assert!(parse_nodes("0").is_err() && parse_nodes("65").is_err() && parse_bodies("x").is_err());
    }
}
