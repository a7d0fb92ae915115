//! Silhouettes travel, one machine computes: the paper's layout.

use std::sync::Arc;
use std::time::Duration;

use hull::pass::{Pass, Round};
use hull::{Observer, View, ViewSet};
use proto::convert::SilhouetteEncoding;

use super::TransportError;
use super::in_process::LocalProbes;
use super::nodes::{Nodes, fetch};

/// Nodes whose silhouettes are fetched, and the frame that was fetched last.
pub(super) struct Gather {
    pub nodes: Nodes,
    pub encoding: SilhouetteEncoding,
    pub silhouette_bytes: u64,
    observers: Vec<Arc<Observer>>,
    fetched: Option<(u64, ViewSet)>,
    probes: LocalProbes,
}

impl Gather {
    pub fn new(nodes: Nodes, observers: Vec<Arc<Observer>>) -> Gather {
        Gather {
            nodes,
            encoding: SilhouetteEncoding::default(),
            silhouette_bytes: 0,
            observers,
            fetched: None,
            probes: LocalProbes::default(),
        }
    }

    pub async fn run_pass(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        timeout: Duration,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), TransportError> {
        if pass.question().is_none() {
            return Ok(());
        }
        let fetched = tokio::time::timeout(timeout, self.fetch(frame, pass.asks_planes())).await;
        let late = |_| TransportError::Silhouettes { frame, timeout };
        fetched.map_err(late)??;
        if let Some((_, views)) = &self.fetched {
            self.probes.run(pass, views, took);
        }
        Ok(())
    }

    /// Fetches a frame; planes tell how far they moved since the frame before, whether anything was asked about that
    /// or not.
    async fn fetch(&mut self, frame: u64, needs_before: bool) -> Result<(), TransportError> {
        let fetched = self.fetched.as_ref().map(|(fetched, _)| *fetched);
        if fetched == Some(frame) {
            return Ok(());
        }
        if let Some(before) = frame.checked_sub(1).filter(|&before| needs_before && fetched != Some(before)) {
            // A node that has passed it over tells of an earlier one at best.
            if let Ok(views) = self.views(before).await {
                self.fetched = Some((before, views));
            }
        }
        let views = self.views(frame).await?;
        let views = match &self.fetched {
            Some((before, seen)) => views.after(seen, frame.saturating_sub(*before)),
            None => views,
        };
        self.fetched = Some((frame, views));
        Ok(())
    }

    async fn views(&mut self, frame: u64) -> Result<ViewSet, TransportError> {
        let (silhouettes, bytes) = fetch(&self.nodes.clients, frame, self.encoding).await?;
        self.silhouette_bytes += bytes;
        let views = self.observers.iter().zip(&silhouettes);
        Ok(ViewSet::new(views.map(|(observer, seen)| View::new(Arc::clone(observer), seen)).collect()))
    }
}
