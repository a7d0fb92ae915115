//! A node as others watch it: what it counts, and whether it does its work.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::SystemTime;

use film_time::{FilmState, fresh_s};
use net::Credentials;
use telemetry::Pulse;
use tokio::time::Instant;

use super::Service;
use super::hold::SharedHold;
use super::incoming::Access;
use super::worker::MAX_WAITING;
use crate::frames::FrameRing;
use crate::metrics::{AnswerFigures, AnswerMeter, CameraFigures, FilmMeter, TrafficFigures, TrafficMeter};

/// A node as seen from outside its threads. Copies are cheap, and hold none of its work up.
#[derive(Clone)]
pub struct NodeWatch {
    fps: f64,
    film: Arc<FilmMeter>,
    ring: Arc<FrameRing>,
    hold: SharedHold,
    answers: Arc<AnswerMeter>,
    pub(super) port: Arc<TrafficMeter>,
    waiting: Arc<AtomicUsize>,
    credentials: Option<Arc<Credentials>>,
    pulse: Pulse,
}

impl NodeWatch {
    pub(super) fn of(service: &Service, film: Arc<FilmMeter>) -> NodeWatch {
        let (answers, waiting) = service.worker.meters();
        NodeWatch {
            fps: service.description.fps,
            film,
            ring: Arc::clone(&service.ring),
            hold: service.hold.clone(),
            answers,
            port: Arc::default(),
            waiting,
            credentials: None,
            pulse: service.pulse.clone(),
        }
    }

    pub(super) fn with(self, access: &Access) -> NodeWatch {
        let credentials = match access {
            Access::Certified(credentials) => Some(Arc::clone(credentials)),
            Access::ThisMachine | Access::AnyPeer => None,
        };
        NodeWatch { credentials, ..self }
    }

    /// Whether its film and its answers get on.
    pub fn pulse(&self) -> &Pulse {
        &self.pulse
    }

    /// Each camera of the node.
    pub fn cameras(&self) -> Vec<CameraFigures> {
        self.film.cameras()
    }

    /// Questions and what became of them.
    pub fn answers(&self) -> AnswerFigures {
        self.answers.read()
    }

    /// What crossed its port.
    pub fn traffic(&self) -> TrafficFigures {
        self.port.read()
    }

    /// How many questions wait or are being answered, and how many may wait.
    pub fn queue(&self) -> (usize, usize) {
        (self.waiting.load(Ordering::Relaxed), MAX_WAITING)
    }

    /// Whether a coordinator leads it.
    pub fn is_held(&self) -> bool {
        !self.hold.lock().is_deserted(Instant::now())
    }

    /// How far film time may be off here, seconds, once a coordinator has told it.
    pub fn clock_bound_s(&self) -> Option<f64> {
        self.film.clock_bound_s()
    }

    /// When its certificate ends, if it has one.
    pub fn certificate_ends(&self) -> Option<SystemTime> {
        self.credentials.as_ref().map(Credentials::not_after)
    }

    /// What it lacks to do its work: every camera films.
    pub fn lacks(&self) -> Option<String> {
        if let FilmState::Failed(why) = self.ring.state() {
            return Some(format!("film failed: {why}"));
        }
        let fresh_s = fresh_s(self.fps);
        let cameras = self.cameras();
        let late = cameras.iter().find(|camera| camera.age_s().is_none_or(|age_s| age_s > fresh_s))?;
        let name = &late.name;
        Some(match late.age_s() {
            _ if !self.is_held() => format!("camera {name:?} does not film: no coordinator leads this node"),
            None => format!("camera {name:?} has not filmed yet"),
            Some(age_s) => format!("camera {name:?} films nothing: its newest frame is {age_s:.1} s old"),
        })
    }
}
