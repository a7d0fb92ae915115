//! The background learnt again while film goes on: from so many frames of the film itself, beginning at the
//! same frame in every camera. Frames are cut out with the old background until the new one is there. A room that is not
//! empty by the old one is refused, and the old one can be used again.

use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use film_time::{BACKGROUND_S, BackgroundFilm};
use parking_lot::Mutex;
use segment::{BackgroundBuilder, BackgroundModel, Method};
use thiserror::Error;
use tokio::sync::oneshot;

use super::segmenter::CutoutError;
use crate::config::NodeCamera;
use crate::source::Image;

/// The room is empty while no frame has more foreground than this share of the image, by the background in use.
const MAX_FOREGROUND: f64 = 0.005;
/// Backgrounds that wait to be restored, at most.
const MAX_RESTORES: usize = 4;

/// Why no background is learnt.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BackgroundError {
    /// Too little film, or too much.
    #[error("a background of {frames} frames, expected {least} to {most}")]
    Length {
        /// Frames requested.
        frames: u64,
        /// The least.
        least: u64,
        /// The most.
        most: u64,
    },
    /// A camera whose frames are silhouettes already.
    #[error("camera {0:?} learns no background: its source gives masks")]
    Masks(String),
    /// A camera that needs no background.
    #[error("camera {0:?} learns no background: it is keyed by colour")]
    Chroma(String),
    /// The room was not empty.
    #[error(
        "camera {camera:?} keeps its background: while the new one was filmed, {:.1} % of its image were foreground, \
         expected an empty room ({} % at most)", 100.0 * share, 100.0 * MAX_FOREGROUND
    )]
    Foreground {
        /// Name of the camera.
        camera: String,
        /// The greatest share of its image.
        share: f64,
    },
    /// Its frames make no background.
    #[error("camera {camera:?} keeps its background: {error}")]
    Cutout {
        /// Name of the camera.
        camera: String,
        /// What happened.
        error: CutoutError,
    },
    /// It films nothing, or was asked for another one.
    #[error(
        "camera {0:?} keeps its background: it films nothing, or was asked for another one before this was learnt"
    )]
    Dropped(String),
}

/// Checks the length of film at so many frames per second, and that all cameras have a background.
pub(super) fn check_background<'a>(
    film: BackgroundFilm,
    cameras: impl Iterator<Item = &'a NodeCamera>,
    fps: f64,
) -> Result<(), BackgroundError> {
    let frames_of = |seconds: f64| (seconds * fps).ceil() as u64;
    let (least, most) = (frames_of(*BACKGROUND_S.start()), frames_of(*BACKGROUND_S.end()));
    if !(least..=most).contains(&film.frames) {
        return Err(BackgroundError::Length { frames: film.frames, least, most });
    }
    for camera in cameras {
        let name = || camera.camera.name().to_owned();
        if camera.source.gives_masks() {
            return Err(BackgroundError::Masks(name()));
        }
        if camera.segmentation.method == Method::Chroma {
            return Err(BackgroundError::Chroma(name()));
        }
    }
    Ok(())
}

/// What a camera answers once it uses its new background, or keeps the one before.
type Answer = Result<(), BackgroundError>;

/// The backgrounds that the cameras of a node are learning. Dropped before all use theirs, none does.
pub struct Learning {
    id: u64,
    slots: Vec<Arc<BackgroundSlot>>,
    /// The cameras that have not answered, by name.
    waiting: Vec<(String, oneshot::Receiver<Answer>)>,
    is_done: bool,
}

impl Learning {
    /// Has film threads learn their backgrounds, each with the name of its camera.
    pub(super) fn begin<'a>(
        film: BackgroundFilm,
        cameras: impl Iterator<Item = (&'a str, &'a Arc<BackgroundSlot>)> + Clone,
    ) -> Learning {
        Learning {
            id: film.id,
            waiting: cameras.clone().map(|(name, slot)| (name.into(), slot.learn(film))).collect(),
            slots: cameras.map(|(_, slot)| Arc::clone(slot)).collect(),
            is_done: false,
        }
    }

    /// Waits until all cameras use theirs, or one keeps the one before: then all do.
    pub async fn finished(mut self) -> Answer {
        let answer = poll_fn(|context| self.poll(context)).await;
        self.is_done = answer.is_ok();
        answer
    }

    fn poll(&mut self, context: &mut Context<'_>) -> Poll<Answer> {
        let mut refused = None;
        self.waiting.retain_mut(|(name, learnt)| match Pin::new(learnt).poll(context) {
            Poll::Pending => true,
            Poll::Ready(answer) => {
                let answer = answer.unwrap_or_else(|_| Err(BackgroundError::Dropped(name.clone())));
                refused = refused.take().or(answer.err());
                false
            }
        });
        match refused {
            Some(error) => Poll::Ready(Err(error)),
            None if self.waiting.is_empty() => Poll::Ready(Ok(())),
            None => Poll::Pending,
        }
    }
}

