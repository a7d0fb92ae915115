//! Computes answers to questions, one after the other: on a thread of its own, small ones on the caller's.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use hull::ViewSet;
use hull::question::Question;
use parking_lot::Mutex;
use prost::Message as _;
use proto::convert::{Precision, RefusalReason, answer_to_wire, refusal, refusal_of};
use proto::v1;
use telemetry::{Beat, Span};
use tokio::sync::mpsc;
use tokio::time::Instant;
use tonic::Status;

use super::seats::{Seat, Share};
use super::turns::{NoTurn, Turns};
use crate::cores::{Cores, work_ns};
use crate::frames::{Frame, FrameError, FrameRing};
use crate::metrics::AnswerMeter;

/// Questions of one connection that wait at most, more than a coordinator asks at once; beyond, the node is busy.
pub(super) const MAX_WAITING: usize = 64;

/// The most that one question may take, nanoseconds: so long others wait for it at worst.
const MAX_WORK_NS: usize = 1_000_000_000;

/// Up to so much work, nanoseconds, the network thread does itself: waking another one and being woken by it
/// takes a tenth of a millisecond, in which bytes could as well wait.
const AT_ONCE_NS: usize = 400_000;

/// A question and how to answer it.
pub(super) struct ProbeJob {
    pub id: u64,
    pub frame: u64,
    /// Which of its cameras answer, by their places in the rig; none: all.
    pub cameras: Vec<u32>,
    pub precision: Precision,
    pub question: Question,
    /// From its arrival to its answer.
    pub span: Span,
    /// What it holds while it waits.
    pub _share: Share,
}

/// A reply that has not been sent, and what it holds until then.
pub(super) struct WaitingReply {
    pub reply: v1::ProbeReply,
    _share: Share,
}

/// Where the replies of one stream go.
#[derive(Clone)]
pub(super) struct ReplySender {
    replies: mpsc::Sender<Result<WaitingReply, Status>>,
    seat: Option<Arc<Seat>>,
}

impl ReplySender {
    pub fn new(replies: mpsc::Sender<Result<WaitingReply, Status>>, seat: Option<Arc<Seat>>) -> ReplySender {
        ReplySender { replies, seat }
    }

    /// Names the connection; 0 where there is but one.
    fn connection(&self) -> u64 {
        self.seat.as_ref().map_or(0, |seat| seat.id())
    }

    /// Replies are not read any more: the connection or its stream has ended.
    fn is_closed(&self) -> bool {
        self.replies.is_closed()
    }

    /// Waits until the peer has read others.
    pub async fn send(&self, reply: v1::ProbeReply) -> Result<(), Closed> {
        self.replies.send(self.counted(reply)).await.map_err(|_| Closed)
    }

    /// The stream ends with that.
    pub async fn fail(&self, status: Status) {
        let _ = self.replies.send(Err(status)).await;
    }

    /// Does not wait: a peer that has gone, or reads nothing, must not hold up the others.
    fn try_send(&self, reply: v1::ProbeReply) -> Result<(), Closed> {
        self.replies.try_send(self.counted(reply)).map_err(|_| Closed)
    }

    fn counted(&self, reply: v1::ProbeReply) -> Result<WaitingReply, Status> {
        match Share::take(&self.seat, reply.encoded_len()) {
            Ok(share) => Ok(WaitingReply { reply, _share: share }),
            Err(error) => Err(Status::resource_exhausted(error.to_string())),
        }
    }
}

/// The peer no longer reads the stream's replies.
#[derive(Debug)]
pub(super) struct Closed;

/// The worker of a node, shared by its streams. Its thread, if it has one, ends with the last of them.
#[derive(Clone)]
pub(super) struct Worker {
    computation: Arc<Mutex<Computation>>,
    /// Jobs that are queued or being answered.
    waiting: Arc<AtomicUsize>,
    answers: Arc<AnswerMeter>,
    /// To its thread. Without one all is answered at once.
    queue: Option<Arc<Queue>>,
    cameras: usize,
}

/// Closes the queue when the last worker is dropped.
struct Queue(Arc<Turns<WaitingJob>>);

/// A question that waits, where its answer goes, and the span of its waiting.
type WaitingJob = (ProbeJob, ReplySender, Span);

impl Drop for Queue {
    fn drop(&mut self) {
        self.0.close();
    }
}

impl Worker {
    /// How many cameras the node has.
    pub fn camera_count(&self) -> usize {
        self.cameras
    }

    /// What it counts: answers, and the questions that wait.
    pub fn meters(&self) -> (Arc<AnswerMeter>, Arc<AtomicUsize>) {
        (Arc::clone(&self.answers), Arc::clone(&self.waiting))
    }

    /// Counts a reply that refuses its question, when it is sent.
    pub fn note_refusal(&self, reply: &v1::ProbeReply) {
        refusal_of(reply).into_iter().for_each(|reason| self.answers.refused(reason));
    }

    /// A worker for a node of so many cameras.
    pub fn new(ring: Arc<FrameRing>, cameras: usize, beat: Arc<Beat>) -> Worker {
        let mut worker = Worker::without_thread(ring, cameras, Cores::of_this_machine());
        let jobs = Arc::new(Turns::new(MAX_WAITING));
        worker.queue = Some(Arc::new(Queue(Arc::clone(&jobs))));
        let (shared, count) = (Arc::clone(&worker.computation), Arc::clone(&worker.waiting));
        std::thread::spawn(move || run(&shared, &jobs, &count, &beat));
        worker
    }

