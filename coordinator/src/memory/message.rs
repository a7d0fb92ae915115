//! The message of a checkpoint's contents. No other program reads it, so it stands here instead of in a `.proto` file.

use prost::Message;
use world_encodings::checkpoint::message::World;

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