impl Drop for Learning {
    fn drop(&mut self) {
        if !self.is_done {
            self.slots.iter().for_each(|slot| slot.restore(self.id));
        }
    }
}

/// A background that is to be learnt, and where that is answered.
#[derive(Debug)]
pub(super) struct BackgroundOrder {
    pub film: BackgroundFilm,
    pub answer: oneshot::Sender<Answer>,
}

/// What is asked of a camera's background, on its way to the film thread.
#[derive(Default)]
pub(super) struct BackgroundSlot(Mutex<Asked>);

#[derive(Default)]
struct Asked {
    /// The film thread is there, and will look here.
    is_filmed: bool,
    order: Option<BackgroundOrder>,
    /// The ids of backgrounds that are to go, the newest last.
    restore: Vec<u64>,
}

impl BackgroundSlot {
    /// A film thread begins, or has ended: what is asked for after that is answered by none.
    pub fn set_filmed(&self, is_filmed: bool) {
        let mut asked = self.0.lock();
        asked.is_filmed = is_filmed;
        asked.order = None;
    }

    /// Has the film thread learn a background instead of one that was asked for before.
    fn learn(&self, film: BackgroundFilm) -> oneshot::Receiver<Answer> {
        let (answer, learnt) = oneshot::channel();
        let mut asked = self.0.lock();
        asked.order = asked.is_filmed.then_some(BackgroundOrder { film, answer });
        learnt
    }

    /// Has it use the background again that was in use before this one.
    pub fn restore(&self, id: u64) {
        let mut asked = self.0.lock();
        asked.order.take_if(|order| order.film.id == id);
        if asked.restore.len() == MAX_RESTORES {
            asked.restore.remove(0);
        }
        asked.restore.push(id);
    }

    /// The ids of backgrounds that are to go.
    pub fn take_restores(&self) -> Vec<u64> {
        std::mem::take(&mut self.0.lock().restore)
    }

    fn take_order(&self) -> Option<BackgroundOrder> {
        self.0.lock().order.take()
    }
}

/// The background that a film thread is learning.
#[derive(Default)]
pub(super) struct BackgroundCapture {
    order: Option<BackgroundOrder>,
    builder: Option<BackgroundBuilder>,
    /// The greatest share of an image that was foreground.
    foreground: f64,
}

/// A background whose film is over.
pub(super) struct CapturedBackground {
    pub order: BackgroundOrder,
    pub model: Result<BackgroundModel, CutoutError>,
    /// The greatest share of an image that was foreground by the background in use.
    pub foreground: f64,
}

impl CapturedBackground {
    /// Whether the room was not empty, and that matters.
    pub fn is_occupied(&self) -> bool {
        self.foreground > MAX_FOREGROUND && !self.order.film.allow_foreground
    }
}

impl BackgroundCapture {
    /// Takes a frame of the film, and which share of it is foreground; returns the background once the last has come. A new
    /// order drops what is under way, an error ends it.
    pub fn add(
        &mut self,
        slot: &BackgroundSlot,
        frame: u64,
        image: &Image,
        foreground: f64,
    ) -> Option<CapturedBackground> {
        if let Some(order) = slot.take_order() {
            *self = BackgroundCapture { order: Some(order), ..BackgroundCapture::default() };
        }
        let film = self.order.as_ref()?.film;
        let frames_before = frame.checked_sub(film.first_frame)?;
        let model = if frames_before < film.frames {
            self.foreground = self.foreground.max(foreground);
            Err(self.push(image).err()?)
        } else {
            self.finish()
        };
        let BackgroundCapture { order, foreground, .. } = std::mem::take(self);
        Some(CapturedBackground { order: order?, model, foreground })
    }

    /// Learns the background of that id no longer.
    pub fn stop(&mut self, id: u64) {
        if self.order.as_ref().is_some_and(|order| order.film.id == id) {
            *self = BackgroundCapture::default();
        }
    }

