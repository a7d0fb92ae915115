//! What is full first: the largest cluster that was measured, beside what the model makes of the smaller ones.

use serde::Serialize;
use setup::cli::{Outcome, outln};

use super::model::model_of;
use super::rows::Row;
use crate::scale::report::{LATENCY_S, PASSES_PER_S};
use crate::scale::{Network, Part, Prediction, Room, predict};

/// The link of every machine, bits per second.
const LINK_BITS_PER_S: f64 = 1e9;

/// How full each part is with a pass a step.
#[derive(Debug, Serialize)]
pub struct Limits {
    /// Of which cluster.
    cluster: String,
    /// The cores of this machine, which nodes and coordinator share.
    machine_used: f64,
    parts: Vec<PartUse>,
    /// The part that is full first, as measured, and by the model.
    first: [&'static str; 2],
    /// So many passes a second fill it.
    most_passes_per_s: [f64; 2],
}

/// A part of the cluster; over 1 it cannot keep up.
#[derive(Debug, Serialize)]
struct PartUse {
    name: &'static str,
    measured: f64,
    model: f64,
}

impl Limits {
    /// Of the rows of the response, precision and sockets that come first: the largest cluster, by the others.
    pub fn of(rows: &[Row], cores: usize) -> Option<Limits> {
        let first = rows.first()?;
        let kind = |row: &Row| (row.response, row.precision, row.sockets, row.bodies, row.width, row.height);
        let alike: Vec<&Row> = rows.iter().filter(|row| kind(row) == kind(first)).collect();
        let largest = alike.iter().copied().max_by_key(|row| row.nodes)?;
        let a_node = |row: &Row| row.cameras / row.nodes;
        let smaller = alike.iter().copied().filter(|row| row.nodes < largest.nodes);
        let smaller: Vec<&Row> = smaller.filter(|row| a_node(row) == a_node(largest)).collect();
        let measured = model_of(&smaller)?;
        let room = Room { rigs: 1, nodes_per_rig: largest.nodes, passes_per_s: PASSES_PER_S, cores };
        let network = Network { link_bits_per_s: LINK_BITS_PER_S, latency_s: LATENCY_S };
        let told = [used(largest), predict(&measured, &network, &room)];
        let [found, model] = told.map(|prediction| prediction.used);
        let names = Part::ALL.map(Part::name);
        let parts = names.into_iter().zip(found).zip(model);
        let nodes_ms = largest.nodes as f64 * largest.node_cpu_ms.unwrap_or_default();
        let all_ms = largest.coordinator_cpu_ms + nodes_ms;
        let limits = told.map(|prediction| prediction.limit());
        Some(Limits {
            cluster: format!("{} nodes, {} cameras", largest.nodes, largest.cameras),
            machine_used: all_ms * 1e-3 * PASSES_PER_S / cores as f64,
            parts: parts.map(|((name, measured), model)| PartUse { name, measured, model }).collect(),
            first: limits.map(|(part, _)| part.name()),
            most_passes_per_s: limits.map(|(_, used)| PASSES_PER_S / used.max(1e-9)),
        })
    }

    /// The same for people.
    pub fn print(&self) -> Outcome {
        let Limits { cluster, machine_used, parts, first, most_passes_per_s } = self;
        outln!(
            "\n{cluster}, {PASSES_PER_S} passes a second, links of 1 Gbit/s: measured, and by the model of fewer nodes"
        )?;
        for PartUse { name, measured, model } in parts {
            outln!("  {name:<30} {:>6.0} % {:>6.0} %", 100.0 * measured, 100.0 * model)?;
        }
        let here = 100.0 * machine_used;
        outln!(
            "  this machine's cores, all on it {here:>5.0} %: {:.0} passes a second",
            PASSES_PER_S / machine_used
        )?;
        let ([found, told], [passes, by_model]) = (first, most_passes_per_s);
        outln!(
            "  first full on machines of their own: {found}, at {passes:.0} passes a second; by the model: {told}, at {by_model:.0}"
        )
    }
}

/// How full each of [`Part::ALL`] is, as measured; the time of a step with all on one machine.
fn used(row: &Row) -> Prediction {
    let link = |bytes: f64| row.nodes as f64 * bytes * 8.0 * PASSES_PER_S / LINK_BITS_PER_S;
    let a_step = PASSES_PER_S * 1e-3;
    let used = [
        link(row.bytes_from_node_pass),
        link(row.bytes_to_node_pass),
        row.busiest_thread_ms * a_step,
        row.node_cpu_ms.unwrap_or_default() * a_step,
        row.p50_ms * a_step,
    ];
    Prediction { pass_ms: row.p50_ms, used }
}
