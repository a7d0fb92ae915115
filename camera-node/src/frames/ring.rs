//! The ring: frames appear when all cameras have delivered them, and leave in their order.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use film_time::{FilmState, monotonic_s};
use hull::ViewSet;
use parking_lot::Mutex;
use proto::{CameraStatus, TroubleKind};
use thiserror::Error;
use tokio::sync::futures::Notified;
use tokio::sync::{Notify, watch};

use super::frame::{CameraFrame, Frame, Stamp};
use super::health::CameraHealth;

/// How many frames are kept if nothing else is said.
pub const RING_FRAMES: usize = 8;
/// Silhouettes of all frames of a ring together, as compact bytes; beyond, fewer frames are kept.
const MAX_BYTES: usize = 256 << 20;

/// Frames go on without a camera that has delivered nothing for so long after another's first frame, seconds.
const BEGIN_WITHOUT_S: f64 = 1.5;

/// Why a frame is not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum FrameError {
    /// It has left the ring, or was passed over.
    #[error("frame {asked} is gone: the ring holds {oldest} to {newest}")]
    Gone {
        /// The frame asked for.
        asked: u64,
        /// The oldest there is.
        oldest: u64,
        /// The newest there is.
        newest: u64,
    },
    /// It has not come yet.
    #[error("frame {asked} has not come yet: the newest is {newest}")]
    NotYet {
        /// The frame asked for.
        asked: u64,
        /// The newest there is.
        newest: u64,
    },
    /// The ring is empty.
    #[error("no frame has come yet")]
    Empty,
}

struct Parts {
    stamp: Stamp,
    cameras: Vec<Option<CameraFrame>>,
}

#[derive(Default)]
struct Inner {
    ring: VecDeque<Arc<Frame>>,
    /// The frame that the coordinator uses, however old.
    held: Option<Arc<Frame>>,
    /// Frames that some cameras have delivered and others not, at most [`RING_FRAMES`].
    pending: BTreeMap<u64, Parts>,
    /// Which cameras' films have ended, and the newest frame that each has delivered.
    ended: Vec<bool>,
    delivered: Vec<Option<u64>>,
    /// The first frame that waits for each camera; none waits for one that is left out.
    awaited_from: Vec<Option<u64>>,
    /// When the first frame of any camera was delivered, by [`monotonic_s`].
    began_s: Option<f64>,
    /// Whether frames go on without a camera that does not film.
    goes_on: bool,
    state: FilmState,
    /// How each camera films.
    health: Vec<CameraHealth>,
    /// Counts runs: each begins with an empty ring and numbers its frames again.
    run: u64,
    /// What the coordinator calls this run, 0 before the first.
    called: u64,
}

impl Inner {
    fn new(camera_count: usize) -> Inner {
        let (ended, delivered) = (vec![false; camera_count], vec![None; camera_count]);
        let (awaited_from, health) =
            (vec![Some(0); camera_count], vec![CameraHealth::default(); camera_count]);
        Inner { ended, delivered, awaited_from, health, ..Inner::default() }
    }

    /// Whether a frame has all cameras that it waits for.
    fn is_complete(&self, number: u64) -> bool {
        let awaits = |from: &Option<u64>| from.is_some_and(|from| from <= number);
        self.pending.get(&number).is_some_and(|parts| {
            let mut cameras = parts.cameras.iter().zip(&self.awaited_from);
            cameras.all(|(part, from)| part.is_some() || !awaits(from))
        })
    }

    /// Leaves out a camera that is two frames behind all others. One that has yet to begin is waited for, for a while.
    fn leave_out_late(&mut self, now_s: f64) {
        // Film that has ended comes no more, and ends all.
        if self.ended.contains(&true) {
            return;
        }
        let began_s = *self.began_s.get_or_insert(now_s);
        if now_s > began_s + BEGIN_WITHOUT_S {
            let cameras = self.awaited_from.iter_mut().zip(&self.delivered);
            cameras.filter(|(_, delivered)| delivered.is_none()).for_each(|(from, _)| *from = None);
        }
        let cameras = self.delivered.iter().zip(&self.awaited_from).enumerate();
        let awaited = cameras.filter(|(_, (_, from))| from.is_some());
        let mut newest: Vec<(Option<u64>, usize)> =
            awaited.map(|(camera, (delivered, _))| (*delivered, camera)).collect();
        newest.sort_unstable();
        if let [(Some(last), camera), (Some(next), _), ..] = newest[..]
            && next >= last + 2
        {
            self.awaited_from[camera] = None;
        }
    }

