//! A node's description of itself: message and back.

use super::ConvertError;
use super::bulk::{Field, unpack};
use super::film::within;
use super::from_wire::settings_from_wire;
use super::to_wire::settings_to_wire;
use crate::codec::MAX_CAMERAS;
use crate::text::{MAX_NAME_CHARS, clean};
use crate::{CameraDescription, NodeDescription, v1};

/// A description.
pub fn description_to_wire(description: &NodeDescription) -> v1::DescribeReply {
    let NodeDescription { version, cameras, settings, fps, term } = description;
    let camera = |camera: &CameraDescription| {
        let CameraDescription { name, rig_index, size: (width, height), calibration_digest } = camera;
        v1::CameraDescription {
            name: name.clone(),
            rig_index: (*rig_index).into(),
            width: *width,
            height: *height,
            calibration_digest: calibration_digest.to_vec().into(),
        }
    };
    v1::DescribeReply {
        version: version.clone(),
        cameras: cameras.iter().map(camera).collect(),
        settings: Some(settings_to_wire(settings)),
        frames_per_s: *fps,
        term: *term,
    }
}

/// A description; its texts are cleaned.
pub fn description_from_wire(reply: v1::DescribeReply) -> Result<NodeDescription, ConvertError> {
    let v1::DescribeReply { version, cameras, settings, frames_per_s, term } = reply;
    let field = |name| Field("DescribeReply", name);
    let settings = settings.ok_or(ConvertError::Missing { message: "DescribeReply", field: "settings" })?;
    if cameras.len() > MAX_CAMERAS {
        let found = cameras.len();
        return Err(field("cameras").value(format!("holds {found}, expected at most {MAX_CAMERAS}")));
    }
    Ok(NodeDescription {
        version: clean(&version, MAX_NAME_CHARS),
        cameras: cameras.into_iter().map(camera_from_wire).collect::<Result<_, _>>()?,
        settings: settings_from_wire(&settings)?,
        fps: within(frames_per_s, 0.0, 1e6, field("frames_per_s"))?,
        term,
    })
}

fn camera_from_wire(camera: v1::CameraDescription) -> Result<CameraDescription, ConvertError> {
    let v1::CameraDescription { name, rig_index, width, height, calibration_digest } = camera;
    let field = |name| Field("CameraDescription", name);
    let place = u16::try_from(rig_index);
    let digest = unpack(&calibration_digest, 1, field("calibration_digest"), |digest: [u8; 32]| digest)?[0];
    Ok(CameraDescription {
        name: clean(&name, MAX_NAME_CHARS),
        rig_index: place
            .map_err(|_| field("rig_index").value(format!("is {rig_index}, expected 16 bits")))?,
        size: (width, height),
        calibration_digest: digest,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_description_comes_back_and_lies_are_refused() {
        let camera = CameraDescription {
            name: "left".into(),
            rig_index: 3,
            size: (640, 480),
            calibration_digest: [7; 32],
        };
        let description = NodeDescription {
            version: "0.1.0".into(),
            cameras: vec![camera],
            settings: hull::ProbeSettings::default(),
            fps: 30.0,
            term: 4,
        };
        let wire = description_to_wire(&description);
        assert_eq!(description_from_wire(wire.clone()), Ok(description));
        type Lie = fn(&mut v1::DescribeReply);
        let lies: [(Lie, &str); 5] = [
            (|reply| reply.settings = None, "DescribeReply.settings is missing"),
            (|reply| reply.frames_per_s = f64::NAN, "DescribeReply.frames_per_s: is NaN"),
            (|reply| reply.cameras[0].rig_index = 70_000, "CameraDescription.rig_index: is 70000"),
            (
                |reply| reply.cameras[0].calibration_digest = vec![1].into(),
                "CameraDescription.calibration_digest holds 1 bytes, expected 32",
            ),
            (
                |reply| reply.cameras = vec![reply.cameras[0].clone(); 5000],
                "DescribeReply.cameras: holds 5000",
            ),
        ];
        for (lie, expected) in lies {
            let mut lied = wire.clone();
            lie(&mut lied);
            let error = description_from_wire(lied).expect_err(expected).to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
