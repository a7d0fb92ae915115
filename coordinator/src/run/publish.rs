//! What followers see: the world after every step, its bodies when they change, figures.

use std::sync::Arc;

use film_time::{FrameReport, Stamps};
use hull::collision::BodyCollision;
use sim::{Body, BodyId, BodyResponse};

use super::Coordinator;
use super::now;
use super::watch::RecentFigures;
use crate::core::playback::Playback;
use crate::figures::Progress;
use crate::live::{BodyLook, BodyState, CameraStatus, Live, RunStatus, SceneState, TouchPoint, WorldState};
use crate::metrics::MetricsSender;
use crate::roster::RosterNode;

/// A camera whose captures are off by more, periods, films out of step; by less than the other, in step again.
const UNSYNCED: f64 = 0.25;
const SYNCED_AGAIN: f64 = 0.2;

/// The end of followers, and what is published there.
#[derive(Default)]
pub(super) struct Publisher {
    pub live: Option<Live>,
    pub metrics: Option<MetricsSender>,
    /// Counts worlds.
    pub generation: u32,
    /// The last step, for followers that come while the world does not move.
    pub view: StepView,
    /// Since the last report.
    pub recent: RecentFigures,
    scene_version: u64,
    /// Bodies have changed while a film time was sought, and followers have not received them.
    is_scene_late: bool,
    /// Of each camera, whether it was said that it films out of step.
    unsynced: Vec<bool>,
}

impl Publisher {
    fn is_watched(&self) -> bool {
        self.live.as_ref().is_some_and(Live::is_watched)
    }
}

/// What followers see of a step.
#[derive(Default)]
pub(super) struct StepView {
    /// Film time of its end, seconds.
    pub film_s: f64,
    /// Its frame, if there was a hull.
    pub frame: Option<u64>,
    /// Bodies that touched the hull.
    pub touching: usize,
    /// Moving bodies: how many samples of each are inside the hull, and its response, metres.
    bodies: Vec<(BodyId, usize, Option<[f64; 3]>)>,
    touches: Vec<(BodyId, TouchPoint)>,
}

impl StepView {
    /// Another world: there are no responses to its bodies yet.
    pub fn forget_bodies(&mut self) {
        self.bodies.clear();
        self.touches.clear();
        self.touching = 0;
    }
}

impl Coordinator {
    /// Keeps the hull's responses before a step moves bodies: where they touch is where they are now.
    pub(super) fn note_touches(&mut self, responses: &[BodyResponse], collisions: Option<&[BodyCollision]>) {
        self.publisher.view.forget_bodies();
        if !self.publisher.is_watched() {
            return;
        }
        let bodies = || self.run.world.moving_bodies();
        let response = |(body, response): (&Body, &BodyResponse)| {
            (body.id, response.inside_samples, response.response_m)
        };
        let responses = bodies().zip(responses).map(response).collect();
        let points = bodies().zip(collisions.unwrap_or_default()).flat_map(|(body, collision)| {
            let world_from_body = body.pose.world_from_body();
            let samples_body = body.shape.samples_body();
            collision.inside().map(move |(sample, way_out_m)| {
                (body.id, touch_point(world_from_body(samples_body[sample as usize]), way_out_m))
            })
        });
        let touches = points.collect();
        let view = &mut self.publisher.view;
        (view.bodies, view.touches) = (responses, touches);
    }

    /// Publishes the world as it is, but none on the way to a film time that is sought.
    pub(super) fn publish_world(&self) {
        if self.run.is_seeking() {
            return;
        }
        // A world that stands still is published for followers that come later.
        let is_seen = |live: &&Live| live.is_watched() || self.run.steering.is_paused();
        let Some(live) = self.publisher.live.as_ref().filter(is_seen) else { return };
        let state = Arc::new(self.world_state());
        live.world.send_if_modified(|known| {
            let is_new = known.as_ref() != Some(&state);
            if is_new {
                *known = Some(state);
            }
            is_new
        });
    }

    fn world_state(&self) -> WorldState {
        let bodies = self.run.world.bodies();
        let place = |id: BodyId| bodies.binary_search_by_key(&id, |body| body.id).ok();
        let touches = self.publisher.view.touches.iter();
        WorldState {
            generation: self.publisher.generation,
            step: self.run.world.steps(),
            film_s: self.publisher.view.film_s,
            frame: self.publisher.view.frame,
            paused: self.run.steering.is_paused(),
            bodies: bodies.iter().map(|body| self.body_state(body)).collect(),
            touches: touches
                .filter_map(|&(id, point)| Some(TouchPoint { body: place(id)? as u32, ..point }))
                .collect(),
            patches: self.run.world.patches().collect(),
        }
    }

    fn body_state(&self, body: &Body) -> BodyState {
        let responses = &self.publisher.view.bodies;
        let place = responses.binary_search_by_key(&body.id, |&(id, ..)| id);
        let (_, inside_samples, response_m) = place.map_or((body.id, 0, None), |place| responses[place]);
        BodyState {
            id: body.id,
            pose: body.pose,
            velocity_m_s: body.velocity_m_s,
            spin_rad_s: body.spin_rad_s,
            inside_samples: inside_samples as u32,
            response_m,
            grabbed: self.run.world.is_grabbed(body.id),
            asleep: self.run.world.is_asleep(body.id),
        }
    }

