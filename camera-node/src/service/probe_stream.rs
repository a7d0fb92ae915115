//! One probe stream: messages become questions, the worker's answers messages.

use std::sync::Arc;

use hull::question::Question;
use proto::convert::{Precision, QuestionReader, RefusalReason, refusal};
use proto::v1;
use tokio::time::Instant;
use tokio_stream::StreamExt;
use tonic::Streaming;

use super::hold::SharedHold;
use super::worker::{ProbeJob, ReplySender, Worker};
use crate::shapes::Shapes;

/// A stream and what it keeps: its list of bodies.
pub(super) struct ProbeStream {
    reader: QuestionReader,
    shapes: Arc<Shapes>,
    worker: Worker,
    hold: SharedHold,
    replies: ReplySender,
}

impl ProbeStream {
    pub fn new(shapes: Arc<Shapes>, worker: Worker, hold: SharedHold, replies: ReplySender) -> ProbeStream {
        ProbeStream { reader: QuestionReader::default(), shapes, worker, hold, replies }
    }

    /// Serves until the stream ends.
    pub async fn serve(mut self, mut requests: Streaming<v1::ProbeRequest>) {
        while let Some(Ok(request)) = requests.next().await {
            let reply = match self.read(request) {
                Ok(job) => self.worker.answer(job, &self.replies),
                Err(reply) => Some(*reply),
            };
            if let Some(reply) = reply
                && self.replies.send(Ok(reply)).await.is_err()
            {
                return;
            }
        }
    }

    fn read(&mut self, mut request: v1::ProbeRequest) -> Result<ProbeJob, Box<v1::ProbeReply>> {
        let (id, frame) = (request.id, request.frame);
        let is_held = self.hold.lock().check(request.holder, Instant::now());
        is_held.map_err(|by| Box::new(refusal(id, RefusalReason::Held, by.to_string())))?;
        let precision = if request.rounded { Precision::Quantised } else { Precision::Exact };
        let cameras = std::mem::take(&mut request.cameras);
        let most = self.worker.camera_count();
        if cameras.len() > most {
            let message = format!("ProbeRequest.cameras: holds {}, expected at most {most}", cameras.len());
            return Err(Box::new(refusal(id, RefusalReason::Malformed, message)));
        }
        let mut question = Question::default();
        let read = self.reader.read(request, |key| self.shapes.get(key), &mut question);
        read.map_err(|error| Box::new(refusal(id, RefusalReason::from(&error), error.to_string())))?;
        Ok(ProbeJob { id, frame, cameras, precision, question })
    }
}
