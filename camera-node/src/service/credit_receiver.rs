//! What a coordinator tells of film while its stream lives, and what becomes of the film when no lease holder is left.

use std::sync::Arc;

use proto::v1;
use tokio::time::Instant;
use tokio_stream::StreamExt as _;
use tonic::Streaming;

use super::hold::{DESERTED_AFTER, SharedHold};
use crate::capture::Filming;
use crate::frames::FrameRing;

/// Film that the lease holder of the node controls.
pub(super) struct Led {
    pub hold: SharedHold,
    pub film: Arc<dyn Filming>,
    pub ring: Arc<FrameRing>,
}

impl Led {
    /// Does what the messages of one stream say, as long as their sender holds the node.
    pub async fn follow(self, mut credits: Streaming<v1::FrameCredit>) {
        let mut counted: Option<u64> = None;
        while let Some(Ok(v1::FrameCredit { up_to_frame, in_use, holder })) = credits.next().await {
            let mut hold = self.hold.lock();
            if counted.is_none() && hold.stream_began(holder) {
                counted = Some(holder);
            }
            if hold.check(holder, Instant::now()).is_err() {
                continue;
            }
            drop(hold);
            self.film.credit(up_to_frame);
            if let Some(frame) = in_use {
                self.ring.hold(frame);
            }
        }
        if let Some(holder) = counted {
            let led = self.hold.lock().stream_ended(holder, Instant::now());
            // What others begin and end costs nothing.
            if led {
                self.stop_if_deserted().await;
            }
        }
    }

    /// Cameras without a lease holder are stopped after a while; a coordinator that comes back starts them again.
    async fn stop_if_deserted(self) {
        tokio::time::sleep(DESERTED_AFTER).await;
        // Film threads end between two frames.
        let stop = move || self.film.stop_if(&|| self.hold.lock().is_deserted(Instant::now()));
        let stopped = film_time::apart(stop).await;
        if stopped == Some(true) {
            tracing::info!("no coordinator for {} s: the cameras stop", DESERTED_AFTER.as_secs());
        }
    }
}