    fn push(&mut self, image: &Image) -> Result<(), CutoutError> {
        let format = image.format()?;
        let builder = self.builder.get_or_insert_with(|| BackgroundBuilder::new(format));
        Ok(builder.push(&image.data)?)
    }

    fn finish(&mut self) -> Result<BackgroundModel, CutoutError> {
        let builder = self.builder.take().ok_or(CutoutError::NoFrame)?;
        Ok(builder.finish()?)
    }
}

#[cfg(test)]
mod tests {
    use segment::Layout;

    use super::*;
    use crate::source::ImageKind;

    fn grey(level: u8) -> Image {
        Image { kind: ImageKind::Colour(Layout::Rgb), width: 8, height: 8, data: vec![level; 192] }
    }

    fn film(first_frame: u64, frames: u64) -> BackgroundFilm {
        BackgroundFilm { id: first_frame, first_frame, frames, allow_foreground: false }
    }

    /// The slot of a camera that films.
    fn slot() -> Arc<BackgroundSlot> {
        let slot = Arc::<BackgroundSlot>::default();
        slot.set_filmed(true);
        slot
    }

    /// What is captured of the frames, each with its level and its share of foreground, and after which.
    fn capture(
        film: BackgroundFilm,
        frames: impl IntoIterator<Item = (u64, u8, f64)>,
    ) -> Option<(u64, CapturedBackground)> {
        let (slot, mut capture) = (slot(), BackgroundCapture::default());
        let _learnt = slot.learn(film);
        let mut frames = frames.into_iter();
        frames.find_map(|(frame, level, foreground)| {
            Some((frame, capture.add(&slot, frame, &grey(level), foreground)?))
        })
    }

    /// After which of the frames a background is there, and its level.
    fn learn(film: BackgroundFilm, frames: impl Iterator<Item = (u64, u8)>) -> Option<(u64, u8)> {
        let (frame, captured) = capture(film, frames.map(|(frame, level)| (frame, level, 0.0)))?;
        Some((frame, captured.model.ok()?.mean()[0]))
    }

    #[test]
    fn a_background_is_learnt_from_the_requested_frames_alone() {
        let level = |frame: u64| if (5..9).contains(&frame) { 100 } else { 200 };
        assert_eq!(learn(film(5, 4), (0..20).map(|frame| (frame, level(frame)))), Some((9, 100)));
        let missed = (0..20).filter(|frame| frame % 3 != 0).map(|frame| (frame, level(frame)));
        assert_eq!(learn(film(5, 4), missed), Some((10, 100)), "missed frames delay nothing");
        let none = (0..4).chain(12..13).map(|frame| (frame, 50));
        assert_eq!(learn(film(5, 4), none), None, "no frame, no background");
    }

    #[test]
    fn a_room_is_empty_while_no_frame_of_the_film_has_more_than_half_a_percent_of_foreground() {
        let share_at =
            |at: u64, share: f64| (0..12).map(move |frame| (frame, 9, if frame == at { share } else { 0.0 }));
        let is_occupied =
            |film, frames| capture(film, frames).is_some_and(|(_, captured)| captured.is_occupied());
        assert!(!is_occupied(film(2, 6), share_at(4, 0.005)));
        assert!(is_occupied(film(2, 6), share_at(4, 0.0051)), "one frame is enough");
        assert!(!is_occupied(film(2, 6), share_at(1, 0.5)), "before");
        assert!(!is_occupied(film(2, 6), share_at(8, 0.5)), "after");
        assert!(!is_occupied(BackgroundFilm { allow_foreground: true, ..film(2, 6) }, share_at(4, 0.5)));
    }

    #[tokio::test]
    async fn a_new_order_replaces_what_is_under_way() {
        let (slot, mut capture) = (slot(), BackgroundCapture::default());
        let begin = |film| Learning::begin(film, [("cam", &slot)].into_iter());
        let first = begin(film(0, 3));
        assert!(capture.add(&slot, 0, &grey(10), 0.5).is_none());
        let second = begin(film(1, 2));
        let captured: Vec<_> = (1..6).filter_map(|frame| capture.add(&slot, frame, &grey(90), 0.0)).collect();
        let [CapturedBackground { model: Ok(model), foreground: 0.0, .. }] = &captured[..] else {
            panic!("{} captured", captured.len())
        };
        assert_eq!((model.frames(), model.mean()[0]), (2, 90));
        let dropped = Err(BackgroundError::Dropped("cam".into()));
        assert_eq!(first.finished().await, dropped);
        drop(captured);
        assert_eq!(second.finished().await, dropped, "its answer never came");
    }

