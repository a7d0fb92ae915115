//! A body's geometry in every encoding: body frame, metres. A new solid needs a line in each function of this file.

use proto::recording::{Polyhedron, Round, Solid as RecordedSolid, solid::Solid as Recorded};
use proto::v1::BodyShape;
use proto::v1::body_shape::{Ball, Box, Capsule, Cone, Cylinder, Hull, Kind};
use serde_json::{Value, json};
use sim::{ShapeRequest, Solid};

use crate::checkpoint::error::WorldBytesError;
use crate::checkpoint::message::{Solid as KeptSolid, numbers};
use crate::recording::values::{self as recording_values, ConvertError};
use crate::service::values::{self as service_values, Missing};

/// The solid as the gRPC service describes it; a convex hull by its corners.
pub fn to_service(solid: &Solid) -> BodyShape {
    let kind = match *solid {
        Solid::Box { size_m } => Kind::Box(Box { size: Some(service_values::vector(size_m)) }),
        Solid::Ball { radius_m: radius } => Kind::Ball(Ball { radius }),
        Solid::Capsule { radius_m: radius, length_m: length } => Kind::Capsule(Capsule { radius, length }),
        Solid::Cylinder { radius_m: radius, height_m: height } => Kind::Cylinder(Cylinder { radius, height }),
        Solid::Cone { radius_m: radius, height_m: height } => Kind::Cone(Cone { radius, height }),
        Solid::Hull(ref hull) => {
            let points = hull.corners_m().iter().map(|&corner| service_values::vector(corner)).collect();
            Kind::Hull(Hull { points })
        }
    };
    BodyShape { kind: Some(kind) }
}

/// What a caller of the gRPC service asks for, unchecked.
pub fn from_service(shape: Option<BodyShape>) -> Result<ShapeRequest, Missing> {
    let missing = Missing { field: "shape", expected: "box, ball, capsule, cylinder, cone or hull" };
    Ok(match shape.and_then(|shape| shape.kind).ok_or(missing)? {
        Kind::Box(Box { size }) => {
            ShapeRequest::Box { size: service_values::needed("shape.box.size", size)? }
        }
        Kind::Ball(Ball { radius }) => ShapeRequest::Ball { radius },
        Kind::Capsule(Capsule { radius, length }) => ShapeRequest::Capsule { radius, length },
        Kind::Cylinder(Cylinder { radius, height }) => ShapeRequest::Cylinder { radius, height },
        Kind::Cone(Cone { radius, height }) => ShapeRequest::Cone { radius, height },
        Kind::Hull(Hull { points }) => {
            ShapeRequest::Hull { points: points.into_iter().map(service_values::numbers).collect() }
        }
    })
}

/// The solid as a recording keeps it.
pub fn to_recording(solid: &Solid) -> RecordedSolid {
    let round = |radius_m, length_m| Round { radius_m, length_m };
    let kind = match *solid {
        Solid::Box { size_m } => Recorded::BoxSizeM(recording_values::vector(size_m)),
        Solid::Ball { radius_m } => Recorded::BallRadiusM(radius_m),
        Solid::Capsule { radius_m, length_m } => Recorded::Capsule(round(radius_m, length_m)),
        Solid::Cylinder { radius_m, height_m } => Recorded::Cylinder(round(radius_m, height_m)),
        Solid::Cone { radius_m, height_m } => Recorded::Cone(round(radius_m, height_m)),
        Solid::Hull(ref hull) => Recorded::Hull(Polyhedron {
            corners_m: hull.corners_m().iter().map(|&corner| recording_values::vector(corner)).collect(),
            triangles: hull.triangles().iter().flatten().map(|&corner| corner as u32).collect(),
            points_m: hull.points_m().iter().map(|&point| recording_values::vector(point)).collect(),
        }),
    };
    RecordedSolid { solid: Some(kind) }
}

/// What a recording holds, unchecked; a convex hull is made again of its points.
pub fn from_recording(solid: Option<RecordedSolid>) -> Result<ShapeRequest, ConvertError> {
    const NAME: &str = "Solid";
    let kind = solid.and_then(|solid| solid.solid).ok_or_else(|| ConvertError::missing(NAME, "solid"))?;
    Ok(match kind {
        Recorded::BoxSizeM(size_m) => ShapeRequest::Box { size: recording_values::finite(NAME, &size_m)? },
        Recorded::BallRadiusM(radius) => ShapeRequest::Ball { radius },
        Recorded::Capsule(Round { radius_m: radius, length_m: length }) => {
            ShapeRequest::Capsule { radius, length }
        }
        Recorded::Cylinder(Round { radius_m: radius, length_m: height }) => {
            ShapeRequest::Cylinder { radius, height }
        }
        Recorded::Cone(Round { radius_m: radius, length_m: height }) => ShapeRequest::Cone { radius, height },
        Recorded::Hull(Polyhedron { points_m, .. }) => {
            let points = points_m.iter().map(|point| recording_values::finite(NAME, point));
            ShapeRequest::Hull { points: points.collect::<Result<_, _>>()? }
        }
    })
}

