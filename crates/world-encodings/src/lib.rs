//! What a body is, what all bodies obey and what nodes remember of a world, as messages and back. Four encodings share the
//! types of [`sim`]: the gRPC service of programs ([`service`]), a recording ([`recording`]), a checkpoint ([`checkpoint`])
//! and JSON. A solid stands for all four in one file ([`shape`]).
//!
//! What a recording or a checkpoint holds is checked as a scene's bodies are. A request of a program is not:
//! [`ShapeRequest::check`](sim::ShapeRequest::check) and [`BodyRequest::check`](sim::BodyRequest::check) do that, and the
//! world checks parameters. Metres, kilograms, seconds, radians; world frame unless a name says `body`; rotations are world
//! from body, a quaternion x, y, z, w.

pub mod checkpoint;
pub mod fuzz;
pub mod recording;
pub mod service;
pub mod shape;

pub use checkpoint::{WorldBytesError, world_from_bytes, world_to_bytes};
