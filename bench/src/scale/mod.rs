//! A model of clusters larger than any at hand: what a measured pass would take with more cameras, more
//! rigs and real links, and which part breaks first. Plain functions over plain data; nothing here measures.
//!
//! Every machine hangs on one switch by a link of the same rate, and no message is lost. A message is
//! passed on once it is whole. Each rig's passes run on one core of the coordinator; all rigs begin their
//! passes at the same moment, which is the worst. The rounds of a pass are taken as alike.

pub mod report;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The most cameras that are looked at when the breaking point is searched.
const MAX_NODES: usize = 4096;

/// What one pass of one rig costs, as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassMeasurement {
    /// Round trips of a pass.
    pub rounds: u32,
    /// Bytes to a node.
    pub bytes_to_node: f64,
    /// Bytes from a node.
    pub bytes_from_node: f64,
    /// Processor time of a node, milliseconds.
    pub node_ms: f64,
    /// Processor time of the coordinator for every node, milliseconds.
    pub coordinator_per_node_ms: f64,
    /// Processor time of the coordinator whatever the nodes, milliseconds.
    pub coordinator_fixed_ms: f64,
}

/// The network: a switch, and a link of one rate to every machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Network {
    /// Rate of every link, each way.
    pub link_bits_per_s: f64,
    /// From machine to machine, one way, for the first byte, seconds.
    pub latency_s: f64,
}

/// What one coordinator machine serves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// Rigs that have nothing in common but the coordinator machine.
    pub rigs: usize,
    /// Nodes of every rig, a camera each.
    pub nodes_per_rig: usize,
    /// Passes of every rig per second.
    pub passes_per_s: f64,
    /// Cores of the coordinator machine.
    pub cores: usize,
}

/// A part that can be too slow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The coordinator's link, from the nodes.
    Incoming,
    /// The coordinator's link, to the nodes.
    Outgoing,
    /// The coordinator's processor.
    Coordinator,
    /// A node's processor.
    Node,
    /// The time between two passes: what has to wait for one another adds up, although no part is full.
    Step,
}

impl Part {
    /// All parts.
    pub const ALL: [Part; 5] = [Part::Incoming, Part::Outgoing, Part::Coordinator, Part::Node, Part::Step];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Part::Incoming => "coordinator's link, incoming",
            Part::Outgoing => "coordinator's link, outgoing",
            Part::Coordinator => "coordinator's processor",
            Part::Node => "a node's processor",
            Part::Step => "time of a step",
        }
    }
}

/// What the model predicts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// From the beginning of a pass to the result of the last rig, milliseconds.
    pub pass_ms: f64,
    /// How much of each of [`Part::ALL`] is used; over 1 it cannot keep up.
    pub used: [f64; Part::ALL.len()],
}

impl Prediction {
    /// What limits, and how much of it is used: the fullest link or processor, unless all of them could
    /// keep up and only the time of a step is too short.
    pub fn limit(&self) -> (Part, f64) {
        let (mut limit, mut most) = (Part::Incoming, f64::NEG_INFINITY);
        for (part, used) in Part::ALL.into_iter().zip(self.used) {
            if part == Part::Step && most > 1.0 {
                break;
            }
            if used > most {
                (limit, most) = (part, used);
            }
        }
        (limit, most)
    }
}

/// What a room would take.
pub fn predict(measured: &PassMeasurement, network: &Network, room: &Room) -> Prediction {
    let nodes = (room.rigs * room.nodes_per_rig) as f64;
    let link_share = |bytes: f64| nodes * bytes * 8.0 * room.passes_per_s / network.link_bits_per_s;
    let a_rig_ms =
        measured.coordinator_fixed_ms + measured.coordinator_per_node_ms * room.nodes_per_rig as f64;
    // A rig's passes use one core; a core serves several rigs in turn.
    let rigs_of_a_core = room.rigs.div_ceil(room.cores) as f64;
    let pass_ms = Simulation::new(measured, network, room).pass_ms();
    let per_ms = room.passes_per_s * 1e-3;
    Prediction {
        pass_ms,
        used: [
            link_share(measured.bytes_from_node),
            link_share(measured.bytes_to_node),
            a_rig_ms * rigs_of_a_core * per_ms,
            measured.node_ms * per_ms,
            pass_ms * per_ms,
        ],
    }
}

