//! A cluster that is asked passes, and what they cost.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use coordinator::{Percentiles, Placement, SERVING_THREADS, Transport};
use film_time::Pace;
use hull::cull::WorldBox;
use hull::pass::Round;
use node_client::{Agreement, ByteCounts, ExpectedNode, Sockets};
use proto::convert::{Precision, SilhouetteEncoding};
use setup::cli::{Failure, Outcome};
use tokio::runtime::Runtime;

use super::bodies::Bodies;
use super::film::{FPS, Film};
use crate::passes::{Asked, Passes};
use crate::usage::{this_process_cpu_s, thread_cpu_s, thread_s, threads_named};

/// How long nodes may take to connect, and to read their films.
const READY_TIMEOUT: Duration = Duration::from_secs(60);
/// How long a round may take, however busy the machine.
const ROUND_TIMEOUT: Duration = Duration::from_secs(60);
/// Passes before any that count: shapes are known, buffers have grown, connections have their windows, and the
/// coordinator has tried both ways of asking and chosen.
const WARM_UP: u64 = 24;
/// Passes that share a frame: bodies stepped at 120/s on film of 30 frames/s.
pub const PASSES_PER_FRAME: u64 = 4;

/// What is asked about bodies, and in what form points are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointForm {
    /// Registered shapes at poses.
    Registered,
    /// Points of the world.
    RawPoints,
    /// Registered shapes at poses, with offset samples and what is around them, asked about for contacts.
    Contacts,
}

/// Where a pass is answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnswerPlace {
    /// At the nodes.
    Nodes,
    /// At the coordinator, from silhouettes that are gathered.
    Coordinator,
}

/// A coordinator's side of a cluster whose film has come.
pub struct ClusterClient {
    runtime: Runtime,
    transport: Transport,
    passes: Passes,
    /// The system's numbers of the threads that serve connections.
    serving: Vec<u32>,
    frames: u64,
    /// Bytes that the news of one frame took, over all nodes.
    pub news_bytes_per_frame: f64,
}

/// What passes cost.
#[derive(Clone, Debug, Default)]
pub struct PassCosts {
    /// Number of passes.
    pub passes: u64,
    /// A whole pass.
    pub pass_ms: Percentiles,
    /// Each round of it, by name.
    pub stages: BTreeMap<Round, Percentiles>,
    /// Round trips of all passes, by round.
    pub trips: BTreeMap<Round, u64>,
    /// Bytes at the sockets, over all nodes and passes.
    pub bytes: ByteCounts,
    /// The share of all samples, and offset samples if they were asked about, that was inside.
    pub inside_share: f64,
    /// Processor time of the coordinator's thread, milliseconds a pass.
    pub coordinator_cpu_ms: f64,
    /// Processor time of everything else in this process, milliseconds a pass: of threads that serve connections, or of
    /// nodes that live in it.
    pub hosted_cpu_ms: f64,
    /// Processor time of the busiest of all these threads, milliseconds a pass.
    pub busiest_thread_ms: f64,
}

/// What gathering the silhouettes of one frame costs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameCosts {
    /// Bytes at the sockets.
    pub bytes: f64,
    /// Processor time of the coordinator: reading, decoding, and making the frame ready to be asked,
    /// milliseconds.
    pub coordinator_cpu_ms: f64,
}

impl ClusterClient {
    /// Connects to the nodes of a film before the first question, and lets them read all of it.
    pub fn to(
        film: &Film,
        nodes: Vec<ExpectedNode>,
        bodies: &Bodies,
        (answered, dial): (AnswerPlace, Arc<Sockets>),
        threads: usize,
    ) -> Outcome<ClusterClient> {
        let runtime = coordinator::runtime(threads).map_err(Failure::run)?;
        let (settings, shapes, frames) = (film.settings(), bodies.shapes(), film.plan.frames);
        let (transport, news) = runtime.block_on(async {
            let gather = (answered == AnswerPlace::Coordinator).then(|| film.observers());
            let mut transport = Transport::connect(
                nodes,
                gather.map_or(Placement::Nodes, Placement::Here),
                Agreement::new(settings, FPS, shapes).dialling(dial),
            );
            transport.ready(READY_TIMEOUT).await.map_err(Failure::run)?;
            transport.start(Pace::lock_step(1), None).await.map_err(Failure::run)?;
            let before = transport.bytes();
            transport.credit(frames - 1);
            transport.frame(frames - 1, READY_TIMEOUT).await.map_err(Failure::run)?;
            let news = transport.bytes().since(before);
            Ok::<_, Failure>((transport, news))
        })?;
        let news_bytes_per_frame = (news.to_nodes + news.from_nodes) as f64 / frames as f64;
        let mut passes = Passes::new(settings, transport.group_count());
        passes.pass.speculate(transport.asks_nodes());
        let serving = threads_named(SERVING_THREADS);
        Ok(ClusterClient { runtime, transport, passes, serving, frames, news_bytes_per_frame })
    }