    fn note_end(&mut self) {
        let cameras = || self.ended.iter().zip(&self.delivered);
        let shortest = cameras().filter(|(ended, _)| **ended).map(|(_, last)| *last).min();
        let Some(shortest) = shortest else { return };
        let awaited = || cameras().zip(&self.awaited_from).filter(|(_, from)| from.is_some());
        let all_have_it = awaited().all(|((ended, last), _)| *ended || *last >= shortest);
        if all_have_it && self.state == FilmState::Running {
            self.state = FilmState::Ended;
        }
    }
}

/// A frame of one of the runs that a ring has seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameId {
    /// Which run, counted by the ring.
    pub run: u64,
    /// The frame's number in it.
    pub number: u64,
}

/// What is new in a ring.
#[derive(Debug)]
pub struct News {
    /// The run that is on, counted by the ring.
    pub run: u64,
    /// What the coordinator calls it, 0 before the first.
    pub called: u64,
    /// Its frames, oldest first.
    pub frames: Vec<Arc<Frame>>,
    /// The state of its film; of one that has ended, no frame follows these.
    pub state: FilmState,
}

/// The ring; shared by film threads, the service and, in process, the coordinator.
pub struct FrameRing {
    camera_count: usize,
    /// How many are kept.
    frames: usize,
    inner: Mutex<Inner>,
    version: watch::Sender<u64>,
    /// The same for streams, in the order in which they began to wait: what they send is then always in one order.
    streams: Notify,
}

impl FrameRing {
    /// An empty ring for a node of so many cameras.
    pub fn new(camera_count: usize) -> FrameRing {
        FrameRing {
            camera_count,
            frames: RING_FRAMES,
            inner: Mutex::new(Inner::new(camera_count)),
            version: watch::Sender::new(0),
            streams: Notify::new(),
        }
    }

    /// The same that keeps so many frames.
    pub fn keeping(self, frames: usize) -> FrameRing {
        FrameRing { frames, ..self }
    }

    /// How many frames are kept.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Forgets all frames: a run begins, which the coordinator calls so. It goes on without a camera that does not film,
    /// or waits for it.
    pub fn begin_run(&self, called: u64, goes_on: bool) {
        let mut inner = self.lock();
        let run = inner.run + 1;
        *inner = Inner { run, called, goes_on, ..Inner::new(self.camera_count) };
        drop(inner);
        self.changed();
    }

    /// Hands in one camera's part of a frame (`camera` counts within the node); the frame appears once
    /// all cameras have delivered theirs.
    pub fn offer(&self, camera: usize, stamp: Stamp, part: CameraFrame) {
        self.offer_at(camera, stamp, part, monotonic_s());
    }

    fn offer_at(&self, camera: usize, stamp: Stamp, part: CameraFrame, now_s: f64) {
        let mut inner = self.lock();
        inner.delivered[camera] = Some(stamp.number);
        inner.health[camera].note(stamp, &part, now_s);
        inner.note_end();
        if let Some(newest) =
            inner.ring.back().map(|newest| newest.number).filter(|newest| stamp.number <= *newest)
        {
            // One that is less than a period behind the others is waited for from the next frame on.
            if stamp.number == newest {
                inner.awaited_from[camera].get_or_insert(newest + 1);
            }
            return;
        }
        let count = self.camera_count;
        let parts =
            inner.pending.entry(stamp.number).or_insert_with(|| Parts { stamp, cameras: vec![None; count] });
        // The earliest of them: so later frames are captured later, whichever camera delivers first.
        if stamp.capture_time_s < parts.stamp.capture_time_s {
            parts.stamp = stamp;
        }
        parts.cameras[camera] = Some(part);
        inner.awaited_from[camera].get_or_insert(stamp.number);
        if inner.goes_on {
            inner.leave_out_late(now_s);
        }
        self.publish_complete(&mut inner);
        if inner.pending.len() > RING_FRAMES {
            // A camera that missed its frame must not hold the others' parts for ever.
            inner.pending.pop_first();
        }
        drop(inner);
        self.changed();
    }

    /// How each camera films now, for who looks; `rig_indices` are their places in the rig.
    pub fn status(&self, rig_indices: &[u16]) -> Vec<CameraStatus> {
        let (inner, now_s) = (self.lock(), monotonic_s());
        rig_indices.iter().zip(&inner.health).map(|(place, health)| health.status(*place, now_s)).collect()
    }

