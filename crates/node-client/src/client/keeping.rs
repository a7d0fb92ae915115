//! Keeps a node connected: finds it, checks who answers, leads it, reads what it reports, and renews the connection.

use std::sync::Arc;
use std::time::Duration;

use film_time::{ClockLine, FilmEvent, monotonic_s};
use futures::future::BoxFuture;
use futures::stream::FuturesUnordered;
use proto::convert::{
    answer_from_wire, claim_to_wire, description_from_wire, film_event_from_wire, node_clock_from_wire,
};
use proto::{Address, v1};
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_stream::StreamExt;
use tokio_stream::wrappers::ReceiverStream;

use super::state::{Connection, LAST_WORDS, Streams};
use super::{MAX_SENDING, NodeClient, NodeEvent, register};
use crate::agreement::{Agreement, Terms};
use crate::clock_estimate::ClockEstimate;
use crate::connection::connect;
use crate::error::NodeError;
use crate::reply_limits::NodeCalls;

const FIRST_BACKOFF: Duration = Duration::from_millis(50);
const LONGEST_BACKOFF: Duration = Duration::from_secs(1);
/// A connection that has lasted for so long was sound.
const SOUND: Duration = Duration::from_secs(5);
/// All calls of a connection's beginning together: sources open, programs start.
const BEGIN_TIMEOUT: Duration = Duration::from_secs(30);

/// A node that another holds is asked so often, and for so long: its holder may have lost power just now.
const CLAIM_EVERY: Duration = Duration::from_millis(200);
const HELD_PATIENCE: Duration = Duration::from_secs(2);
/// So many messages a second that are none of what a node was asked for are no fault, and eight a frame.
const MOST_STRAY: u32 = 64;
/// A renewal that fails is tried again after this part of a connection's age.
const RENEW_AGAIN: f64 = 0.03;

/// How often the clock of a node is read, and first how many times before a run begins there.
const CLOCK_EVERY: Duration = Duration::from_millis(500);
const FIRST_READINGS: usize = 4;
/// A node that answers nothing else for so long is connected again: film time there would go astray.
const CLOCK_TIMEOUT: Duration = Duration::from_secs(5);

impl NodeClient {
    async fn report(&self, event: NodeEvent) -> Result<(), NodeError> {
        self.events.send((self.index, event)).await.map_err(|_| NodeError::Closed)
    }

