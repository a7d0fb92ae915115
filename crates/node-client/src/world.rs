//! The worlds that a node remembers.

use bytes::Bytes;
use proto::v1;

use crate::client::NodeClient;
use crate::error::NodeError;

impl NodeClient {
    /// Has the node remember a checkpoint; it keeps this one and the one before.
    pub async fn keep_world(&self, checkpoint: Bytes) -> Result<(), NodeError> {
        let holder = self.holder();
        self.client()?.keep_world(v1::KeepWorldRequest { checkpoint, holder }).await?;
        Ok(())
    }

    /// The last two checkpoints that the node was given, the newest first, not checked; fewer if it was given fewer.
    pub async fn fetch_worlds(&self) -> Result<Vec<Bytes>, NodeError> {
        let reply = self.client()?.fetch_world(v1::FetchWorldRequest {}).await?;
        let v1::FetchWorldReply { checkpoint, previous } = reply.into_inner();
        Ok([checkpoint, previous].into_iter().filter(|checkpoint| !checkpoint.is_empty()).collect())
    }
}