/// The fewest for which some part cannot keep up, and that part; `None` if none does up to
/// [`MAX_NODES`] nodes. `room` makes the room of so many; it must need more with every one.
pub fn breaking_point(
    measured: &PassMeasurement,
    network: &Network,
    room: impl Fn(usize) -> Room,
) -> Option<(usize, Part)> {
    let limit = |count: usize| predict(measured, network, &room(count)).limit();
    let fits = |count: usize| room(count).rigs * room(count).nodes_per_rig <= MAX_NODES;
    let mut high = 1;
    while limit(high).1 <= 1.0 {
        high *= 2;
        if !fits(high) {
            return None;
        }
    }
    let mut low = high / 2;
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        *(if limit(middle).1 > 1.0 { &mut high } else { &mut low }) = middle;
    }
    Some((high, limit(high).0))
}

/// Where a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Place {
    Asking,
    Outgoing,
    Node,
    Incoming,
    Merging,
}

/// A message reaches a place: nanoseconds, and in the order of rigs and nodes at one moment.
type Arrival = Reverse<(u64, usize, usize, Place)>;

/// One pass of every rig, message by message.
struct Simulation<'a> {
    room: &'a Room,
    rounds: u32,
    /// What a message takes, nanoseconds: of the coordinator each way, of the links, of the node.
    handling_ns: u64,
    fixed_ns: u64,
    outgoing_ns: u64,
    incoming_ns: u64,
    node_ns: u64,
    latency_ns: u64,
    queue: BinaryHeap<Arrival>,
    /// When each is free again.
    cores: Vec<u64>,
    outgoing: u64,
    incoming: u64,
}

