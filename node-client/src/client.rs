//! One node: connects with backoff, checks who answers, keeps its streams open and hands on what it reports.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use futures::future::BoxFuture;
use futures::stream::FuturesUnordered;
use hull::question::Question;
use hull::{Shape, Silhouette};
use proto::convert::{
    ExpectedAnswer, ProbeAnswer, SilhouetteEncoding, StreamKnows, WrittenQuestion, answer_from_wire,
    claim_to_wire, description_from_wire, film_event_from_wire, node_clock_from_wire, shape_to_wire,
    silhouette_from_data, start_to_wire,
};
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{
    Address, CameraDescription, Claim, ClockLine, FilmEvent, Pace, RunStart, TraceParent, monotonic_s, v1,
};
use tokio::sync::{Notify, mpsc};
use tokio::time::Instant;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Channel;

use crate::agreement::{Agreement, ExpectedNode, Terms};
use crate::connection::connect;
use crate::error::NodeError;
use crate::film_time::ClockEstimate;

/// Requests on their way: a pass has one question at a time, and a stalled node must not collect more.
const MAX_SENDING: usize = 8;
const FIRST_BACKOFF: Duration = Duration::from_millis(50);
const LONGEST_BACKOFF: Duration = Duration::from_secs(1);
/// All calls of a connection's beginning together: sources open, programs start.
const BEGIN_TIMEOUT: Duration = Duration::from_secs(30);
/// Who answers at an address that was only found must say who it is within this.
const FOUND_TIMEOUT: Duration = Duration::from_secs(5);

/// A node that another holds is asked so often, and for so long: whoever held it may have lost power just now.
const CLAIM_EVERY: Duration = Duration::from_millis(200);
const HELD_PATIENCE: Duration = Duration::from_secs(2);

/// What is still on its way over an old connection comes within this.
const LAST_WORDS: Duration = Duration::from_secs(1);
/// A renewal that fails is tried again after this part of a connection's age.
const RENEW_AGAIN: f64 = 0.03;

/// How often the clock of a node is read, and first how many times before a run begins there.
const CLOCK_EVERY: Duration = Duration::from_millis(500);
const FIRST_READINGS: usize = 4;
/// A node that answers nothing else for so long is connected anew: film time there would go astray.
const CLOCK_TIMEOUT: Duration = Duration::from_secs(5);
/// The longest description that is read.
const MAX_DESCRIPTION_BYTES: usize = 1 << 20;

/// What a node reports.
#[derive(Debug)]
pub enum NodeEvent {
    /// It is connected, checked, and has received shapes and pace. What it reported before no longer holds.
    Up,
    /// The connection broke, or could not be made.
    Down(NodeError),
    /// Of its film.
    Film {
        /// What.
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
    state: Mutex<State>,
    /// The connection in use is of no use.
    given_up: Notify,
}

#[derive(Default)]
struct State {
    connection: Option<Connection>,
    /// What the probe stream has received.
    knows: StreamKnows,
    /// Questions without an answer; the oldest is forgotten first.
    open: VecDeque<(u64, ExpectedAnswer)>,
    /// All that the node may do so far; each message says all of it.
    credit: v1::FrameCredit,
    clock: ClockEstimate,
    /// What it said last: our clock by the node's.
    clock_line: Option<ClockLine>,
    /// How often the connection was renewed since it was made, and when last.
    renewals: u64,
    renewed: Option<Instant>,
    /// The last event of film that was reported of this run.
    last_of_film: Option<FilmEvent>,
}

impl State {
    /// Begins anew over another connection; what the node may do stays.
    fn connect(&mut self, connection: Connection) {
        let (credit, clock) = (self.credit, std::mem::take(&mut self.clock));
        *self = State { connection: Some(connection), credit, clock, ..State::default() };
        self.send_credit();
    }

    /// Goes on over another connection to the same node. Questions that are open are answered over the old one.
    fn renew(&mut self, connection: Connection) {
        self.connection = Some(connection);
        self.knows = StreamKnows::default();
        self.renewals += 1;
        self.renewed = Some(Instant::now());
        self.send_credit();
    }

