//! What a node reports of itself to coordinators and viewers: message and back.

use super::ConvertError;
use super::bulk::Field;
use super::description::{description_from_wire, description_to_wire};
use super::film::{
    MAX_FRAME, MAX_FRAMES_PER_S, MAX_TIME_S, pace_from_wire, pace_to_wire, stamps_from_wire, stamps_to_wire,
    within,
};
use crate::text::{MAX_MESSAGE_CHARS, MAX_NAME_CHARS, clean};
use crate::{CameraStatus, CameraTrouble, HolderStatus, NewestFrame, NodeStatus, TroubleKind, v1};

/// A status.
pub fn status_to_wire(status: NodeStatus) -> v1::StatusReply {
    let NodeStatus { node, node_s, unix_s, holder, certificate_ends_unix_s, failure, cameras } = status;
    let holder = holder.map(|holder| {
        let HolderStatus { name, term, held_s, is_there } = holder;
        v1::Holder { name, term, held_s, is_there }
    });
    v1::StatusReply {
        node: Some(description_to_wire(&node)),
        node_s,
        unix_s,
        holder,
        certificate_ends_unix_s: certificate_ends_unix_s.unwrap_or_default(),
        failure: failure.unwrap_or_default(),
        cameras: cameras.into_iter().map(camera_to_wire).collect(),
    }
}

fn camera_to_wire(camera: CameraStatus) -> v1::CameraStatus {
    let CameraStatus { rig_index, frames, newest, frames_per_s, jitter_s, trouble } = camera;
    let blank = v1::CameraStatus {
        rig_index: rig_index.into(),
        frames,
        frames_per_s,
        jitter_s,
        trouble: trouble.map(trouble_to_wire),
        ..v1::CameraStatus::default()
    };
    let Some(NewestFrame { frame, age_s, foreground, stamps, pace }) = newest else { return blank };
    let (stamps, pace) = (stamps_to_wire(stamps).into(), pace.map(pace_to_wire));
    v1::CameraStatus { frame, age_s, foreground, stamps, pace, ..blank }
}

fn trouble_to_wire(trouble: CameraTrouble) -> v1::CameraTrouble {
    let CameraTrouble { kind, message, age_s } = trouble;
    let kind = match kind {
        TroubleKind::Source => v1::camera_trouble::Kind::Source,
        TroubleKind::Rate => v1::camera_trouble::Kind::Rate,
        TroubleKind::Stamps => v1::camera_trouble::Kind::Stamps,
    };
    v1::CameraTrouble { kind: kind.into(), message, age_s }
}

/// A status, of exactly the cameras that its description has; its texts are cleaned.
pub fn status_from_wire(reply: v1::StatusReply) -> Result<NodeStatus, ConvertError> {
    let v1::StatusReply { node, node_s, unix_s, holder, certificate_ends_unix_s, failure, cameras } = reply;
    let field = |name| Field("StatusReply", name);
    let node = node.ok_or(ConvertError::Missing { message: "StatusReply", field: "node" })?;
    let node = description_from_wire(node)?;
    let found: Vec<u32> = cameras.iter().map(|camera| camera.rig_index).collect();
    let described: Vec<u32> = node.cameras.iter().map(|camera| camera.rig_index.into()).collect();
    if found != described {
        let what = format!("are {} cameras, expected those of its description", found.len());
        return Err(field("cameras").value(what));
    }
    let places = node.cameras.iter().map(|camera| camera.rig_index);
    let cameras = places.zip(cameras).map(|(place, camera)| camera_from_wire(place, camera));
    let ends_s = within(certificate_ends_unix_s, 0.0, 1e3 * MAX_TIME_S, field("certificate_ends_unix_s"))?;
    Ok(NodeStatus {
        node_s: within(node_s, -MAX_TIME_S, MAX_TIME_S, field("node_s"))?,
        unix_s: within(unix_s, 0.0, MAX_TIME_S, field("unix_s"))?,
        holder: holder.map(holder_from_wire).transpose()?,
        certificate_ends_unix_s: (ends_s > 0.0).then_some(ends_s),
        failure: (!failure.is_empty()).then(|| clean(&failure, MAX_MESSAGE_CHARS)),
        cameras: cameras.collect::<Result<_, _>>()?,
        node,
    })
}

fn holder_from_wire(holder: v1::Holder) -> Result<HolderStatus, ConvertError> {
    let v1::Holder { name, term, held_s, is_there } = holder;
    let held_s = within(held_s, 0.0, MAX_TIME_S, Field("Holder", "held_s"))?;
    Ok(HolderStatus { name: clean(&name, MAX_NAME_CHARS), term, held_s, is_there })
}

fn camera_from_wire(rig_index: u16, camera: v1::CameraStatus) -> Result<CameraStatus, ConvertError> {
    let kind = camera.stamps();
    let v1::CameraStatus {
        rig_index: _,
        frames,
        frame,
        age_s,
        foreground,
        stamps: _,
        pace,
        frames_per_s,
        jitter_s,
        trouble,
    } = camera;
    let field = |name| Field("CameraStatus", name);
    for (name, number) in [("frames", frames), ("frame", frame)] {
        if number > MAX_FRAME {
            return Err(field(name).value(format!("is {number}, expected at most {MAX_FRAME}")));
        }
    }
    let newest = NewestFrame {
        frame,
        age_s: within(age_s, -MAX_TIME_S, MAX_TIME_S, field("age_s"))?,
        foreground: within(foreground, 0.0, 1.0, field("foreground"))?,
        stamps: stamps_from_wire(kind),
        pace: pace.map(pace_from_wire).transpose()?,
    };
    Ok(CameraStatus {
        rig_index,
        frames,
        newest: (frames > 0).then_some(newest),
        frames_per_s: within(frames_per_s, 0.0, MAX_FRAMES_PER_S, field("frames_per_s"))?,
        jitter_s: within(jitter_s, 0.0, MAX_TIME_S, field("jitter_s"))?,
        trouble: trouble.map(trouble_from_wire).transpose()?,
    })
}

