//! What followers see: the world after every step, its bodies when they change, figures.

use std::sync::Arc;

use hull::pass::{BodyResult, Touch};
use sim::{Body, BodyId, BodyResponse};

use super::Coordinator;
use super::clock::unix_now_s;
use crate::facts::FrameFacts;
use crate::figures::Progress;
use crate::live::{BodyLook, BodyState, CameraStatus, RunStatus, SceneState, TouchPoint, WorldState};

/// What the last step saw, kept for who comes to watch a world that does not move.
#[derive(Default)]
pub(super) struct Seen {
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

impl Seen {
    /// Another world: nothing was said of its bodies yet.
    pub fn forget_bodies(&mut self) {
        self.bodies.clear();
        self.touches.clear();
        self.touching = 0;
    }
}

impl Coordinator {
    fn is_watched(&self) -> bool {
        self.live.as_ref().is_some_and(crate::live::Live::is_watched)
    }

    /// Notes what the hull says before a step moves bodies: where they touch is where they are now.
    pub(super) fn note_touches(&mut self, responses: &[BodyResponse], results: Option<&[BodyResult]>) {
        self.seen.forget_bodies();
        if !self.is_watched() {
            return;
        }
        let bodies = || self.world.moving_bodies();
        let response = |(body, response): (&Body, &BodyResponse)| {
            (body.id, response.inside_samples, response.response_m)
        };
        self.seen.bodies = bodies().zip(responses).map(response).collect();
        let touched =
            bodies().zip(results.unwrap_or_default()).filter(|(_, result)| !result.touches.is_empty());
        let points = touched.flat_map(|(body, result)| {
            let world_from_body = body.pose.world_from_body();
            let samples_body = body.shape.samples_body();
            let point = move |touch: &Touch| {
                (body.id, touch_point(world_from_body(samples_body[touch.sample as usize]), touch))
            };
            result.touches.iter().map(point)
        });
        self.seen.touches = points.collect();
    }

    /// Hands the world as it is to whoever watches.
    pub(super) fn publish_world(&self) {
        let Some(live) = self.live.as_ref().filter(|live| live.is_watched()) else { return };
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
        let bodies = self.world.bodies();
        let place = |id: BodyId| bodies.binary_search_by_key(&id, |body| body.id).ok();
        let touches = self.seen.touches.iter();
        WorldState {
            generation: self.generation,
            step: self.world.steps(),
            film_s: self.seen.film_s,
            frame: self.seen.frame,
            paused: self.steering.is_paused(),
            bodies: bodies.iter().map(|body| self.body_state(body)).collect(),
            touches: touches
                .filter_map(|&(id, point)| Some(TouchPoint { body: place(id)? as u32, ..point }))
                .collect(),
        }
    }

    fn body_state(&self, body: &Body) -> BodyState {
        let found = self.seen.bodies.binary_search_by_key(&body.id, |&(id, ..)| id);
        let (inside_samples, response_m) = found.map_or((0, None), |index| {
            let (_, inside_samples, response_m) = self.seen.bodies[index];
            (inside_samples, response_m)
        });
        BodyState {
            id: body.id,
            pose: body.pose,
            velocity_m_s: body.velocity_m_s,
            spin_rad_s: body.spin_rad_s,
            inside_samples: inside_samples as u32,
            response_m,
            grabbed: self.world.is_grabbed(body.id),
            asleep: self.world.is_asleep(body.id),
        }
    }

    /// Hands out bodies and parameters, watched or not: they change seldom.
    pub(super) fn publish_scene(&mut self) {
        let Some(live) = &self.live else { return };
        self.scene_version += 1;
        let (world, scene) = (&self.world, self.world.scene());
        let look = |body: &Body| BodyLook {
            id: body.id,
            name: body.name.clone(),
            solid: body.solid.clone(),
            color: body.color,
            fixed: body.fixed,
        };
        live.scene.send_replace(Some(Arc::new(SceneState {
            generation: self.generation,
            version: self.scene_version,
            scene: scene.name().to_owned(),
            bodies: world.bodies().iter().map(look).collect(),
            parameters: world.parameters(),
            up: world.up(),
            floor_m: scene.floor().map(|floor| floor.height_m),
        })));
    }

    pub(super) fn publish_status(&self, progress: Progress) {
        let Some(live) = self.live.as_ref().filter(|live| live.is_watched()) else { return };
        live.status.send_replace(Some(Arc::new(RunStatus {
            progress,
            cameras: self.camera_status(),
            frames_missed: self.figures.frames_expected.saturating_sub(self.figures.frames),
            frames_expected: self.figures.frames_expected,
            late_steps: self.figures.late_steps,
            blind_steps: self.figures.blind_steps,
        })));
    }

    fn camera_status(&self) -> Vec<CameraStatus> {
        let (now_s, nodes) = (unix_now_s(), self.transport.nodes_told());
        let cameras = self.observers.iter().map(|observer| {
            let node = nodes.iter().find(|node| node.cameras.contains(&observer.rig_index()));
            (observer, node, node.and_then(|node| node.newest.as_ref()))
        });
        let cameras: Vec<_> = cameras.collect();
        // How far each capture is from where its frame's number puts it, against the mean of all.
        let shift_s = |facts: &FrameFacts| facts.captured_unix_s - facts.frame as f64 / self.settings.fps;
        let shifts: Vec<f64> = cameras.iter().filter_map(|(_, _, facts)| facts.map(shift_s)).collect();
        let mean_s = shifts.iter().sum::<f64>() / shifts.len().max(1) as f64;
        let status = cameras.into_iter().map(|(observer, node, facts)| {
            let camera = observer.camera();
            let of_it = facts.and_then(|facts| {
                facts.cameras.iter().find(|camera| camera.rig_index == observer.rig_index())
            });
            let pixels = f64::from(camera.width()) * f64::from(camera.height());
            CameraStatus {
                name: camera.name().to_owned(),
                problem: node.and_then(|node| node.problem.clone()),
                newest_frame: facts.map(|facts| facts.frame),
                age_ms: facts.map_or(0.0, |facts| (now_s - facts.captured_unix_s) * 1e3),
                sync_ms: facts.map_or(0.0, |facts| (shift_s(facts) - mean_s) * 1e3),
                foreground: of_it.map_or(0.0, |camera| camera.area as f64 / pixels),
                silhouette_bytes: of_it.map_or(0, |camera| camera.silhouette_bytes),
                segment_ms: of_it.map_or(0.0, |camera| camera.segment_ms),
            }
        });
        status.collect()
    }
}

/// A sample inside the hull, where it is in the world, and its own way out. The body's place in the list is
/// filled in when the list is made.
fn touch_point(point_world: nalgebra::Point3<f64>, touch: &Touch) -> TouchPoint {
    TouchPoint {
        body: 0,
        point_m: [point_world.x, point_world.y, point_world.z].map(|component| component as f32),
        response_m: touch.response_m().unwrap_or_default().map(|component| component as f32),
    }
}
