//! The nodes of a run: their clients, and the events that come from them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use film_time::{FilmEvent, Pace, monotonic_s};
use futures::stream::{FuturesUnordered, StreamExt};
use hull::{Shape, Silhouette};
use node_client::{Agreement, NodeClient, NodeError, NodeEvent};
use proto::convert::{ProbeAnswer, SilhouetteEncoding};
use telemetry::Span;
use tokio::sync::mpsc;
use tokio::time::Instant;

use super::trace::question_span;
use super::{FirstFrame, TransportError, WantedBackground};
use crate::roster::{Arrival, Roster};

/// A picture, or a message to the cameras, is not worth more of a step's time.
pub(super) const CALL_TIMEOUT: Duration = Duration::from_secs(2);

/// Sources open and programs start within this, or the node hangs.
const START_TIMEOUT: Duration = Duration::from_secs(30);

/// A live run with enough cameras waits so long for the remaining nodes to start.
const START_PATIENCE: Duration = Duration::from_secs(1);

/// Half of the nodes know new shapes: the others are waited for so much longer.
const SLOWER_THAN_HALF: Duration = Duration::from_millis(20);

/// Clients of all nodes, in the order of the roster.
pub(super) struct Nodes {
    pub clients: Vec<Arc<NodeClient>>,
    pub agreement: Arc<Agreement>,
    events: mpsc::Receiver<(usize, NodeEvent)>,
    /// The frame after the newest that any node reported in this run; for who no longer sees the roster.
    next_frame: Arc<AtomicU64>,
    /// Of the pass in flight.
    pub trace: Span,
}

/// What concerns the pass in flight.
pub(super) enum PassEvent {
    /// A node's answer to the question of that id, and the milliseconds that it computed.
    Reply(usize, u64, ProbeAnswer, f64),
    /// A node's connection broke, and why.
    Down(usize, NodeError),
}

impl Nodes {
    pub fn new(
        clients: Vec<Arc<NodeClient>>,
        agreement: Arc<Agreement>,
        events: mpsc::Receiver<(usize, NodeEvent)>,
    ) -> Nodes {
        Nodes { clients, agreement, events, next_frame: Arc::default(), trace: Span::NONE }
    }

    /// Counts the frames of a new run.
    pub fn begin_run(&self) {
        self.next_frame.store(0, Ordering::Relaxed);
    }

    /// How many events wait, and how many may.
    pub fn waiting_events(&self) -> (usize, usize) {
        (self.events.len(), self.events.max_capacity())
    }

    /// Hands the roster all events that are there.
    pub fn drain(&mut self, roster: &mut Roster) {
        while let Ok((node, event)) = self.events.try_recv() {
            self.note(roster, node, event);
        }
    }

    /// Waits for an event and hands it to the roster. What concerns a pass is returned.
    pub async fn next(&mut self, roster: &mut Roster) -> Option<PassEvent> {
        match self.events.recv().await {
            Some((node, event)) => self.note(roster, node, event),
            // Every client holds a sender: there are none.
            None => std::future::pending().await,
        }
    }

    fn note(&self, roster: &mut Roster, node: usize, event: NodeEvent) -> Option<PassEvent> {
        match event {
            NodeEvent::Up => roster.up(node),
            // It was on its way when we began our run.
            NodeEvent::Film { run, .. } if !self.agreement.is_of_run(run) => {}
            NodeEvent::Film { event, heard_s, .. } => {
                if let FilmEvent::Frame(report) = &event {
                    roster.heard(Arrival { node, frame: report.frame, heard_s });
                }
                roster.film_event(node, event, heard_s);
                if let Some(newest) = roster.newest_of_two() {
                    self.next_frame.fetch_max(newest.saturating_add(1), Ordering::Relaxed);
                }
                if let Some(why) = roster.nodes()[node].film_failure().map(str::to_owned) {
                    roster.fault(node, heard_s, why);
                }
            }
            NodeEvent::Clock(bound_s) => roster.clock(node, bound_s),
            NodeEvent::Down(error) => {
                match &error {
                    NodeError::Held(by) => roster.held(node, by.clone()),
                    error if error.is_mismatch() => roster.wrong(node, error.to_string()),
                    error => {
                        if error.is_invalid() {
                            roster.fault(node, monotonic_s(), error.to_string());
                        } else if roster.nodes()[node].missing().is_none()
                            && !matches!(error, NodeError::Timeout(_))
                        {
                            // One that breaks its connection again and again is late with all that it was asked. What we broke
                            // because a call was not answered has been waited for: its answers since then tell how it behaves.
                            roster.record_late(&[node], monotonic_s(), &error.to_string());
                        }
                        roster.down(node, error.to_string());
                    }
                }
                return Some(PassEvent::Down(node, error));
            }
            NodeEvent::Reply(id, answer, compute_ms) => {
                return Some(PassEvent::Reply(node, id, answer, compute_ms));
            }
        }
        None
    }

