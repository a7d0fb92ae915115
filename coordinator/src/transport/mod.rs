//! Three layouts behind one face: `cluster` (questions travel, nodes compute), `gather` (silhouettes travel, one
//! machine computes: the paper's layout) and `in process` (nothing travels); and `auto`, the faster of the first two,
//! measured as a run goes. They wait; what is decided from what
//! they receive is decided by the [`Roster`] and the pass.

mod cluster;
mod fan_out;
mod gather;
mod in_process;
mod nodes;
mod remote;
mod trace;

use std::sync::Arc;
use std::time::Duration;

use film_time::{BackgroundFilm, FilmState, Pace};
use futures::future::BoxFuture;
use hull::pass::{Pass, Round};
use hull::{Observer, Shape, Silhouette};
use node_client::{Agreement, ByteCounts, ExpectedNode, NodeClient, NodeError};
use proto::convert::{Precision, SilhouetteEncoding};
use telemetry::Span;
use thiserror::Error;
use tokio::sync::mpsc;
use tokio::time::Instant;

use crate::core::answering::Answering;
use crate::core::command::Refusal;
use crate::roster::{Missing, Roster, RosterNode, joined};
use in_process::InProcess;
use nodes::{CALL_TIMEOUT, Nodes};
use remote::Remote;
use trace::pass_span;

pub use in_process::LocalFrames;

/// An error of cameras in this process.
pub type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// Events of one node that wait: a second of film at 60 frames/s, the reply to its one open question, and its end.
const MAX_EVENTS_PER_NODE: usize = 64;

/// Why nodes, or the cameras of this process, did not do what they were asked.
#[derive(Debug, Error)]
pub enum TransportError {
    /// A node failed.
    #[error("node {node}: {error}")]
    Node {
        /// The node and its cameras.
        node: String,
        /// What failed.
        error: NodeError,
    },
    /// A node's answer does not fit its question.
    #[error("node {node}: invalid reply: {error}")]
    Answer {
        /// The node and its cameras.
        node: String,
        /// What does not fit.
        error: hull::pass::AnswerError,
    },
    /// A node is led by another coordinator.
    #[error(transparent)]
    Held(Missing),
    /// Nodes are not there.
    #[error("{}", joined(.0))]
    Missing(Vec<Missing>),
    /// A frame of this process's cameras is no longer there.
    #[error("frame {frame} is gone")]
    Gone {
        /// Number of the frame.
        frame: u64,
    },
    /// A frame did not come in time.
    #[error("not every node has frame {frame} after {} s", timeout.as_secs())]
    Late {
        /// Number of the frame.
        frame: u64,
        /// In which time.
        timeout: Duration,
    },
    /// Film failed for good.
    #[error("{0}")]
    FilmFailed(String),
    /// The cameras of this process.
    #[error("{0}")]
    Local(BoxError),
}

impl From<TransportError> for Refusal {
    fn from(error: TransportError) -> Refusal {
        Refusal::Nodes(error.into())
    }
}

impl TransportError {
    fn of(client: &NodeClient, error: NodeError) -> TransportError {
        TransportError::Node { node: client.node().to_string(), error }
    }

    /// True where a node will not, rather than cannot at present.
    pub(crate) fn is_refusal(&self) -> bool {
        matches!(self, TransportError::Node { error: NodeError::Refused(_), .. })
    }
}

/// A layout, connected, and who is there.
pub struct Transport {
    roster: Roster,
    layout: Layout,
}

enum Layout {
    Remote(Box<Remote>),
    InProcess(Box<InProcess>),
}

/// Where probes about the cameras of nodes are computed; with the observers of the whole rig, in rig order.
pub enum Placement {
    /// At the nodes.
    Nodes,
    /// Here: silhouettes travel.
    Here(Vec<Arc<Observer>>),
    /// At the nodes, or here where that is faster: measured as a run goes.
    Fastest(Vec<Arc<Observer>>),
}

/// The first frame of film that a background is learnt from: one that no camera has filmed before the message
/// arrives, so that all begin at the same one.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FirstFrame {
    /// This one.
    At(u64),
    /// So many after the newest.
    AfterNewest(u64),
}

/// A background that all cameras are to learn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WantedBackground {
    /// See [`BackgroundFilm`].
    pub id: u64,
    pub first: FirstFrame,
    /// Frames of film.
    pub frames: u64,
    /// See [`BackgroundFilm`].
    pub allow_foreground: bool,
    /// Until all cameras have learnt it.
    pub takes_at_most: Duration,
}

