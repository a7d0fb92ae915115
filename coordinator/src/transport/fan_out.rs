//! The messages of a pass without a question in them: what sockets and threads alone take.

use std::time::Duration;

use hull::question::Question;
use tokio::time::{Instant, timeout_at};

use super::TransportError;
use super::cluster::{Asking, Cluster, failed, late};
use super::nodes::{Nodes, PassEvent};
use crate::roster::Roster;

impl Cluster {
    /// Asks about nothing as often as the last pass asked, each time of the same nodes.
    pub async fn fan_out(
        &mut self,
        nodes: &mut Nodes,
        frame: u64,
        timeout: Duration,
        roster: &mut Roster,
    ) -> Result<(), TransportError> {
        nodes.drain(roster);
        let asked = std::mem::take(&mut self.asked);
        let question = Question::default();
        for waiting in &asked {
            let asking = self.asking(&question, frame, roster, timeout);
            for node in (0..waiting.len()).filter(|&node| waiting[node]) {
                let to = (asking.frame, asking.cameras[node].clone());
                let sent = nodes.clients[node].ask(asking.id, to, &question, &asking.written, None);
                sent.map_err(|error| failed(nodes, node, error))?;
            }
            answered(nodes, waiting.clone(), &asking, roster).await?;
        }
        self.asked = asked;
        Ok(())
    }
}

/// Waits until all have answered.
async fn answered(
    nodes: &mut Nodes,
    mut waiting: Vec<bool>,
    asking: &Asking,
    roster: &mut Roster,
) -> Result<(), TransportError> {
    while let Some(slowest) = waiting.iter().position(|&waits| waits) {
        let event = timeout_at(asking.deadline, nodes.next(roster)).await;
        let event = event.ok().filter(|_| Instant::now() <= asking.deadline);
        match event.ok_or_else(|| late(nodes, slowest, asking))? {
            Some(PassEvent::Reply(node, id, ..)) if id == asking.id => waiting[node] = false,
            Some(PassEvent::Down(node, error)) if waiting[node] => return Err(failed(nodes, node, error)),
            Some(PassEvent::Reply(..) | PassEvent::Down(..)) | None => {}
        }
    }
    Ok(())
}
