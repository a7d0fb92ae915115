//! A room as one JSON object. docs/commands.md lists the keys.

use film_time::unix_now_s;
use proto::{CameraDescription, CameraStatus};
use serde::Serialize;
use setup::ClusterFile;

use super::days_left;
use super::room::NodeSample;

#[derive(Serialize)]
struct Room<'a> {
    time_unix_s: f64,
    room: &'a str,
    fps: f64,
    ok: bool,
    lacks: &'a [String],
    nodes: Vec<Node>,
}

#[derive(Serialize)]
struct Node {
    name: String,
    address: String,
    problem: Option<String>,
    version: Option<String>,
    leader: Option<Leader>,
    clock_offset_ms: Option<f64>,
    clock_bound_ms: Option<f64>,
    certificate_days: Option<i64>,
    film_failure: Option<String>,
    cameras: Vec<Camera>,
}

#[derive(Serialize)]
struct Leader {
    name: String,
    term: u64,
    held_s: f64,
    is_there: bool,
}

#[derive(Serialize)]
struct Camera {
    name: String,
    rig_index: u16,
    frames_per_s: f64,
    age_ms: Option<f64>,
    frame: Option<u64>,
    foreground: Option<f64>,
    stamps: Option<&'static str>,
    jitter_ms: f64,
    trouble: Option<String>,
}

/// The room, in one line.
pub fn line(file: &ClusterFile, samples: &[NodeSample], lacks: &[String]) -> serde_json::Result<String> {
    let room = Room {
        time_unix_s: unix_now_s(),
        room: &file.name,
        fps: file.fps,
        ok: lacks.is_empty(),
        lacks,
        nodes: samples.iter().map(node).collect(),
    };
    serde_json::to_string(&room)
}

fn node(sample: &NodeSample) -> Node {
    let silent = Node {
        name: sample.name(),
        address: sample.node.place.to_string(),
        problem: sample.found.as_ref().err().map(ToString::to_string),
        version: None,
        leader: None,
        clock_offset_ms: None,
        clock_bound_ms: None,
        certificate_days: None,
        film_failure: None,
        cameras: Vec::new(),
    };
    let Ok(report) = &sample.found else { return silent };
    let status = &report.status;
    let leader = status.holder.clone().map(|holder| {
        let proto::HolderStatus { name, term, held_s, is_there } = holder;
        Leader { name, term, held_s, is_there }
    });
    Node {
        address: report.address.to_string(),
        version: Some(status.node.version.clone()),
        leader,
        clock_offset_ms: Some(1e3 * report.clock_offset_s),
        clock_bound_ms: Some(1e3 * report.clock_bound_s),
        certificate_days: days_left(status),
        film_failure: status.failure.clone(),
        cameras: status.node.cameras.iter().zip(&status.cameras).map(camera).collect(),
        ..silent
    }
}

fn camera((described, status): (&CameraDescription, &CameraStatus)) -> Camera {
    let newest = status.newest.as_ref();
    Camera {
        name: described.name.clone(),
        rig_index: status.rig_index,
        frames_per_s: status.frames_per_s,
        age_ms: newest.map(|newest| 1e3 * newest.age_s),
        frame: newest.map(|newest| newest.frame),
        foreground: newest.map(|newest| newest.foreground),
        stamps: newest.map(|newest| newest.stamps.word()),
        jitter_ms: 1e3 * status.jitter_s,
        trouble: status.trouble.as_ref().map(|trouble| trouble.message.clone()),
    }
}