    /// Remembers, for who looks, why a camera's film has failed.
    pub fn note_trouble(&self, camera: usize, kind: TroubleKind, why: &str) {
        self.lock().health[camera].fail(kind, why, monotonic_s());
    }

    /// A camera films nothing now: frames go on without it, until it delivers again.
    pub fn leave_out(&self, camera: usize) {
        let mut inner = self.lock();
        if inner.goes_on {
            inner.awaited_from[camera] = None;
            self.publish_complete(&mut inner);
        }
        drop(inner);
        self.changed();
    }

    fn publish_complete(&self, inner: &mut Inner) {
        let complete: Vec<u64> =
            inner.pending.keys().copied().filter(|&number| inner.is_complete(number)).collect();
        complete.into_iter().for_each(|number| self.publish(inner, number));
    }

    fn publish(&self, inner: &mut Inner, number: u64) {
        let Some(Parts { stamp, cameras }) = inner.pending.remove(&number) else { return };
        inner.pending = inner.pending.split_off(&number);
        let cameras: Vec<CameraFrame> = cameras.into_iter().flatten().collect();
        let views = ViewSet::new(cameras.iter().map(|camera| camera.view.clone()).collect());
        let views = match inner.ring.back() {
            Some(before) => views.after(&before.views, number - before.number),
            None => views,
        };
        let expected = inner.ring.back().map_or(0, |before| before.number + 1);
        inner.ring.push_back(Arc::new(Frame {
            number,
            capture_time_s: stamp.capture_time_s,
            captured_unix_s: stamp.captured_unix_s,
            skipped: number - expected,
            cameras,
            views,
        }));
        let bytes = |frame: &Arc<Frame>| frame.cameras.iter().map(|camera| camera.bytes.len()).sum::<usize>();
        let mut total: usize = inner.ring.iter().map(bytes).sum();
        while inner.ring.len() > self.frames || total > MAX_BYTES && inner.ring.len() > 1 {
            total -= inner.ring.pop_front().as_ref().map_or(0, bytes);
        }
    }

    /// Notes that a camera's film has ended. The node's film ends with the shortest: once the others have
    /// delivered what it had. Its last frames stay in the ring.
    pub fn end(&self, camera: usize) {
        let mut inner = self.lock();
        inner.ended[camera] = true;
        inner.note_end();
        drop(inner);
        self.changed();
    }

    /// Notes that the film has failed.
    pub fn fail(&self, why: String) {
        let mut inner = self.lock();
        if !matches!(inner.state, FilmState::Failed(_)) {
            inner.state = FilmState::Failed(why);
        }
        drop(inner);
        self.changed();
    }

    /// The state of the film.
    pub fn state(&self) -> FilmState {
        self.lock().state.clone()
    }

    /// Keeps a frame, however old it gets, until another is held or a run begins: a world that stands still, or
    /// holds the last frame of film, goes on asking about it. One that is not there is not held.
    pub fn hold(&self, number: u64) {
        let mut inner = self.lock();
        let in_ring = inner.ring.iter().find(|frame| frame.number == number).cloned();
        if in_ring.is_some() {
            inner.held = in_ring;
        }
    }

    /// The frame of that number.
    pub fn get(&self, number: u64) -> Result<Arc<Frame>, FrameError> {
        let inner = self.lock();
        let (oldest, newest) = match (inner.ring.front(), inner.ring.back()) {
            (Some(oldest), Some(newest)) => (oldest.number, newest.number),
            _ => return Err(FrameError::Empty),
        };
        if number > newest {
            return Err(FrameError::NotYet { asked: number, newest });
        }
        let found = inner.ring.iter().chain(&inner.held).find(|frame| frame.number == number);
        found.cloned().ok_or(FrameError::Gone { asked: number, oldest, newest })
    }

    /// The newest frame.
    pub fn newest(&self) -> Result<Arc<Frame>, FrameError> {
        self.lock().ring.back().cloned().ok_or(FrameError::Empty)
    }

    /// What has come after a frame.
    pub fn since(&self, seen: Option<FrameId>) -> News {
        let inner = self.lock();
        let last = seen.filter(|seen| seen.run == inner.run).map(|seen| seen.number);
        let is_new = |frame: &&Arc<Frame>| last.is_none_or(|last| frame.number > last);
        let frames = inner.ring.iter().filter(is_new).cloned().collect();
        News { run: inner.run, called: inner.called, frames, state: inner.state.clone() }
    }

    /// Wakes whenever a frame, an end or a failure has come.
    pub fn watch(&self) -> watch::Receiver<u64> {
        self.version.subscribe()
    }

