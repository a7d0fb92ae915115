//! One node: asks it and tells it things. `keeping` connects with backoff, checks who answers, keeps its streams open and
//! hands on what it reports.

mod keeping;
mod state;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use film_time::{BackgroundFilm, ClockLine, FilmEvent, Pace, RunStart, monotonic_s};
use hull::question::Question;
use hull::{Shape, Silhouette};
use parking_lot::{Mutex, MutexGuard};
use proto::convert::{
    ExpectedAnswer, ExpectedCamera, ProbeAnswer, SilhouetteEncoding, StreamKnows, WrittenQuestion,
    shape_to_wire, silhouette_from_data, start_to_wire,
};
use proto::{CameraDescription, Claim, TraceParent, v1};
use tokio::sync::{Notify, mpsc};

use self::state::State;
use crate::agreement::{Agreement, ExpectedNode};
use crate::error::NodeError;
use crate::reply_limits::{NodeCalls, ReplyLimits};

/// Requests on their way: a pass asks two questions at a time at most, and a stalled node must not collect more.
const MAX_SENDING: usize = 8;
/// Questions whose replies are read. Earlier ones are given up: what they need to be read is not kept for a silent node.
const MAX_OPEN: usize = 2;

/// What a node reports.
#[derive(Debug)]
pub enum NodeEvent {
    /// It is connected, checked, and has received shapes and pace. What it reported before no longer holds.
    Up,
    /// The connection broke, or could not be made.
    Down(NodeError),
    /// Of its film.
    Film {
        /// Of which run.
        run: u64,
        /// What the node reports.
        event: FilmEvent,
        /// When it came, by this process's monotonic clock, seconds.
        heard_s: f64,
    },
    /// Film time there may be off by so much, seconds.
    Clock(f64),
    /// The answer to the question of that id, and the milliseconds that it computed.
    Reply(u64, ProbeAnswer, f64),
}

/// The client of one node.
pub struct NodeClient {
    node: ExpectedNode,
    index: usize,
    agreement: Arc<Agreement>,
    events: mpsc::Sender<(usize, NodeEvent)>,
    /// The term of our claim to this node.
    term: AtomicU64,
    limits: Arc<ReplyLimits>,
    state: Mutex<State>,
    /// The connection in use is of no use.
    given_up: Notify,
    /// Held while shapes are registered once more.
    registering: tokio::sync::Mutex<()>,
}

impl NodeClient {
    /// Begins to connect, and does so again whenever the connection breaks, until the receiver of events is gone. They
    /// carry `index`. Must run within a tokio runtime.
    pub fn spawn(
        node: ExpectedNode,
        index: usize,
        agreement: Arc<Agreement>,
        events: mpsc::Sender<(usize, NodeEvent)>,
    ) -> Arc<NodeClient> {
        let (term, state) = (AtomicU64::new(0), Mutex::default());
        let limits = ReplyLimits::of(&node.cameras);
        let given_up = Notify::new();
        let registering = tokio::sync::Mutex::default();
        let client = Arc::new(NodeClient {
            node,
            index,
            agreement,
            events,
            term,
            limits,
            state,
            given_up,
            registering,
        });
        client.state().credit = client.no_credit();
        tokio::spawn(Arc::clone(&client).keep_connected());
        client
    }

    /// The node that is meant.
    pub fn node(&self) -> &ExpectedNode {
        &self.node
    }

    /// What a short question to it usually takes, seconds.
    pub fn trip_s(&self) -> f64 {
        self.state().clock.trip_s()
    }

    /// Our monotonic clock by the node's, once that was read.
    pub fn clock(&self) -> Option<ClockLine> {
        self.state().clock_line
    }

    /// Gives up the connection in use, or being made, for another: the node does not answer, or does not know of the run.
    pub fn reconnect(&self) {
        self.given_up.notify_waiters();
    }

    /// Questions that it has not answered.
    pub fn open_questions(&self) -> usize {
        self.state().open.len()
    }

    /// Begins a run at this node.
    pub async fn start(&self, pace: Pace) -> Result<(), NodeError> {
        let mut client = self.client()?;
        {
            let mut state = self.state();
            state.credit = self.no_credit();
            state.last_of_film = None;
        }
        client.start(self.run_start(pace)?).await?;
        Ok(())
    }

    /// A run as this node is told of it: its clock has been read.
    fn run_start(&self, pace: Pace) -> Result<v1::StartRequest, NodeError> {
        let clock = self.state().clock.film_time(pace.zero_s, monotonic_s());
        let start = start_to_wire(RunStart::of(pace, clock.ok_or(NodeError::NotConnected)?));
        Ok(v1::StartRequest { holder: self.holder(), ..start })
    }

    /// Our claim to the node, whose lease has this term: the same for as long as we live, so that
    /// a coordinator that displaces us is not displaced again.
    fn claim(&self, held_term: u64) -> Claim {
        let claim = self.agreement.claim(held_term);
        let kept = self.term.compare_exchange(0, claim.term, Ordering::Relaxed, Ordering::Relaxed);
        Claim { term: kept.err().unwrap_or(claim.term), ..claim }
    }

    /// By what the node knows us.
    pub(crate) fn holder(&self) -> u64 {
        self.agreement.holder()
    }

    fn no_credit(&self) -> v1::FrameCredit {
        v1::FrameCredit { holder: self.holder(), ..v1::FrameCredit::default() }
    }

    /// Lets a lock-step node go on up to a frame.
    pub fn credit(&self, up_to_frame: u64) {
        let mut state = self.state();
        if state.credit.up_to_frame < up_to_frame {
            state.credit.up_to_frame = up_to_frame;
            state.send_credit();
        }
    }