    /// Whether an event of film is news: where two connections overlap, both report it.
    fn is_news(&mut self, event: &FilmEvent) -> bool {
        let overlaps = self.renewed.is_some_and(|renewed| renewed.elapsed() < 3 * LAST_WORDS);
        let is_known = match (event, &self.last_of_film) {
            _ if !overlaps => false,
            (FilmEvent::Frame(new), Some(FilmEvent::Frame(last))) => new.frame <= last.frame,
            (new, Some(last)) => new == last,
            (_, None) => false,
        };
        if !is_known {
            self.last_of_film = Some(event.clone());
        }
        !is_known
    }

    /// Sends the credit. One that does not fit is dropped: the next includes it.
    fn send_credit(&self) {
        if let Some(connection) = &self.connection {
            let _ = connection.credits.try_send(self.credit);
        }
    }
}

struct Connection {
    client: CameraNodeClient<Channel>,
    probes: mpsc::Sender<v1::ProbeRequest>,
    credits: mpsc::Sender<v1::FrameCredit>,
}

/// The streams that a connection is read from.
struct Streams {
    replies: tonic::Streaming<v1::ProbeReply>,
    frames: tonic::Streaming<v1::FrameInfo>,
}

impl NodeClient {
    /// Begins to connect, and does so again whenever the connection breaks, until nobody receives events. They
    /// carry `index`. Must run within a tokio runtime.
    pub fn spawn(
        node: ExpectedNode,
        index: usize,
        agreement: Arc<Agreement>,
        events: mpsc::Sender<(usize, NodeEvent)>,
    ) -> Arc<NodeClient> {
        let (term, state) = (AtomicU64::new(0), Mutex::default());
        let client =
            Arc::new(NodeClient { node, index, agreement, events, term, state, given_up: Notify::new() });
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

    /// Gives up the connection in use, if there is one, for another: the node does not answer.
    pub fn connect_anew(&self) {
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

    /// Our claim to the node, which somebody holds with this term, or nobody: the same for as long as we live, so that
    /// whoever displaces us is not displaced again.
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
        let named =
            |camera: &&CameraDescription| cameras.is_empty() || cameras.contains(&camera.rig_index.into());
        let asked = self.node.cameras.iter().filter(named);
        let expected = asked.map(|camera| (camera.rig_index, camera.size)).collect();
        let holder = self.holder();
        let traceparent = trace_field(trace);
        let message = v1::ProbeRequest { holder, cameras, traceparent, ..written.message(knows, id, frame) };
        connection.probes.try_send(message).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => NodeError::Stalled,
            mpsc::error::TrySendError::Closed(_) => NodeError::NotConnected,
        })?;
        knows.learn(written);
        if open.len() == MAX_SENDING {
            open.pop_front();
        }
        let (kind, points) = (question.kind, question.len());
        open.push_back((id, ExpectedAnswer { kind, points, cameras: expected }));
        Ok(())
    }

    /// Sends everything anew with the next question: one was refused, so what the node has is unknown.
    pub fn forget_sent(&self) {
        self.state().knows = StreamKnows::default();
    }

    /// Registers the run's shapes once more.
    pub async fn register_again(&self) -> Result<(), NodeError> {
        let shapes = self.agreement.terms().shapes.clone();
        self.register(&shapes).await
    }

    /// Registers shapes.
    pub async fn register(&self, shapes: &[Arc<Shape>]) -> Result<(), NodeError> {
        register(&mut self.client()?, shapes, self.holder()).await
    }