    /// Wakes at the next frame, end or failure that comes after this call.
    pub fn changes(&self) -> Notified<'_> {
        self.streams.notified()
    }

    fn changed(&self) {
        self.version.send_modify(|version| *version += 1);
        self.streams.notify_waiters();
    }

    fn lock(&self) -> parking_lot::MutexGuard<'_, Inner> {
        // A panic elsewhere leaves the ring consistent: no statement here panics between two changes.
        self.inner.lock()
    }
}

#[cfg(test)]
mod tests {
    use hull::{Observer, ProbeSettings, Silhouette};

    use super::*;

    fn observer(rig_index: u16) -> Arc<Observer> {
        let camera = crate::source::tests::camera(8, 4);
        Arc::new(Observer::new(camera, rig_index, ProbeSettings::default(), None))
    }

    fn offer(ring: &FrameRing, camera: usize, number: u64) {
        offer_at(ring, camera, number, 0.0);
    }

    fn offer_at(ring: &FrameRing, camera: usize, number: u64, now_s: f64) {
        let stamp = Stamp { number, capture_time_s: 0.0, captured_unix_s: 0.0 };
        let silhouette = Silhouette::empty(8, 4).expect("size");
        ring.offer_at(camera, stamp, CameraFrame::new(&observer(camera as u16), silhouette, 0.0), now_s);
    }

    #[test]
    fn frames_begin_without_a_camera_that_never_films_and_wait_for_it_once_it_does() {
        let ring = FrameRing::new(3);
        ring.begin_run(1, true);
        for number in 0..70 {
            let now_s = 100.0 + number as f64 / 30.0;
            (0..2).for_each(|camera| offer_at(&ring, camera, number, now_s));
            assert_eq!(held(&ring).is_empty(), now_s <= 101.5, "at {now_s} s");
        }
        assert!(held(&ring).iter().all(|(_, cameras)| *cameras == [0, 1]));
        for number in 70..73 {
            (0..3).for_each(|camera| offer_at(&ring, camera, number, 103.0));
        }
        assert_eq!(held(&ring).last(), Some(&(72, vec![0, 1, 2])));
        let waits = FrameRing::new(2);
        (0..900).for_each(|number| offer_at(&waits, 0, number, number as f64));
        assert!(held(&waits).is_empty(), "a run in lock-step waits for all");
    }

    #[test]
    fn frames_appear_when_all_cameras_have_them_and_leave_in_order() {
        let ring = FrameRing::new(2);
        offer(&ring, 0, 0);
        assert!(matches!(ring.get(0), Err(FrameError::Empty)));
        offer(&ring, 1, 0);
        assert_eq!(ring.get(0).expect("complete").cameras.len(), 2);
        for number in 1..=RING_FRAMES as u64 {
            offer(&ring, 1, number);
            offer(&ring, 0, number);
        }
        assert!(matches!(ring.get(0), Err(FrameError::Gone { asked: 0, oldest: 1, newest: 8 })));
        assert!(matches!(ring.get(9), Err(FrameError::NotYet { .. })));
    }

    #[test]
    fn the_frame_in_use_stays_until_another_is_or_a_run_begins() {
        let ring = FrameRing::new(1);
        (0..4).for_each(|number| offer(&ring, 0, number));
        ring.hold(2);
        (4..40).for_each(|number| offer(&ring, 0, number));
        assert_eq!(ring.get(2).map(|frame| frame.number), Ok(2));
        assert!(matches!(ring.get(3), Err(FrameError::Gone { .. })));
        ring.hold(3);
        assert_eq!(ring.get(2).map(|frame| frame.number), Ok(2), "what is gone cannot take its place");
        ring.hold(39);
        assert!(matches!(ring.get(2), Err(FrameError::Gone { .. })));
        ring.begin_run(1, false);
        assert!(matches!(ring.get(39), Err(FrameError::Empty)));
    }

    #[test]
    fn a_frame_that_one_camera_missed_is_counted_and_forgotten() {
        let ring = FrameRing::new(2);
        offer(&ring, 0, 3);
        offer(&ring, 1, 3);
        assert_eq!(ring.get(3).expect("complete").skipped, 3, "those since the run began");
        offer(&ring, 0, 4);
        offer(&ring, 0, 5);
        offer(&ring, 1, 5);
        assert_eq!(ring.get(5).expect("complete").skipped, 1);
        assert!(matches!(ring.get(4), Err(FrameError::Gone { .. })));
    }

