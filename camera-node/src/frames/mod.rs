//! The ring of recent frames: silhouettes ready to be probed, each frame complete over all cameras of
//! the node. It is the only thing that film and service share.

mod frame;
mod health;
mod ring;

pub use frame::{CameraFrame, Frame, Stamp};
pub use ring::{FrameError, FrameId, FrameRing, News, RING_FRAMES};