impl<'a> Simulation<'a> {
    fn new(measured: &PassMeasurement, network: &Network, room: &'a Room) -> Simulation<'a> {
        let a_round = |ms: f64| ns(ms * 1e6 / f64::from(measured.rounds.max(1)));
        let link_ms = |bytes: f64| bytes * 8e3 / network.link_bits_per_s;
        Simulation {
            room,
            rounds: measured.rounds,
            handling_ns: a_round(0.5 * measured.coordinator_per_node_ms),
            fixed_ns: a_round(measured.coordinator_fixed_ms),
            outgoing_ns: a_round(link_ms(measured.bytes_to_node)),
            incoming_ns: a_round(link_ms(measured.bytes_from_node)),
            node_ns: a_round(measured.node_ms),
            latency_ns: ns(network.latency_s * 1e9),
            queue: BinaryHeap::new(),
            cores: vec![0; room.cores.max(1)],
            outgoing: 0,
            incoming: 0,
        }
    }

    fn pass_ms(mut self) -> f64 {
        let mut rounds_left = vec![self.rounds; self.room.rigs];
        let mut waiting = vec![self.room.nodes_per_rig; self.room.rigs];
        (0..self.room.rigs).for_each(|rig| self.ask(rig, 0));
        let mut last = 0;
        while let Some(Reverse((now, rig, node, place))) = self.queue.pop() {
            let core = rig % self.cores.len();
            let (next, at) = match place {
                Place::Asking => (Place::Outgoing, served(&mut self.cores[core], now, self.handling_ns)),
                Place::Outgoing => {
                    (Place::Node, served(&mut self.outgoing, now, self.outgoing_ns) + self.latency_ns)
                }
                // The answer crosses the node's own link before it waits for the coordinator's.
                Place::Node => (Place::Incoming, now + self.node_ns + self.incoming_ns + self.latency_ns),
                Place::Incoming => (Place::Merging, served(&mut self.incoming, now, self.incoming_ns)),
                Place::Merging => {
                    let merged = served(&mut self.cores[core], now, self.handling_ns);
                    waiting[rig] -= 1;
                    if waiting[rig] == 0 {
                        let done = served(&mut self.cores[core], merged, self.fixed_ns);
                        last = last.max(done);
                        rounds_left[rig] -= 1;
                        waiting[rig] = self.room.nodes_per_rig;
                        if rounds_left[rig] > 0 {
                            self.ask(rig, done);
                        }
                    }
                    continue;
                }
            };
            self.queue.push(Reverse((at, rig, node, next)));
        }
        last as f64 * 1e-6
    }

    fn ask(&mut self, rig: usize, now: u64) {
        self.queue.extend((0..self.room.nodes_per_rig).map(|node| Reverse((now, rig, node, Place::Asking))));
    }
}

/// When something that serves one at a time is done with this one.
fn served(free: &mut u64, now: u64, takes: u64) -> u64 {
    *free = now.max(*free) + takes;
    *free
}

fn ns(value: f64) -> u64 {
    value.max(0.0).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    const MEASURED: PassMeasurement = PassMeasurement {
        rounds: 4,
        bytes_to_node: 4_000.0,
        bytes_from_node: 8_000.0,
        node_ms: 0.4,
        coordinator_per_node_ms: 0.08,
        coordinator_fixed_ms: 0.4,
    };
    const GIGABIT: Network = Network { link_bits_per_s: 1e9, latency_s: 50e-6 };
    const ONE: Room = Room { rigs: 1, nodes_per_rig: 1, passes_per_s: 120.0, cores: 2 };

    #[test]
    fn one_node_takes_what_its_parts_take_one_after_the_other() {
        // Rounds of: 10 + 8 µs out, 50 there, 100 of the node, 16 + 50 back, 16 in, 10 + 100 to merge.
        let expected_ms = 4.0 * (10.0 + 8.0 + 50.0 + 100.0 + 16.0 + 50.0 + 16.0 + 10.0 + 100.0) * 1e-3;
        let told = predict(&MEASURED, &GIGABIT, &ONE);
        assert!((told.pass_ms - expected_ms).abs() < 1e-9, "{} and {expected_ms}", told.pass_ms);
        let expected =
            [8e3 * 8.0 * 120.0 / 1e9, 4e3 * 8.0 * 120.0 / 1e9, 0.48 * 0.12, 0.4 * 0.12, expected_ms * 0.12];
        for (used, expected) in told.used.iter().zip(expected) {
            assert!((used - expected).abs() < 1e-12, "{:?}", told.used);
        }
    }

    #[test]
    fn nodes_compute_together_but_share_the_coordinators_link() {
        let slow = Network { link_bits_per_s: 1e7, ..GIGABIT };
        let pass_ms = |network: &Network, nodes| {
            predict(&MEASURED, network, &Room { nodes_per_rig: nodes, ..ONE }).pass_ms
        };
        let (one, many) = (pass_ms(&GIGABIT, 1), pass_ms(&GIGABIT, 8));
        assert!(many < 4.0 * one, "{one} and {many} ms");
        let incoming_ms = 64.0 * MEASURED.bytes_from_node * 8e3 / 1e7;
        assert!(pass_ms(&slow, 64) > incoming_ms);
    }

    #[test]
    fn what_breaks_first_follows_from_what_is_scarce() {
        let cameras = |nodes| Room { nodes_per_rig: nodes, ..ONE };
        let first =
            |measured: &PassMeasurement, network: &Network| breaking_point(measured, network, cameras);
        // 8,333 µs a step: the coordinator's core merges for about a hundred nodes.
        let (count, part) = first(&MEASURED, &GIGABIT).expect("breaks");
        assert!((60..110).contains(&count), "{count}");
        assert!(matches!(part, Part::Step | Part::Coordinator), "{part:?}");
        let idle = PassMeasurement {
            coordinator_per_node_ms: 0.0,
            coordinator_fixed_ms: 0.0,
            node_ms: 0.0,
            ..MEASURED
        };
        let (count, part) = first(&idle, &Network { latency_s: 0.0, link_bits_per_s: 1e8 }).expect("breaks");
        assert!(count <= 13, "{count}");
        assert!(matches!(part, Part::Step | Part::Incoming), "{part:?}");
        let slow = PassMeasurement { node_ms: 20.0, ..MEASURED };
        assert_eq!(first(&slow, &GIGABIT).expect("breaks").0, 1);
        let nothing = PassMeasurement { bytes_to_node: 0.0, bytes_from_node: 0.0, ..idle };
        assert_eq!(first(&nothing, &GIGABIT), None);
    }

    #[test]
    fn rigs_spread_over_the_cores() {
        // Links that delay no message.
        let network = Network { link_bits_per_s: 1e12, ..GIGABIT };
        let pass_ms = |rigs, cores| {
            predict(&MEASURED, &network, &Room { rigs, nodes_per_rig: 8, cores, ..ONE }).pass_ms
        };
        assert!(pass_ms(2, 2) < 1.2 * pass_ms(1, 2));
        assert!(pass_ms(4, 1) > 2.0 * pass_ms(4, 4));
    }
}
