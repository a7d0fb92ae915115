//! A room on a simulated network: hosts, what happens to them, and the log of it all.

use std::io::Write;
use std::net::Ipv4Addr;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use camera_node::frames::FrameRing;
use camera_node::service::serve_film;
use coordinator::hooks::{EndRecord, FrameRecord, Recorder, StepRecord};
use coordinator::live::{Command, Follower, live};
use coordinator::{
    AskEvery, Coordinator, GoingOn, GoneOn, MemoryUse, Placement, Progress, RunSettings, Snapshot, Transport,
    Watcher,
};
use film_time::ring_frames;
use futures::Stream;
use futures::future::BoxFuture;
use hull::ProbeSettings;
use node_client::{Agreement, Destination, Dial, ExpectedNode, Socket};
use proto::Address;
use setup::expected_node;
use sim::{BodyRequest, Scene, World, WorldSettings};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tonic::transport::server::Connected;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::FormatTime;
use turmoil::net::{TcpListener, TcpStream};

use crate::film::{CAMERAS, FPS, NODES, Studio};
use crate::liar::{self, Habit};
use crate::poison::Poison;

/// A simulated run, seconds.
const RUN_S: u64 = 20;
/// All that fails is well by then, seconds.
const WELL_S: u64 = 14;
/// And the room is whole from then on, seconds: `WELL_S` and what it takes to be found again.
const WHOLE_S: f64 = 17.5;
const PORT: u16 = 7001;
/// Behind a node that lies, the honest one.
const HONEST_PORT: u16 = 7002;
/// A run with a node that lies, seconds.
const LYING_S: u64 = 9;
/// A body of another shape is spawned so often beside a liar.
const SPAWN_EVERY: Duration = Duration::from_millis(400);
/// For so long a run waits for its nodes, seconds; beside a liar for less, as it may never say that it is there.
const PATIENCE_S: u64 = 60;
const PATIENCE_WITH_LIAR_S: u64 = 1;
/// Steps without a hull that a node that lies may cost: a second's.
const MOST_BLIND_STEPS: u64 = 120;
/// Beside a liar the first hull comes within so long, simulated seconds, and so many steps of a run's 120 a second are made.
const FIRST_HULL_WITHIN_S: f64 = 4.0;
const LEAST_STEPS: u64 = 120 * (LYING_S - 4);
/// A coordinator that starts over goes on from at most so many steps before.
const MOST_LOST_STEPS: u64 = 240;
/// Bodies of this scene never move faster, m/s.
const FASTEST_M_S: f64 = 20.0;

/// What refusals of malformed questions name.
const FIELDS_OF_QUESTIONS: [&str; 3] = ["Points.", "Bodies.", "ProbeRequest."];

const SCENE: &str = "
    [[bodies]]
    name = 'box'
    shape.box.size = [0.25, 0.25, 0.25]
    count = 2
    place.stack.foot = [0.5, 0.0, 0.1]";

/// What a seed gave.
pub struct Outcome {
    pub log: Vec<String>,
    pub steps: u64,
    pub wrong: Option<String>,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// Networks and computers fail.
    Network,
    /// A node lies.
    Liar,
    /// A node lies about the world that it remembers, and the coordinator is restarted.
    Poison,
}

/// Numbers from a seed (SplitMix64).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    pub fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % end
    }

    pub fn ms(&mut self, from: u64, to: u64) -> Duration {
        Duration::from_millis(from + self.below(to - from))
    }
}

#[derive(Clone, Copy, Debug)]
enum Fault {
    /// What is sent is lost, both ways, and so are the connections.
    Cut(usize),
    /// What is sent waits.
    Held(usize),
    /// Messages take up to 60 ms.
    Slow(usize),
    /// One message in so many hundred is lost, and with it its connection.
    Lossy(usize),
    /// A computer without power: its peers are not told.
    NodeDead(usize),
    CoordinatorDead,
}

/// Faults by when they begin and end.
fn faults(random: &mut Random) -> Vec<(Duration, Duration, Fault)> {
    let count = 1 + random.below(5);
    let fault = |_| {
        let (begin, node) = (random.ms(1500, 1000 * WELL_S - 3000), random.below(NODES as u64) as usize);
        let lasts = random.ms(100, 3000);
        let fault = match random.below(11) {
            0 | 1 => Fault::Cut(node),
            2 | 3 => Fault::Held(node),
            4 | 5 => Fault::Slow(node),
            6 | 7 => Fault::Lossy(node),
            8 | 9 => Fault::NodeDead(node),
            _ => Fault::CoordinatorDead,
        };
        (begin, begin + lasts, fault)
    };
    (0..count).map(fault).collect()
}