    #[tokio::test]
    async fn if_one_camera_keeps_its_background_all_of_the_node_do() {
        let slots = [slot(), slot()];
        let begin = || Learning::begin(film(0, 1), ["left", "right"].into_iter().zip(&slots));
        let answer = |slot: &BackgroundSlot, answer| {
            let mut capture = BackgroundCapture::default();
            let captured = (0..3).find_map(|frame| capture.add(slot, frame, &grey(9), 0.0)).expect("learnt");
            captured.order.answer.send(answer).expect("it is waited for");
        };
        let restored = || slots.iter().map(|slot| slot.take_restores()).collect::<Vec<_>>();
        let learning = begin();
        slots.iter().for_each(|slot| answer(slot, Ok(())));
        assert_eq!(learning.finished().await, Ok(()));
        assert_eq!(restored(), [[]; 2]);
        let learning = begin();
        let refused = Err(BackgroundError::Foreground { camera: "right".into(), share: 0.5 });
        // The other one films nothing any more.
        answer(&slots[1], refused.clone());
        assert_eq!(learning.finished().await, refused);
        assert_eq!(restored(), [[0], [0]]);
        drop(begin());
        assert_eq!(restored(), [[0], [0]], "the peer that asked is gone");
    }

    #[tokio::test]
    async fn a_camera_whose_film_has_ended_learns_none() {
        let slot = slot();
        let begin = || Learning::begin(film(0, 1), [("cam", &slot)].into_iter());
        let waiting = begin();
        slot.set_filmed(false);
        let dropped = Err(BackgroundError::Dropped("cam".into()));
        assert_eq!(waiting.finished().await, dropped);
        assert_eq!(begin().finished().await, dropped);
    }

    #[test]
    fn what_is_restored_is_not_learnt_any_more() {
        let (slot, mut capture) = (slot(), BackgroundCapture::default());
        let mut is_learnt = |frames: std::ops::Range<u64>| {
            frames.into_iter().any(|frame| capture.add(&slot, frame, &grey(9), 0.0).is_some())
        };
        let _waiting = slot.learn(film(1, 2));
        slot.restore(1);
        assert!(!is_learnt(0..6), "it had not begun");
        let _other = slot.learn(film(7, 2));
        slot.restore(1);
        assert!(is_learnt(6..12), "another one is learnt");
        assert_eq!(slot.take_restores(), [1, 1]);
        let _begun = slot.learn(film(20, 2));
        assert!(!is_learnt(20..21));
        capture.stop(20);
        assert!((21..30).all(|frame| capture.add(&slot, frame, &grey(9), 0.0).is_none()), "it had begun");
    }

    #[test]
    fn numbers_at_the_end_of_their_range_overflow_nothing() {
        let end = film(u64::MAX - 1, u64::MAX);
        assert_eq!(learn(end, [0, u64::MAX - 1, u64::MAX].into_iter().map(|frame| (frame, 9))), None);
        let slot = slot();
        (0..1000).for_each(|id| slot.restore(id));
        assert_eq!(slot.take_restores(), [996, 997, 998, 999]);
    }

    #[test]
    fn a_background_takes_as_much_film_as_the_one_bound_says() {
        let check = |frames, fps| check_background(film(0, frames), std::iter::empty(), fps);
        let error = |frames| BackgroundError::Length { frames, least: 6, most: 900 };
        assert_eq!(check(5, 30.0), Err(error(5)));
        assert_eq!(check(6, 30.0), Ok(()));
        assert_eq!(check(900, 30.0), Ok(()));
        for frames in [0, 901, u64::MAX] {
            assert_eq!(check(frames, 30.0), Err(error(frames)));
        }
        assert_eq!(check(3600, 120.0), Ok(()));
    }

    #[test]
    fn a_refusal_names_the_camera_and_what_it_saw() {
        let refused = BackgroundError::Foreground { camera: "left".into(), share: 0.0318 };
        assert_eq!(
            refused.to_string(),
            "camera \"left\" keeps its background: while the new one was filmed, 3.2 % of its image were foreground, \
             expected an empty room (0.5 % at most)"
        );
    }
}
