//! What the loop hands out of what it counts.

use std::sync::Arc;
use std::time::Instant;

use super::Coordinator;
use crate::figures::{Figures, NodeBytes, Progress, RunCounts};
use crate::live::{CameraStatus, MAX_WAITING};
use crate::metrics::{MetricsSender, NodeMetrics, Queue, RunMetrics, RunTimes};
use crate::roster::{HullUnavailable, RosterNode};

impl Coordinator {
    /// Hands out metrics from now on.
    pub fn with_metrics(mut self, metrics: MetricsSender) -> Coordinator {
        self.publisher.metrics = Some(metrics);
        self.publish_waiting();
        self
    }

    /// Publishes which nodes the run waits for.
    pub(super) fn publish_waiting(&mut self) {
        if self.publisher.metrics.is_some() {
            let cameras = self.camera_status();
            self.publish_metrics(None, &cameras);
        }
    }

    /// Hands out what is known now; `progress` once the loop turns.
    pub(super) fn publish_metrics(&mut self, progress: Option<&Progress>, cameras: &[CameraStatus]) {
        if self.publisher.metrics.is_none() {
            return;
        }
        let unavailable = self.run.film.unavailable.as_ref();
        let metrics = RunMetrics {
            at: Instant::now(),
            hull_frame: self.publisher.view.frame,
            hull_unavailable: unavailable.map(HullUnavailable::to_string),
            progress: progress.cloned(),
            cameras: cameras.to_vec(),
            nodes: self.node_metrics(),
            counts: self.counts(),
            times: times(&self.run.figures),
            queues: self.queues(),
        };
        if let Some(sender) = &self.publisher.metrics {
            sender.send_replace(Some(Arc::new(metrics)));
        }
    }

    fn node_metrics(&self) -> Vec<NodeMetrics> {
        let nodes = self.transport.roster().nodes().iter().enumerate();
        let node = |(index, node): (usize, &RosterNode)| {
            let client = self.transport.clients().get(index);
            NodeMetrics {
                cameras: node.cameras().to_vec(),
                is_up: node.missing().is_none(),
                is_left_out: node.is_left_out(),
                connections: node.connections(),
                clock: client.and_then(|client| client.clock()),
                trip_s: client.map(|client| client.trip_s()),
                open_questions: client.map_or(0, |client| client.open_questions()),
            }
        };
        nodes.map(node).collect()
    }

    /// What was counted up to now.
    pub(super) fn counts(&self) -> RunCounts {
        let bytes = self.transport.bytes();
        RunCounts {
            slipped_s: self.run.clock.slipped_s,
            bytes: NodeBytes {
                to_nodes: bytes.to_nodes,
                from_nodes: bytes.from_nodes,
                silhouettes: self.transport.silhouette_bytes(),
            },
            ..self.run.figures.counts.clone()
        }
    }

    fn queues(&self) -> Vec<Queue> {
        let orders = self.publisher.live.as_ref().map_or(0, |live| live.orders.len());
        let commands = Queue { name: "commands", length: orders, capacity: MAX_WAITING };
        let events = self.transport.waiting_events();
        let events = events.map(|(length, capacity)| Queue { name: "node_events", length, capacity });
        [commands].into_iter().chain(events).collect()
    }
}

fn times(figures: &Figures) -> RunTimes {
    RunTimes {
        stages: std::array::from_fn(|stage| *figures.times.stage_ms[stage].histogram()),
        step: *figures.times.step_ms.histogram(),
        pass: figures.times.pass,
        response_age: *figures.times.response_age_ms.histogram(),
        hull_age: figures.times.hull_age,
    }
}
