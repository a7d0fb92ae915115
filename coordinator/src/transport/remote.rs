//! Cameras behind nodes, and where probes about them are computed.

use std::sync::Arc;
use std::time::Duration;

use hull::pass::{Pass, Round};
use proto::convert::{Precision, SilhouetteEncoding};
use telemetry::Span;
use tokio::sync::oneshot;
use tokio::time::Instant;

use super::cluster::Cluster;
use super::gather::Gather;
use super::nodes::{CALL_TIMEOUT, Nodes, fetch};
use super::{Placement, TransportError};
use crate::core::choice::{Choice, Way};
use crate::roster::Roster;

/// Where nodes may be left for silhouettes, a frame is fetched so often to know what that takes.
const TRY_EVERY: Duration = Duration::from_secs(1);

/// Nodes, and both ways to answer a pass.
pub(super) struct Remote {
    pub nodes: Nodes,
    pub gather: Gather,
    cluster: Cluster,
    choice: Choice,
    trial: Trial,
}

/// What fetching a frame takes, while nodes are asked.
#[derive(Default)]
struct Trial {
    began: Option<Instant>,
    running: Option<oneshot::Receiver<f64>>,
    took_ms: Option<f64>,
}

impl Remote {
    pub fn new(nodes: Nodes, placement: Placement) -> Remote {
        let fps = nodes.agreement.fps();
        let (choice, observers) = match placement {
            Placement::Nodes => (Choice::fixed(Way::Asks), Vec::new()),
            Placement::Here(observers) => (Choice::fixed(Way::Gathers), observers),
            Placement::Fastest(observers) => (Choice::free(fps), observers),
        };
        let cluster = Cluster::new(&nodes, Precision::Exact);
        let gather = Gather::new(&nodes, observers);
        Remote { nodes, gather, cluster, choice, trial: Trial::default() }
    }

    pub fn with_precision(mut self, precision: Precision) -> Remote {
        self.cluster = self.cluster.with_precision(&self.nodes, precision);
        if precision == Precision::Quantised && self.choice.is_free() {
            // What is rounded for few bytes is not to depend on what is faster.
            self.choice = Choice::fixed(Way::Asks);
        }
        self
    }

    pub fn with_silhouettes_as(mut self, encoding: SilhouetteEncoding) -> Remote {
        self.gather.encode_as(encoding);
        self
    }

    /// Whether nodes are asked.
    pub fn asks(&self) -> bool {
        self.choice.way() == Way::Asks
    }

    /// Whether nodes are ever asked.
    pub fn may_ask(&self) -> bool {
        self.asks() || self.choice.is_free()
    }

    /// Before the first pass: takes the way that suits nodes so far away.
    pub fn begin(&mut self, roster: &Roster) {
        self.choice.begin(trip_ms(&self.nodes, roster));
    }

    /// Takes the faster way from now on; whether that is another.
    pub fn choose(&mut self) -> bool {
        self.choice.change()
    }

    /// The messages of the last pass with nothing in them.
    pub async fn fan_out(
        &mut self,
        frame: u64,
        timeout: Duration,
        roster: &mut Roster,
    ) -> Result<(), TransportError> {
        self.cluster.fan_out(&mut self.nodes, frame, timeout, roster).await
    }

    /// Answers a pass; a round may take `timeout`, or without one what is usual.
    pub async fn run_pass(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        timeout: Option<Duration>,
        roster: &mut Roster,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), TransportError> {
        let Remote { nodes, gather, cluster, choice, trial } = self;
        let is_empty = pass.question().is_none();
        let (mut rounds, mut rounds_ms) = (0, 0.0);
        if choice.way() == Way::Asks {
            let mut count = |round, ms| {
                rounds_ms += ms;
                took(round, ms);
            };
            let computed_ms = cluster.run_pass(nodes, pass, frame, timeout, roster, &mut count).await?;
            if let Some(fetch_ms) = trial.took_ms.filter(|_| !is_empty) {
                choice.took(rounds_ms, fetch_ms + computed_ms);
            }
            if choice.is_free() {
                trial.go_on(nodes, frame, roster);
            }
        } else {
            let mut count = |round, ms| {
                rounds += 1;
                rounds_ms += ms;
                took(round, ms);
            };
            let fetched_ms = gather.run_pass(nodes, pass, frame, timeout, roster, &mut count).await?;
            if !is_empty {
                let asks_ms =
                    f64::from(rounds) * trip_ms(nodes, roster) + rounds_ms / nodes.clients.len() as f64;
                choice.took(asks_ms, fetched_ms.unwrap_or_default() + rounds_ms);
            }
        }
        Ok(())
    }
}

/// What a short question to all nodes that are there takes, milliseconds.
fn trip_ms(nodes: &Nodes, roster: &Roster) -> f64 {
    let there = nodes.clients.iter().zip(roster.nodes()).filter(|(_, node)| !node.is_left_out());
    there.map(|(client, _)| client.trip_s() * 1e3).fold(0.0, f64::max)
}

impl Trial {
    /// Fetches a frame beside the passes, now and then, from the nodes that steps go on with.
    fn go_on(&mut self, nodes: &Nodes, frame: u64, roster: &Roster) {
        if let Some(running) = &mut self.running {
            match running.try_recv() {
                Ok(took_ms) => self.took_ms = Some(took_ms),
                Err(oneshot::error::TryRecvError::Empty) => return,
                // It failed: nothing is known of gathering.
                Err(oneshot::error::TryRecvError::Closed) => self.took_ms = None,
            }
            self.running = None;
        }
        if self.began.is_some_and(|began| began.elapsed() < TRY_EVERY) {
            return;
        }
        self.began = Some(Instant::now());
        let (tell, running) = oneshot::channel();
        self.running = Some(running);
        let there = nodes.clients.iter().zip(roster.nodes()).filter(|(_, node)| !node.is_left_out());
        let clients: Vec<_> = there.map(|(client, _)| Arc::clone(client)).collect();
        tokio::spawn(async move {
            let began = Instant::now();
            let encoding = SilhouetteEncoding::default();
            if fetch(&clients, frame, encoding, CALL_TIMEOUT, &Span::NONE).await.0.is_ok() {
                // The run may have ended.
                let _ = tell.send(began.elapsed().as_secs_f64() * 1e3);
            }
        });
    }
}
