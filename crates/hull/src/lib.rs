//! The geometry of the visual hull: cameras, silhouettes, probes and the pass.
//!
//! Everything here is a plain function over plain data. The crate knows no files, clocks, threads,
//! network or physics; what it computes is De Decker, Mertens and Bekaert, *Interactive collision
//! detection for free-viewpoint video* (section numbers in module headers are that paper's).
//!
//! Conventions: metres, radians, a right-handed world; camera frame x right, y down, z forward;
//! a pixel's centre has integer coordinates, so the projection `(u, v)` falls in pixel
//! `(floor(u + 0.5), floor(v + 0.5))`. Answers are the same bits on every machine: sums run in
//! sample order, sine and cosine come from `libm`, nothing is contracted to fused multiply-add.

pub mod body;
pub mod calibration_words;
pub mod camera;
pub mod collision;
pub mod contact;
pub mod coordinates;
pub mod cull;
pub mod faces;
pub mod fuzz;
pub mod lens;
pub mod lens_model;
pub mod merge;
pub mod oracle;
pub mod pass;
pub mod probe;
pub mod question;
pub mod reach;
pub mod response;
pub mod rig;
pub mod rotation;
pub mod rule;
pub mod silhouette;
pub mod surface;
pub mod text;
pub mod vector;
pub mod view;
pub mod view_set;

pub use body::{Pose, Shape};
pub use camera::{Camera, CameraError, Pixel};
pub use reach::Reach;
pub use rig::{Rig, RigError};
pub use rule::{HullRule, NormalWindow, OutOfView, ProbeSettings};
pub use silhouette::Silhouette;
pub use vector::VectorPath;
pub use view::{Class, Observer, View};
pub use view_set::ViewSet;
