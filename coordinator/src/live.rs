//! What others see of a run while it goes on, and what they may ask of it.
//!
//! The loop publishes the world after every step and its status four times a second, and takes commands
//! between steps. A [`Follower`] is the other end: cheap to copy, free to lag, without back-pressure. Nothing
//! is published while there is no follower.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use hull::Pose;
use serde::Serialize;
use sim::Solid;
pub use sim::{BodyId, HullPatch, Parameters};
use tokio::sync::{mpsc, oneshot, watch};

pub use crate::client::{Client, ClientKind, WeakClient};
pub use crate::core::command::{Command, MAX_STEPS, MAX_WAITING, Outcome, Refusal, SPEEDS};
pub use crate::core::playback::PlaybackStatus;

/// So many resets may wait beyond [`MAX_WAITING`]: the way out of a world of too much must not be full of it.
pub(crate) const RESETS_BEYOND: usize = 8;

/// A command on its way, and where its answer goes.
#[derive(Debug)]
pub struct Order {
    /// What is asked.
    pub command: Command,
    /// The client that asks.
    pub client: Client,
    /// Where the answer goes.
    pub reply: oneshot::Sender<Result<Outcome, Refusal>>,
}

/// One body after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// Its id, unique in the run.
    pub id: BodyId,
    /// World from body.
    pub pose: Pose,
    /// Velocity of its origin in the world, m/s.
    pub velocity_m_s: [f64; 3],
    /// Angular velocity in the world, rad/s.
    pub spin_rad_s: [f64; 3],
    /// How many of its samples were inside the hull.
    pub inside_samples: u32,
    /// How the hull moved it, metres, if it did.
    pub response_m: Option<[f64; 3]>,
    /// Whether a follower holds it.
    pub grabbed: bool,
    /// Whether the solver has put it to sleep.
    pub asleep: bool,
}

/// One sample that was inside the hull.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchPoint {
    /// The body's place in [`WorldState::bodies`].
    pub body: u32,
    /// Where it was, world, metres.
    pub point_m: [f32; 3],
    /// Its own way out, metres; zero without one.
    pub response_m: [f32; 3],
}

/// The world after a step.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldState {
    /// Counts worlds: a reset or another scene begins a new one.
    pub generation: u32,
    /// How many steps it has made.
    pub step: u64,
    /// Film time, seconds.
    pub film_s: f64,
    /// The frame that the step saw, if there was a hull.
    pub frame: Option<u64>,
    /// Whether steps have stopped.
    pub paused: bool,
    /// Every body that moves or is fixed, in the order of [`SceneState::bodies`].
    pub bodies: Vec<BodyState>,
    /// All samples inside the hull before the step.
    pub touches: Vec<TouchPoint>,
    /// The hull's surface at the bodies after the step; bodies by their place in `bodies`.
    pub patches: Vec<HullPatch>,
}

/// What a body looks like.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyLook {
    /// Its id, unique in the run.
    pub id: BodyId,
    /// Its name.
    pub name: String,
    /// Its geometry, body frame.
    pub solid: Solid,
    /// sRGB, 0 to 1.
    pub color: [f32; 3],
    /// Whether it never moves.
    pub fixed: bool,
}

/// What changes seldom: published when bodies come or go, or parameters change.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// As in [`WorldState::generation`].
    pub generation: u32,
    /// Counts changes within the run.
    pub version: u64,
    /// The scene's name.
    pub scene: String,
    /// All bodies.
    pub bodies: Vec<BodyLook>,
    /// Every parameter as it is.
    pub parameters: Parameters,
    /// The unit vector against gravity.
    pub up: [f64; 3],
    /// Height of the floor along up, metres.
    pub floor_m: Option<f64>,
}