impl WantedBackground {
    fn film(&self, first_frame: u64) -> BackgroundFilm {
        let WantedBackground { id, frames, allow_foreground, .. } = *self;
        BackgroundFilm { id, first_frame, frames, allow_foreground }
    }
}

impl Transport {
    /// Connects to nodes. Must run within a tokio runtime.
    pub fn connect(nodes: Vec<ExpectedNode>, placement: Placement, agreement: Agreement) -> Transport {
        let agreement = Arc::new(agreement);
        let (sender, events) = mpsc::channel(MAX_EVENTS_PER_NODE * nodes.len().max(1));
        let places = |node: &ExpectedNode| node.cameras.iter().map(|camera| camera.rig_index).collect();
        let roster_nodes =
            nodes.iter().map(|node| RosterNode::new(node.to_string(), places(node)).endless(node.is_endless));
        let roster = Roster::new(roster_nodes.collect());
        let spawn = |(index, node)| NodeClient::spawn(node, index, Arc::clone(&agreement), sender.clone());
        let clients = nodes.into_iter().enumerate().map(spawn).collect();
        let nodes = Nodes::new(clients, agreement, events);
        Transport { roster, layout: Layout::Remote(Box::new(Remote::new(nodes, placement))) }
    }

    /// Cameras of this process.
    pub fn in_process(frames: Box<dyn LocalFrames>) -> Transport {
        let (cameras, roster) = InProcess::new(frames);
        Transport { roster, layout: Layout::InProcess(Box::new(cameras)) }
    }

    /// Gathers silhouettes in another encoding than runs and LZ4: for measurements.
    pub fn with_silhouettes_as(self, encoding: SilhouetteEncoding) -> Transport {
        self.remotely(|remote| remote.with_silhouettes_as(encoding))
    }

    /// Asks and answers with rounded numbers, or again with exact ones: see [`Precision`].
    pub fn with_precision(self, precision: Precision) -> Transport {
        self.remotely(|remote| remote.with_precision(precision))
    }

    fn remotely(self, change: impl FnOnce(Remote) -> Remote) -> Transport {
        let layout = match self.layout {
            Layout::Remote(remote) => Layout::Remote(Box::new(change(*remote))),
            other => other,
        };
        Transport { layout, ..self }
    }

    /// Who is there and what they have reported, as of the last wait.
    pub fn roster(&self) -> &Roster {
        &self.roster
    }

    /// The same, to decide whom steps go on without.
    pub(crate) fn roster_mut(&mut self) -> &mut Roster {
        &mut self.roster
    }

    /// Where the answers to a pass come from.
    pub(crate) fn answering(&self) -> Answering {
        match &self.layout {
            Layout::Remote(remote) if remote.asks() => Answering::Nodes(remote.nodes.clients.len()),
            Layout::Remote(_) => Answering::Gathered,
            Layout::InProcess(_) => Answering::InProcess,
        }
    }

    /// Whether nodes answer passes, so that a question takes a trip.
    pub fn asks_nodes(&self) -> bool {
        self.answering().asks_nodes()
    }

    /// How many groups a pass asks.
    pub fn group_count(&self) -> usize {
        self.answering().group_count()
    }

    /// Between two frames: goes on where probes are computed faster. True if that is elsewhere: passes ask other groups.
    pub(crate) fn choose_placement(&mut self) -> bool {
        let Layout::Remote(remote) = &mut self.layout else { return false };
        let has_changed = remote.choose();
        if has_changed {
            let placement = if remote.asks() { "nodes compute" } else { "silhouettes are gathered" };
            tracing::info!("{placement}: that is faster now");
        }
        has_changed
    }

    fn nodes(&self) -> Option<&Nodes> {
        match &self.layout {
            Layout::Remote(remote) => Some(&remote.nodes),
            Layout::InProcess(_) => None,
        }
    }

    /// One a node; none where cameras are in this process.
    pub(crate) fn clients(&self) -> &[Arc<NodeClient>] {
        self.nodes().map_or(&[], |nodes| &nodes.clients)
    }

    /// Takes note of what has come, without waiting.
    pub fn drain(&mut self) {
        let Transport { roster, layout } = self;
        match layout {
            Layout::Remote(remote) => remote.nodes.drain(roster),
            Layout::InProcess(cameras) => cameras.drain(roster),
        }
    }

