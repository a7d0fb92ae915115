//! The world that a node remembers.

use bytes::Bytes;
use proto::v1;

use crate::client::NodeClient;
use crate::error::NodeError;

impl NodeClient {
    /// Has the node remember a checkpoint, in the place of the one before.
    pub async fn keep_world(&self, checkpoint: Bytes) -> Result<(), NodeError> {
        let holder = self.holder();
        self.client()?.keep_world(v1::KeepWorldRequest { checkpoint, holder }).await?;
        Ok(())
    }

    /// The checkpoint that the node was last given, not checked; `None` without one.
    pub async fn fetch_world(&self) -> Result<Option<Bytes>, NodeError> {
        let reply = self.client()?.fetch_world(v1::FetchWorldRequest {}).await?;
        let v1::FetchWorldReply { checkpoint } = reply.into_inner();
        Ok(Some(checkpoint).filter(|checkpoint| !checkpoint.is_empty()))
    }
}