    /// What frames hold, by the places of their cameras.
    fn held(ring: &FrameRing) -> Vec<(u64, Vec<u16>)> {
        let places = |frame: &Arc<Frame>| frame.cameras.iter().map(|camera| camera.rig_index).collect();
        ring.since(None).frames.iter().map(|frame| (frame.number, places(frame))).collect()
    }

    #[test]
    fn frames_go_on_without_a_camera_that_films_nothing_and_wait_for_it_again_once_it_does() {
        let ring = FrameRing::new(3);
        ring.begin_run(1, true);
        (0..3).for_each(|camera| offer(&ring, camera, 0));
        offer(&ring, 0, 1);
        offer(&ring, 2, 1);
        assert_eq!(held(&ring).len(), 1, "it may still come");
        ring.leave_out(1);
        assert_eq!(held(&ring)[1], (1, vec![0, 2]), "it will not");
        offer(&ring, 0, 2);
        offer(&ring, 2, 2);
        offer(&ring, 0, 3);
        offer(&ring, 1, 3);
        assert_eq!(held(&ring).len(), 3);
        offer(&ring, 2, 3);
        offer(&ring, 2, 4);
        offer(&ring, 0, 4);
        assert_eq!(held(&ring)[2..], [(2, vec![0, 2]), (3, vec![0, 1, 2])], "the next waits for it");
    }

    #[test]
    fn a_camera_comes_back_though_the_others_are_always_a_little_earlier() {
        let ring = FrameRing::new(2);
        ring.begin_run(1, true);
        (0..2).for_each(|camera| offer(&ring, camera, 0));
        ring.leave_out(1);
        for number in 1..4 {
            offer(&ring, 0, number);
            offer(&ring, 1, number);
        }
        assert_eq!(held(&ring)[1..], [(1, vec![0]), (2, vec![0, 1]), (3, vec![0, 1])]);
    }

    #[test]
    fn a_camera_two_frames_behind_all_others_is_left_out() {
        let ring = FrameRing::new(3);
        ring.begin_run(1, true);
        (0..3).for_each(|camera| offer(&ring, camera, 0));
        for number in 1..=2 {
            offer(&ring, 0, number);
            offer(&ring, 1, number);
        }
        assert_eq!(held(&ring)[1..], [(1, vec![0, 1]), (2, vec![0, 1])]);
        offer(&ring, 2, 1);
        assert_eq!(held(&ring).len(), 3, "what comes too late is dropped");
        let waits = FrameRing::new(2);
        (0..9).for_each(|number| offer(&waits, 0, number));
        assert!(held(&waits).is_empty(), "a run that waits for all excludes no camera");
    }

    #[test]
    fn frames_come_again_when_a_camera_is_back_and_count_those_it_missed() {
        let ring = FrameRing::new(3);
        (0..3).for_each(|camera| offer(&ring, camera, 0));
        for number in 1..1000 {
            offer(&ring, 0, number);
            // The third is back two frames later than the second, which then misses one.
            if number >= 990 && number != 992 {
                offer(&ring, 1, number);
            }
            if number >= 992 {
                offer(&ring, 2, number);
            }
            assert!(ring.lock().pending.len() <= RING_FRAMES);
        }
        let frames = ring.since(None).frames;
        let found: Vec<_> = frames.iter().map(|frame| (frame.number, frame.skipped)).take(3).collect();
        assert_eq!(found, [(0, 0), (993, 992), (994, 0)]);
    }

    #[test]
    fn film_ends_with_the_shortest_and_fails_when_one_does() {
        let ring = FrameRing::new(2);
        offer(&ring, 0, 0);
        ring.end(0);
        assert_eq!(ring.state(), FilmState::Running, "the other has yet to deliver frame 0");
        offer(&ring, 1, 0);
        assert_eq!(ring.state(), FilmState::Ended);
        ring.begin_run(1, false);
        ring.fail("no".into());
        ring.end(0);
        ring.end(1);
        assert_eq!(ring.state(), FilmState::Failed("no".into()));
    }

    #[test]
    fn frames_of_a_longer_film_do_not_push_out_the_last_common_ones() {
        let ring = FrameRing::new(2);
        for number in 0..200 {
            offer(&ring, 0, number);
            match number {
                0..60 => offer(&ring, 1, number),
                60 => ring.end(1),
                _ => {}
            }
        }
        let News { frames, state, .. } = ring.since(None);
        assert_eq!(state, FilmState::Ended);
        let numbers: Vec<u64> = frames.iter().map(|frame| frame.number).collect();
        assert_eq!(numbers, (52..60).collect::<Vec<u64>>());
    }
}
