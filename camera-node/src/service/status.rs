//! What the node reports of itself to coordinators and viewers. It changes nothing, and costs next to
//! nothing.

use std::sync::Arc;
use std::time::UNIX_EPOCH;

use film_time::{FilmState, monotonic_s, unix_now_s};
use net::Credentials;
use proto::convert::status_to_wire;
use proto::v1::node_status_server::{NodeStatus, NodeStatusServer};
use proto::{NodeDescription, v1};
use tokio::time::Instant;
use tonic::{Request, Response, Status};

use super::Service;
use super::hold::SharedHold;
use super::incoming::Access;
use crate::frames::FrameRing;

/// The question is empty.
const MAX_QUESTION_BYTES: usize = 1024;

/// The state behind the call.
pub(super) struct StatusService {
    description: NodeDescription,
    rig_indices: Vec<u16>,
    ring: Arc<FrameRing>,
    hold: SharedHold,
    /// Those that the node shows.
    credentials: Option<Arc<Credentials>>,
}

impl StatusService {
    /// Of the node that this service is of.
    pub fn of(service: &Service, access: &Access) -> NodeStatusServer<StatusService> {
        let credentials = match access {
            Access::Certified(credentials) => Some(Arc::clone(credentials)),
            Access::ThisMachine | Access::AnyPeer => None,
        };
        let description = service.description.clone();
        let status = StatusService {
            rig_indices: description.cameras.iter().map(|camera| camera.rig_index).collect(),
            description,
            ring: Arc::clone(&service.ring),
            hold: service.hold.clone(),
            credentials,
        };
        NodeStatusServer::new(status).max_decoding_message_size(MAX_QUESTION_BYTES)
    }

    fn now(&self) -> proto::NodeStatus {
        let holder = self.hold.lock().holder(Instant::now());
        let mut node = self.description.clone();
        node.term = holder.as_ref().map_or(0, |holder| holder.term);
        let ends = self.credentials.as_ref().map(|credentials| credentials.not_after_in_use());
        proto::NodeStatus {
            node,
            cameras: self.ring.status(&self.rig_indices),
            holder,
            certificate_ends_unix_s: ends
                .map(|ends| ends.duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())),
            failure: match self.ring.state() {
                FilmState::Failed(why) => Some(why),
                FilmState::Running | FilmState::Ended => None,
            },
            // Last, so that the asker's clock is compared with readings that are as new as can be.
            node_s: monotonic_s(),
            unix_s: unix_now_s(),
        }
    }
}

#[tonic::async_trait]
impl NodeStatus for StatusService {
    async fn status(&self, _: Request<v1::StatusRequest>) -> Result<Response<v1::StatusReply>, Status> {
        Ok(Response::new(status_to_wire(self.now())))
    }
}