    /// Has the node keep a frame, however old it gets, until another is in use.
    pub fn use_frame(&self, frame: u64) {
        let mut state = self.state();
        if state.credit.in_use != Some(frame) {
            state.credit.in_use = Some(frame);
            state.send_credit();
        }
    }

    /// Puts a question about a frame's cameras (places in the rig; none: all that it has) on its way, as a part of a trace;
    /// an error if the node is not there, or does not read.
    pub fn ask(
        &self,
        id: u64,
        (frame, cameras): (u64, Vec<u32>),
        question: &Question,
        written: &WrittenQuestion,
        trace: Option<TraceParent>,
    ) -> Result<(), NodeError> {
        let mut state = self.state();
        let State { connection, knows, open, .. } = &mut *state;
        let connection = connection.as_ref().ok_or(NodeError::NotConnected)?;
        let is_asked =
            |camera: &&ExpectedCamera| cameras.is_empty() || cameras.contains(&camera.rig_index.into());
        let asked = self.node.expected_cameras.iter().filter(is_asked).copied().collect();
        let expected = ExpectedAnswer::new(question, written.points_world(), asked);
        self.limits.asked(expected.most_bytes(), !open.is_empty());
        let holder = self.holder();
        let traceparent = trace_field(trace);
        let message = v1::ProbeRequest { holder, cameras, traceparent, ..written.message(knows, id, frame) };
        connection.probes.try_send(message).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => NodeError::Stalled,
            mpsc::error::TrySendError::Closed(_) => NodeError::NotConnected,
        })?;
        knows.learn(written);
        if open.len() == MAX_OPEN {
            open.pop_front();
        }
        open.push_back((id, expected));
        Ok(())
    }

    /// Sends everything again with the next question: one was refused, so what the node has is unknown.
    pub fn forget_sent(&self) {
        self.state().knows = StreamKnows::default();
    }

    /// Registers the run's shapes once more.
    pub async fn register_again(&self) -> Result<(), NodeError> {
        let Ok(_one_at_a_time) = self.registering.try_lock() else {
            // Over a narrow link one takes long, and several take longer.
            drop(self.registering.lock().await);
            return Ok(());
        };
        let shapes = self.agreement.terms().shapes.clone();
        self.register(&shapes).await
    }

    /// Registers shapes.
    pub async fn register(&self, shapes: &[Arc<Shape>]) -> Result<(), NodeError> {
        register(&mut self.client()?, shapes, self.holder()).await
    }

    /// Has the node's cameras learn their backgrounds again, and waits until they have; or only asks whether they can.
    pub async fn take_background(&self, film: BackgroundFilm, check_only: bool) -> Result<(), NodeError> {
        let BackgroundFilm { id, first_frame, frames, allow_foreground } = film;
        let holder = self.holder();
        let request =
            v1::TakeBackgroundRequest { id, first_frame, frames, check_only, holder, allow_foreground };
        self.client()?.take_background(request).await?;
        Ok(())
    }

    /// Has the cameras whose backgrounds have that id use the ones before again.
    pub async fn restore_background(&self, id: u64) -> Result<(), NodeError> {
        let request = v1::RestoreBackgroundRequest { id, holder: self.holder() };
        self.client()?.restore_background(request).await?;
        Ok(())
    }

    /// The silhouettes of a frame by place in the rig, and how many bytes they travelled as.
    pub async fn silhouettes(
        &self,
        frame: u64,
        encoding: SilhouetteEncoding,
        trace: Option<TraceParent>,
    ) -> Result<(Vec<(u16, Silhouette)>, u64), NodeError> {
        let encoding_wire = v1::SilhouetteEncoding::from(encoding).into();
        let request =
            v1::FetchSilhouettesRequest { frame, encoding: encoding_wire, traceparent: trace_field(trace) };
        let mut stream = self.client()?.fetch_silhouettes(request).await?.into_inner();
        let expected = self.node.cameras.len();
        let mut bytes = 0;
        let mut found: Vec<(u16, Silhouette)> = Vec::with_capacity(expected);
        while let Some(v1::Silhouette { rig_index, data }) = stream.message().await? {
            let camera = self.node.cameras.iter().find(|camera| u32::from(camera.rig_index) == rig_index);
            let is_new =
                |camera: &&CameraDescription| found.iter().all(|(known, _)| *known != camera.rig_index);
            let wrong = NodeError::Cameras { found: found.len() + 1, expected };
            let camera = camera.filter(is_new).ok_or(wrong)?;
            bytes += data.len() as u64;
            found.push((camera.rig_index, silhouette_from_data(&data, camera.size, encoding)?));
        }
        // A frame may have gone on without some camera.
        if found.is_empty() {
            return Err(NodeError::Cameras { found: 0, expected });
        }
        Ok((found, bytes))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    pub(crate) fn client(&self) -> Result<NodeCalls, NodeError> {
        let state = self.state();
        state.connection.as_ref().map(|connection| connection.client.clone()).ok_or(NodeError::NotConnected)
    }
}

/// As messages name a span; empty: none.
fn trace_field(trace: Option<TraceParent>) -> String {
    trace.map_or_else(String::new, |parent| parent.to_string())
}

async fn register(client: &mut NodeCalls, shapes: &[Arc<Shape>], holder: u64) -> Result<(), NodeError> {
    let shapes = shapes.iter().map(|shape| shape_to_wire(shape)).collect();
    client.register_shapes(v1::RegisterShapesRequest { shapes, holder }).await?;
    Ok(())
}
