//! Solids and bodies as they are put down.

use sim::{BodyRequest, BodySpec, MassSpec, ShapeRequest, Solid};

use super::ConvertError;
use super::numbers::{colour, colour_from_message, finite, pose_from_message, required, rotation, vector};
use crate::messages::{self, Polyhedron, Round, body_spec, solid::Solid as Kind};

/// A solid.
pub(crate) fn solid(found: &Solid) -> messages::Solid {
    let round = |radius_m, length_m| Round { radius_m, length_m };
    let kind = match found {
        Solid::Box { size_m } => Kind::BoxSizeM(vector(*size_m)),
        Solid::Ball { radius_m } => Kind::BallRadiusM(*radius_m),
        Solid::Capsule { radius_m, length_m } => Kind::Capsule(round(*radius_m, *length_m)),
        Solid::Cylinder { radius_m, height_m } => Kind::Cylinder(round(*radius_m, *height_m)),
        Solid::Cone { radius_m, height_m } => Kind::Cone(round(*radius_m, *height_m)),
        Solid::Hull(hull) => Kind::Hull(Polyhedron {
            corners_m: hull.corners_m().iter().map(|corner| vector(*corner)).collect(),
            triangles: hull.triangles().iter().flatten().map(|&corner| corner as u32).collect(),
            points_m: hull.points_m().iter().map(|point| vector(*point)).collect(),
        }),
    };
    messages::Solid { solid: Some(kind) }
}

fn shape_request(found: Option<messages::Solid>) -> Result<ShapeRequest, ConvertError> {
    let kind = found.and_then(|found| found.solid).ok_or_else(|| ConvertError::missing("Solid", "solid"))?;
    Ok(match kind {
        Kind::BoxSizeM(size_m) => ShapeRequest::Box { size: finite("Solid", &size_m)? },
        Kind::BallRadiusM(radius) => ShapeRequest::Ball { radius },
        Kind::Capsule(Round { radius_m, length_m }) => {
            ShapeRequest::Capsule { radius: radius_m, length: length_m }
        }
        Kind::Cylinder(Round { radius_m, length_m }) => {
            ShapeRequest::Cylinder { radius: radius_m, height: length_m }
        }
        Kind::Cone(Round { radius_m, length_m }) => ShapeRequest::Cone { radius: radius_m, height: length_m },
        Kind::Hull(Polyhedron { points_m, .. }) => {
            let points = points_m.iter().map(|point| finite("Solid", point));
            ShapeRequest::Hull { points: points.collect::<Result<_, _>>()? }
        }
    })
}

/// A body as it is put down.
pub(crate) fn body_spec(spec: &BodySpec) -> messages::BodySpec {
    let BodySpec { name, solid: geometry, pose, velocity_m_s, mass, friction, restitution, fixed, color } =
        spec;
    messages::BodySpec {
        name: name.clone(),
        solid: Some(solid(geometry)),
        position_m: Some(vector(pose.position_m())),
        rotation: Some(rotation(pose.rotation_xyzw())),
        velocity_m_s: Some(vector(*velocity_m_s)),
        mass_spec: Some(match *mass {
            MassSpec::MassKg(kg) => body_spec::MassSpec::MassKg(kg),
            MassSpec::DensityKgM3(kg_m3) => body_spec::MassSpec::DensityKgM3(kg_m3),
        }),
        friction: *friction,
        restitution: *restitution,
        fixed: *fixed,
        colour: Some(colour(*color)),
    }
}

/// The body of a message, with the checks of a scene's bodies.
pub(crate) fn body_spec_from_message(spec: messages::BodySpec) -> Result<BodySpec, ConvertError> {
    const NAME: &str = "BodySpec";
    let pose = pose_from_message(NAME, spec.position_m.as_ref(), spec.rotation.as_ref())?;
    let (mass, density) = match spec.mass_spec.ok_or_else(|| ConvertError::missing(NAME, "mass_spec"))? {
        body_spec::MassSpec::MassKg(kg) => (Some(kg), None),
        body_spec::MassSpec::DensityKgM3(kg_m3) => (None, Some(kg_m3)),
    };
    let request = BodyRequest {
        name: Some(spec.name),
        shape: shape_request(spec.solid)?,
        position: pose.position_m(),
        rotation_xyzw: None,
        velocity: Some(required(NAME, "velocity_m_s", spec.velocity_m_s.as_ref())?),
        mass,
        density,
        friction: Some(spec.friction),
        restitution: Some(spec.restitution),
        fixed: spec.fixed,
        color: Some(colour_from_message(spec.colour.as_ref()).map(f64::from)),
    };
    let checked = request.check().map_err(|error| ConvertError::new(NAME, error))?;
    // A rotation that was normalised once is not normalised again: every bit counts.
    Ok(BodySpec { pose, ..checked })
}
