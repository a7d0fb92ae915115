//! Silhouettes in the encodings that gathering can ask for. The first is what gathering uses; the others
//! are what it is measured against.

use bytes::Bytes;
use hull::Silhouette;
use hull::silhouette::{Run, SilhouetteBuilder};

use super::ConvertError;
use super::bulk::Field;
use super::choice::{push_number, take_number};
use crate::{MAX_MESSAGE_BYTES, v1};

/// The encoding of a silhouette in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SilhouetteEncoding {
    /// Runs, then LZ4: [`Silhouette::encode`].
    #[default]
    RunsLz4,
    /// Runs alone.
    Runs,
    /// A bit a pixel.
    Mask,
    /// A byte a pixel: an uncompressed image.
    Grey,
}

impl From<SilhouetteEncoding> for v1::SilhouetteEncoding {
    fn from(encoding: SilhouetteEncoding) -> v1::SilhouetteEncoding {
        match encoding {
            SilhouetteEncoding::RunsLz4 => v1::SilhouetteEncoding::RunsLz4,
            SilhouetteEncoding::Runs => v1::SilhouetteEncoding::Runs,
            SilhouetteEncoding::Mask => v1::SilhouetteEncoding::Mask,
            SilhouetteEncoding::Grey => v1::SilhouetteEncoding::Grey,
        }
    }
}

impl From<v1::SilhouetteEncoding> for SilhouetteEncoding {
    fn from(encoding: v1::SilhouetteEncoding) -> SilhouetteEncoding {
        match encoding {
            v1::SilhouetteEncoding::RunsLz4 => SilhouetteEncoding::RunsLz4,
            v1::SilhouetteEncoding::Runs => SilhouetteEncoding::Runs,
            v1::SilhouetteEncoding::Mask => SilhouetteEncoding::Mask,
            v1::SilhouetteEncoding::Grey => SilhouetteEncoding::Grey,
        }
    }
}

/// Beside the runs: headers.
const MOST_BESIDE_BYTES: usize = 128;

const FIELD: Field = Field("Silhouette", "data");

/// A silhouette as bytes.
pub fn silhouette_data(silhouette: &Silhouette, encoding: SilhouetteEncoding) -> Bytes {
    match encoding {
        SilhouetteEncoding::RunsLz4 => silhouette.encode().into(),
        SilhouetteEncoding::Runs => runs(silhouette).into(),
        SilhouetteEncoding::Mask => mask(silhouette).into(),
        SilhouetteEncoding::Grey => grey(silhouette).into(),
    }
}

/// No message with a silhouette of a camera of that width and height, pixels, is longer, whatever its encoding, bytes.
pub fn most_silhouette_bytes((width, height): (u32, u32)) -> usize {
    let (width, height) = (width as usize, height as usize);
    // The fullest has a run at every other pixel: two bytes for each, and a count for each row. What LZ4 does not shorten it
    // makes longer by one in 255.
    let runs = (width + 3) * height;
    (runs + runs / 255 + MOST_BESIDE_BYTES).min(MAX_MESSAGE_BYTES)
}

/// The silhouette of a camera of that width and height, pixels. Memory stays within what `size` and the
/// length of `data` allow.
pub fn silhouette_from_data(
    data: &[u8],
    size: (u32, u32),
    encoding: SilhouetteEncoding,
) -> Result<Silhouette, ConvertError> {
    match encoding {
        SilhouetteEncoding::RunsLz4 => {
            Silhouette::decode(data, size).map_err(|error| FIELD.value(error.to_string()))
        }
        SilhouetteEncoding::Runs => from_runs(data, size),
        SilhouetteEncoding::Mask => {
            let pixels = size.0 as usize * size.1 as usize;
            FIELD.check_length(data.len(), pixels.div_ceil(8))?;
            from_rows(size, |pixel| data[pixel / 8] >> (pixel % 8) & 1)
        }
        SilhouetteEncoding::Grey => {
            FIELD.check_length(data.len(), size.0 as usize * size.1 as usize)?;
            from_rows(size, |pixel| u8::from(data[pixel] > 127))
        }
    }
}

fn runs(silhouette: &Silhouette) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(silhouette.run_count() * 3 + silhouette.height() as usize);
    for row in 0..silhouette.height() {
        let runs = silhouette.row(row);
        push_number(&mut bytes, runs.len());
        let mut after = 0;
        for (index, run) in runs.iter().enumerate() {
            push_number(&mut bytes, usize::from(run.start) - after - usize::from(index > 0));
            push_number(&mut bytes, usize::from(run.end - run.start) - 1);
            after = usize::from(run.end);
        }
    }
    bytes
}

fn mask(silhouette: &Silhouette) -> Vec<u8> {
    let width = silhouette.width() as usize;
    let mut bytes = vec![0u8; (width * silhouette.height() as usize).div_ceil(8)];
    for row in 0..silhouette.height() {
        for run in silhouette.row(row) {
            let first = row as usize * width;
            for pixel in first + usize::from(run.start)..first + usize::from(run.end) {
                bytes[pixel / 8] |= 1 << (pixel % 8);
            }
        }
    }
    bytes
}

