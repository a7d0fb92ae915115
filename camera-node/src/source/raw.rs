//! Frames without any header, one after the other, as cameras write them: only the cluster file says what
//! they are.

use std::io::{self, BufRead, Read};

use segment::{Format, Layout, Range, Sampling};
use serde::Deserialize;

use super::y4m::{Reader, Y4mError};

/// The layouts that cameras write without a header, by their usual names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RawLayout {
    /// Triples of red, green, blue (`rgb24`).
    Rgb,
    /// Planes of Y, U and V for 2 × 2 pixels (`yuv420p`).
    I420,
    /// A plane of Y and one of pairs U, V for 2 × 2 pixels.
    Nv12,
    /// Packed Y, U, Y, V for two pixels (`yuyv422`, YUY2).
    Yuyv,
    /// Packed U, Y, V, Y for two pixels (`uyvy422`).
    Uyvy,
}

impl RawLayout {
    /// The order of the bytes, black and white being those of a range.
    pub fn layout(self, range: Range) -> Layout {
        match self {
            RawLayout::Rgb => Layout::Rgb,
            RawLayout::I420 => Layout::Planar(Sampling::C420, range),
            RawLayout::Nv12 => Layout::Nv12(range),
            RawLayout::Yuyv => Layout::Yuyv(range),
            RawLayout::Uyvy => Layout::Uyvy(range),
        }
    }
}

/// Bytes that become frames: with headers, or without.
#[derive(Debug)]
pub enum FrameReader<R> {
    /// A YUV4MPEG2 stream: its header gives size and rate.
    Y4m(Reader<R>),
    /// Frames of a known format, nothing else.
    Raw {
        /// The bytes.
        inner: R,
        /// What each frame is.
        format: Format,
        /// Frames read.
        frames: u64,
    },
}

impl<R: BufRead> FrameReader<R> {
    /// Reads the next frame into `bytes`; `false` at the film's end.
    pub fn read(&mut self, bytes: &mut Vec<u8>) -> Result<bool, Y4mError> {
        match self {
            FrameReader::Y4m(reader) => reader.read(bytes),
            FrameReader::Raw { inner, format, frames } => {
                let read = read_whole(inner, format.frame_bytes(), *frames, bytes)?;
                *frames += u64::from(read);
                Ok(read)
            }
        }
    }
}

fn read_whole(
    inner: &mut impl Read,
    expected: usize,
    frame: u64,
    bytes: &mut Vec<u8>,
) -> Result<bool, Y4mError> {
    bytes.clear();
    // Grows with what really comes.
    let found =
        inner.take(expected as u64).read_to_end(bytes).map_err(|error: io::Error| Y4mError::Io(error))?;
    match found {
        0 => Ok(false),
        found if found < expected => Err(Y4mError::Truncated { frame, found, expected }),
        _ => Ok(true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn raw_frames_follow_each_other_and_a_cut_one_is_refused() {
        let format = Format::new(RawLayout::Yuyv.layout(Range::Full), 2, 1).expect("size");
        let mut reader = FrameReader::Raw { inner: &b"abcdefghij"[..], format, frames: 0 };
        let mut bytes = Vec::new();
        assert!(reader.read(&mut bytes).expect("a frame"));
        assert_eq!(bytes, b"abcd");
        assert!(reader.read(&mut bytes).expect("a frame"));
        let error = reader.read(&mut bytes).expect_err("cut").to_string();
        assert_eq!(error, "stopped in the middle of frame 2: found 2 bytes of it, expected 4");
    }
}
