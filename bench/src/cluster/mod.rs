//! `hulltouch-bench cluster`: what a pass takes over real node processes of this machine.

pub mod bodies;
mod certificates;
mod charts;
pub mod connection;
pub mod film;
mod limits;
mod measure;
mod model;
pub mod names;
mod rows;

use clap::Args;
use proto::convert::Precision;
use serde::Serialize;
use setup::cli::{ArgumentError, Outcome, PRECISIONS, RESPONSES, named, outln, parse_size};
use sim::ResponseMode;

use self::bodies::SAMPLES;
use self::limits::Limits;
use self::measure::{Scene, Setting, measured};
use self::model::model_of;
use self::names::SocketName;
use self::rows::{Row, TABLE, print_stages};
use super::outputs::{Outputs, within};
use super::scale::report::{ScaleReport, report};
use super::table::{Machine, Table};

const BASE_NODES: usize = 8;
const BASE_BODIES: usize = 30;
const BASE_SIZE: (u32, u32) = (3840, 2160);
const NODES: [usize; 5] = [1, 2, 4, 8, 16];
const BODIES: [usize; 5] = [1, 10, 30, 100, 200];
const SIZES: [(u32, u32); 4] = [(640, 480), (1920, 1080), (3840, 2160), (7680, 4320)];

/// Time and bytes of a pass over node processes on this machine, and a model of larger clusters.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch-bench cluster --nodes 8 --bodies 30 --size 3840x2160 --json cluster.json\n\n  \
    hulltouch-bench cluster --nodes 8 --bodies 200 --samples 300 --size 640x480 --response contacts\n\n\
    Each node is a process with a ring full of silhouettes; the coordinator is this process. Bodies of \
    500 samples stand against a person, about 5 % of the samples inside, and move a little with every \
    pass. A pass is the paper's (classes, edges, exits, exits along the mean, a check) or one for \
    contacts: classes of every sample and of its offset sample a centimetre out, planes of those inside, \
    how they moved since the frame before, and, of bodies that no plane faces, the exits against their faces \
    (exits) and the planes there (check). Four passes share a frame; the first of them asks for planes \
    of 192 points around every body too. Without --nodes, --bodies and --size each of them is varied \
    about 8 nodes, 30 bodies, 3840x2160; with any of them every combination of what is given is \
    measured. Up to 8 nodes share 8 cameras; more have one each, or as many as --node-cameras says. The \
    tables of scale are a model that starts from the figures of this run, of the response and the \
    precision that are named first. Of several numbers of nodes the largest is printed beside what the \
    model makes of the others.\n\n\
    After the passes as many more are made, each followed by its own messages with nothing in them: the \
    column pass/empty compares their medians. Of the coordinator's processor time the table tells all \
    threads together, and per node these and the busiest.\n\n  \
    hulltouch-bench cluster --nodes 4,8,16,32 --node-cameras 8 --size 160x120 --abstain")]
pub struct ClusterBenchArguments {
    /// Numbers of node processes.
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse_nodes)]
    nodes: Vec<usize>,
    /// Cameras of every node.
    #[arg(long, value_name = "K", value_parser = parse_nodes)]
    node_cameras: Option<usize>,
    /// Cameras abstain about what they do not see.
    #[arg(long)]
    abstain: bool,
    /// Threads of the coordinator that serve connections; 0: the one that makes passes does. Otherwise as many as
    /// runs have.
    #[arg(long, value_name = "T", value_parser = parse_threads)]
    threads: Option<usize>,
    /// Numbers of bodies.
    #[arg(long, value_name = "B,…", value_delimiter = ',', value_parser = parse_bodies)]
    bodies: Vec<usize>,
    /// Image sizes of the cameras.
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// Samples of each body.
    #[arg(long, value_name = "S", default_value_t = SAMPLES, value_parser = parse_samples)]
    samples: usize,
    /// How bodies answer the hull.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = named(RESPONSES), default_value = "paper,contacts")]
    response: Vec<ResponseMode>,
    /// Encodings of numbers on the wire.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',', value_parser = named(PRECISIONS), default_value = "exact,quantised")]
    precision: Vec<Precision>,
    /// Over which sockets nodes are asked.
    #[arg(long, value_name = "KIND,…", value_delimiter = ',', default_value = "unix")]
    sockets: Vec<SocketName>,
    /// Passes of every figure.
    #[arg(long, value_name = "N", default_value = "400", value_parser = clap::value_parser!(u64).range(1..))]
    passes: u64,
    #[command(flatten)]
    outputs: Outputs,
}