fn node_name(node: usize) -> String {
    format!("node-{node}")
}

const COORDINATOR: &str = "coordinator";

impl Fault {
    fn begin(self, sim: &mut turmoil::Sim<'_>) {
        match self {
            Fault::Cut(node) => sim.partition(COORDINATOR, node_name(node)),
            Fault::Held(node) => sim.hold(COORDINATOR, node_name(node)),
            Fault::Slow(node) => {
                sim.set_link_max_message_latency(COORDINATOR, node_name(node), Duration::from_millis(60));
            }
            Fault::Lossy(node) => sim.set_link_fail_rate(COORDINATOR, node_name(node), 0.002),
            Fault::NodeDead(node) => {
                sim.partition(COORDINATOR, node_name(node));
                sim.crash(node_name(node));
            }
            Fault::CoordinatorDead => {
                (0..NODES).for_each(|node| sim.partition(COORDINATOR, node_name(node)));
                sim.crash(COORDINATOR);
            }
        }
    }

    fn end(self, sim: &mut turmoil::Sim<'_>, latency: Duration) {
        match self {
            Fault::Cut(node) => sim.repair(COORDINATOR, node_name(node)),
            Fault::Held(node) => sim.release(COORDINATOR, node_name(node)),
            Fault::Slow(node) => sim.set_link_max_message_latency(COORDINATOR, node_name(node), latency),
            Fault::Lossy(node) => {
                sim.set_link_fail_rate(COORDINATOR, node_name(node), 0.0);
                sim.repair(COORDINATOR, node_name(node));
            }
            Fault::NodeDead(node) => {
                sim.repair(COORDINATOR, node_name(node));
                sim.bounce(node_name(node));
            }
            Fault::CoordinatorDead => {
                (0..NODES).for_each(|node| sim.repair(COORDINATOR, node_name(node)));
                sim.bounce(COORDINATOR);
            }
        }
    }
}

/// Some seconds of a room.
pub fn play(studio: &Studio, seed: u64, trouble: Trouble) -> Outcome {
    let log = Log::default();
    let subscriber = tracing_subscriber::fmt()
        .with_writer(log.clone())
        .with_timer(SimulatedTime)
        .with_ansi(false)
        .with_max_level(tracing::Level::INFO)
        .finish();
    tracing::subscriber::with_default(subscriber, || run(studio, seed, trouble, &log));
    let Kept { lines, steps, wrong, .. } = std::mem::take(&mut *log.0.lock().expect("no panic"));
    Outcome { log: lines, steps, wrong }
}