fn grey(silhouette: &Silhouette) -> Vec<u8> {
    let width = silhouette.width() as usize;
    let mut bytes = vec![0u8; width * silhouette.height() as usize];
    for (row, pixels) in (0..).zip(bytes.chunks_exact_mut(width)) {
        for run in silhouette.row(row) {
            pixels[usize::from(run.start)..usize::from(run.end)].fill(255);
        }
    }
    bytes
}

fn builder(size: (u32, u32)) -> Result<SilhouetteBuilder, ConvertError> {
    SilhouetteBuilder::new(size.0, size.1).map_err(|error| FIELD.value(error.to_string()))
}

fn from_rows(size: (u32, u32), pixel: impl Fn(usize) -> u8) -> Result<Silhouette, ConvertError> {
    let mut builder = builder(size)?;
    let width = size.0 as usize;
    let mut mask = vec![0; width];
    for row in 0..size.1 as usize {
        mask.iter_mut().enumerate().for_each(|(column, value)| *value = pixel(row * width + column));
        builder.push_mask_row(&mask).map_err(|error| FIELD.value(error.to_string()))?;
    }
    builder.finish().map_err(|error| FIELD.value(error.to_string()))
}

fn from_runs(data: &[u8], size: (u32, u32)) -> Result<Silhouette, ConvertError> {
    let mut builder = builder(size)?;
    let width = size.0 as usize;
    let mut rest = data;
    let mut runs = Vec::new();
    for row in 0..size.1 {
        runs.clear();
        let count = take_number(&mut rest, FIELD)?;
        if count > width / 2 + 1 {
            return Err(FIELD.value(format!("row {row} holds {count} runs of {width} pixels")));
        }
        let mut after = 0;
        for index in 0..count {
            let start = after + take_number(&mut rest, FIELD)? + usize::from(index > 0);
            let end = start + take_number(&mut rest, FIELD)? + 1;
            if end > width {
                return Err(FIELD.value(format!("row {row} ends at {end} of {width} pixels")));
            }
            runs.push(Run { start: start as u16, end: end as u16 });
            after = end;
        }
        builder.push_runs(&runs).map_err(|error| FIELD.value(error.to_string()))?;
    }
    FIELD.check_length(data.len(), data.len() - rest.len())?;
    builder.finish().map_err(|error| FIELD.value(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use prost::Message as _;

    const ALL: [SilhouetteEncoding; 4] = [
        SilhouetteEncoding::RunsLz4,
        SilhouetteEncoding::Runs,
        SilhouetteEncoding::Mask,
        SilhouetteEncoding::Grey,
    ];

    proptest! {
        #[test]
        fn silhouettes_survive_every_encoding(
            width in 1u32..70, height in 1u32..9, seed in proptest::collection::vec(0u8..2, 70 * 9),
        ) {
            let mask = &seed[..(width * height) as usize];
            let silhouette = Silhouette::from_mask(width, height, mask).expect("a mask");
            for encoding in ALL {
                let data = silhouette_data(&silhouette, encoding);
                let message = v1::Silhouette { rig_index: 9, data: data.clone() };
                prop_assert!(message.encoded_len() <= most_silhouette_bytes((width, height)));
                let back = silhouette_from_data(&data, (width, height), encoding);
                prop_assert_eq!(back.as_ref(), Ok(&silhouette), "{:?}", encoding);
            }
        }

        #[test]
        fn any_bytes_are_a_silhouette_or_an_error(
            data in proptest::collection::vec(any::<u8>(), 0..60), size in (1u32..20, 1u32..6),
        ) {
            for encoding in ALL {
                if let Ok(silhouette) = silhouette_from_data(&data, size, encoding) {
                    prop_assert_eq!((silhouette.width(), silhouette.height()), size);
                }
            }
        }
    }

    #[test]
    fn the_fullest_silhouette_is_no_longer_than_its_camera_allows() {
        let (width, height) = (4096, 40);
        let comb: Vec<u8> = (0..width * height).map(|pixel| (pixel % 2) as u8).collect();
        let comb = Silhouette::from_mask(width, height, &comb).expect("a mask");
        for encoding in ALL {
            assert!(silhouette_data(&comb, encoding).len() <= most_silhouette_bytes((width, height)));
        }
    }

    #[test]
    fn sizes_are_those_of_the_layouts() {
        let silhouette = Silhouette::from_mask(16, 3, &[1; 48]).expect("a mask");
        let length = |encoding| silhouette_data(&silhouette, encoding).len();
        assert_eq!(length(SilhouetteEncoding::Grey), 48);
        assert_eq!(length(SilhouetteEncoding::Mask), 6);
        assert_eq!(length(SilhouetteEncoding::Runs), 9, "a count, a gap and a length a row");
    }
}
