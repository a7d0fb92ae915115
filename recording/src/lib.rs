//! Recordings.
mod v1 {
    #![allow(missing_docs, clippy::all, unused_qualifications)]
    include!(concat!(env!("OUT_DIR"), "/hulltouch.recording.v1.rs"));
}
