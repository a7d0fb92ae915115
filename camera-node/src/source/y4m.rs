//! YUV4MPEG2, what ffmpeg and GStreamer write to a pipe: a header line, then per frame a `FRAME`
//! line and the planes. Nothing is trusted: every way in which the bytes can be wrong has an error.

use std::io::{self, BufRead, Read};

use hull::camera::MAX_SIDE_PIXELS;
use segment::{Format, Layout, Range, Sampling, SizeError};
use thiserror::Error;

/// The longest header or frame line, bytes. ffmpeg's are under 100; comments may add some.
const MAX_LINE_BYTES: usize = 1024;

/// A film's first line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Frames per second as numerator and denominator; `None` if the film does not tell.
    pub rate: Option<(u32, u32)>,
    /// How colour is sampled (in 4:2:0 the siting differs by name; we take the nearest).
    pub chroma: Sampling,
    /// Which bytes are black and white.
    pub range: Range,
}

/// How the bytes are not YUV4MPEG2, or why they stopped.
#[derive(Debug, Error)]
pub enum Y4mError {
    /// Reading failed.
    #[error("reading failed: {0}")]
    Io(#[from] io::Error),
    /// Nothing came at all.
    #[error("found no bytes at all, expected a YUV4MPEG2 header")]
    Empty,
    /// The first bytes are something else.
    #[error("starts with {found:?}, expected \"YUV4MPEG2 …\"")]
    Magic {
        /// The first bytes, shortened.
        found: String,
    },
    /// A line does not end.
    #[error("{what} does not end within {MAX_LINE_BYTES} bytes (starts with {found:?})")]
    LongLine {
        /// The kind of line: the header, or a FRAME line.
        what: &'static str,
        /// Its first bytes, shortened.
        found: String,
    },
    /// A parameter of the header is missing or wrong.
    #[error("header has {found:?}, expected {expected}")]
    Parameter {
        /// The parameter as it stands, or what is missing.
        found: String,
        /// What would be right.
        expected: &'static str,
    },
    /// The bytes between two frames are something else.
    #[error("frame {frame} starts with {found:?}, expected a FRAME line")]
    FrameLine {
        /// Frames read before it.
        frame: u64,
        /// What stands there, shortened.
        found: String,
    },
    /// The bytes end inside a frame.
    #[error("stopped in the middle of frame {frame}: found {found} bytes of it, expected {expected}")]
    Truncated {
        /// Frames read before it.
        frame: u64,
        /// Bytes that came.
        found: usize,
        /// Bytes of a whole frame.
        expected: usize,
    },
}

fn sampling(name: &str) -> Option<Sampling> {
    match name {
        "mono" => Some(Sampling::Mono),
        "420" | "420jpeg" | "420mpeg2" | "420paldv" => Some(Sampling::C420),
        "422" => Some(Sampling::C422),
        "411" => Some(Sampling::C411),
        "444" => Some(Sampling::C444),
        _ => None,
    }
}

impl Header {
    /// Reads the header line, without its line feed.
    pub fn parse(line: &[u8]) -> Result<Header, Y4mError> {
        let line = std::str::from_utf8(line)
            .ok()
            .filter(|line| {
                line.starts_with("YUV4MPEG2") && matches!(line.as_bytes().get(9), None | Some(b' '))
            })
            .ok_or_else(|| Y4mError::Magic { found: shortened(line) })?;
        let (mut width, mut height, mut rate) = (None, None, None);
        let (mut chroma, mut range) = (Sampling::C420, Range::Limited);
        for word in line.split(' ').skip(1).filter(|word| !word.is_empty()) {
            let (tag, value) = word.split_at(word.chars().next().map_or(0, char::len_utf8));
            let wrong = |expected| Y4mError::Parameter { found: shortened(word.as_bytes()), expected };
            match tag {
                "W" => width = Some(side(value).ok_or_else(|| wrong("a width of 1 to 16384 pixels"))?),
                "H" => height = Some(side(value).ok_or_else(|| wrong("a height of 1 to 16384 pixels"))?),
                "F" => rate = ratio(value).ok_or_else(|| wrong("frames per second as F30000:1001"))?,
                "C" => {
                    chroma = sampling(value).ok_or_else(|| {
                        wrong("C420…, C422, C411, C444 or Cmono of 8 bits (for ffmpeg: -pix_fmt yuv420p)")
                    })?;
                }
                "X" if value == "COLORRANGE=FULL" => range = Range::Full,
                "X" if value == "COLORRANGE=LIMITED" => range = Range::Limited,
                // Interlacing, pixel aspect and comments do not change the bytes.
                _ => {}
            }
        }
        let missing = |expected| Y4mError::Parameter { found: shortened(line.as_bytes()), expected };
        Ok(Header {
            width: width.ok_or_else(|| missing("a width (W640)"))?,
            height: height.ok_or_else(|| missing("a height (H480)"))?,
            rate,
            chroma,
            range,
        })
    }

