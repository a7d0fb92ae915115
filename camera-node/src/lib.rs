//! A camera node: sources, segmentation, the ring of silhouettes, and the service that answers probes.
//!
//! One process serves one or more cameras. Film runs on a thread a camera ([`capture`]), finished frames
//! wait in a bounded ring ([`frames`]), pictures for people are encoded on request ([`pictures`]), probes are
//! computed on threads of their own, and only their bytes pass through the async [`service`].

pub mod capture;
mod config;
mod cores;
mod film_check;
pub mod frames;
pub mod fuzz;
pub mod listen;
pub mod metrics;
pub mod pictures;
pub mod scratch;
pub mod service;
mod shapes;
pub mod source;

pub use config::{NodeCamera, NodeConfig};
pub use film_check::{FilmCheckError, ShortFilm};
pub use source::SourceConfig;
