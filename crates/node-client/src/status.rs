//! Asking a node how it is, as a viewer: its run does not notice.

use std::sync::Arc;
use std::time::Duration;

use film_time::{monotonic_s, unix_now_s};
use proto::convert::status_from_wire;
use proto::text::{MAX_NAME_CHARS, clean};
use proto::v1::node_status_client::NodeStatusClient;
use proto::{Address, NodeStatus, v1};
use tonic::transport::Channel;

use crate::agreement::ExpectedNode;
use crate::connection::{Dial, channel};
use crate::counting::ByteCounters;
use crate::error::NodeError;

/// A node that says nothing for so long is not reached.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(4);
/// The quickest of so many answers says most of the node's clock.
const READINGS: usize = 5;
/// Far more than the cameras of any node need.
const MAX_ANSWER_BYTES: usize = 4 << 20;

/// How a node is, and how far its wall clock is from ours.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeReport {
    /// Where it answered.
    pub address: Address,
    /// What it says.
    pub status: NodeStatus,
    /// The node's wall clock less ours, seconds.
    pub clock_offset_s: f64,
    /// How far that may be off: half of the quickest answer's way there and back.
    pub clock_bound_s: f64,
}

/// Asks one node, again and again over one connection while that lasts.
pub struct StatusClient {
    node: ExpectedNode,
    dial: Arc<dyn Dial>,
    connected: Option<(Address, NodeStatusClient<Channel>)>,
}

impl StatusClient {
    /// Will ask this node.
    pub fn new(node: ExpectedNode, dial: Arc<dyn Dial>) -> StatusClient {
        StatusClient { node, dial, connected: None }
    }

    /// The node that is meant.
    pub fn node(&self) -> &ExpectedNode {
        &self.node
    }

    /// Asks; connects before, if need be. An error within a few seconds if the node does not answer.
    pub async fn ask(&mut self) -> Result<NodeReport, NodeError> {
        let asked = tokio::time::timeout(ANSWER_TIMEOUT, self.reach_and_ask()).await;
        let asked = asked.unwrap_or(Err(NodeError::Timeout(ANSWER_TIMEOUT)));
        if asked.is_err() {
            self.connected = None;
        }
        asked
    }

    async fn reach_and_ask(&mut self) -> Result<NodeReport, NodeError> {
        if let Some((address, client)) = &mut self.connected {
            // What breaks a connection that is old may be mended over a new one.
            if let Ok(report) = read(address, client).await {
                return Ok(report);
            }
        }
        let (report, client) = self.reach().await?;
        self.connected = Some((report.address.clone(), client));
        Ok(report)
    }

    /// Of a node that is looked for, it must have the cameras of the node that is meant.
    async fn reach(&self) -> Result<(NodeReport, NodeStatusClient<Channel>), NodeError> {
        self.node.place.reach(|address| async move { self.try_address(&address).await }).await
    }

    async fn try_address(
        &self,
        address: &Address,
    ) -> Result<(NodeReport, NodeStatusClient<Channel>), NodeError> {
        let channel = channel(&self.node.at(address), &self.dial, &Arc::<ByteCounters>::default()).await?;
        let mut client = NodeStatusClient::new(channel).max_decoding_message_size(MAX_ANSWER_BYTES);
        let first = client.status(v1::StatusRequest {}).await;
        first.map_err(|status| match (status.code(), NodeError::from(status)) {
            (tonic::Code::Unimplemented, _) => NodeError::NoStatus,
            (_, NodeError::Lost(why)) => NodeError::AtOnce { why, hint: self.dial.hint() },
            (_, other) => other,
        })?;
        let report = read(address, &mut client).await?;
        let found = &report.status.node.cameras;
        if self.node.place.is_sought() {
            let lacks = |name: &str| found.iter().all(|camera| camera.name != clean(name, MAX_NAME_CHARS));
            if let Some(missing) = self.node.cameras.iter().find(|camera| lacks(&camera.name)) {
                return Err(crate::Mismatch::NoCamera(missing.name.clone()).into());
            }
        }
        Ok((report, client))
    }
}

/// Several answers: the clock of the quickest, all else of the last.
async fn read(address: &Address, client: &mut NodeStatusClient<Channel>) -> Result<NodeReport, NodeError> {
    let mut clock: Option<(f64, f64)> = None;
    let mut last = None;
    for _ in 0..READINGS {
        let (sent_s, sent_unix_s) = (monotonic_s(), unix_now_s());
        let reply = client.status(v1::StatusRequest {}).await?.into_inner();
        let half_trip_s = 0.5 * (monotonic_s() - sent_s);
        let status = status_from_wire(reply)?;
        let offset_s = status.unix_s - (sent_unix_s + half_trip_s);
        if clock.is_none_or(|(_, bound_s)| half_trip_s < bound_s) {
            clock = Some((offset_s, half_trip_s));
        }
        last = Some(status);
    }
    let (Some((clock_offset_s, clock_bound_s)), Some(status)) = (clock, last) else {
        return Err(NodeError::NotConnected);
    };
    Ok(NodeReport { address: address.clone(), status, clock_offset_s, clock_bound_s })
}