fn run(studio: &Studio, seed: u64, trouble: Trouble, log: &Log) {
    let mut random = Random(seed);
    let latency = random.ms(1, 9);
    let mut sim = turmoil::Builder::new()
        .rng_seed(random.below(u64::MAX))
        .tick_duration(Duration::from_millis(1))
        .simulation_duration(Duration::from_secs(10 * RUN_S))
        .min_message_latency(Duration::from_micros(200))
        .max_message_latency(latency)
        .tcp_capacity(4096)
        .build();
    let liar = (trouble != Trouble::Network).then(|| random.below(NODES as u64) as usize);
    for node in 0..NODES {
        let lies = liar.filter(|&liar| liar == node).map(|_| Random(random.below(u64::MAX)));
        let port = if lies.is_some() { HONEST_PORT } else { PORT };
        if let Some(lies) = &lies {
            log.say(format_args!("{} lies: {lies:?}", node_name(node)));
        }
        let config = studio.config(2 * node..2 * node + 2);
        sim.host(node_name(node), move || {
            let config = config.clone();
            let ring = Arc::new(FrameRing::new(config.cameras.len()).keeping(ring_frames(FPS)));
            let film = Arc::new(studio.film(&config, Arc::clone(&ring)));
            let habit = lies.clone().map(|random| match trouble {
                Trouble::Poison => Habit::poisoning(random, Poison::ALL[seed as usize % Poison::ALL.len()]),
                Trouble::Network | Trouble::Liar => Habit::new(random),
            });
            async move {
                let honest = async {
                    serve_film(&config, film, ring, accepted(port).await?).await?;
                    Ok::<_, Box<dyn std::error::Error>>(())
                };
                let Some(habit) = habit else { return honest.await };
                futures::try_join!(honest, liar::serve(PORT, HONEST_PORT, habit))?;
                Ok(())
            }
        });
    }
    let coordinator_log = log.clone();
    sim.host(COORDINATOR, move || {
        let log = coordinator_log.clone();
        let made = coordinator(studio, &log, trouble);
        async move {
            let mut watcher = log.clone();
            let ended = made().run(&mut watcher, std::future::pending()).await;
            log.wrong(match ended {
                Ok(_) => "the run ended".to_owned(),
                Err(why) => format!("the run failed: {why}"),
            });
            std::future::pending().await
        }
    });
    if trouble == Trouble::Liar {
        steps(&mut sim, Duration::from_secs(LYING_S), log);
        return log.check_blindness();
    }
    if trouble == Trouble::Poison {
        for (at_s, is_dead) in [(4, true), (5, false)] {
            steps(&mut sim, Duration::from_secs(at_s), log);
            let fault = Fault::CoordinatorDead;
            if is_dead { fault.begin(&mut sim) } else { fault.end(&mut sim, latency) }
        }
        steps(&mut sim, Duration::from_secs(LYING_S), log);
        return log.check_gone_on();
    }
    let faults = faults(&mut random);
    let mut events: Vec<(Duration, bool, Fault)> =
        faults.iter().flat_map(|&(begin, end, fault)| [(begin, true, fault), (end, false, fault)]).collect();
    events.sort_by_key(|&(at, ..)| at);
    let deaths = faults.iter().filter(|(.., fault)| matches!(fault, Fault::NodeDead(_))).count();
    log.0.lock().expect("no panic").node_deaths = deaths;
    for (at, begins, fault) in events {
        steps(&mut sim, at, log);
        log.say(format_args!("{} {fault:?}", if begins { "begins" } else { "ends" }));
        if begins { fault.begin(&mut sim) } else { fault.end(&mut sim, latency) }
    }
    steps(&mut sim, Duration::from_secs(RUN_S), log);
    log.check_end();
}

/// The connections to a port of a simulated host.
pub async fn accepted(port: u16) -> std::io::Result<impl Stream<Item = std::io::Result<SimulatedSocket>>> {
    let listener = TcpListener::bind((Ipv4Addr::UNSPECIFIED, port)).await?;
    let accept = |listener: TcpListener| async move {
        let accepted = listener.accept().await;
        Some((accepted.map(|(stream, _)| SimulatedSocket(stream)), listener))
    };
    Ok(futures::stream::unfold(listener, accept))
}

fn steps(sim: &mut turmoil::Sim<'_>, until: Duration, log: &Log) {
    while sim.elapsed() < until {
        log.0.lock().expect("no panic").now = sim.elapsed();
        if let Err(why) = sim.step() {
            log.wrong(format!("a host ended: {why}"));
            return;
        }
    }
}

/// What makes a coordinator once its host runs.
fn coordinator(studio: &Studio, log: &Log, trouble: Trouble) -> impl FnOnce() -> Coordinator + use<> {
    let observers = studio.config(0..CAMERAS).observers();
    let node = |node: usize| {
        let address: Address = format!("{}:{PORT}", node_name(node)).parse().expect("an address");
        let expected = expected_node(&studio.rig, address, &[2 * node, 2 * node + 1]);
        ExpectedNode { is_endless: true, ..expected }
    };
    let nodes: Vec<_> = (0..NODES).map(node).collect();
    let log = log.clone();
    let patience_s = if trouble == Trouble::Liar { PATIENCE_WITH_LIAR_S } else { PATIENCE_S };
    move || {
        let scene = Scene::from_toml("simulated", SCENE).expect("a scene");
        let world = World::new(&scene, WorldSettings::default()).expect("a world");
        let shapes = world.asked_shapes().collect();
        let agreement =
            Agreement::new(ProbeSettings::default(), FPS, shapes).dialling(Arc::new(SimulatedNetwork));
        let placement = Placement::Fastest(observers.clone());
        let transport = Transport::connect(nodes, placement, agreement);
        let settings = RunSettings {
            probes: ProbeSettings::default(),
            fps: FPS,
            latency_s: None,
            hold_s: 0.0,
            going_on: GoingOn::default(),
            seconds: None,
            lock_step: false,
            ask_every: AskEvery::Frame,
            reuse_within_m: scene.hull().reuse_within_m,
            connect_timeout: Duration::from_secs(patience_s),
        };
        let coordinator = Coordinator::new(transport, world, observers, settings)
            .with_memory(MemoryUse::GoOn)
            .with_recorder(Box::new(log.clone()));
        if trouble != Trouble::Liar {
            return coordinator;
        }
        let (live, follower) = live();
        tokio::spawn(spawn_bodies(follower, log));
        coordinator.with_live(live)
    }
}