    /// Has all cameras learn their backgrounds; if one cannot, all keep theirs. What is returned needs the run no more.
    pub fn take_background(
        &self,
        wanted: WantedBackground,
    ) -> impl Future<Output = Result<(), TransportError>> + Send + use<> {
        let (clients, next_frame) = (self.clients.clone(), Arc::clone(&self.next_frame));
        async move {
            let check = wanted.film(0);
            each(&clients, |client| in_time(CALL_TIMEOUT, client.take_background(check, true))).await?;
            let first_frame = match wanted.first {
                FirstFrame::At(frame) => frame,
                // As of now: asking whether they can took a while.
                FirstFrame::AfterNewest(later) => next_frame.load(Ordering::Relaxed) + later,
            };
            let film = wanted.film(first_frame);
            let at_most = wanted.takes_at_most;
            let taken = each(&clients, |client| in_time(at_most, client.take_background(film, false))).await;
            if taken.is_err() {
                // A node that does not hear this restores it itself, because its call has ended.
                let _ = restore_background(&clients, wanted.id).await;
            }
            taken
        }
    }

    /// Has all cameras use the backgrounds again that were in use before that one.
    pub fn restore_background(
        &self,
        id: u64,
    ) -> impl Future<Output = Result<(), TransportError>> + Send + use<> {
        let clients = self.clients.clone();
        async move { restore_background(&clients, id).await }
    }

    /// Starts a run at all nodes, also at those that connect later. With `least_cameras`, of a live run, it goes on without
    /// nodes that do not start: these are reconnected, and start then. It fails if a node refuses and all that start have
    /// fewer cameras.
    pub async fn start(&self, pace: Pace, least_cameras: Option<usize>) -> Result<(), TransportError> {
        self.agreement.begin_run(pace);
        let Some(least_cameras) = least_cameras else {
            return each(&self.clients, |client| start_at(client, pace)).await;
        };
        let started = |client: Arc<NodeClient>| async move {
            let started = start_at(&client, pace).await;
            if let Err(error) = &started {
                if !error.is_absence() {
                    tracing::warn!("node {}: cannot start: {error}", client.node());
                }
                client.reconnect();
            }
            (client, started)
        };
        let mut starts: FuturesUnordered<_> = self.clients.iter().cloned().map(started).collect();
        let patience = Instant::now() + START_PATIENCE;
        let (mut cameras, mut refused) = (0, None);
        loop {
            let is_enough = cameras >= least_cameras;
            let next = if is_enough {
                tokio::time::timeout_at(patience, starts.next()).await
            } else {
                Ok(starts.next().await)
            };
            match next {
                Ok(Some((client, Ok(())))) => cameras += client.node().cameras.len(),
                Ok(Some((client, Err(error)))) if !error.is_absence() => {
                    refused.get_or_insert_with(|| TransportError::of(&client, error));
                }
                Ok(Some(_)) => {}
                Ok(None) => return refused.filter(|_| !is_enough).map_or(Ok(()), Err),
                Err(_) => break,
            }
        }
        tokio::spawn(async move { while starts.next().await.is_some() {} });
        Ok(())
    }

    pub fn credit(&self, up_to_frame: u64) {
        self.clients.iter().for_each(|client| client.credit(up_to_frame));
    }

    pub fn use_frame(&self, frame: u64) {
        self.clients.iter().for_each(|client| client.use_frame(frame));
    }

    /// Makes shapes known to all nodes that answer at present. Waits at most `at_most`, and not long for nodes that are slower
    /// than half of the others: they receive the shapes meanwhile, and nodes that come back when they first miss one. At most
    /// half of the nodes that refuse do so wrongly: such a node is excluded when it is asked about a shape that it does not have.
    pub async fn register(
        &self,
        shapes: &[Arc<Shape>],
        at_most: Duration,
        roster: &Roster,
    ) -> Result<(), TransportError> {
        let now_s = monotonic_s();
        let asked = self.clients.iter().enumerate().filter(|&(place, _)| roster.answers(place, now_s));
        let register = |client: Arc<NodeClient>, shapes: Vec<Arc<Shape>>| async move {
            let registered = tokio::time::timeout(CALL_TIMEOUT, client.register(&shapes)).await;
            (client, registered.unwrap_or(Err(NodeError::Timeout(CALL_TIMEOUT))))
        };
        let mut calls: FuturesUnordered<_> =
            asked.map(|(_, client)| register(Arc::clone(client), shapes.to_vec())).collect();
        let (count, mut know, mut refused) = (calls.len(), 0, Vec::new());
        let mut until = Instant::now() + at_most;
        while let Ok(Some((client, registered))) = tokio::time::timeout_at(until, calls.next()).await {
            match registered {
                Ok(()) => know += 1,
                Err(error @ NodeError::Refused(_)) => refused.push(TransportError::of(&client, error)),
                Err(_) => {}
            }
            if 2 * know >= count {
                until = until.min(Instant::now() + SLOWER_THAN_HALF);
            }
        }
        tokio::spawn(async move { while calls.next().await.is_some() {} });
        let are_many = 2 * refused.len() > count;
        refused.into_iter().next().filter(|_| are_many).map_or(Ok(()), Err)
    }
}