    /// Asks so many passes.
    pub fn passes(&mut self, bodies: &Bodies, asked: PointForm, passes: u64) -> Outcome<PassCosts> {
        let mut costs = PassCosts::default();
        let (mut found, mut used) = (Found::default(), Used::default());
        for pass in 0..WARM_UP + passes {
            if pass == WARM_UP {
                costs = PassCosts { passes, ..PassCosts::default() };
                (found, used) = (Found::default(), Used::default());
            }
            found.add(self.pass_about(bodies, asked, pass, &mut costs, &mut used)?);
        }
        let a_pass_ms = |seconds: f64| seconds * 1e3 / passes.max(1) as f64;
        costs.bytes = used.bytes;
        costs.inside_share = found.inside as f64 / found.asked.max(1) as f64;
        costs.coordinator_cpu_ms = a_pass_ms(used.thread_s);
        costs.hosted_cpu_ms = a_pass_ms(used.process_s - used.thread_s);
        costs.busiest_thread_ms = a_pass_ms(used.busiest_s());
        Ok(costs)
    }

    /// Asks passes, each followed by its own messages with nothing in them: what both took, milliseconds.
    pub fn fan_outs(
        &mut self,
        bodies: &Bodies,
        asked: PointForm,
        passes: u64,
    ) -> Outcome<(Percentiles, Percentiles)> {
        let (mut costs, mut empty_ms) = (PassCosts::default(), Percentiles::default());
        for pass in 0..passes {
            self.pass_about(bodies, asked, pass, &mut costs, &mut Used::default())?;
            let ClusterClient { runtime, transport, .. } = self;
            let began = Instant::now();
            let frame = pass / PASSES_PER_FRAME % self.frames;
            runtime.block_on(transport.fan_out(frame, ROUND_TIMEOUT)).map_err(Failure::run)?;
            empty_ms.add(began.elapsed().as_secs_f64() * 1e3);
        }
        Ok((costs.pass_ms, empty_ms))
    }

    fn pass_about(
        &mut self,
        bodies: &Bodies,
        asked: PointForm,
        pass: u64,
        costs: &mut PassCosts,
        used: &mut Used,
    ) -> Outcome<Found> {
        let frame = pass / PASSES_PER_FRAME % self.frames;
        match asked {
            PointForm::Registered => self.counted(&bodies.at_pass(pass), frame, costs, used),
            PointForm::RawPoints => self.counted(&bodies.world_at_pass(pass), frame, costs, used),
            PointForm::Contacts => {
                let points = bodies.contacts_at_pass(pass, pass.is_multiple_of(PASSES_PER_FRAME));
                self.counted(&points, frame, costs, used)
            }
        }
    }

    /// One pass, and what it used.
    fn counted<B: Asked>(
        &mut self,
        bodies: &[B],
        frame: u64,
        costs: &mut PassCosts,
        used: &mut Used,
    ) -> Outcome<Found> {
        // Reading what other threads used takes longer than reading the clocks: before and after these.
        let serving_s = self.serving_s();
        let before = Counters::now(&self.transport);
        let found = self.pass(bodies, frame, costs)?;
        used.add(&before, &Counters::now(&self.transport));
        used.serving_s.resize(serving_s.len(), 0.0);
        let now_s = self.serving_s();
        for ((used_s, before_s), now_s) in used.serving_s.iter_mut().zip(serving_s).zip(now_s) {
            *used_s += now_s - before_s;
        }
        Ok(found)
    }

    /// Processor time of each thread that serves connections, seconds.
    fn serving_s(&self) -> Vec<f64> {
        self.serving.iter().map(|&thread| thread_s(thread)).collect()
    }

    /// The same cluster, whose silhouettes travel in an encoding.
    pub fn encoded_as(self, encoding: SilhouetteEncoding) -> ClusterClient {
        ClusterClient { transport: self.transport.with_silhouettes_as(encoding), ..self }
    }