/// Now and then another ball of a size of its own: nodes must be told of its shape.
async fn spawn_bodies(follower: Follower, log: Log) {
    for count in 1.. {
        tokio::time::sleep(SPAWN_EVERY).await;
        let ball =
            format!("shape.ball.radius = {}\nposition = [0.5, 1.5, 0.1]", 0.05 + 1e-3 * f64::from(count));
        let request: BodyRequest = toml::from_str(&ball).expect("the keys of a request");
        let body = Box::new(request.check().expect("a body"));
        if let Err(why) = follower.order(Command::Spawn(body)).await {
            log.wrong(format!("ball {count} is refused: {why}"));
        }
    }
}

/// Everything that happened.
#[derive(Default)]
struct Kept {
    lines: Vec<String>,
    steps: u64,
    wrong: Option<String>,
    now: Duration,
    last_step: u64,
    node_deaths: usize,
    /// Steps without a hull since the first one with one, if there was one.
    blind_steps: Option<u64>,
    /// When the first step with a hull was made, seconds of simulated time.
    first_hull_s: Option<f64>,
    /// The newest frame in use, how many cameras it has, and when it came into use.
    used: Option<(u64, usize, f64)>,
}

#[derive(Clone, Default)]
struct Log(Arc<Mutex<Kept>>);

impl Log {
    fn say(&self, what: std::fmt::Arguments<'_>) {
        let mut kept = self.0.lock().expect("no panic");
        let line = format!("{:.3} {what}", kept.now.as_secs_f64());
        kept.lines.push(line);
    }

    fn wrong(&self, why: String) {
        self.say(format_args!("wrong: {why}"));
        self.0.lock().expect("no panic").wrong.get_or_insert(why);
    }

    /// A node that lies costs little: steps are made all the time, the first hull comes soon, and then is there but for a
    /// second.
    fn check_blindness(&self) {
        let (blind, first_hull_s, steps) = {
            let kept = self.0.lock().expect("no panic");
            (kept.blind_steps, kept.first_hull_s, kept.steps)
        };
        match blind {
            Some(..=MOST_BLIND_STEPS) => {}
            other => self.wrong(format!("steps without a hull: {other:?}")),
        }
        if first_hull_s.is_none_or(|at_s| at_s > FIRST_HULL_WITHIN_S) {
            self.wrong(format!("the first hull came at {first_hull_s:?} s"));
        }
        if steps < LEAST_STEPS {
            self.wrong(format!("{steps} steps were made, expected {LEAST_STEPS}"));
        }
    }

    /// The restarted coordinator goes on from where it was, and says so.
    fn check_gone_on(&self) {
        let kept = self.0.lock().expect("no panic");
        let gone_on = kept.lines.iter().filter(|line| line.contains("goes on from step")).count();
        drop(kept);
        if gone_on != 1 {
            self.wrong(format!("it went on {gone_on} times from a world that nodes remember"));
        }
    }

    /// At the end all cameras are there, and have been for a while.
    fn check_end(&self) {
        let used = self.0.lock().expect("no panic").used;
        match used {
            Some((_, CAMERAS, now_s)) if now_s > RUN_S as f64 - 0.5 => {}
            other => self.wrong(format!("at the end it uses (frame, cameras, since) {other:?}")),
        }
    }
}

impl Recorder for Log {
    fn frame(&mut self, record: FrameRecord<'_>) {
        let cameras = record.reports.iter().map(|report| report.cameras.len()).sum();
        let mut kept = self.0.lock().expect("no panic");
        let now_s = kept.now.as_secs_f64();
        kept.used = Some((record.frame, cameras, now_s));
        drop(kept);
        if now_s > WHOLE_S && cameras < CAMERAS {
            self.wrong(format!("frame {} has {cameras} cameras at {now_s} s", record.frame));
        }
    }