    /// Size and layout of its frames.
    pub fn format(&self) -> Result<Format, SizeError> {
        Format::new(Layout::Planar(self.chroma, self.range), self.width, self.height)
    }

    /// Bytes of one frame's planes.
    pub fn frame_bytes(&self) -> usize {
        // A parsed header has a size that frames may have.
        self.format().map_or(0, Format::frame_bytes)
    }
}

/// Reads frames one after the other.
#[derive(Debug)]
pub struct Reader<R> {
    inner: R,
    header: Header,
    frames: u64,
}

impl<R: BufRead> Reader<R> {
    /// Reads the header.
    pub fn new(mut inner: R) -> Result<Reader<R>, Y4mError> {
        let line = match line(&mut inner)? {
            Line::Nothing => return Err(Y4mError::Empty),
            Line::Whole(line) => line,
            Line::Cut(found) if found.starts_with(b"YUV4MPEG2 ") => {
                return Err(Y4mError::LongLine { what: "header", found: shortened(&found) });
            }
            Line::Cut(found) => return Err(Y4mError::Magic { found: shortened(&found) }),
        };
        Ok(Reader { inner, header: Header::parse(&line)?, frames: 0 })
    }

    /// The film's header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Reads the next frame's planes, Y then U then V, into `planes`; `false` at the film's end.
    pub fn read(&mut self, planes: &mut Vec<u8>) -> Result<bool, Y4mError> {
        let frame = self.frames;
        match line(&mut self.inner)? {
            Line::Nothing => return Ok(false),
            Line::Whole(line) if line == b"FRAME" || line.starts_with(b"FRAME ") => {}
            Line::Cut(found) if found.starts_with(b"FRAME ") && found.len() > MAX_LINE_BYTES => {
                return Err(Y4mError::LongLine { what: "a FRAME line", found: shortened(&found) });
            }
            Line::Cut(found) if b"FRAME ".starts_with(found.get(..6).unwrap_or(&found)) => {
                return Err(Y4mError::Truncated { frame, found: 0, expected: self.header.frame_bytes() });
            }
            Line::Whole(found) | Line::Cut(found) => {
                return Err(Y4mError::FrameLine { frame, found: shortened(&found) });
            }
        }
        let expected = self.header.frame_bytes();
        planes.clear();
        // Grows with what really comes; a header alone cannot make us take memory.
        let found = (&mut self.inner).take(expected as u64).read_to_end(planes)?;
        if found < expected {
            return Err(Y4mError::Truncated { frame, found, expected });
        }
        self.frames += 1;
        Ok(true)
    }
}

enum Line {
    Nothing,
    Whole(Vec<u8>),
    /// No line feed: the bytes ended, or there are too many.
    Cut(Vec<u8>),
}

fn line(inner: &mut impl BufRead) -> io::Result<Line> {
    let mut line = Vec::new();
    inner.take(MAX_LINE_BYTES as u64 + 1).read_until(b'\n', &mut line)?;
    Ok(match line.last() {
        None => Line::Nothing,
        Some(b'\n') => {
            line.pop();
            Line::Whole(line)
        }
        Some(_) => Line::Cut(line),
    })
}

fn side(value: &str) -> Option<u32> {
    number(value).filter(|side| (1..=MAX_SIDE_PIXELS).contains(side))
}

/// `Some(None)` is the format's own "unknown", `0:0`.
fn ratio(value: &str) -> Option<Option<(u32, u32)>> {
    let (top, bottom) = value.split_once(':')?;
    let (top, bottom) = (number(top)?, number(bottom)?);
    match (top, bottom) {
        (0, 0) => Some(None),
        (0, _) | (_, 0) => None,
        both => Some(Some(both)),
    }
}

fn number(value: &str) -> Option<u32> {
    // `parse` would also take a plus sign.
    value.bytes().all(|byte| byte.is_ascii_digit()).then(|| value.parse().ok())?
}

fn shortened(bytes: &[u8]) -> String {
    let text: String = String::from_utf8_lossy(&bytes[..bytes.len().min(160)]).into_owned();
    if text.chars().count() <= 40 { text } else { text.chars().take(39).chain("…".chars()).collect() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[track_caller]
    fn header(line: &str) -> Header {
        Header::parse(line.as_bytes()).expect("a header")
    }

    #[track_caller]
    fn check_refused(bytes: &[u8], message: &str) {
        let error = read_all(bytes).expect_err("refused");
        assert_eq!(error.to_string(), message);
    }

    fn read_all(bytes: &[u8]) -> Result<Vec<Vec<u8>>, Y4mError> {
        let mut reader = Reader::new(bytes)?;
        let (mut frames, mut planes) = (Vec::new(), Vec::new());
        while reader.read(&mut planes)? {
            frames.push(planes.clone());
        }
        Ok(frames)
    }

    #[test]
    fn headers_give_size_rate_chroma_and_range() {
        let found = header("YUV4MPEG2 W640 H480 F30000:1001 Ip A1:1 C422 XYSCSS=422 XCOLORRANGE=FULL");
        let expected = Header {
            width: 640,
            height: 480,
            rate: Some((30000, 1001)),
            chroma: Sampling::C422,
            range: Range::Full,
        };
        assert_eq!(found, expected);
        let plain = header("YUV4MPEG2 H3 W5 F0:0");
        assert_eq!((plain.chroma, plain.range, plain.rate), (Sampling::C420, Range::Limited, None));
    }

    #[test]
    fn odd_sides_round_their_colour_planes_up() {
        for (chroma, bytes) in [
            ("", 15 + 2 * 6),
            ("C420jpeg", 15 + 2 * 6),
            ("C420mpeg2", 15 + 2 * 6),
            ("C420paldv", 15 + 2 * 6),
            ("C422", 15 + 2 * 9),
            ("C411", 15 + 2 * 6),
            ("C444", 45),
            ("Cmono", 15),
        ] {
            assert_eq!(header(&format!("YUV4MPEG2 W5 H3 {chroma}")).frame_bytes(), bytes, "{chroma}");
        }
    }

    #[test]
    fn frames_with_parameters_and_line_feeds_in_their_planes_are_read_exactly() {
        let mut bytes = b"YUV4MPEG2 W2 H2 Cmono\nFRAME\n\nF\nRFRAME Ip XCOLORRANGE=FULL\n".to_vec();
        bytes.extend([0, 1, 2, 3]);
        assert_eq!(read_all(&bytes).expect("two frames"), [b"\nF\nR".to_vec(), vec![0, 1, 2, 3]]);
    }

    #[test]
    fn each_way_to_lie_has_its_own_line() {
        check_refused(b"", "found no bytes at all, expected a YUV4MPEG2 header");
        check_refused(b"RIFF\x00\x01", "starts with \"RIFF\\0\\u{1}\", expected \"YUV4MPEG2 …\"");
        check_refused(b"YUV4MPEG2X W2\n", "starts with \"YUV4MPEG2X W2\", expected \"YUV4MPEG2 …\"");
        check_refused(b"YUV4MPEG2 H2\n", "header has \"YUV4MPEG2 H2\", expected a width (W640)");
        check_refused(b"YUV4MPEG2 W0 H2\n", "header has \"W0\", expected a width of 1 to 16384 pixels");
        check_refused(
            b"YUV4MPEG2 W2 H99999999999\n",
            "header has \"H99999999999\", expected a height of 1 to 16384 pixels",
        );
        check_refused(
            b"YUV4MPEG2 W2 H2 F25\n",
            "header has \"F25\", expected frames per second as F30000:1001",
        );
        check_refused(
            b"YUV4MPEG2 W2 H2 C420p10\n",
            "header has \"C420p10\", expected C420…, C422, C411, C444 or Cmono of 8 bits (for ffmpeg: -pix_fmt yuv420p)",
        );
        check_refused(
            b"YUV4MPEG2 W2 H2 Cmono\nFRAME\nabcdFRAME\nab",
            "stopped in the middle of frame 1: found 2 bytes of it, expected 4",
        );
        check_refused(
            b"YUV4MPEG2 W2 H2 Cmono\nFRAME\nabcdFRA",
            "stopped in the middle of frame 1: found 0 bytes of it, expected 4",
        );
        check_refused(
            b"YUV4MPEG2 W2 H2 Cmono\nFRAME\nabcdhello\n",
            "frame 1 starts with \"hello\", expected a FRAME line",
        );
        let mut long = b"YUV4MPEG2 W2 H2 X".to_vec();
        long.resize(5000, b'y');
        check_refused(
            &long,
            "header does not end within 1024 bytes (starts with \"YUV4MPEG2 W2 H2 Xyyyyyyyyyyyyyyyyyyyyyy…\")",
        );
    }

    fn header_strategy() -> impl Strategy<Value = (u32, u32, &'static str)> {
        (1..40u32, 1..40u32, prop::sample::select(vec!["C420jpeg", "C422", "C411", "C444", "Cmono"]))
    }

    proptest! {
        #[test]
        fn whole_films_come_back_and_cut_ones_are_refused(
            (width, height, chroma) in header_strategy(), frames in 1..4usize, seed: u8, cut in 1..2000usize,
        ) {
            let mut bytes = format!("YUV4MPEG2 W{width} H{height} F25:1 {chroma}\n").into_bytes();
            let header = Header::parse(&bytes[..bytes.len() - 1]).expect("valid");
            let start = bytes.len();
            let planes = |frame: usize| -> Vec<u8> {
                (0..header.frame_bytes()).map(|i| (i * 7 + frame * 31 + usize::from(seed)) as u8).collect()
            };
            for frame in 0..frames {
                bytes.extend_from_slice(b"FRAME\n");
                bytes.extend(planes(frame));
            }
            let expected: Vec<Vec<u8>> = (0..frames).map(planes).collect();
            prop_assert_eq!(read_all(&bytes).expect("whole"), expected);
            let kept = start + cut % (bytes.len() - start);
            let per_frame = header.frame_bytes() + 6;
            match read_all(&bytes[..kept]) {
                Ok(found) => {
                    prop_assert_eq!((kept - start) % per_frame, 0);
                    prop_assert_eq!(found.len(), (kept - start) / per_frame);
                }
                Err(Y4mError::Truncated { frame, .. }) => {
                    prop_assert_eq!(frame as usize, (kept - start) / per_frame);
                }
                Err(other) => prop_assert!(false, "{other}"),
            }
        }

        #[test]
        fn any_bytes_end_in_frames_or_an_error(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            words in prop::collection::vec("[WHFCXIA][0-9:a-zé=]{0,9}", 0..6),
            good_start: bool,
        ) {
            let mut film = Vec::new();
            if good_start {
                film = format!("YUV4MPEG2 W3 H2 {}\nFRAME\n", words.join(" ")).into_bytes();
            }
            film.extend(bytes);
            if let Err(error) = read_all(&film) {
                prop_assert!(!error.to_string().contains('\n'));
            }
        }
    }
}
