//! Silhouettes travel, one machine computes: the paper's layout.

use std::sync::Arc;
use std::time::Duration;

use film_time::monotonic_s;
use hull::pass::{Pass, Round};
use hull::{Observer, Silhouette, View, ViewSet};
use node_client::NodeClient;
use proto::convert::SilhouetteEncoding;
use telemetry::Span;
use tokio::time::Instant;

use super::TransportError;
use super::in_process::LocalProbes;
use super::nodes::{Nodes, Unfetched, fetch};
use crate::core::round_trips::RoundTrips;
use crate::roster::Roster;

/// The frames whose silhouettes were fetched last.
pub(super) struct Gather {
    encoding: SilhouetteEncoding,
    pub silhouette_bytes: u64,
    observers: Vec<Arc<Observer>>,
    /// At most two, one after the other.
    fetched: Vec<(u64, ViewSet)>,
    /// The nodes that were fetched from, and their places in the roster.
    clients: Vec<Arc<NodeClient>>,
    places: Vec<usize>,
    fetches: RoundTrips,
    probes: LocalProbes,
}

impl Gather {
    pub fn new(nodes: &Nodes, observers: Vec<Arc<Observer>>) -> Gather {
        Gather {
            clients: nodes.clients.clone(),
            places: (0..nodes.clients.len()).collect(),
            fetches: RoundTrips::new(nodes.clients.len(), nodes.agreement.fps()),
            encoding: SilhouetteEncoding::default(),
            silhouette_bytes: 0,
            observers,
            fetched: Vec::new(),
            probes: LocalProbes::default(),
        }
    }

    /// From the next frame on silhouettes travel so. Those that came otherwise are fetched again.
    pub fn encode_as(&mut self, encoding: SilhouetteEncoding) {
        self.encoding = encoding;
        self.fetched.clear();
    }

    /// Answers a pass; each fetch may take `timeout`, or without one what is usual. Returns what fetching the frame took,
    /// milliseconds, if it was not there.
    pub async fn run_pass(
        &mut self,
        nodes: &Nodes,
        pass: &mut Pass,
        frame: u64,
        timeout: Option<Duration>,
        roster: &mut Roster,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<Option<f64>, TransportError> {
        if pass.question().is_none() {
            return Ok(None);
        }
        self.go_on_with(nodes, roster);
        let (began, is_there) = (Instant::now(), self.fetched.iter().any(|(at, _)| *at == frame));
        let span = if is_there { Span::NONE } else { nodes.trace.part("fetch") };
        let timeout = timeout.unwrap_or_else(|| self.fetches.timeout(roster, monotonic_s()));
        let fetched = self.fetch(frame, pass.asks_planes(), timeout, &span).await;
        if let Err(Unfetched { failed, error }) = fetched {
            let now_s = monotonic_s();
            let failed = failed.into_iter().map(|(client, error)| (self.places[client], error));
            let (late, wrong): (Vec<_>, Vec<_>) = failed.partition(|(_, error)| error.is_absence());
            wrong.iter().for_each(|(node, error)| roster.fault(*node, now_s, error.to_string()));
            if let Some((_, why)) = late.first() {
                let nodes: Vec<usize> = late.iter().map(|(node, _)| *node).collect();
                roster.record_late(&nodes, now_s, &why.to_string());
            }
            return Err(error);
        }
        let fetched_ms = (!is_there).then(|| began.elapsed().as_secs_f64() * 1e3);
        drop(span);
        let _span = nodes.trace.part("compute");
        if let Some((_, views)) = self.fetched.iter().find(|(at, _)| *at == frame) {
            self.probes.run(pass, views, took);
        }
        Ok(fetched_ms)
    }

    /// Takes note of who is there. Frames of other cameras are other frames.
    fn go_on_with(&mut self, nodes: &Nodes, roster: &Roster) {
        let is_there = |&place: &usize| !roster.nodes()[place].is_left_out();
        let places: Vec<usize> = (0..nodes.clients.len()).filter(is_there).collect();
        if places != self.places {
            self.clients = places.iter().map(|&place| Arc::clone(&nodes.clients[place])).collect();
            self.places = places;
            self.fetched.clear();
        }
    }

    /// Fetches a frame; planes tell how far they moved since the frame before, whether anything was asked about that
    /// or not.
    async fn fetch(
        &mut self,
        frame: u64,
        needs_before: bool,
        timeout: Duration,
        span: &Span,
    ) -> Result<(), Unfetched> {
        if self.fetched.iter().any(|(at, _)| *at == frame) {
            return Ok(());
        }
        let newest = self.fetched.last().map(|(at, _)| *at);
        if let Some(before) = frame.checked_sub(1).filter(|&before| needs_before && newest != Some(before)) {
            // A node that has passed it over tells of an earlier one at best.
            if let Ok(views) = self.views(before, timeout, span).await {
                self.fetched.push((before, views));
            }
        }
        let views = self.views(frame, timeout, span).await?;
        let views = match self.fetched.last() {
            Some((before, seen)) => views.after(seen, frame.saturating_sub(*before)),
            None => views,
        };
        self.fetched.retain(|(at, _)| at + 1 == frame);
        self.fetched.push((frame, views));
        Ok(())
    }

    async fn views(&mut self, frame: u64, timeout: Duration, span: &Span) -> Result<ViewSet, Unfetched> {
        let (fetched, took_ms) = fetch(&self.clients, frame, self.encoding, timeout, span).await;
        let nodes_ms: Vec<(usize, f64)> = self.places.iter().copied().zip(took_ms).collect();
        self.fetches.record(&nodes_ms);
        let fetched = fetched?;
        self.silhouette_bytes += fetched.bytes;
        let view = |(rig_index, seen): &(u16, Silhouette)| {
            let observer = self.observers.iter().find(|observer| observer.rig_index() == *rig_index)?;
            Some(View::new(Arc::clone(observer), seen))
        };
        Ok(ViewSet::new(fetched.silhouettes.iter().filter_map(view).collect()))
    }
}