    /// One that answers on its callers' threads.
    pub fn without_thread(ring: Arc<FrameRing>, cameras: usize, cores: Cores) -> Worker {
        let answers = Arc::new(AnswerMeter::default());
        let computation = Arc::new(Mutex::new(Computation { ring, cores, answers: Arc::clone(&answers) }));
        Worker { computation, waiting: Arc::default(), answers, queue: None, cameras }
    }

    /// Answers a small question here and now, if nothing else waits; others are queued, and answered through
    /// the sender. A question that is too much, or one too many, is a refusal.
    pub fn answer(&self, job: ProbeJob, replies: &ReplySender) -> Option<v1::ProbeReply> {
        let work_ns = work_ns(&job.question, self.cameras);
        if work_ns > MAX_WORK_NS {
            let message = format!(
                "a question of {} points takes about {:.1} s here, expected at most {} s",
                job.question.len(),
                work_ns as f64 / 1e9,
                MAX_WORK_NS / 1_000_000_000
            );
            return Some(refusal(job.id, RefusalReason::TooManyPoints, message));
        }
        let Some(Queue(queue)) = self.queue.as_deref() else {
            return Some(self.computation.lock().reply(&job));
        };
        let is_idle = self.waiting.load(Ordering::Acquire) == 0;
        if is_idle
            && work_ns <= AT_ONCE_NS
            && let Some(mut computation) = self.computation.try_lock()
        {
            return Some(computation.reply(&job));
        }
        let id = job.id;
        self.waiting.fetch_add(1, Ordering::Release);
        // Those of connections that have ended hold memory and turns.
        let forgotten = queue.forget(|(_, replies, _)| replies.is_closed());
        self.waiting.fetch_sub(forgotten, Ordering::Release);
        let waits = job.span.part("wait");
        let no_turn = queue.push(replies.connection(), (job, replies.clone(), waits)).err()?;
        self.waiting.fetch_sub(1, Ordering::Release);
        let message = match no_turn {
            NoTurn::Full => format!("{MAX_WAITING} questions wait"),
            NoTurn::Closed => "the node is ending".to_owned(),
        };
        Some(refusal(id, RefusalReason::Busy, message))
    }
}

/// Answers queued questions, connections by turns.
fn run(computation: &Mutex<Computation>, jobs: &Turns<WaitingJob>, waiting: &AtomicUsize, beat: &Beat) {
    while let Some((job, replies, waits)) = jobs.next() {
        drop(waits);
        if replies.is_closed() {
            waiting.fetch_sub(1, Ordering::Release);
            continue;
        }
        beat.works();
        let mut computation = computation.lock();
        let reply = computation.reply(&job);
        refusal_of(&reply).into_iter().for_each(|reason| computation.answers.refused(reason));
        drop(computation);
        drop(job);
        if replies.try_send(reply).is_err() {
            tracing::debug!("a reply found no reader");
        }
        waiting.fetch_sub(1, Ordering::Release);
        beat.waits();
    }
}

/// The views of the cameras that are named, if these are not all that the frame has; or the first that it lacks.
fn named(frame: &Frame, cameras: &[u32]) -> Result<Option<ViewSet>, u32> {
    let has = |rig_index: u32| frame.cameras.iter().any(|camera| u32::from(camera.rig_index) == rig_index);
    if let Some(&lacking) = cameras.iter().find(|&&rig_index| !has(rig_index)) {
        return Err(lacking);
    }
    let is_all = cameras.is_empty()
        || frame.cameras.iter().all(|camera| cameras.contains(&u32::from(camera.rig_index)));
    Ok((!is_all).then(|| frame.views.only(|rig_index| cameras.contains(&u32::from(rig_index)))))
}

struct Computation {
    ring: Arc<FrameRing>,
    cores: Cores,
    answers: Arc<AnswerMeter>,
}

impl Computation {
    fn reply(&mut self, job: &ProbeJob) -> v1::ProbeReply {
        let answered = catch_unwind(AssertUnwindSafe(|| self.answer(job)));
        answered.unwrap_or_else(|_| {
            // No message may end the node, not even one that finds a bug.
            tracing::error!("a question made the computation panic");
            self.cores = Cores::of_this_machine();
            refusal(job.id, RefusalReason::Malformed, "the computation panicked")
        })
    }

    fn answer(&mut self, job: &ProbeJob) -> v1::ProbeReply {
        let began = Instant::now();
        let &ProbeJob { id, frame, ref cameras, precision, ref question, ref span, _share: _ } = job;
        let _span = span.part("compute");
        let frame = match self.ring.get(frame) {
            Ok(frame) => frame,
            Err(error) => {
                let reason = match error {
                    FrameError::Gone { .. } => RefusalReason::Gone,
                    FrameError::NotYet { .. } | FrameError::Empty => RefusalReason::NotYet,
                };
                return refusal(id, reason, error.to_string());
            }
        };
        let narrowed = match named(&frame, cameras) {
            Ok(narrowed) => narrowed,
            Err(lacking) => {
                let message = format!("frame {} went on without camera {lacking}", frame.number);
                return refusal(id, RefusalReason::Gone, message);
            }
        };
        let views = narrowed.as_ref().unwrap_or(&frame.views);
        let answer = self.cores.answer(views, question);
        let camera_count = views.views().len();
        let took_s = began.elapsed().as_secs_f64();
        self.answers.answered(question.kind, question.len(), took_s);
        answer_to_wire(id, answer, camera_count, precision, took_s * 1e3)
    }
}
