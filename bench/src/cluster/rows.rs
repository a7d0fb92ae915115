//! The rows of the bench `cluster`, and how they are printed.

use coordinator::Percentiles;
use hull::pass::Round;
use serde::Serialize;
use setup::cli::{Outcome, outln};

use super::connection::PassCosts;
use crate::table::{Columns, number, or_dash};

/// What was measured of one setting.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Node processes.
    pub nodes: usize,
    /// Cameras of all nodes.
    pub cameras: usize,
    /// Bodies asked about.
    pub bodies: usize,
    /// Samples of all bodies.
    pub samples: usize,
    /// Of every camera's images, pixels.
    pub width: u32,
    /// Of every camera's images, pixels.
    pub height: u32,
    /// What the bodies are asked for.
    pub response: &'static str,
    /// The encoding of numbers on the wire.
    pub precision: &'static str,
    /// The kind of sockets.
    pub sockets: &'static str,
    /// Passes measured.
    pub passes: u64,
    /// The median pass, milliseconds.
    pub p50_ms: f64,
    /// The slowest hundredth, milliseconds.
    pub p99_ms: f64,
    /// The slowest, milliseconds.
    pub max_ms: f64,
    /// Bytes at the coordinator's socket of a node, both ways.
    pub bytes_per_node_pass: f64,
    /// Of these, to the node.
    pub bytes_to_node_pass: f64,
    /// Of these, from the node.
    pub bytes_from_node_pass: f64,
    /// The share of the samples, and of their offset samples where these are asked about, that was inside.
    pub inside_share: f64,
    /// Processor time of a node, milliseconds a pass.
    pub node_cpu_ms: Option<f64>,
    /// Threads of the coordinator that serve connections, beside the one that makes passes.
    pub threads: usize,
    /// Processor time of the coordinator, all its threads, milliseconds a pass.
    pub coordinator_cpu_ms: f64,
    /// Of its busiest thread.
    pub busiest_thread_ms: f64,
    /// The median of passes with nothing in their messages, milliseconds.
    pub empty_p50_ms: f64,
    /// The median of the passes that these took turns with.
    pub beside_empty_p50_ms: f64,
    /// Resident memory of the largest node with a full ring, MB.
    pub node_rss_mb: Option<f64>,
    /// The most it ever was, MB.
    pub node_peak_rss_mb: Option<f64>,
    /// Round trips of a pass.
    pub trips_per_pass: f64,
    /// The pass by rounds, in their order.
    pub stages: Vec<Stage>,
}

/// One round of the passes.
#[derive(Clone, Debug, Serialize)]
pub struct Stage {
    /// Its name in tables and JSON.
    pub name: String,
    /// Round trips of it in a pass.
    pub trips: f64,
    /// The median, milliseconds.
    pub p50_ms: f64,
    /// The slowest hundredth, milliseconds.
    pub p99_ms: f64,
    /// The slowest, milliseconds.
    pub max_ms: f64,
}

/// The rounds with their figures.
pub fn stages(costs: &PassCosts) -> Vec<Stage> {
    let stage = |(round, ms): (&Round, &Percentiles)| Stage {
        name: coordinator::Stage::from(*round).name().to_owned(),
        trips: costs.trips.get(round).map_or(0.0, |&trips| trips as f64 / costs.passes.max(1) as f64),
        p50_ms: ms.p50().unwrap_or_default(),
        p99_ms: ms.p99().unwrap_or_default(),
        max_ms: ms.max().unwrap_or_default(),
    };
    costs.stages.iter().map(stage).collect()
}

/// What a chart goes over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Varied {
    /// Node processes.
    Nodes,
    /// The number of bodies.
    Bodies,
    /// Pixels of a camera.
    Size,
}

impl Varied {
    /// All of them.
    pub const ALL: [Varied; 3] = [Varied::Nodes, Varied::Bodies, Varied::Size];

    /// Its value in a row: nodes, bodies, or megapixels of a camera.
    pub fn of(self, row: &Row) -> f64 {
        match self {
            Varied::Nodes => row.nodes as f64,
            Varied::Bodies => row.bodies as f64,
            Varied::Size => f64::from(row.width) * f64::from(row.height) * 1e-6,
        }
    }
}

