//! What stands in the studio as plain data, for who builds it elsewhere.

use nalgebra::{Isometry3, Rotation3, UnitQuaternion};

use crate::solid::{Form, Solid};
use crate::studio::StageSettings;

/// A convex piece of the person or of a prop at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConvexSolid {
    /// Its form in its own frame.
    pub form: ConvexForm,
    /// World from its own frame, metres.
    pub world: Isometry3<f64>,
}

/// The form of a convex piece, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConvexForm {
    /// A box about the origin.
    Cuboid {
        /// Edge lengths.
        size_m: [f64; 3],
    },
    /// The convex hull of two balls, squashed.
    RoundCone {
        /// The one ball is about the origin, the other so far up +Y.
        length_m: f64,
        /// Of the ball about the origin.
        start_m: f64,
        /// Of the other.
        end_m: f64,
        /// Scale along the axes, 1 along +Y.
        squash: [f64; 3],
    },
}

impl ConvexSolid {
    fn of(solid: &Solid) -> ConvexSolid {
        let form = match solid.form {
            Form::Cuboid { half_m } => ConvexForm::Cuboid { size_m: (half_m * 2.0).into() },
            Form::RoundCone { length_m, start_m, end_m } => {
                ConvexForm::RoundCone { length_m, start_m, end_m, squash: solid.squash.into() }
            }
        };
        let rotation = Rotation3::from_matrix_unchecked(solid.frame);
        let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
        ConvexSolid { form, world: Isometry3::from_parts(solid.origin.into(), rotation) }
    }
}

impl StageSettings {
    /// All of person and props at a time, seconds, in an order that never changes.
    pub fn convex_solids(&self, time_s: f64) -> Vec<ConvexSolid> {
        self.solids(time_s).iter().map(ConvexSolid::of).collect()
    }
}