    pub(super) async fn keep_connected(self: Arc<NodeClient>) {
        let mut backoff = FIRST_BACKOFF;
        while !self.events.is_closed() {
            // From here on: a run that starts while this connection is made does not reach the node over it.
            let mut given_up = std::pin::pin!(self.given_up.notified());
            given_up.as_mut().enable();
            let begun = tokio::time::timeout(BEGIN_TIMEOUT, self.begin()).await;
            let connected = Instant::now();
            let error = match begun.unwrap_or(Err(NodeError::Timeout(BEGIN_TIMEOUT))) {
                Ok((connection, streams)) => {
                    self.state().connect(connection);
                    tracing::debug!("node {} is up", self.node);
                    let error = tokio::select! {
                        biased;
                        error = self.read(streams) => error,
                        () = given_up => NodeError::NotConnected,
                    };
                    self.state().connection = None;
                    // One that breaks at once each time is not connected twenty times a second.
                    backoff = if connected.elapsed() > SOUND { FIRST_BACKOFF } else { backoff };
                    error
                }
                Err(error) => error,
            };
            // The run may have ended, and then there is no receiver.
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

    /// Another connection to a node that we lead already: both sides show certificates again.
    async fn renew(&self) -> Result<(Connection, Streams), NodeError> {
        let (mut client, held_term) = self.reach().await?;
        if !self.agreement.observes() {
            self.hold(&mut client, held_term).await?;
        }
        open_streams(client).await
    }

    /// Connects to the node, and says with which term it is held.
    async fn reach(&self) -> Result<(NodeCalls, u64), NodeError> {
        self.node.place.reach(|address| async move { self.connect_checked(&address).await }).await
    }

    /// Connects, and checks who answers.
    async fn connect_checked(&self, address: &Address) -> Result<(NodeCalls, u64), NodeError> {
        let Agreement { dial, counters, .. } = &*self.agreement;
        let mut client = connect(&self.node.at(address), dial, counters, &self.limits).await?;
        let described = client.describe(v1::DescribeRequest {}).await;
        let described = described.map_err(|status| match NodeError::from(status) {
            NodeError::Lost(why) => NodeError::AtOnce { why, hint: self.agreement.dial.hint() },
            other => other,
        });
        let description = description_from_wire(described?.into_inner())?;
        self.agreement.check(&self.node, &description)?;
        Ok((client, description.term))
    }

    /// Claims the node, whose lease has this term, and begins the run there, if one is on.
    async fn lead(&self, client: &mut NodeCalls, held_term: u64) -> Result<(), NodeError> {
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
    async fn hold(&self, client: &mut NodeCalls, held_term: u64) -> Result<(), NodeError> {
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
            let begun = tokio::time::timeout(BEGIN_TIMEOUT, self.renew()).await;
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

    async fn read_clock(&self, client: &mut NodeCalls) -> Result<(), NodeError> {
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
        let mut stray = Stray::new(self.agreement.fps());
        while let Some(reply) = replies.next().await {
            // A stream that never pauses leaves other work its turn.
            tokio::task::consume_budget().await;
            let reply = reply?;
            let id = reply.id;
            let open = {
                let mut state = self.state();
                let place = state.open.iter().position(|(open, _)| *open == id);
                place.and_then(|place| state.open.remove(place))
            };
            // Nothing is decoded that was not asked, or that was answered already.
            let Some((_, expected)) = open else {
                stray.count()?;
                continue;
            };
            let (answer, compute_ms) = answer_from_wire(reply, &expected)?;
            self.report(NodeEvent::Reply(id, answer, compute_ms)).await?;
        }
        Err(NodeError::Closed)
    }

    async fn read_film(&self, mut frames: tonic::Streaming<v1::FrameInfo>) -> Result<(), NodeError> {
        let mut before: Option<(u64, f64)> = None;
        let mut stray = Stray::new(self.agreement.fps());
        while let Some(info) = frames.next().await {
            tokio::task::consume_budget().await;
            let info = info?;
            let run = info.run;
            let event = film_event_from_wire(info, &self.node.cameras)?;
            if !self.agreement.is_of_run(run) {
                stray.count()?;
                continue;
            }
            let is_new = matches!(&event, FilmEvent::Frame(report) if before.is_none_or(|(before, _)| report.frame > before));
            if !is_new {
                stray.count()?;
            }
            if let FilmEvent::Frame(report) = &event {
                check_order(before, (report.frame, report.capture_time_s))?;
                before = Some((report.frame, report.capture_time_s));
                self.agreement.cut().heard(report);
            }
            let is_news = self.state().is_news(run, &event);
            if is_news {
                self.report(NodeEvent::Film { run, event, heard_s: monotonic_s() }).await?;
            }
        }
        Err(NodeError::Closed)
    }
}

/// Messages of a node that are none of what it was asked for: a few come late, many are a fault.
struct Stray {
    most: u32,
    since: Instant,
    count: u32,
}

impl Stray {
    /// None so far; of film of `fps` frames a second.
    fn new(fps: f64) -> Stray {
        Stray { most: (8.0 * fps) as u32 + MOST_STRAY, since: Instant::now(), count: 0 }
    }

    fn count(&mut self) -> Result<(), NodeError> {
        if self.since.elapsed() > Duration::from_secs(1) {
            (self.since, self.count) = (Instant::now(), 0);
        }
        self.count += 1;
        if self.count > self.most { Err(NodeError::Flood { count: self.count }) } else { Ok(()) }
    }
}

async fn open_streams(mut client: NodeCalls) -> Result<(Connection, Streams), NodeError> {
    let (credits, credit_stream) = mpsc::channel(MAX_SENDING);
    let (probes, probe_stream) = mpsc::channel(MAX_SENDING);
    let frames = client.watch_frames(ReceiverStream::new(credit_stream)).await?.into_inner();
    let replies = client.probe(ReceiverStream::new(probe_stream)).await?.into_inner();
    Ok((Connection { client, probes, credits }, Streams { replies, frames }))
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