    /// Waits until something has come, and takes note of it. Safe to abandon.
    pub async fn next(&mut self) {
        let Transport { roster, layout } = self;
        match layout {
            // Replies outside a pass come too late.
            Layout::Remote(remote) => drop(remote.nodes.next(roster).await),
            Layout::InProcess(cameras) => cameras.next(roster).await,
        }
    }

    /// The same for at most so long.
    pub async fn next_within(&mut self, at_most: Duration) {
        // Whether news or the clock ended the wait is for the caller to see.
        let _ = tokio::time::timeout(at_most, self.next()).await;
    }

    /// Waits until every node is there; after `timeout`, says which are not and why.
    pub async fn ready(&mut self, timeout: Duration) -> Result<(), TransportError> {
        let deadline = Instant::now() + timeout;
        loop {
            self.drain();
            if let Some(held) = self.roster.displaced() {
                return Err(TransportError::Held(held));
            }
            let missing: Vec<Missing> = self.roster.missing().collect();
            if missing.is_empty() {
                return Ok(());
            }
            let news = tokio::time::timeout_at(deadline, self.next()).await;
            if news.is_err() || Instant::now() > deadline {
                return Err(TransportError::Missing(missing));
            }
        }
    }

    /// Waits until every node has a frame.
    pub async fn frame(&mut self, frame: u64, timeout: Duration) -> Result<(), TransportError> {
        let deadline = Instant::now() + timeout;
        loop {
            self.drain();
            if self.roster.newest_common(frame) == Some(frame) {
                return Ok(());
            }
            if let FilmState::Failed(why) = self.roster.film(frame) {
                return Err(TransportError::FilmFailed(why));
            }
            let news = tokio::time::timeout_at(deadline, self.next()).await;
            if news.is_err() || Instant::now() > deadline {
                return Err(TransportError::Late { frame, timeout });
            }
        }
    }

    /// Starts a run at all nodes; a live one also if some do not start and the others have at least so many cameras. From now
    /// on passes may ask other groups.
    pub async fn start(&mut self, pace: Pace, least_cameras: Option<usize>) -> Result<(), TransportError> {
        self.drain();
        self.roster.begin_run();
        if let Some(nodes) = self.nodes() {
            nodes.begin_run();
        }
        let Transport { roster, layout } = self;
        match layout {
            Layout::Remote(remote) => {
                remote.begin(roster);
                remote.nodes.start(pace, least_cameras).await
            }
            Layout::InProcess(cameras) => cameras.frames.start(pace).map_err(TransportError::Local),
        }
    }

    /// Lets a lock-step run go on up to a frame.
    pub fn credit(&self, up_to_frame: u64) {
        match &self.layout {
            Layout::Remote(remote) => remote.nodes.credit(up_to_frame),
            Layout::InProcess(cameras) => cameras.frames.credit(up_to_frame),
        }
    }

    /// Makes all nodes keep a frame, however old it gets, until another is in use.
    pub(crate) fn use_frame(&self, frame: u64) {
        match &self.layout {
            Layout::Remote(remote) => remote.nodes.use_frame(frame),
            Layout::InProcess(cameras) => cameras.frames.use_frame(frame),
        }
    }

    /// Makes shapes known to all nodes, also to those that come back later: these and no others. Takes at most so long.
    pub(crate) async fn register_shapes(
        &mut self,
        shapes: Vec<Arc<Shape>>,
        at_most: Duration,
    ) -> Result<(), TransportError> {
        let Transport { roster, layout: Layout::Remote(remote) } = self else { return Ok(()) };
        let new = remote.nodes.agreement.replace_shapes(shapes);
        // Where silhouettes are gathered, no node is asked about shapes.
        if new.is_empty() || !remote.may_ask() {
            return Ok(());
        }
        remote.nodes.register(&new, at_most, roster).await
    }

