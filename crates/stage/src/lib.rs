//! A synthetic studio: an actor, props and a room, rendered for every camera, with ground truth.
//!
//! World: metres, right-handed, +Y up, the floor at y = 0; the person stands at the origin and faces +Z, so
//! its left is at +X. Frames depend on (settings, camera, index, frame number) to the byte, on every
//! machine: sines come from `libm`, and nothing runs in parallel.
//!
//! - [`StageSettings`]: who and what is there; [`Motion`]: where the person's joints are at a time.
//! - [`CameraStage`]: the film of one camera, and its true masks; [`true_silhouette`]: one as runs, of an image of any
//!   size. [`studio_rig`]: the cameras.
//! - [`Truth`]: signed distance to everything real; [`ConvexSolid`]: what it is made of.

mod camera_stage;
mod convex;
mod figure;
mod lifted_box;
mod material;
mod maths;
mod motion;
mod motions;
mod noise;
pub mod props;
mod rect;
mod rig;
mod room;
mod shadow;
mod skeleton;
mod solid;
mod studio;
mod trace;
mod tray;

#[cfg(test)]
mod tests;

pub use camera_stage::{CameraStage, true_silhouette};
pub use convex::{ConvexForm, ConvexSolid};
pub use motion::{LIFT_RISE_S, LIFT_TILT_S, Motion, NEUTRAL_S, Speed, UnknownMotion};
pub use noise::NOISE_SIGMA;
pub use props::{Prop, UnknownProp};
pub use rig::{AIM_M, FIELD_OF_VIEW_RAD, RIG_RADIUS_M, studio_rig};
pub use skeleton::Joint;
pub use studio::{StageSettings, Truth};