/// How a camera does. Its fields are keys of the page's status.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraStatus {
    /// Its name.
    pub name: String,
    /// Why its node is not there, if so.
    pub problem: Option<String>,
    /// Its newest frame.
    pub newest_frame: Option<u64>,
    /// From that frame's capture to now, milliseconds.
    pub age_ms: f64,
    /// By what its frames are numbered: `index`, `counter`, `capture` or `arrival`.
    pub stamps: &'static str,
    /// Of a live camera, once it is known: where its captures lie between frames of film, 0 to 1.
    pub phase: Option<f64>,
    /// Of a live camera, once it is known.
    pub frames_per_s: Option<f64>,
    /// How far its captures lie from the median of all cameras', milliseconds.
    pub sync_ms: f64,
    /// How far its film time may be off, milliseconds.
    pub clock_bound_ms: f64,
    /// Share of foreground pixels.
    pub foreground: f64,
    /// Bytes of its compact silhouette.
    pub silhouette_bytes: u32,
    /// From capture to silhouette, milliseconds.
    pub segment_ms: f64,
    /// How long after their film time nearly all its frames are known, milliseconds; `None` if that is not measured.
    pub late_ms: Option<f64>,
    /// By how much the film that bodies collide with could be newer without it, milliseconds.
    pub costs_ms: f64,
    /// Steps go on without it.
    pub left_out: bool,
}

/// How a run does: published four times a second. Its fields are keys of the page's status.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunStatus {
    /// As on the console.
    pub progress: crate::Progress,
    /// Each camera, in rig order.
    pub cameras: Vec<CameraStatus>,
    /// Frames of film up to now that no step used: [`crate::Figures::frames_missed`].
    pub frames_missed: u64,
    /// Frames that film held so far.
    pub frames_expected: u64,
    /// Steps that used an older frame than theirs.
    pub late_steps: u64,
    /// Steps without a hull.
    pub blind_steps: u64,
    /// Steps that went on without some camera.
    pub reduced_steps: u64,
    /// How a recording is played, if the run is a replay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replay: Option<PlaybackStatus>,
}

/// The end that steers and watches. Copies are cheap.
#[derive(Clone, Debug)]
pub struct Follower {
    orders: mpsc::Sender<Order>,
    client: Client,
    /// The world after the newest step.
    pub world: watch::Receiver<Option<Arc<WorldState>>>,
    /// Bodies and parameters.
    pub scene: watch::Receiver<Option<Arc<SceneState>>>,
    /// The run's figures, four times a second.
    pub status: watch::Receiver<Option<Arc<RunStatus>>>,
    watching: Arc<AtomicUsize>,
    /// Pages among them.
    pages: Arc<AtomicUsize>,
    is_steered: Arc<AtomicBool>,
}

/// Counts a follower, and a page also as such, until dropped.
#[derive(Debug)]
pub struct Watching(Vec<Arc<AtomicUsize>>);

/// The loop's end.
#[derive(Debug)]
pub struct Live {
    /// Commands for the next step.
    pub orders: mpsc::Receiver<Order>,
    /// The world after the newest step.
    pub world: watch::Sender<Option<Arc<WorldState>>>,
    /// Bodies and parameters.
    pub scene: watch::Sender<Option<Arc<SceneState>>>,
    /// The run's figures, four times a second.
    pub status: watch::Sender<Option<Arc<RunStatus>>>,
    watching: Arc<AtomicUsize>,
    pages: Arc<AtomicUsize>,
}

/// Both ends.
pub fn live() -> (Live, Follower) {
    let (order, orders) = mpsc::channel(MAX_WAITING + RESETS_BEYOND);
    let (world, see_world) = watch::channel(None);
    let (scene, see_scene) = watch::channel(None);
    let (status, see_status) = watch::channel(None);
    let [watching, pages] = [(); 2].map(|()| Arc::new(AtomicUsize::new(0)));
    let follower = Follower {
        orders: order,
        client: Client::new(ClientKind::Program),
        world: see_world,
        scene: see_scene,
        status: see_status,
        watching: Arc::clone(&watching),
        pages: Arc::clone(&pages),
        is_steered: Arc::default(),
    };
    (Live { orders, world, scene, status, watching, pages }, follower)
}

impl Live {
    /// Whether the world is worth publishing at every step.
    pub fn is_watched(&self) -> bool {
        self.watching.load(Ordering::Relaxed) > 0
    }

