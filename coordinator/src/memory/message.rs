//! The messages of a checkpoint's contents. No other program reads them, so they stand here instead of in a `.proto` file.
//! Metres, seconds, radians; world frame; world from body.

use prost::{Message, Oneof};

/// A world and whose it is.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Kept {
    /// BLAKE3 of the calibration digests of all cameras in rig order.
    #[prost(bytes = "vec", tag = "1")]
    pub rig: Vec<u8>,
    /// The digest of the scene with which the run began.
    #[prost(bytes = "vec", tag = "2")]
    pub scene: Vec<u8>,
    /// Drawn when the run began.
    #[prost(fixed64, tag = "3")]
    pub run: u64,
    #[prost(uint64, tag = "4")]
    pub term: u64,
    /// Counts the checkpoints of the run.
    #[prost(uint64, tag = "5")]
    pub sequence: u64,
    #[prost(double, tag = "6")]
    pub kept_unix_s: f64,
    #[prost(message, optional, tag = "7")]
    pub world: Option<World>,
}

/// The term of [`Kept`] alone.
#[derive(Clone, PartialEq, Message)]
pub(super) struct KeptTerm {
    #[prost(uint64, tag = "4")]
    pub term: u64,
}

/// A world.
#[derive(Clone, PartialEq, Message)]
pub(super) struct World {
    #[prost(string, tag = "1")]
    pub scene_name: String,
    #[prost(string, tag = "2")]
    pub scene_toml: String,
    #[prost(double, repeated, tag = "3")]
    pub scene_gravity_m_s2: Vec<f64>,
    #[prost(bool, tag = "4")]
    pub answers_hull: bool,
    #[prost(double, tag = "5")]
    pub hull_restitution: f64,
    #[prost(double, tag = "6")]
    pub hull_friction: f64,
    #[prost(double, repeated, tag = "7")]
    pub gravity_m_s2: Vec<f64>,
    #[prost(uint64, tag = "8")]
    pub steps: u64,
    #[prost(uint32, tag = "9")]
    pub next_id: u32,
    /// Every form once.
    #[prost(message, repeated, tag = "10")]
    pub solids: Vec<Solid>,
    #[prost(message, repeated, tag = "11")]
    pub bodies: Vec<Body>,
}

/// A body.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Body {
    #[prost(uint32, tag = "1")]
    pub id: u32,
    #[prost(string, tag = "2")]
    pub name: String,
    /// Its place in [`World::solids`].
    #[prost(uint32, tag = "3")]
    pub solid: u32,
    #[prost(float, repeated, tag = "4")]
    pub color: Vec<f32>,
    #[prost(bool, tag = "5")]
    pub fixed: bool,
    #[prost(double, tag = "6")]
    pub friction: f64,
    #[prost(double, tag = "7")]
    pub restitution: f64,
    #[prost(oneof = "Mass", tags = "8, 9")]
    pub mass: Option<Mass>,
    #[prost(double, repeated, tag = "10")]
    pub position_m: Vec<f64>,
    #[prost(double, repeated, tag = "11")]
    pub rotation_xyzw: Vec<f64>,
    #[prost(double, repeated, tag = "12")]
    pub velocity_m_s: Vec<f64>,
    #[prost(double, repeated, tag = "13")]
    pub spin_rad_s: Vec<f64>,
}

/// How heavy a body is.
#[derive(Clone, Copy, PartialEq, Oneof)]
pub(super) enum Mass {
    #[prost(double, tag = "8")]
    Kg(f64),
    #[prost(double, tag = "9")]
    KgM3(f64),
}

/// The form of a body.
#[derive(Clone, PartialEq, Message)]
pub(super) struct Solid {
    /// As a scene file calls it.
    #[prost(string, tag = "1")]
    pub kind: String,
    /// A box: its edges. What is round: radius, then length or height. A hull: its points, one after the other.
    #[prost(double, repeated, tag = "2")]
    pub extents_m: Vec<f64>,
}
