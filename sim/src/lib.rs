//! The rigid-body world: scenes, surface samples and the answer to collisions with the visual hull.
//!
//! A [`Scene`] (a TOML file) becomes a [`World`] of bodies. Every step the program asks the hull about
//! the bodies' samples and hands the answers, one [`BodyResponse`] per moving body, to
//! [`World::step`]. The solver is rapier; none of its types leave this crate.
//!
//! Metres, kilograms, seconds; a right-handed world whose up is against the scene's gravity. The
//! solver computes in `f32`; poses that leave are those numbers widened to `f64`. One scene, one seed
//! and one series of responses give the same poses, bit for bit, on every machine.

pub mod fuzz;
pub mod ray;
pub mod response;
mod rotation;
pub mod samples;
pub mod scene;
mod seeded;
pub mod solid;
mod solver;
pub mod summary;
mod support;
pub mod trajectory;
pub mod world;

pub use response::{BodyResponse, HullContact, HullPatch, ResponseMode};
pub use scene::{
    BodyRequest, BodySpec, FRICTION, Floor, HullSurface, MAX_SPEED_M_S, MassSpec, RESTITUTION, Scene,
    SceneError, ShapeRequest, StageHint, ValueError,
};
pub use solid::Solid;
pub use solver::MAX_PATCHES;
pub use summary::BodySummary;
pub use trajectory::TrajectoryDigest;
pub use world::{
    Body, BodyId, BodySnapshot, CommandError, Fault, FaultKind, LimitError, Parameters, PreparedBody,
    StepReport, World, WorldError, WorldSettings, WorldSnapshot,
};