    /// Has every camera of every node learn its background again. If one cannot, all keep theirs. What is returned holds on to the
    /// nodes by itself.
    pub(crate) fn take_background(
        &self,
        wanted: WantedBackground,
    ) -> BoxFuture<'static, Result<(), TransportError>> {
        match &self.layout {
            Layout::Remote(remote) => Box::pin(remote.nodes.take_background(wanted)),
            Layout::InProcess(cameras) => {
                let first_frame = match wanted.first {
                    FirstFrame::At(frame) => frame,
                    FirstFrame::AfterNewest(later) => {
                        self.roster.newest().map_or(0, |newest| newest + 1) + later
                    }
                };
                let taken = cameras.frames.take_background(wanted.film(first_frame));
                let taken = tokio::time::timeout(wanted.takes_at_most, taken);
                let late = "a camera did not film its background in time";
                Box::pin(async move {
                    taken.await.unwrap_or_else(|_| Err(late.into())).map_err(TransportError::Local)
                })
            }
        }
    }

    /// Has every camera use the background again that was in use before the one of that id.
    pub(crate) fn restore_background(&self, id: u64) -> BoxFuture<'static, Result<(), TransportError>> {
        match &self.layout {
            Layout::Remote(remote) => Box::pin(remote.nodes.restore_background(id)),
            Layout::InProcess(cameras) => {
                cameras.frames.restore_background(id);
                Box::pin(futures::future::ready(Ok(())))
            }
        }
    }

    /// Answers a pass over a frame; a round may take `timeout`, or without one three usual ones and a little. `took`
    /// receives each round and its milliseconds.
    pub async fn run_pass(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        timeout: Option<Duration>,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), TransportError> {
        match &mut self.layout {
            Layout::Remote(remote) => {
                let layout = if remote.asks() { "cluster" } else { "gather" };
                remote.nodes.trace = pass_span(pass, frame, layout);
                let answered = remote.run_pass(pass, frame, timeout, &mut self.roster, took).await;
                let span = std::mem::take(&mut remote.nodes.trace);
                answered.inspect_err(|error| span.fail(error))
            }
            Layout::InProcess(cameras) => {
                let _span = pass_span(pass, frame, "inprocess");
                cameras.run_pass(pass, frame, took)
            }
        }
    }

    /// The silhouettes of a frame, for pictures and not for probes. What is returned holds on to the
    /// nodes by itself.
    pub(crate) fn silhouettes(&self, frame: u64) -> Fetching {
        if let Layout::InProcess(cameras) = &self.layout {
            let found = cameras.frames.silhouettes(frame).ok_or(TransportError::Gone { frame });
            return Box::pin(futures::future::ready(found));
        }
        let nodes = self.clients().iter().zip(self.roster.nodes());
        let there = nodes.filter(|(_, node)| !node.is_left_out());
        let clients: Vec<_> = there.map(|(client, _)| Arc::clone(client)).collect();
        Box::pin(async move {
            let fetching =
                nodes::fetch(&clients, frame, SilhouetteEncoding::RunsLz4, CALL_TIMEOUT, &Span::NONE);
            let silhouettes = fetching.await.0.map_err(|unfetched| unfetched.error)?.silhouettes;
            Ok(silhouettes.into_iter().map(|(place, silhouette)| (place, Arc::new(silhouette))).collect())
        })
    }

    /// Sends the messages of the last pass once more with nothing in them, where nodes are asked: what a pass is
    /// measured against. A trip may take `timeout`.
    pub async fn fan_out(&mut self, frame: u64, timeout: Duration) -> Result<(), TransportError> {
        let Transport { roster, layout } = self;
        match layout {
            Layout::Remote(remote) => remote.fan_out(frame, timeout, roster).await,
            Layout::InProcess(_) => Ok(()),
        }
    }

    /// Bytes at the sockets so far.
    pub fn bytes(&self) -> ByteCounts {
        self.nodes().map_or_else(ByteCounts::default, |nodes| nodes.agreement.bytes())
    }

    /// How many events of nodes wait for the loop, and how many may.
    pub(crate) fn waiting_events(&self) -> Option<(usize, usize)> {
        self.nodes().map(Nodes::waiting_events)
    }

    /// Bytes of silhouettes fetched to answer probes.
    pub fn silhouette_bytes(&self) -> u64 {
        if let Layout::Remote(remote) = &self.layout { remote.gather.silhouette_bytes } else { 0 }
    }
}

/// Silhouettes of a frame by their cameras' places in the rig, ascending: of those that it has.
pub type Silhouettes = Vec<(u16, Arc<Silhouette>)>;

/// Silhouettes on their way, or why they did not come.
pub type Fetching = BoxFuture<'static, Result<Silhouettes, TransportError>>;