/// The most rows that differ in `varied` alone, ascending in it.
pub fn series(rows: &[Row], varied: Varied) -> Vec<&Row> {
    let alike = |a: &Row, b: &Row| {
        let others = Varied::ALL.into_iter().filter(|&other| other != varied);
        (a.response, a.precision, a.sockets) == (b.response, b.precision, b.sockets)
            && others.into_iter().all(|other| other.of(a) == other.of(b))
    };
    let company = |row: &Row| rows.iter().filter(|other| alike(row, other)).collect::<Vec<_>>();
    let mut most = rows.iter().map(company).max_by_key(Vec::len).unwrap_or_default();
    most.sort_by(|a, b| varied.of(a).total_cmp(&varied.of(b)));
    most
}

/// The table, without the rounds.
pub const TABLE: Columns<Row> = Columns {
    gap: " ",
    columns: &[
        number("nodes", 5, |row| row.nodes.to_string()),
        number("cameras", 7, |row| row.cameras.to_string()),
        number("bodies", 6, |row| row.bodies.to_string()),
        number("size", 9, |row| format!("{}x{}", row.width, row.height)),
        number("response", 8, |row| row.response.to_owned()),
        number("precision", 9, |row| row.precision.to_owned()),
        number("sockets", 7, |row| row.sockets.to_owned()),
        number("p50", 8, |row| format!("{:.2}", row.p50_ms)),
        number("p99", 8, |row| format!("{:.2}", row.p99_ms)),
        number("max", 8, |row| format!("{:.2}", row.max_ms)),
        number("KB/node", 8, |row| format!("{:.2}", row.bytes_per_node_pass * 1e-3)),
        number("inside", 7, |row| format!("{:.2}%", 100.0 * row.inside_share)),
        number("trips", 5, |row| format!("{:.1}", row.trips_per_pass)),
        number("node cpu", 8, |row| or_dash(row.node_cpu_ms, 3)),
        number("coord.cpu", 9, |row| format!("{:.3}", row.coordinator_cpu_ms)),
        number("a node", 6, |row| format!("{:.3}", row.coordinator_cpu_ms / row.nodes as f64)),
        number("busiest", 7, |row| format!("{:.3}", row.busiest_thread_ms / row.nodes as f64)),
        number("empty p50", 9, |row| format!("{:.2}", row.empty_p50_ms)),
        number("pass/empty", 10, |row| {
            format!("{:.2}", row.beside_empty_p50_ms / row.empty_p50_ms.max(1e-9))
        }),
        number("node MB", 8, |row| or_dash(row.node_rss_mb, 0)),
    ],
};

/// The pass by rounds, and contacts beside the paper's response.
pub fn print_stages(rows: &[Row]) -> Outcome {
    outln!("\nEach round: trips a pass, and p50 / p99 / max of its milliseconds where it is asked")?;
    for row in rows {
        let stage = |stage: &Stage| {
            let Stage { name, trips, p50_ms, p99_ms, max_ms } = stage;
            format!("{name} {trips:.2} x {p50_ms:.2}/{p99_ms:.2}/{max_ms:.2}")
        };
        let stages: Vec<String> = row.stages.iter().map(stage).collect();
        outln!("{} {}", of_row(row), stages.join("  "))?;
    }
    for row in rows {
        let is_same = |other: &&Row| other.response != row.response && of_pair(other) == of_pair(row);
        let Some(paper) = rows.iter().find(is_same).filter(|paper| paper.response == "paper") else {
            continue;
        };
        let rate = paper.p50_ms / row.p50_ms.max(1e-9);
        outln!("{} {rate:.2} times the rate of the paper's response", of_row(row))?;
    }
    Ok(())
}

fn of_row(row: &Row) -> String {
    let Row { nodes, bodies, width, height, response, precision, .. } = row;
    format!("{nodes:>3} nodes {bodies:>4} bodies {width:>5}x{height:<5} {response:8} {precision:9}")
}

/// What rows of different responses share.
fn of_pair(row: &Row) -> (usize, usize, u32, u32, &'static str, &'static str) {
    (row.nodes, row.bodies, row.width, row.height, row.precision, row.sockets)
}
