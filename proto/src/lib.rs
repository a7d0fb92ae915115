//! The wire between coordinator and nodes (`hulltouch.v1`), and its conversions to and from the hull's
//! own types; the messages of a recording. Generated types go no farther than a service and its one client,
//! the recording, and the world's encodings.

/// Generated from `proto/hulltouch/v1`.
pub mod v1 {
    #![allow(missing_docs, clippy::all, unused_qualifications, clippy::semicolon_if_nothing_returned)]
    tonic::include_proto!("hulltouch.v1");

    /// The protocol's own description, for reflection.
    pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/hulltouch_v1.bin"));
}

/// Generated from `proto/hulltouch/recording/v1`: the messages of a recording.
pub mod recording {
    #![allow(missing_docs, clippy::all, unused_qualifications)]
    include!(concat!(env!("OUT_DIR"), "/hulltouch.recording.v1.rs"));

    /// A `FileDescriptorSet` of all messages, which goes into every file.
    pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/recording_v1.bin"));
}

mod address;
mod checkpoint;
mod claim;
pub mod codec;
pub mod convert;
mod description;
pub mod framing;
mod pictures;
mod status;
pub mod text;
mod trace;

pub use address::{Address, AddressError, MAX_SOCKET_PATH_BYTES};
pub use checkpoint::{CheckpointError, MAX_CHECKPOINT_BYTES, open_checkpoint, seal_checkpoint};
pub use claim::Claim;
pub use convert::fuzz;
pub use description::{CameraDescription, NodeDescription};
pub use pictures::{CameraPicture, FramePictures, MAX_SCALE_LOG2, Picture, PictureKind, PictureRequest};
pub use status::{CameraStatus, CameraTrouble, HolderStatus, NewestFrame, NodeStatus, TroubleKind};
pub use trace::TraceParent;

/// The most points one question may hold: a million body samples are 24 MB once placed in the world,
/// and half a second of work for a node.
pub const MAX_POINTS: usize = 1_000_000;

/// The largest message either side accepts, bytes: [`MAX_POINTS`] raw points with room for directions.
pub const MAX_MESSAGE_BYTES: usize = 48 << 20;

/// The largest HTTP/2 frame either side takes, bytes: with the default of 16 KiB a large answer is cut
/// into pieces that are queued one by one.
pub const MAX_FRAME_BYTES: u32 = 256 << 10;
