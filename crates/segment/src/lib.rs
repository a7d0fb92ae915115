//! Background subtraction: camera frames to silhouettes.
//!
//! A [`BackgroundModel`] is learnt from a clip (or one picture) of the empty room and then frozen: a
//! model that adapted would swallow a person who stands still. A [`Segmenter`] holds it against
//! frame after frame: two thresholds on the colour distance per pixel, and between them the angle
//! of the colours, which tells a cast shadow from a person (Cheung et al. 2000, which the paper
//! cites in §3). Green rooms need no model: [`Method::Chroma`]. What is left is cleaned of specks and
//! small holes and handed over as runs.
//!
//! Frames are bytes as cameras give them ([`Layout`]): RGB, or YUV, which is compared as it is. A frame
//! is read once and becomes bits at once; clean-up works on bits and runs. All work per frame is done in
//! integers, so that one frame gives one silhouette on every machine and every [`VectorPath`](hull::VectorPath); nothing is
//! carried from frame to frame.

mod bits;
mod blobs;
mod convert;
mod crop;
mod gain;
mod kernel;
mod layout;
pub mod mask;
mod metric;
mod model;
mod segmenter;
mod settings;
mod thresholds;

pub use convert::{from_rgb, to_rgb};
pub use crop::CROP_GRID;
pub use layout::{Format, Layout, Range, Sampling, SizeError};
pub use model::{BackgroundBuilder, BackgroundModel, MAX_CLIP_FRAMES, ModelError};
pub use segmenter::{SegmentError, Segmented, Segmenter};
pub use settings::{GainMode, Method, SegmentSettings, SettingsError};
