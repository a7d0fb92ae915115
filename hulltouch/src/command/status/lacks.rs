//! What a room lacks: plain decisions over what its nodes said.

use proto::{CameraStatus, NodeStatus};

use super::room::NodeSample;

/// A camera that gives fewer frames than this share of what it should lacks some.
const LEAST_SHARE: f64 = 0.9;

/// What is missing or wrong in a room of so many frames per second, a line each; nothing if it runs as it should.
pub fn lacks(samples: &[NodeSample], fps: f64) -> Vec<String> {
    let mut found = Vec::new();
    for sample in samples {
        match &sample.found {
            Ok(report) => of_node(sample, &report.status, fps, &mut found),
            Err(error) => found.push(format!("node {}: {error}", sample.name())),
        }
    }
    let statuses =
        || samples.iter().filter_map(|sample| sample.found.as_ref().ok()).map(|found| &found.status);
    if statuses().any(|status| status.holder.is_some()) {
        let without = samples
            .iter()
            .filter(|sample| sample.found.as_ref().is_ok_and(|report| report.status.holder.is_none()));
        found.extend(without.map(|sample| format!("node {}: no coordinator leads it", sample.name())));
    } else if statuses().next().is_some() {
        found.push("no coordinator leads the nodes: no camera films".to_owned());
    }
    let mut holders: Vec<&str> =
        statuses().filter_map(|status| status.holder.as_ref()).map(|holder| &holder.name[..]).collect();
    holders.sort_unstable();
    holders.dedup();
    if holders.len() > 1 {
        found.push(format!("the nodes are led by different coordinators: {}", holders.join(", ")));
    }
    found
}

fn of_node(sample: &NodeSample, status: &NodeStatus, fps: f64, found: &mut Vec<String>) {
    let name = sample.name();
    if let Some(why) = &status.failure {
        found.push(format!("node {name}: its film has failed: {why}"));
    }
    for expected in &sample.node.cameras {
        let place = status.node.cameras.iter().position(|camera| camera.name == expected.name);
        let Some(place) = place else {
            found.push(format!("node {name}: it has no camera {:?}", expected.name));
            continue;
        };
        if let Some(lack) = status.holder.as_ref().and_then(|_| of_camera(&status.cameras[place], fps)) {
            found.push(format!("camera {}: {lack}", expected.name));
        }
    }
    if status.holder.as_ref().is_some_and(|holder| !holder.is_there) {
        found.push(format!("node {name}: who led it is gone"));
    }
}

/// What a camera lacks that should film.
fn of_camera(camera: &CameraStatus, fps: f64) -> Option<String> {
    let found = camera.frames_per_s;
    if found >= LEAST_SHARE * fps {
        return None;
    }
    let why = camera.trouble.as_ref().map_or_else(String::new, |trouble| format!(": {}", trouble.message));
    Some(if found == 0.0 {
        format!("it gives no frames{why}")
    } else {
        format!("it gives {found:.1} frames/s, expected {fps}{why}")
    })
}

#[cfg(test)]
mod tests {
    use node_client::{ExpectedNode, NodeError, NodeReport};
    use proto::{Address, CameraDescription, HolderStatus, NodeDescription};

    use super::*;

    fn camera(rig_index: u16) -> CameraDescription {
        let name = format!("cam_{rig_index}");
        CameraDescription { name, rig_index, size: (8, 8), calibration_digest: [0; 32] }
    }

    fn filming(rig_index: u16, frames_per_s: f64) -> CameraStatus {
        CameraStatus { rig_index, frames: 9, newest: None, frames_per_s, jitter_s: 0.0, trouble: None }
    }

    fn sample(name: &str, place: u16, holder: Option<&str>, frames_per_s: f64) -> NodeSample {
        let address = Address::Tcp("127.0.0.1:7001".into());
        let holder =
            holder.map(|name| HolderStatus { name: name.into(), term: 1, held_s: 3.0, is_there: true });
        let status = NodeStatus {
            node: NodeDescription {
                version: "0.1.0".into(),
                cameras: vec![camera(place)],
                settings: hull::ProbeSettings::default(),
                fps: 30.0,
                term: 1,
            },
            node_s: 0.0,
            unix_s: 0.0,
            holder,
            certificate_ends_unix_s: None,
            failure: None,
            cameras: vec![filming(place, frames_per_s)],
        };
        let place = address.clone().into();
        let node = ExpectedNode {
            name: Some(name.into()),
            place,
            cameras: status.node.cameras.clone(),
            expected_cameras: vec![],
            is_endless: false,
        };
        let report = NodeReport { address, status, clock_offset_s: 0.0, clock_bound_s: 1e-4 };
        NodeSample { node, found: Ok(report) }
    }

    #[test]
    fn a_room_that_runs_lacks_nothing() {
        let room = [sample("left", 0, Some("one"), 29.9), sample("right", 1, Some("one"), 30.1)];
        assert_eq!(lacks(&room, 30.0), Vec::<String>::new());
    }

    #[test]
    fn what_is_missing_is_named() {
        type Spoil = fn(&mut [NodeSample; 2]);
        let spoils: [(Spoil, &str); 7] = [
            (|room| room[1].found = Err(NodeError::NotFound), "node right: not found by its name"),
            (
                |room| *room = [sample("left", 0, None, 0.0), sample("right", 1, None, 0.0)],
                "no coordinator leads the nodes: no camera films",
            ),
            (|room| room[1] = sample("right", 1, None, 0.0), "node right: no coordinator leads it"),
            (
                |room| room[1] = sample("right", 1, Some("another"), 30.0),
                "the nodes are led by different coordinators: another, one",
            ),
            (|room| room[0] = sample("left", 0, Some("one"), 0.0), "camera cam_0: it gives no frames"),
            (
                |room| room[0] = sample("left", 0, Some("one"), 15.0),
                "camera cam_0: it gives 15.0 frames/s, expected 30",
            ),
            (|room| room[0].node.cameras = vec![camera(7)], "node left: it has no camera \"cam_7\""),
        ];
        for (spoil, expected) in spoils {
            let mut room = [sample("left", 0, Some("one"), 30.0), sample("right", 1, Some("one"), 30.0)];
            spoil(&mut room);
            let found = lacks(&room, 30.0);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].starts_with(expected), "{found:?}");
        }
    }
}