    /// Has the node's cameras learn their backgrounds anew from so many frames; or only asks whether they can.
    pub async fn take_background(
        &self,
        first_frame: u64,
        frames: u64,
        check_only: bool,
    ) -> Result<(), NodeError> {
        let holder = self.holder();
        let request = v1::TakeBackgroundRequest { first_frame, frames, check_only, holder };
        self.client()?.take_background(request).await?;
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
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn client(&self) -> Result<CameraNodeClient<Channel>, NodeError> {
        let state = self.state();
        state.connection.as_ref().map(|connection| connection.client.clone()).ok_or(NodeError::NotConnected)
    }

    async fn report(&self, event: NodeEvent) -> Result<(), NodeError> {
        self.events.send((self.index, event)).await.map_err(|_| NodeError::Closed)
    }

    async fn keep_connected(self: Arc<NodeClient>) {
        let mut backoff = FIRST_BACKOFF;
        while !self.events.is_closed() {
            let begun = tokio::time::timeout(BEGIN_TIMEOUT, self.begin()).await;
            let error = match begun.unwrap_or(Err(NodeError::Timeout(BEGIN_TIMEOUT))) {
                Ok((connection, streams)) => {
                    backoff = FIRST_BACKOFF;
                    self.state().connect(connection);
                    tracing::debug!("node {} is up", self.node);
                    let error = tokio::select! {
                        biased;
                        error = self.read(streams) => error,
                        () = self.given_up.notified() => NodeError::NotConnected,
                    };
                    self.state().connection = None;
                    error
                }
                Err(error) => error,
            };
            // The run may have ended, and then there is nobody to hear it.
            let _ = self.report(NodeEvent::Down(error)).await;
            tokio::time::sleep(backoff).await;
            backoff = (backoff * 2).min(LONGEST_BACKOFF);
        }
    }

    async fn begin(&self) -> Result<(Connection, Streams), NodeError> {
        let (mut client, held_term) = self.reach().await?;
        if !self.agreement.observes() {
            self.lead(&mut client, held_term).await?;
        }
        open_streams(client).await
    }

    /// Another connection to a node that we lead already: who answers, and who asks, show certificates anew.
    async fn begin_anew(&self) -> Result<(Connection, Streams), NodeError> {
        let (mut client, held_term) = self.reach().await?;
        if !self.agreement.observes() {
            self.hold(&mut client, held_term).await?;
        }
        open_streams(client).await
    }

    /// Connects to the node, and says with which term somebody holds it. All addresses at which it may be are tried
    /// at once, so that nobody who only says to be the node keeps us from it.
    async fn reach(&self) -> Result<(CameraNodeClient<Channel>, u64), NodeError> {
        let addresses = self.node.place.addresses().await;
        if addresses.is_empty() {
            return Err(NodeError::NotFound);
        }
        let attempts = addresses.iter().map(|address| Box::pin(self.try_address(address)));
        futures::future::select_ok(attempts).await.map(|(reached, _)| reached)
    }

    async fn try_address(&self, address: &Address) -> Result<(CameraNodeClient<Channel>, u64), NodeError> {
        if !self.node.place.is_sought() {
            return self.connect_checked(address).await;
        }
        let tried = tokio::time::timeout(FOUND_TIMEOUT, self.connect_checked(address)).await;
        let tried = tried.unwrap_or(Err(NodeError::Timeout(FOUND_TIMEOUT)));
        let place = &self.node.place;
        tried
            .inspect(|_| place.set_checked(address))
            .map_err(|error| NodeError::At { address: address.clone(), error: Box::new(error) })
    }

    /// Connects, and checks who answers.
    async fn connect_checked(
        &self,
        address: &Address,
    ) -> Result<(CameraNodeClient<Channel>, u64), NodeError> {
        let client = connect(&self.node.at(address), &self.agreement.dial, &self.agreement.counters).await?;
        // Whoever answers: a thousand cameras are a quarter of that.
        let mut asked = client.clone().max_decoding_message_size(MAX_DESCRIPTION_BYTES);
        let described = asked.describe(v1::DescribeRequest {}).await;
        let described = described.map_err(|status| match NodeError::from(status) {
            NodeError::Lost(why) => NodeError::AtOnce { why, hint: self.agreement.dial.hint() },
            other => other,
        });
        let description = description_from_wire(described?.into_inner())?;
        self.agreement.check(&self.node, &description)?;
        Ok((client, description.term))
    }

    /// Claims the node, which somebody holds with this term, and begins the run there, if one is on.
    async fn lead(&self, client: &mut CameraNodeClient<Channel>, held_term: u64) -> Result<(), NodeError> {
        self.hold(client, held_term).await?;
        self.state().clock = ClockEstimate::default();
        for _ in 0..FIRST_READINGS {
            self.read_clock(client).await?;
        }
        let Terms { shapes, pace } = self.agreement.terms().clone();
        register(client, &shapes, self.holder()).await?;
        if let Some(pace) = pace {
            client.start(self.run_start(pace)?).await?;
        }
        Ok(())
    }

    /// Claims the node. One that holds us off may yet find that who holds it is gone.
    async fn hold(&self, client: &mut CameraNodeClient<Channel>, held_term: u64) -> Result<(), NodeError> {
        let claim = claim_to_wire(self.claim(held_term));
        let until = Instant::now() + HELD_PATIENCE;
        loop {
            match client.hold(claim.clone()).await.map_err(NodeError::from) {
                Err(NodeError::Held(_)) if Instant::now() < until => tokio::time::sleep(CLAIM_EVERY).await,
                held => return held.map(|_| ()),
            }
        }
    }

    /// Reads streams until one ends; returns why. They are renewed on the way.
    async fn read(&self, streams: Streams) -> NodeError {
        if let Err(error) = self.report(NodeEvent::Up).await {
            return error;
        }
        let mut parts = FuturesUnordered::new();
        self.read_parts(&mut parts, streams);
        let (mut renewal, mut time) = (Box::pin(self.renewed()), Box::pin(self.keep_time()));
        loop {
            tokio::select! {
                // Of several reasons at once the same is told each time.
                biased;
                ended = parts.next() => match ended {
                    // Those of an old connection end when nothing more comes over it.
                    Some((renewals, _)) if renewals != self.state().renewals => {}
                    Some((_, error)) => return error,
                    None => return NodeError::Closed,
                },
                error = &mut time => return error.err().unwrap_or(NodeError::Closed),
                (connection, streams) = &mut renewal => {
                    self.state().renew(connection);
                    self.read_parts(&mut parts, streams);
                    renewal.set(self.renewed());
                    tracing::debug!("the connection to node {} was renewed", self.node);
                }
            }
        }
    }

    /// Begins to read the streams of the connection that is in use now. A part ends with its stream, or some time after
    /// another connection is in use.
    fn read_parts<'a>(
        &'a self,
        parts: &mut FuturesUnordered<BoxFuture<'a, (u64, NodeError)>>,
        streams: Streams,
    ) {
        let Streams { replies, frames } = streams;
        let renewals = self.state().renewals;
        parts.push(Box::pin(self.part(renewals, self.read_replies(replies))));
        parts.push(Box::pin(self.part(renewals, self.read_film(frames))));
    }