    fn step(&mut self, record: &StepRecord<'_>) {
        let responses = record.responses.iter().filter(|response| response.inside_samples > 0).count();
        let digest = record.world.digest().to_string();
        self.say(format_args!(
            "step {} film {:.6} frame {:?} touching {responses} {}",
            record.step, record.film_s, record.frame, digest
        ));
        for body in record.world.moving_bodies() {
            let speed_m_s = body.velocity_m_s.map(|part| part * part).iter().sum::<f64>().sqrt();
            let is_somewhere = body.pose.world_from_body()([0.0; 3]).iter().all(|m| m.is_finite());
            if !(is_somewhere && speed_m_s < FASTEST_M_S) {
                self.wrong(format!("{} moves {speed_m_s} m/s", body.name));
            }
        }
        let mut kept = self.0.lock().expect("no panic");
        kept.steps += 1;
        kept.blind_steps = match (record.frame, kept.blind_steps) {
            (None, None) => None,
            (Some(_), blind) => Some(blind.unwrap_or_default()),
            (None, Some(blind)) => Some(blind + 1),
        };
        if record.frame.is_some() && kept.first_hull_s.is_none() {
            kept.first_hull_s = Some(kept.now.as_secs_f64());
        }
        let before = std::mem::replace(&mut kept.last_step, record.step);
        let is_blind = record.frame.is_none() && kept.now.as_secs_f64() > WHOLE_S;
        let may_forget = kept.node_deaths >= NODES;
        drop(kept);
        if is_blind {
            self.wrong(format!("step {} has no hull", record.step));
        }
        if record.step > before + 1 {
            self.wrong(format!("step {} follows step {before}: steps between are missing", record.step));
        }
        if record.step + MOST_LOST_STEPS < before && !may_forget {
            self.wrong(format!("step {} follows step {before}", record.step));
        }
    }

    fn end(&mut self, _: &EndRecord<'_>) {}
}

impl Watcher for Log {
    fn gone_on(&mut self, from: &GoneOn) {
        self.say(format_args!("goes on from step {}", from.steps));
    }

    fn progress(&mut self, progress: &Progress) {
        self.say(format_args!("latency {:.3} ms, {:?}", progress.latency_ms, progress.hull_unavailable));
    }

    fn wants_snapshot(&mut self, _: f64) -> bool {
        false
    }

    fn snapshot(&mut self, _: Snapshot<'_>) {}
}

/// What the program itself logs.
impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(bytes).trim_end().to_owned();
        let mut kept = self.0.lock().expect("no panic");
        // Whatever is lost on the way, no node is sent a question that it cannot read.
        if FIELDS_OF_QUESTIONS.iter().any(|field| text.contains(field)) {
            kept.wrong.get_or_insert_with(|| format!("a question that is malformed: {text}"));
        }
        kept.lines.push(text);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for Log {
    type Writer = Log;

    fn make_writer(&'a self) -> Log {
        self.clone()
    }
}

struct SimulatedTime;

impl FormatTime for SimulatedTime {
    fn format_time(&self, writer: &mut Writer<'_>) -> std::fmt::Result {
        let now = turmoil::sim_elapsed().unwrap_or_default();
        write!(writer, "{:.3}", now.as_secs_f64())
    }
}

/// Sockets to simulated hosts.
struct SimulatedNetwork;

impl Dial for SimulatedNetwork {
    fn hint(&self) -> String {
        "the network is cut".to_owned()
    }

    fn dial(&self, to: Destination) -> BoxFuture<'static, std::io::Result<Box<dyn Socket>>> {
        Box::pin(async move {
            let Address::Tcp(address) = to.address else {
                return Err(std::io::ErrorKind::Unsupported.into());
            };
            let socket: Box<dyn Socket> = Box::new(TcpStream::connect(address).await?);
            Ok(socket)
        })
    }
}

/// A connection that a simulated host has accepted.
pub struct SimulatedSocket(TcpStream);

impl Connected for SimulatedSocket {
    type ConnectInfo = ();

    fn connect_info(&self) {}
}

impl AsyncRead for SimulatedSocket {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_read(context, buffer)
    }
}

impl AsyncWrite for SimulatedSocket {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<std::io::Result<usize>> {
        Pin::new(&mut self.0).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_shutdown(context)
    }
}
