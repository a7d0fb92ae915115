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
        let fetched = tokio::time::timeout(timeout, self.fetch(frame)).await;
        let late = |_| TransportError::Silhouettes { frame, timeout };
        fetched.map_err(late)??;
        if let Some((_, views)) = &self.fetched {
            self.probes.run(pass, views, took);
        }
        Ok(())
    }

    async fn fetch(&mut self, frame: u64) -> Result<(), TransportError> {
        if self.fetched.as_ref().is_some_and(|(fetched, _)| *fetched == frame) {
            return Ok(());
        }
        let (silhouettes, bytes) = fetch(&self.nodes.clients, frame, self.encoding).await?;
        self.silhouette_bytes += bytes;
        let views = self.observers.iter().zip(&silhouettes);
        let views = views.map(|(observer, silhouette)| View::new(Arc::clone(observer), silhouette));
        let views = ViewSet::new(views.collect());
        let views = match &self.fetched {
            Some((before, seen)) => views.after(seen, frame.saturating_sub(*before)),
            None => views,
        };
        self.fetched = Some((frame, views));
        Ok(())
    }
}