    /// Whether a page is connected.
    pub fn has_page(&self) -> bool {
        self.pages.load(Ordering::Relaxed) > 0
    }
}

impl Follower {
    /// The world is published for as long as what is returned lives.
    pub fn watch(&self) -> Watching {
        let pages = (self.client.kind() == ClientKind::Page).then(|| Arc::clone(&self.pages));
        let counts: Vec<_> = std::iter::once(Arc::clone(&self.watching)).chain(pages).collect();
        for count in &counts {
            count.fetch_add(1, Ordering::Relaxed);
        }
        Watching(counts)
    }

    /// Whether no client has asked for anything yet; from now on one has.
    pub fn is_first_to_steer(&self) -> bool {
        !self.is_steered.swap(true, Ordering::Relaxed)
    }

    /// The same end for another client, which holds bodies of its own.
    pub fn for_client(&self, client: Client) -> Follower {
        Follower { client, ..self.clone() }
    }

    /// The same end for a client of the same kind that holds no body.
    pub fn apart(&self) -> Follower {
        self.for_client(Client::new(self.client.kind()))
    }

    /// Asks for something and waits for the step that does it.
    pub async fn order(&self, command: Command) -> Result<Outcome, Refusal> {
        self.is_steered.store(true, Ordering::Relaxed);
        if command != Command::Reset && self.orders.capacity() <= RESETS_BEYOND {
            return Err(self.closed_or_busy());
        }
        let (reply, answered) = oneshot::channel();
        let order = Order { command, client: self.client.clone(), reply };
        self.orders.try_send(order).map_err(|error| match error {
            mpsc::error::TrySendError::Full(_) => Refusal::Busy,
            mpsc::error::TrySendError::Closed(_) => Refusal::Ended,
        })?;
        answered.await.unwrap_or(Err(Refusal::Ended))
    }

    fn closed_or_busy(&self) -> Refusal {
        if self.orders.is_closed() { Refusal::Ended } else { Refusal::Busy }
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        for count in &self.0 {
            count.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn an_order_is_answered_or_told_that_it_never_will_be() {
        let (mut live, follower) = live();
        let asking = tokio::spawn({
            let follower = follower.clone();
            async move { follower.order(Command::Pause).await }
        });
        let order = live.orders.recv().await.expect("an order");
        assert_eq!(order.command, Command::Pause);
        order.reply.send(Ok(Outcome::Applied)).expect("the test waits");
        assert_eq!(asking.await.expect("no panic").expect("applied"), Outcome::Applied);
        drop(live);
        assert!(matches!(follower.order(Command::Resume).await, Err(Refusal::Ended)));
    }

    #[tokio::test]
    async fn orders_beyond_the_bound_are_refused() {
        let (_live, follower) = live();
        let asked: Vec<_> = (0..=MAX_WAITING)
            .map(|_| {
                let follower = follower.clone();
                Box::pin(async move { follower.order(Command::Pause).await })
            })
            .collect();
        let (mut waiting, mut refused) = (vec![], 0);
        for mut order in asked {
            match futures::poll!(&mut order) {
                std::task::Poll::Ready(answer) => refused += usize::from(answer.is_err()),
                std::task::Poll::Pending => waiting.push(order),
            }
        }
        assert_eq!((waiting.len(), refused), (MAX_WAITING, 1));
        let mut reset = Box::pin(follower.order(Command::Reset));
        assert!(futures::poll!(&mut reset).is_pending(), "it waits for the next step");
    }

    #[test]
    fn the_world_is_published_while_a_viewer_watches() {
        let (live, follower) = live();
        assert!(!live.is_watched());
        let watching = follower.clone().watch();
        assert!(live.is_watched());
        drop(watching);
        assert!(!live.is_watched());
    }

    #[test]
    fn pages_are_counted_among_those_who_watch() {
        let (live, follower) = live();
        let program = follower.watch();
        assert!(live.is_watched() && !live.has_page());
        let page = follower.for_client(Client::new(ClientKind::Page)).watch();
        assert!(live.has_page());
        drop((program, page));
        assert!(!live.is_watched() && !live.has_page());
    }
}