    /// Hands out bodies and parameters, watched or not: they change seldom.
    pub(super) fn publish_scene(&mut self) {
        let publisher = &mut self.publisher;
        publisher.is_scene_late = self.run.is_seeking();
        if publisher.is_scene_late {
            return;
        }
        let Some(live) = &publisher.live else { return };
        publisher.scene_version += 1;
        let (world, scene) = (&self.run.world, self.run.world.scene());
        let look = |body: &Body| BodyLook {
            id: body.id,
            name: body.name.clone(),
            solid: body.solid.clone(),
            color: body.color,
            fixed: body.fixed,
        };
        live.scene.send_replace(Some(Arc::new(SceneState {
            generation: publisher.generation,
            version: publisher.scene_version,
            scene: scene.name().to_owned(),
            bodies: world.bodies().iter().map(look).collect(),
            parameters: world.parameters(),
            up: world.up(),
            floor_m: scene.floor().map(|floor| floor.height_m),
        })));
    }

    /// Publishes bodies that have changed on the way to a film time, once that is reached.
    pub(super) fn publish_late_scene(&mut self) {
        if self.publisher.is_scene_late {
            self.publish_scene();
        }
    }

    pub(super) fn publish_status(&mut self, progress: Progress) {
        let cameras = self.camera_status();
        self.warn_unsynced(&cameras);
        self.publish_metrics(Some(&progress), &cameras);
        let Some(live) = self.publisher.live.as_ref().filter(|live| live.is_watched()) else { return };
        live.status.send_replace(Some(Arc::new(RunStatus {
            progress,
            cameras,
            frames_missed: self.run.figures.frames_missed(),
            frames_expected: self.run.figures.frames_expected,
            late_steps: self.run.figures.counts.misses.late_steps,
            blind_steps: self.run.figures.counts.misses.blind_steps(),
            reduced_steps: self.run.figures.counts.misses.reduced_steps,
            replay: self.run.playback.as_ref().map(Playback::status),
        })));
    }

    /// Says once of a camera that it films out of step with the others.
    fn warn_unsynced(&mut self, cameras: &[CameraStatus]) {
        let period_ms = 1e3 / self.run.settings.fps;
        let warned = &mut self.publisher.unsynced;
        warned.resize(cameras.len(), false);
        for (camera, warned) in cameras.iter().zip(warned) {
            let off = camera.sync_ms.abs() / period_ms;
            if off > UNSYNCED && !*warned {
                let (name, sync_ms) = (&camera.name, camera.sync_ms);
                tracing::warn!("camera {name:?} films {sync_ms:.1} ms out of step with the others");
            }
            *warned = off > if *warned { SYNCED_AGAIN } else { UNSYNCED };
        }
    }

    pub(super) fn camera_status(&self) -> Vec<CameraStatus> {
        let nodes = self.transport.roster().nodes();
        let cameras = self.run.observers().iter().map(|observer| {
            // The cameras of this process are one node.
            let of_node =
                |node: &&RosterNode| nodes.len() == 1 || node.cameras().contains(&observer.rig_index());
            let node = nodes.iter().find(of_node);
            (observer, node, node.and_then(|node| node.newest()))
        });
        let cameras: Vec<_> = cameras.collect();
        // How far each capture is from where its frame's number puts it, against the median of all: one that lies moves no other.
        let shift_s =
            |report: &FrameReport| report.capture_time_s - report.frame as f64 / self.run.settings.fps;
        let mut shifts: Vec<f64> = cameras.iter().filter_map(|(_, _, report)| report.map(shift_s)).collect();
        shifts.sort_by(f64::total_cmp);
        let median_s = shifts.get(shifts.len() / 2).copied().unwrap_or_default();
        let late_s = self.run.clock.latency.late_s();
        let latest_s = late_s.iter().flatten().copied().fold(f64::MIN, f64::max);
        let others_s =
            late_s.iter().flatten().copied().filter(|&late_s| late_s < latest_s).fold(f64::MIN, f64::max);
        let status = cameras.into_iter().map(|(observer, node, report)| {
            let camera = observer.camera();
            let own_s = late_s[usize::from(observer.rig_index())];
            let part = report.and_then(|report| {
                report.cameras.iter().find(|camera| camera.rig_index == observer.rig_index())
            });
            let pixels = f64::from(camera.width()) * f64::from(camera.height());
            CameraStatus {
                name: camera.name().to_owned(),
                problem: node.and_then(|node| Some(node.missing()?.to_string())),
                newest_frame: report.map(|report| report.frame),
                age_ms: report.map_or(0.0, |report| self.run.clock.age_s(report, now()) * 1e3),
                stamps: part.map_or(Stamps::Index, |camera| camera.stamps).word(),
                phase: part.and_then(|camera| Some(camera.pace?.phase)),
                frames_per_s: part.and_then(|camera| Some(camera.pace?.frames_per_s)),
                clock_bound_ms: node.map_or(0.0, |node| node.clock_bound_s() * 1e3),
                sync_ms: report.map_or(0.0, |report| (shift_s(report) - median_s) * 1e3),
                foreground: part.map_or(0.0, |camera| camera.area as f64 / pixels),
                silhouette_bytes: part.map_or(0, |camera| camera.silhouette_bytes),
                segment_ms: part.map_or(0.0, |camera| camera.segment_ms),
                late_ms: own_s.map(|own_s| own_s * 1e3),
                costs_ms: own_s.map_or(0.0, |own_s| (own_s - others_s).max(0.0) * 1e3),
                left_out: node.is_some_and(RosterNode::is_left_out)
                    || !self.run.film.cameras.is_empty()
                        && !self.run.film.cameras.contains(&observer.rig_index()),
            }
        });
        status.collect()
    }
}

/// A sample inside the hull, where it is in the world, and its own way out. The body's place in the list is
/// filled in when the list is made.
fn touch_point(point_world: nalgebra::Point3<f64>, way_out_m: [f64; 3]) -> TouchPoint {
    TouchPoint {
        body: 0,
        point_m: [point_world.x, point_world.y, point_world.z].map(|component| component as f32),
        response_m: way_out_m.map(|component| component as f32),
    }
}
