//! One probe stream: messages become questions, the worker's answers messages.

use std::sync::Arc;

use hull::question::Question;
use proto::convert::{Precision, QuestionReader, RefusalReason, refusal, trace_parent_from_wire};
use proto::v1;
use telemetry::Span;
use tokio_stream::StreamExt;
use tonic::Streaming;

use super::Service;
use super::hold::SharedHold;
use super::seats::{BudgetExhausted, Seat, Share};
use super::worker::{ProbeJob, ReplySender, Worker};
use crate::shapes::Shapes;

/// A stream and what it keeps: its list of bodies.
pub(super) struct ProbeStream {
    reader: QuestionReader,
    shapes: Arc<Shapes>,
    worker: Worker,
    hold: SharedHold,
    replies: ReplySender,
    seat: Option<Arc<Seat>>,
    /// What the list of bodies holds.
    share: Share,
}

impl ProbeStream {
    pub fn new(service: &Service, replies: ReplySender, seat: Option<Arc<Seat>>) -> ProbeStream {
        ProbeStream {
            reader: QuestionReader::default(),
            shapes: Arc::clone(&service.shapes),
            worker: service.worker.clone(),
            hold: service.hold.clone(),
            replies,
            share: Share::of(seat.clone()),
            seat,
        }
    }

    /// Serves until the stream ends.
    pub async fn serve(mut self, mut requests: Streaming<v1::ProbeRequest>) {
        while let Some(request) = requests.next().await {
            let request = match request {
                Ok(request) => request,
                Err(status) => return self.replies.fail(status).await,
            };
            let reply = match self.read(request) {
                Ok(job) => self.worker.answer(job, &self.replies),
                Err(reply) => Some(*reply),
            };
            reply.iter().for_each(|reply| self.worker.note_refusal(reply));
            if let Some(reply) = reply
                && self.replies.send(reply).await.is_err()
            {
                return;
            }
        }
    }

    fn read(&mut self, mut request: v1::ProbeRequest) -> Result<ProbeJob, Box<v1::ProbeReply>> {
        let (id, frame) = (request.id, request.frame);
        let span = Span::answer("answer", trace_parent_from_wire(&request.traceparent));
        let is_held = self.hold.check(request.holder, self.seat.as_deref());
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
        read.map_err(|error| {
            // What is refused leaves nothing behind.
            let _ = self.share.set(self.reader.held_bytes());
            Box::new(refusal(id, RefusalReason::from(&error), error.to_string()))
        })?;
        let share = self.count(&question).map_err(|error| {
            self.reader = QuestionReader::default();
            let _ = self.share.set(0);
            Box::new(refusal(id, RefusalReason::Busy, error.to_string()))
        })?;
        span.count("hulltouch.points", question.len());
        span.count("hulltouch.bytes", question.held_bytes());
        Ok(ProbeJob { id, frame, cameras, precision, question, span, _share: share })
    }

    fn count(&mut self, question: &Question) -> Result<Share, BudgetExhausted> {
        self.share.set(self.reader.held_bytes())?;
        Share::take(&self.seat, question.held_bytes())
    }
}