/// The solid as nodes remember it: its kind, and numbers whose count the kind tells.
pub(crate) fn to_checkpoint(solid: &Solid) -> KeptSolid {
    let extents_m = match *solid {
        Solid::Box { size_m } => size_m.to_vec(),
        Solid::Ball { radius_m } => vec![radius_m],
        Solid::Capsule { radius_m, length_m: long_m }
        | Solid::Cylinder { radius_m, height_m: long_m }
        | Solid::Cone { radius_m, height_m: long_m } => vec![radius_m, long_m],
        Solid::Hull(ref hull) => hull.points_m().as_flattened().to_vec(),
    };
    KeptSolid { kind: solid.kind().to_owned(), extents_m }
}

/// What nodes remember, unchecked.
pub(crate) fn from_checkpoint(found: &KeptSolid) -> Result<ShapeRequest, WorldBytesError> {
    const FIELD: &str = "extents_m";
    let extents_m = &found.extents_m[..];
    let round = || numbers::<f64, 2>(FIELD, extents_m);
    Ok(match &found.kind[..] {
        "box" => ShapeRequest::Box { size: numbers(FIELD, extents_m)? },
        "ball" => numbers(FIELD, extents_m).map(|[radius]| ShapeRequest::Ball { radius })?,
        "capsule" => round().map(|[radius, length]| ShapeRequest::Capsule { radius, length })?,
        "cylinder" => round().map(|[radius, height]| ShapeRequest::Cylinder { radius, height })?,
        "cone" => round().map(|[radius, height]| ShapeRequest::Cone { radius, height })?,
        "hull" => {
            let points = extents_m.chunks(3).map(|point| numbers(FIELD, point));
            ShapeRequest::Hull { points: points.collect::<Result<_, _>>()? }
        }
        _ => return Err(WorldBytesError::Missing("kind")),
    })
}

/// The solid as JSON, with the keys of a scene file; a convex hull by its corners and triangles, which a page draws.
/// [`ShapeRequest`] reads what programs send.
pub fn to_json(solid: &Solid) -> Value {
    match *solid {
        Solid::Box { size_m } => json!({"box": {"size": size_m}}),
        Solid::Ball { radius_m } => json!({"ball": {"radius": radius_m}}),
        Solid::Capsule { radius_m, length_m } => {
            json!({"capsule": {"radius": radius_m, "length": length_m}})
        }
        Solid::Cylinder { radius_m, height_m } => {
            json!({"cylinder": {"radius": radius_m, "height": height_m}})
        }
        Solid::Cone { radius_m, height_m } => json!({"cone": {"radius": radius_m, "height": height_m}}),
        Solid::Hull(ref hull) => json!({"hull": {"corners": hull.corners_m(), "faces": hull.triangles()}}),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of each kind.
    fn solids() -> Vec<Solid> {
        let corners = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|bit| 0.2 * f64::from(bit) - 0.1));
        [
            ShapeRequest::Box { size: [0.1, 0.2, 0.3] },
            ShapeRequest::Ball { radius: 0.1 },
            ShapeRequest::Capsule { radius: 0.1, length: 0.2 },
            ShapeRequest::Cylinder { radius: 0.1, height: 0.2 },
            ShapeRequest::Cone { radius: 0.1, height: 0.2 },
            ShapeRequest::Hull { points: corners.collect() },
        ]
        .map(|request| request.check().expect("a solid"))
        .into()
    }

    #[test]
    fn recordings_and_nodes_give_every_solid_back_to_the_bit() {
        for solid in solids() {
            let recorded = from_recording(Some(to_recording(&solid))).expect("a shape");
            assert_eq!(recorded.check(), Ok(solid.clone()));
            let kept = from_checkpoint(&to_checkpoint(&solid)).expect("a shape");
            assert_eq!(kept.check(), Ok(solid));
        }
    }

    #[test]
    fn what_the_service_describes_can_be_asked_for() {
        for solid in solids() {
            let again = from_service(Some(to_service(&solid))).expect("a shape").check().expect("a solid");
            match (&solid, &again) {
                // The order of corners is the convex hull's own business.
                (Solid::Hull(a), Solid::Hull(b)) => assert_eq!(a.corners_m().len(), b.corners_m().len()),
                _ => assert_eq!(solid, again),
            }
        }
    }

    #[test]
    fn json_has_the_keys_that_are_read() {
        for solid in solids().into_iter().filter(|solid| solid.kind() != "hull") {
            let request: ShapeRequest = serde_json::from_value(to_json(&solid)).expect("a shape");
            assert_eq!(request.check(), Ok(solid));
        }
        let hull = to_json(solids().last().expect("a hull"));
        let lengths = ["corners", "faces"].map(|key| hull["hull"][key].as_array().expect("a list").len());
        assert_eq!(lengths, [8, 12]);
    }
}
