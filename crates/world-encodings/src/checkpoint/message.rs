//! The messages of a world that nodes remember. No other program reads them, so they stand here instead of in a `.proto` file.
//! Metres, seconds, radians; world frame; world from body.

use prost::{Message, Oneof};

use super::error::WorldBytesError;

/// A world.
#[derive(Clone, PartialEq, Message)]
pub struct World {
    /// What the scene is called.
    #[prost(string, tag = "1")]
    pub scene_name: String,
    /// The scene's text.
    #[prost(string, tag = "2")]
    pub scene_toml: String,
    /// The gravity with which the scene begins: three numbers.
    #[prost(double, repeated, tag = "3")]
    pub scene_gravity_m_s2: Vec<f64>,
    /// Whether bodies answer the hull.
    #[prost(bool, tag = "4")]
    pub answers_hull: bool,
    /// The share of the speed into the hull that is mirrored.
    #[prost(double, tag = "5")]
    pub hull_restitution: f64,
    /// Coulomb friction of the hull.
    #[prost(double, tag = "6")]
    pub hull_friction: f64,
    /// The gravity now: three numbers.
    #[prost(double, repeated, tag = "7")]
    pub gravity_m_s2: Vec<f64>,
    /// Steps that were made.
    #[prost(uint64, tag = "8")]
    pub steps: u64,
    /// The number of the body that comes next.
    #[prost(uint32, tag = "9")]
    pub next_id: u32,
    /// Every form once.
    #[prost(message, repeated, tag = "10")]
    pub solids: Vec<Solid>,
    /// By ascending numbers.
    #[prost(message, repeated, tag = "11")]
    pub bodies: Vec<Body>,
}

/// A body.
#[derive(Clone, PartialEq, Message)]
pub struct Body {
    /// Its number.
    #[prost(uint32, tag = "1")]
    pub id: u32,
    /// What it is called.
    #[prost(string, tag = "2")]
    pub name: String,
    /// Its place in [`World::solids`].
    #[prost(uint32, tag = "3")]
    pub solid: u32,
    /// sRGB, 0 to 1: three numbers.
    #[prost(float, repeated, tag = "4")]
    pub color: Vec<f32>,
    /// Whether it never moves.
    #[prost(bool, tag = "5")]
    pub fixed: bool,
    /// Coulomb friction coefficient.
    #[prost(double, tag = "6")]
    pub friction: f64,
    /// Share of the speed that a bounce returns.
    #[prost(double, tag = "7")]
    pub restitution: f64,
    /// How heavy it is; must be there.
    #[prost(oneof = "Mass", tags = "8, 9")]
    pub mass: Option<Mass>,
    /// Three numbers.
    #[prost(double, repeated, tag = "10")]
    pub position_m: Vec<f64>,
    /// Four numbers, of length 1.
    #[prost(double, repeated, tag = "11")]
    pub rotation_xyzw: Vec<f64>,
    /// Three numbers.
    #[prost(double, repeated, tag = "12")]
    pub velocity_m_s: Vec<f64>,
    /// Three numbers.
    #[prost(double, repeated, tag = "13")]
    pub spin_rad_s: Vec<f64>,
}

/// How heavy a body is.
#[derive(Clone, Copy, PartialEq, Oneof)]
pub enum Mass {
    /// The mass, kg.
    #[prost(double, tag = "8")]
    Kg(f64),
    /// A density, kg/m³.
    #[prost(double, tag = "9")]
    KgM3(f64),
}

/// The form of a body.
#[derive(Clone, PartialEq, Message)]
pub struct Solid {
    /// As a scene file calls it.
    #[prost(string, tag = "1")]
    pub kind: String,
    /// A box: its edges. What is round: radius, then length or height. A hull: its points, one after the other.
    #[prost(double, repeated, tag = "2")]
    pub extents_m: Vec<f64>,
}

/// The numbers of a field that holds so many.
pub(crate) fn numbers<T: Copy, const N: usize>(
    field: &'static str,
    found: &[T],
) -> Result<[T; N], WorldBytesError> {
    let wrong = |_| WorldBytesError::Count { field, found: found.len(), expected: N };
    found.try_into().map_err(wrong)
}
