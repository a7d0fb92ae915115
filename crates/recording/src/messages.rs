//! The messages of a recording as they are generated, and their description, which goes into every file.

#![allow(missing_docs, clippy::all, unused_qualifications)]
include!(concat!(env!("OUT_DIR"), "/hulltouch.recording.v1.rs"));

/// A `FileDescriptorSet` of all messages.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/recording_v1.bin"));