/// All that goes into the JSON file.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    table: Table<Row>,
    scale: Option<ScaleReport>,
    limits: Option<Limits>,
}

/// A whole number from 1 to 64.
pub fn parse_nodes(text: &str) -> Result<usize, ArgumentError> {
    within(text, 1, 64)
}

/// A whole number from 1 to 1000.
pub fn parse_bodies(text: &str) -> Result<usize, ArgumentError> {
    within(text, 1, 1000)
}

/// A whole number from 0 to 64.
fn parse_threads(text: &str) -> Result<usize, ArgumentError> {
    within(text, 0, 64)
}

/// A whole number from 20 to 5000.
fn parse_samples(text: &str) -> Result<usize, ArgumentError> {
    within(text, 20, 5000)
}

/// Runs it.
pub fn run(arguments: &ClusterBenchArguments) -> Outcome {
    arguments.outputs.prepare()?;
    let machine = Machine::here();
    let mut rows = Vec::new();
    let mut measure = || {
        outln!("{}; nodes and coordinator share its cores", machine.line())?;
        outln!("bodies of {} samples, {} passes each, milliseconds", arguments.samples, arguments.passes)?;
        TABLE.print_titles()?;
        let mut scene: Option<Scene> = None;
        for setting in settings(arguments) {
            let scene = Scene::prepared(&mut scene, &setting)?;
            for &sockets in &arguments.sockets {
                let measured = measured(scene, &setting, sockets, arguments.passes)?;
                measured.iter().try_for_each(|row| TABLE.print(row))?;
                rows.extend(measured);
            }
        }
        Ok(())
    };
    let measured = measure();
    let scale = model_of(&rows.iter().collect::<Vec<_>>()).map(|measured| report(&measured, cores()));
    let limits = Limits::of(&rows, cores());
    let measured = measured.and_then(|()| {
        print_stages(&rows)?;
        scale.as_ref().map_or(Ok(()), ScaleReport::print)?;
        limits.as_ref().map_or(Ok(()), Limits::print)
    });
    let report = Report { table: Table { bench: "cluster", machine, rows }, scale, limits };
    arguments.outputs.write(measured, &report, |folder| charts::draw(&report.table.rows, folder))
}

/// Every combination of what is given; without anything given, the base with one thing varied at a time.
fn settings(arguments: &ClusterBenchArguments) -> Vec<Setting> {
    let ClusterBenchArguments { nodes, bodies, size, .. } = arguments;
    let setting = |nodes, size, bodies| Setting {
        nodes,
        node_cameras: arguments.node_cameras,
        abstain: arguments.abstain,
        threads: arguments.threads.unwrap_or_else(|| coordinator::threads_for(nodes)),
        size,
        bodies,
        samples: arguments.samples,
        responses: arguments.response.clone(),
        precisions: arguments.precision.clone(),
    };
    if nodes.is_empty() && bodies.is_empty() && size.is_empty() {
        let one = |nodes, size| setting(nodes, size, vec![BASE_BODIES]);
        let sizes = SIZES.into_iter().filter(|&size| size != BASE_SIZE).map(|size| one(BASE_NODES, size));
        let spread = NODES.into_iter().map(|nodes| match nodes {
            BASE_NODES => setting(nodes, BASE_SIZE, BODIES.to_vec()),
            other => one(other, BASE_SIZE),
        });
        return sizes.chain(spread).collect();
    }
    let or_base = |given: &Vec<usize>, base| if given.is_empty() { vec![base] } else { given.clone() };
    let (nodes, bodies) = (or_base(nodes, BASE_NODES), or_base(bodies, BASE_BODIES));
    let sizes = if size.is_empty() { vec![BASE_SIZE] } else { size.clone() };
    let of_size = |&size: &(u32, u32)| {
        nodes.iter().map(|&nodes| setting(nodes, size, bodies.clone())).collect::<Vec<_>>()
    };
    sizes.iter().flat_map(of_size).collect()
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
