//! Applies the frame credits that coordinators send, and stops the cameras when no lease holder is left.

use std::sync::Arc;

use proto::v1;
use tokio::time::Instant;
use tokio_stream::StreamExt as _;
use tonic::Streaming;

use super::hold::{DESERTED_AFTER, SharedHold};
use crate::capture::Filming;
use crate::frames::FrameRing;

/// Applies the credits of one stream to the film and the ring of the node.
pub(super) struct CreditReceiver {
    pub hold: SharedHold,
    pub film: Arc<dyn Filming>,
    pub ring: Arc<FrameRing>,
}

impl CreditReceiver {
    /// Applies the messages of one stream, as long as their sender holds the lease.
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
            let was_holder = self.hold.lock().stream_ended(holder, Instant::now());
            // Streams of other peers change nothing.
            if was_holder {
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