/// Starts a run at a node.
async fn start_at(client: &NodeClient, pace: Pace) -> Result<(), NodeError> {
    in_time(START_TIMEOUT, client.start(pace)).await
}

/// Calls all nodes at once. Of several errors a refusal counts first.
async fn each<'a, F>(
    clients: &'a [Arc<NodeClient>],
    call: impl Fn(&'a Arc<NodeClient>) -> F,
) -> Result<(), TransportError>
where
    F: Future<Output = Result<(), NodeError>>,
{
    let calls = clients.iter().map(|client| {
        let called = call(client);
        async move { called.await.map_err(|error| TransportError::of(client, error)) }
    });
    let results = futures::future::join_all(calls).await.into_iter();
    let (refused, others): (Vec<_>, Vec<_>) =
        results.partition(|result| result.as_ref().is_err_and(TransportError::is_refusal));
    refused.into_iter().chain(others).collect()
}

async fn restore_background(clients: &[Arc<NodeClient>], id: u64) -> Result<(), TransportError> {
    each(clients, |client| in_time(CALL_TIMEOUT, client.restore_background(id))).await
}

/// A call that has failed if it is not answered by then.
async fn in_time(
    timeout: Duration,
    call: impl Future<Output = Result<(), NodeError>>,
) -> Result<(), NodeError> {
    tokio::time::timeout(timeout, call).await.unwrap_or(Err(NodeError::Timeout(timeout)))
}

/// Silhouettes of a frame.
pub(super) struct Fetched {
    /// By their cameras' places in the rig, ascending.
    pub silhouettes: Vec<(u16, Silhouette)>,
    /// What they travelled as.
    pub bytes: u64,
}

/// Why silhouettes did not come.
pub(super) struct Unfetched {
    /// The places among the clients of the nodes that did not send them, and why.
    pub failed: Vec<(usize, NodeError)>,
    /// The first of these.
    pub error: TransportError,
}

/// Fetches the silhouettes of a frame from nodes; a part of a trace. Also returns what each node took, or had at its disposal,
/// milliseconds.
pub(super) async fn fetch(
    clients: &[Arc<NodeClient>],
    frame: u64,
    encoding: SilhouetteEncoding,
    timeout: Duration,
    trace: &Span,
) -> (Result<Fetched, Unfetched>, Vec<f64>) {
    let began = Instant::now();
    let calls = clients.iter().map(|client| async move {
        let span = question_span(trace, "fetch from a node", client);
        let call = tokio::time::timeout(timeout, client.silhouettes(frame, encoding, span.parent()));
        let fetched = call.await.unwrap_or(Err(NodeError::Timeout(timeout)));
        (fetched.inspect_err(|error| span.fail(error)), began.elapsed().as_secs_f64() * 1e3)
    });
    let mut all = Fetched { silhouettes: Vec::new(), bytes: 0 };
    let (mut failed, mut first) = (Vec::new(), None);
    let (results, took_ms): (Vec<_>, Vec<f64>) = futures::future::join_all(calls).await.into_iter().unzip();
    for (place, (client, fetched)) in clients.iter().zip(results).enumerate() {
        match fetched {
            Ok((silhouettes, bytes)) => {
                all.silhouettes.extend(silhouettes);
                all.bytes += bytes;
            }
            Err(error) => {
                first.get_or_insert_with(|| TransportError::of(client, error.clone()));
                failed.push((place, error));
            }
        }
    }
    all.silhouettes.sort_by_key(|(rig_index, _)| *rig_index);
    (first.map_or(Ok(all), |error| Err(Unfetched { failed, error })), took_ms)
}

#[cfg(test)]
mod tests {
    use film_time::FilmState;
    use hull::ProbeSettings;

    use super::*;
    use crate::roster::RosterNode;

    #[test]
    fn what_is_still_heard_of_another_run_changes_nothing() {
        let (sender, events) = mpsc::channel(8);
        let agreement = Arc::new(Agreement::new(ProbeSettings::default(), 30.0, vec![]));
        let mut nodes = Nodes::new(vec![], Arc::clone(&agreement), events);
        let mut roster = Roster::new(vec![RosterNode::new("node a".into(), vec![0])]);
        roster.up(0);
        let mut film_after = |run: u64, event: FilmEvent| {
            sender.try_send((0, NodeEvent::Film { run, event, heard_s: 0.0 })).expect("room");
            nodes.drain(&mut roster);
            roster.film(0)
        };
        agreement.begin_run(Pace::lock_step(2));
        assert_eq!(film_after(1, FilmEvent::Ended), FilmState::Running);
        assert_eq!(film_after(1, FilmEvent::Failed("no camera".into())), FilmState::Running);
        assert_eq!(film_after(2, FilmEvent::Ended), FilmState::Ended);
    }
}