fn trouble_from_wire(trouble: v1::CameraTrouble) -> Result<CameraTrouble, ConvertError> {
    let kind = match trouble.kind() {
        v1::camera_trouble::Kind::Source => TroubleKind::Source,
        v1::camera_trouble::Kind::Rate => TroubleKind::Rate,
        v1::camera_trouble::Kind::Stamps => TroubleKind::Stamps,
    };
    let v1::CameraTrouble { kind: _, message, age_s } = trouble;
    let age_s = within(age_s, 0.0, MAX_TIME_S, Field("CameraTrouble", "age_s"))?;
    Ok(CameraTrouble { kind, message: clean(&message, MAX_MESSAGE_CHARS), age_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CameraDescription, NodeDescription};
    use film_time::{CameraPace, Stamps};

    fn status() -> NodeStatus {
        let camera = |name: &str, rig_index| CameraDescription {
            name: name.into(),
            rig_index,
            size: (64, 48),
            calibration_digest: [3; 32],
        };
        let newest = NewestFrame {
            frame: 70,
            age_s: 0.04,
            foreground: 0.08,
            stamps: Stamps::Capture,
            pace: Some(CameraPace { phase: 0.25, frames_per_s: 29.97 }),
        };
        let trouble =
            CameraTrouble { kind: TroubleKind::Rate, message: "films 15 frames/s".into(), age_s: 2.5 };
        let filming = CameraStatus {
            rig_index: 2,
            frames: 71,
            newest: Some(newest),
            frames_per_s: 29.9,
            jitter_s: 0.001,
            trouble: None,
        };
        let silent = CameraStatus {
            rig_index: 5,
            frames: 0,
            newest: None,
            frames_per_s: 0.0,
            jitter_s: 0.0,
            trouble: Some(trouble),
        };
        let holder = HolderStatus { name: "the coordinator".into(), term: 4, held_s: 9.0, is_there: true };
        NodeStatus {
            node: NodeDescription {
                version: "0.1.0".into(),
                cameras: vec![camera("left", 2), camera("right", 5)],
                settings: hull::ProbeSettings::default(),
                fps: 30.0,
                term: 4,
            },
            node_s: 12.5,
            unix_s: 1.7e9,
            holder: Some(holder),
            certificate_ends_unix_s: Some(1.8e9),
            failure: Some("no disk".into()),
            cameras: vec![filming, silent],
        }
    }

    #[test]
    fn a_status_comes_back() {
        assert_eq!(status_from_wire(status_to_wire(status())), Ok(status()));
        let idle = NodeStatus { holder: None, certificate_ends_unix_s: None, failure: None, ..status() };
        assert_eq!(status_from_wire(status_to_wire(idle.clone())), Ok(idle));
    }

    #[test]
    fn a_status_that_cannot_be_is_refused_by_field() {
        type Lie = fn(&mut v1::StatusReply);
        let lies: [(Lie, &str); 9] = [
            (|reply| reply.node = None, "StatusReply.node is missing"),
            (|reply| reply.unix_s = f64::NAN, "StatusReply.unix_s: is NaN"),
            (|reply| drop(reply.cameras.pop()), "StatusReply.cameras: are 1 cameras"),
            (|reply| reply.cameras[0].rig_index = 9, "StatusReply.cameras: are 2 cameras"),
            (
                |reply| reply.cameras = vec![reply.cameras[0].clone(); 100_000],
                "StatusReply.cameras: are 100000 cameras",
            ),
            (|reply| reply.cameras[0].foreground = 1.5, "CameraStatus.foreground: is 1.5, expected 0 to 1"),
            (|reply| reply.cameras[0].frame = u64::MAX, "CameraStatus.frame: is 18446744073709551615"),
            (|reply| reply.cameras[1].jitter_s = f64::INFINITY, "CameraStatus.jitter_s: is inf"),
            (
                |reply| reply.holder.as_mut().expect("held").held_s = -1.0,
                "Holder.held_s: is -1, expected 0 to",
            ),
        ];
        for (lie, expected) in lies {
            let mut wire = status_to_wire(status());
            lie(&mut wire);
            let error = status_from_wire(wire).expect_err(expected).to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }

    #[test]
    fn its_texts_are_lines_fit_for_a_terminal() {
        let mut wire = status_to_wire(status());
        let nasty = format!("\x1b[2J{}\nforged", "x".repeat(200_000));
        wire.failure.clone_from(&nasty);
        wire.holder.as_mut().expect("held").name.clone_from(&nasty);
        wire.cameras[1].trouble.as_mut().expect("one").message = nasty;
        let status = status_from_wire(wire).expect("a status");
        let trouble = status.cameras[1].trouble.as_ref().expect("one");
        for text in [status.failure.expect("one"), status.holder.expect("held").name, trouble.message.clone()]
        {
            assert!(text.chars().count() <= 301 && !text.chars().any(char::is_control), "{text}");
        }
    }
}
