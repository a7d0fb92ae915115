//! The model's tables: cameras of one rig, and many rigs, at the usual rates.

use serde::Serialize;
use setup::cli::{Outcome, outln};

use crate::table::{Columns, number, words};

use super::{Network, Part, PassMeasurement, Prediction, Room, breaking_point, predict};

/// Rates of links, bits per second: 100 Mbit/s, 1 and 10 Gbit/s.
pub const LINKS_BITS_PER_S: [f64; 3] = [1e8, 1e9, 1e10];
/// Assumed from machine to machine through a switch, one way, seconds.
pub const LATENCY_S: f64 = 50e-6;
/// Passes a second: one for each step of the simulation.
pub const PASSES_PER_S: f64 = 120.0;
/// Cameras of one rig.
const CAMERAS: [usize; 6] = [8, 16, 32, 64, 128, 256];
/// Rigs of one coordinator machine, and the cameras of each.
const RIGS: [usize; 5] = [1, 2, 4, 16, 64];
const CAMERAS_PER_RIG: usize = 8;

/// One prediction.
#[derive(Debug, Serialize)]
pub struct ScaleRow {
    link_bits_per_s: f64,
    rigs: usize,
    cameras: usize,
    passes_per_s: f64,
    pass_ms: f64,
    incoming_used: f64,
    outgoing_used: f64,
    coordinator_used: f64,
    node_used: f64,
    step_used: f64,
    /// The part that limits.
    limit: &'static str,
    /// True if it cannot keep up.
    breaks: bool,
}

/// The model's rows, and a note on them.
#[derive(Debug, Serialize)]
pub struct ScaleReport {
    /// What this is.
    pub note: String,
    /// One predicted setup a row.
    pub rows: Vec<ScaleRow>,
    /// What breaks first, at which link, in words.
    pub breaking: Vec<String>,
}

/// Asks the model about rigs of one camera a node, of a coordinator with so many cores.
pub fn report(measured: &PassMeasurement, cores: usize) -> ScaleReport {
    let room = |rigs, nodes_per_rig| Room { rigs, nodes_per_rig, passes_per_s: PASSES_PER_S, cores };
    let (mut rows, mut breaking) = (Vec::new(), Vec::new());
    for link_bits_per_s in LINKS_BITS_PER_S {
        let network = Network { link_bits_per_s, latency_s: LATENCY_S };
        let one_rig = CAMERAS.map(|cameras| room(1, cameras));
        let many_rigs = RIGS.map(|rigs| room(rigs, CAMERAS_PER_RIG));
        let rooms = one_rig.iter().chain(&many_rigs[1..]);
        rows.extend(rooms.map(|room| row(&network, room, &predict(measured, &network, room))));
        let words = |what: &str, found: Option<(usize, Part)>| match found {
            Some((count, part)) => {
                format!("{}: {what} at {count}, by the {}", link_name(link_bits_per_s), part.name())
            }
            None => format!("{}: {what} nowhere within the model", link_name(link_bits_per_s)),
        };
        let cameras = breaking_point(measured, &network, |count| room(1, count));
        breaking.push(words("cameras of one rig break first", cameras));
        let rigs = breaking_point(measured, &network, |count| room(count, CAMERAS_PER_RIG));
        breaking.push(words("rigs of 8 cameras break first", rigs));
    }
    ScaleReport { note: note(measured, cores), rows, breaking }
}

fn note(measured: &PassMeasurement, cores: usize) -> String {
    format!(
        "a model, not a measurement: {} rounds a pass, {:.0} + {:.0} bytes and {:.3} ms a node, \
         {:.3} ms + {:.4} ms a node at the coordinator (of {cores} cores), all measured in this run; links \
         of {:.0} µs, no loss, a step and pass every {:.2} ms, all rigs asking at the same moment",
        measured.rounds,
        measured.bytes_to_node,
        measured.bytes_from_node,
        measured.node_ms,
        measured.coordinator_fixed_ms,
        measured.coordinator_per_node_ms,
        LATENCY_S * 1e6,
        1e3 / PASSES_PER_S,
    )
}

fn row(network: &Network, room: &Room, prediction: &Prediction) -> ScaleRow {
    let [incoming_used, outgoing_used, coordinator_used, node_used, step_used] = prediction.used;
    let (limit, used) = prediction.limit();
    ScaleRow {
        link_bits_per_s: network.link_bits_per_s,
        rigs: room.rigs,
        cameras: room.rigs * room.nodes_per_rig,
        passes_per_s: room.passes_per_s,
        pass_ms: prediction.pass_ms,
        incoming_used,
        outgoing_used,
        coordinator_used,
        node_used,
        step_used,
        limit: limit.name(),
        breaks: used > 1.0,
    }
}

/// A link's rate in words.
pub fn link_name(bits_per_s: f64) -> String {
    if bits_per_s < 1e9 {
        format!("{:.0} Mbit/s", bits_per_s * 1e-6)
    } else {
        format!("{:.0} Gbit/s", bits_per_s * 1e-9)
    }
}

const TABLE: Columns<ScaleRow> = Columns {
    gap: " ",
    columns: &[
        number("link", 10, |row| link_name(row.link_bits_per_s)),
        number("rigs", 5, |row| row.rigs.to_string()),
        number("cameras", 8, |row| row.cameras.to_string()),
        number("pass ms", 9, |row| format!("{:.2}", row.pass_ms)),
        number("used: incoming", 15, |row| percent(row.incoming_used)),
        number("outgoing", 8, |row| percent(row.outgoing_used)),
        number("coordinator", 11, |row| percent(row.coordinator_used)),
        number("node", 5, |row| percent(row.node_used)),
        number("step", 6, |row| percent(row.step_used)),
        words(" limit", 0, |row| {
            format!(" {}{}", row.limit, if row.breaks { ": cannot keep up" } else { "" })
        }),
    ],
};

fn percent(used: f64) -> String {
    format!("{:.0} %", 100.0 * used)
}

impl ScaleReport {
    /// The report for people.
    pub fn print(&self) -> Outcome {
        outln!("\nScale: {}", self.note)?;
        TABLE.print_titles()?;
        self.rows.iter().try_for_each(|row| TABLE.print(row))?;
        self.breaking.iter().try_for_each(|line| outln!("  {line}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_link_has_its_rows_and_says_what_breaks() {
        let measured = PassMeasurement {
            rounds: 5,
            bytes_to_node: 5e3,
            bytes_from_node: 1e4,
            node_ms: 0.5,
            coordinator_per_node_ms: 0.1,
            coordinator_fixed_ms: 0.5,
        };
        let told = report(&measured, 2);
        assert_eq!(told.rows.len(), LINKS_BITS_PER_S.len() * (CAMERAS.len() + RIGS.len() - 1));
        assert_eq!(told.breaking.len(), 2 * LINKS_BITS_PER_S.len());
        let slow =
            told.rows.iter().find(|row| row.cameras == 256 && row.link_bits_per_s == 1e8).expect("a row");
        assert!(slow.breaks && slow.incoming_used > 1.0, "{slow:?}");
        assert!(told.note.starts_with("a model"));
    }
}