    /// Reads one stream to its end: over which connection that was, and why it ended.
    async fn part(
        &self,
        renewals: u64,
        reading: impl Future<Output = Result<(), NodeError>>,
    ) -> (u64, NodeError) {
        let ended = tokio::select! {
            biased;
            ended = reading => ended,
            () = self.replaced(renewals) => Ok(()),
        };
        (renewals, ended.err().unwrap_or(NodeError::Closed))
    }

    /// Completes some time after the connection was renewed: what was on its way has come by then.
    async fn replaced(&self, renewals: u64) {
        loop {
            tokio::time::sleep(LAST_WORDS).await;
            if self.state().renewals != renewals {
                return tokio::time::sleep(LAST_WORDS).await;
            }
        }
    }

    /// Another connection, when it is time for one. One that cannot be made is tried again: the old one is still there.
    async fn renewed(&self) -> (Connection, Streams) {
        let Some(age) = self.agreement.dial.renews_after() else { return std::future::pending().await };
        tokio::time::sleep(age).await;
        loop {
            let begun = tokio::time::timeout(BEGIN_TIMEOUT, self.begin_anew()).await;
            match begun.unwrap_or(Err(NodeError::Timeout(BEGIN_TIMEOUT))) {
                Ok(begun) => return begun,
                Err(error) => {
                    tracing::warn!("the connection to node {} cannot be renewed: {error}", self.node);
                }
            }
            tokio::time::sleep(age.mul_f64(RENEW_AGAIN)).await;
        }
    }

    /// Reads the node's clock again and again, and tells the node what film time that makes.
    async fn keep_time(&self) -> Result<(), NodeError> {
        if self.agreement.observes() {
            return std::future::pending().await;
        }
        loop {
            tokio::time::sleep(CLOCK_EVERY).await;
            self.read_clock(&mut self.client()?).await?;
            let known = {
                let mut state = self.state();
                state.clock_line = state.clock.film_time(0.0, monotonic_s());
                state.clock_line
            };
            if let Some(ClockLine { bound_s, .. }) = known {
                self.report(NodeEvent::Clock(bound_s)).await?;
            }
        }
    }

