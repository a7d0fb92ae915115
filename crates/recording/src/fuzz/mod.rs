//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use coordinator::LocalFrames as _;
use coordinator::hooks::{Schedule as _, Scheduled, Sees};
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use crate::channels::Channel;
use crate::convert::RunHeader;
use crate::{ReadError, Recording};

/// So many frames are read.
const MAX_FRAMES: usize = 8;
/// Frames of more pixels a camera are not made views of: that takes long, and finds nothing else.
const MAX_PIXELS: u64 = 1 << 16;
/// Rigs of more cameras are not read farther than their header.
const MAX_CAMERAS: usize = 64;

/// A recording as it stands on a disk, read to its end: whatever is damaged is an error of one line.
pub fn recording(bytes: &[u8]) {
    let file = Temporary::new(bytes);
    read(&file.0).unwrap_or_else(|error| {
        let line = error.to_string();
        assert!(!line.contains('\n'), "an error of one line: {line}");
    });
}

/// The same of messages, each after its channel (a byte: header, steps, end, silhouettes and colours of two cameras) and its
/// length (two bytes), in a file that is whole.
pub fn recorded_messages(bytes: &[u8]) {
    if let Ok(file) = file_of(bytes) {
        recording(&file);
    }
}

fn file_of(bytes: &[u8]) -> mcap::McapResult<Vec<u8>> {
    let names = ["left".to_owned(), "right".to_owned()];
    let mut file = std::io::Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    let mut writer = Writer::with_options(&mut file, options)?;
    let kinds = [
        Channel::Header,
        Channel::Step,
        Channel::End,
        Channel::Silhouette(0),
        Channel::Silhouette(1),
        Channel::Colour(0),
        Channel::Colour(1),
    ];
    let mut ids = Vec::new();
    for kind in kinds {
        ids.push(writer.add_channel(0, &kind.topic(&names), "protobuf", &Default::default())?);
    }
    let mut rest = bytes;
    while let Some((&[channel, a, b], left)) = rest.split_first_chunk() {
        let (message, left) = left.split_at(usize::from(u16::from_le_bytes([a, b])).min(left.len()));
        rest = left;
        let channel_id = ids[usize::from(channel) % ids.len()];
        let header = MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
        writer.write_to_known_channel(&header, message)?;
    }
    writer.finish()?;
    drop(writer);
    Ok(file.into_inner())
}

fn read(path: &std::path::Path) -> Result<(), ReadError> {
    let recording = Recording::open(path)?;
    let header = recording.header();
    let cameras = header.rig.cameras();
    assert_eq!(RunHeader::from_message(&header.to_message()).as_ref(), Ok(header), "what was written again");
    if cameras.len() > MAX_CAMERAS {
        return Ok(());
    }
    let mut steps = recording.steps()?;
    while let Some(Scheduled { commands: _, sees }) = steps.next() {
        if let Sees::Given { film_s, .. } | Sees::Recorded { film_s, .. } = sees {
            assert!(film_s.is_finite(), "a step at {film_s} s");
        }
    }
    let pictures = recording.pictures()?;
    for frame in recording.frame_numbers().take(MAX_FRAMES) {
        let found = pictures.frame(frame)?.unwrap_or_default();
        assert!(found.len() <= cameras.len(), "a picture a camera");
    }
    let pixels = |camera: &hull::Camera| u64::from(camera.width()) * u64::from(camera.height());
    if cameras.iter().all(|camera| pixels(camera) <= MAX_PIXELS) {
        let frames = recording.frames()?;
        for frame in recording.frame_numbers().take(MAX_FRAMES) {
            let Some(report) = frames.report(frame) else { return Ok(()) };
            assert!(report.capture_time_s.is_finite() && report.captured_unix_s.is_finite(), "{report:?}");
            assert!(report.cameras.iter().all(|camera| camera.segment_ms >= 0.0), "{report:?}");
        }
    }
    Ok(())
}

/// A file for as long as it is read.
struct Temporary(PathBuf);

impl Temporary {
    fn new(bytes: &[u8]) -> Temporary {
        static MADE: AtomicU64 = AtomicU64::new(0);
        let made = MADE.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("hulltouch-fuzz-{}-{made}.mcap", std::process::id()));
        std::fs::write(&path, bytes).expect("room for a file");
        Temporary(path)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // Nothing can be done about it.
        let _ = std::fs::remove_file(&self.0);
    }
}
