//! Computes answers to questions, one after the other: on a thread of its own, small ones on the caller's.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use hull::ViewSet;
use hull::question::Question;
use proto::convert::{Precision, RefusalReason, answer_to_wire, refusal};
use proto::v1;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tonic::Status;

use crate::cores::{Cores, work_ns};
use crate::frames::{Frame, FrameError, FrameRing};

/// Questions that wait at most, more than a coordinator asks at once; beyond, the node is busy.
pub(super) const MAX_WAITING: usize = 64;

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
}

/// Where the replies of one stream go.
pub(super) type ReplySender = mpsc::Sender<Result<v1::ProbeReply, Status>>;

/// The worker of a node, shared by its streams. Its thread, if it has one, ends with the last of them.
#[derive(Clone)]
pub(super) struct Worker {
    computation: Arc<Mutex<Computation>>,
    /// Jobs that are queued or being answered.
    waiting: Arc<AtomicUsize>,
    /// To its thread. Without one all is answered at once.
    queue: Option<SyncSender<(ProbeJob, ReplySender)>>,
    cameras: usize,
}

impl Worker {
    /// How many cameras the node has.
    pub fn camera_count(&self) -> usize {
        self.cameras
    }

    /// A worker for a node of so many cameras.
    pub fn new(ring: Arc<FrameRing>, cameras: usize) -> Worker {
        let mut worker = Worker::without_thread(ring, cameras, Cores::of_this_machine());
        let (queue, jobs) = sync_channel(MAX_WAITING);
        let (shared, count) = (Arc::clone(&worker.computation), Arc::clone(&worker.waiting));
        std::thread::spawn(move || run(&shared, &jobs, &count));
        worker.queue = Some(queue);
        worker
    }

    /// One that answers on its callers' threads.
    pub fn without_thread(ring: Arc<FrameRing>, cameras: usize, cores: Cores) -> Worker {
        let computation = Arc::new(Mutex::new(Computation { ring, cores }));
        Worker { computation, waiting: Arc::default(), queue: None, cameras }
    }

    /// Answers a small question here and now, if nothing else waits; others are queued, and answered through
    /// the sender. A full queue is a refusal.
    pub fn answer(&self, job: ProbeJob, replies: &ReplySender) -> Option<v1::ProbeReply> {
        let Some(queue) = &self.queue else {
            return Some(self.computation.lock().unwrap_or_else(PoisonError::into_inner).reply(&job));
        };
        let is_idle = self.waiting.load(Ordering::Acquire) == 0;
        if is_idle
            && work_ns(&job.question, self.cameras) <= AT_ONCE_NS
            && let Ok(mut computation) = self.computation.try_lock()
        {
            return Some(computation.reply(&job));
        }
        let id = job.id;
        self.waiting.fetch_add(1, Ordering::Release);
        let full = queue.try_send((job, replies.clone())).err()?;
        self.waiting.fetch_sub(1, Ordering::Release);
        let message = match full {
            TrySendError::Full(_) => format!("{MAX_WAITING} questions wait"),
            TrySendError::Disconnected(_) => "the node is ending".to_owned(),
        };
        Some(refusal(id, RefusalReason::Busy, message))
    }
}

/// Answers queued questions in their order.
fn run(computation: &Mutex<Computation>, jobs: &Receiver<(ProbeJob, ReplySender)>, waiting: &AtomicUsize) {
    while let Ok((job, replies)) = jobs.recv() {
        let reply = computation.lock().unwrap_or_else(PoisonError::into_inner).reply(&job);
        // A peer that has gone, or reads nothing, must not hold up the others.
        if replies.try_send(Ok(reply)).is_err() {
            tracing::debug!("a reply found no reader");
        }
        waiting.fetch_sub(1, Ordering::Release);
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
        let &ProbeJob { id, frame, ref cameras, precision, ref question } = job;
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
        answer_to_wire(id, answer, camera_count, precision, began.elapsed().as_secs_f64() * 1e3)
    }
}