    async fn read_clock(&self, client: &mut CameraNodeClient<Channel>) -> Result<(), NodeError> {
        let pace = self.agreement.terms().pace;
        let start = pace.and_then(|pace| self.run_start(pace).ok());
        let request = v1::KeepTimeRequest {
            run: start.map_or(0, |start| start.run),
            clock: start.and_then(|start| start.clock),
            holder: self.holder(),
            phase: self.agreement.cut().phase(),
        };
        let sent_s = monotonic_s();
        let reply = tokio::time::timeout(CLOCK_TIMEOUT, client.keep_time(request)).await;
        let reply = reply.map_err(|_| NodeError::Timeout(CLOCK_TIMEOUT))??.into_inner();
        let received_s = monotonic_s();
        self.state().clock.read(sent_s, node_clock_from_wire(reply)?, received_s);
        Ok(())
    }

    async fn read_replies(&self, mut replies: tonic::Streaming<v1::ProbeReply>) -> Result<(), NodeError> {
        while let Some(reply) = replies.next().await {
            let reply = reply?;
            let id = reply.id;
            let open = {
                let mut state = self.state();
                let place = state.open.iter().position(|(open, _)| *open == id);
                place.and_then(|place| state.open.remove(place))
            };
            // Nothing is decoded that was not asked, or that was answered already.
            let Some((_, expected)) = open else {
                tracing::debug!("node {}: a reply to no open question", self.node);
                continue;
            };
            let (answer, compute_ms) = answer_from_wire(reply, &expected)?;
            self.report(NodeEvent::Reply(id, answer, compute_ms)).await?;
        }
        Err(NodeError::Closed)
    }

    async fn read_film(&self, mut frames: tonic::Streaming<v1::FrameInfo>) -> Result<(), NodeError> {
        let mut before: Option<(u64, f64)> = None;
        while let Some(info) = frames.next().await {
            let event = film_event_from_wire(info?, &self.node.cameras)?;
            if let FilmEvent::Frame(report) = &event {
                check_order(before, (report.frame, report.capture_time_s))?;
                before = Some((report.frame, report.capture_time_s));
                self.agreement.cut().heard(report);
            }
            let is_news = self.state().is_news(&event);
            if is_news {
                self.report(NodeEvent::Film { event, heard_s: monotonic_s() }).await?;
            }
        }
        Err(NodeError::Closed)
    }
}

async fn open_streams(mut client: CameraNodeClient<Channel>) -> Result<(Connection, Streams), NodeError> {
    let (credits, credit_stream) = mpsc::channel(MAX_SENDING);
    let (probes, probe_stream) = mpsc::channel(MAX_SENDING);
    let frames = client.watch_frames(ReceiverStream::new(credit_stream)).await?.into_inner();
    let replies = client.probe(ReceiverStream::new(probe_stream)).await?.into_inner();
    Ok((Connection { client, probes, credits }, Streams { replies, frames }))
}

/// As messages name a span; empty: none.
fn trace_field(trace: Option<TraceParent>) -> String {
    trace.map_or_else(String::new, |parent| parent.to_string())
}

/// Later frames are captured later. A number that is not higher begins another run.
fn check_order(before: Option<(u64, f64)>, found: (u64, f64)) -> Result<(), NodeError> {
    match before {
        Some((before, before_s)) if found.0 > before && found.1 <= before_s => {
            Err(NodeError::Backwards { frame: found.0, found_s: found.1, before, before_s })
        }
        _ => Ok(()),
    }
}

async fn register(
    client: &mut CameraNodeClient<Channel>,
    shapes: &[Arc<Shape>],
    holder: u64,
) -> Result<(), NodeError> {
    let shapes = shapes.iter().map(|shape| shape_to_wire(shape)).collect();
    client.register_shapes(v1::RegisterShapesRequest { shapes, holder }).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capture_times_that_run_backwards_are_refused_and_another_run_is_not() {
        assert_eq!(check_order(None, (0, 0.0)), Ok(()));
        assert_eq!(check_order(Some((4, 0.4)), (5, 0.5)), Ok(()));
        assert_eq!(check_order(Some((4, 0.4)), (0, 0.0)), Ok(()));
        let error = check_order(Some((4, 0.4)), (5, 0.3)).expect_err("backwards").to_string();
        assert_eq!(error, "invalid reply: frame 5 was captured at 0.3 s, before frame 4 at 0.4 s");
    }
}