    /// The same cluster, asked and answered in numbers of a precision.
    pub fn in_precision(self, precision: Precision) -> ClusterClient {
        ClusterClient { transport: self.transport.with_precision(precision), ..self }
    }

    /// Gathers every frame, each for one pass over the bodies.
    pub fn gather(&mut self, bodies: &Bodies) -> Outcome<FrameCosts> {
        let mut costs = FrameCosts::default();
        for frame in 0..self.frames {
            let mut took_ms = [0.0; 2];
            let points = bodies.at_pass(frame);
            let before = self.transport.bytes();
            // The second pass finds the frame already there.
            for took_ms in &mut took_ms {
                let began_s = thread_cpu_s();
                self.pass(&points, frame, &mut PassCosts::default())?;
                *took_ms = (thread_cpu_s() - began_s) * 1e3;
            }
            let bytes = self.transport.bytes().since(before);
            costs.bytes += (bytes.to_nodes + bytes.from_nodes) as f64 / self.frames as f64;
            costs.coordinator_cpu_ms += (took_ms[0] - took_ms[1]).max(0.0) / self.frames as f64;
        }
        Ok(costs)
    }

    /// One pass.
    fn pass<B: Asked>(&mut self, bodies: &[B], frame: u64, costs: &mut PassCosts) -> Outcome<Found> {
        let ClusterClient { runtime, transport, passes, .. } = self;
        let mut stages_ms: BTreeMap<Round, f64> = BTreeMap::new();
        runtime.block_on(async {
            let began = Instant::now();
            // Every body touches the person: none would be culled by a box around the hull.
            passes.begin(bodies, &WorldBox::EVERYWHERE);
            let trips = &mut costs.trips;
            // A round may take several trips: some nodes are asked about what others leave.
            let mut took = |round, ms| {
                *stages_ms.entry(round).or_default() += ms;
                *trips.entry(round).or_default() += 1;
            };
            transport
                .run_pass(&mut passes.pass, frame, Some(ROUND_TIMEOUT), &mut took)
                .await
                .map_err(Failure::run)?;
            let asked = bodies.iter().map(Asked::point_count).sum();
            let found = Found { inside: passes.inside_count(), asked };
            costs.pass_ms.add(began.elapsed().as_secs_f64() * 1e3);
            for (round, ms) in stages_ms {
                costs.stages.entry(round).or_default().add(ms);
            }
            Ok(found)
        })
    }
}

impl PassCosts {
    /// Bytes to and from one of so many nodes in a pass.
    pub fn bytes_per_node_pass(&self, nodes: usize) -> (f64, f64) {
        let all = (nodes as u64 * self.passes).max(1) as f64;
        (self.bytes.to_nodes as f64 / all, self.bytes.from_nodes as f64 / all)
    }

    /// Round trips of a pass.
    pub fn trips_per_pass(&self) -> f64 {
        self.trips.values().sum::<u64>() as f64 / self.passes.max(1) as f64
    }

    /// The passes asked, those before the measurement too.
    pub fn passes_with_warm_up(&self) -> u64 {
        WARM_UP + self.passes
    }
}

/// Points that passes were about, and how many of them were inside.
#[derive(Clone, Copy, Default)]
struct Found {
    inside: usize,
    asked: usize,
}

impl Found {
    fn add(&mut self, other: Found) {
        self.inside += other.inside;
        self.asked += other.asked;
    }
}

/// Counters at one moment.
struct Counters {
    bytes: ByteCounts,
    process_s: f64,
    thread_s: f64,
}

impl Counters {
    fn now(transport: &Transport) -> Counters {
        Counters { bytes: transport.bytes(), process_s: this_process_cpu_s(), thread_s: thread_cpu_s() }
    }
}

/// What passes used.
#[derive(Default)]
struct Used {
    bytes: ByteCounts,
    process_s: f64,
    thread_s: f64,
    serving_s: Vec<f64>,
}

impl Used {
    fn add(&mut self, before: &Counters, after: &Counters) {
        let bytes = after.bytes.since(before.bytes);
        self.bytes.to_nodes += bytes.to_nodes;
        self.bytes.from_nodes += bytes.from_nodes;
        self.process_s += after.process_s - before.process_s;
        self.thread_s += after.thread_s - before.thread_s;
    }

    fn busiest_s(&self) -> f64 {
        self.serving_s.iter().copied().fold(self.thread_s, f64::max)
    }
}
