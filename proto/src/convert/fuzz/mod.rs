//! What must hold of whatever bytes a peer sends: one function a decoder, which panics where it does not. Fuzz
//! targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

mod answer;
mod node;
mod question;
#[cfg(test)]
mod tests;

pub use answer::answer;
pub use node::node_messages;
pub use question::question;

use super::bulk::Field;
use super::choice::{ChoiceWriter, read_choice};
use super::packed::{pack, unpack_at_most, unpack_exactly};
use super::{SilhouetteEncoding, silhouette_data, silhouette_from_data};
use crate::{open_checkpoint, seal_checkpoint};

const FIELD: Field = Field("Fuzz", "field");

/// A packed field, after its bound (two bytes): never longer than that, and packed again it is the same.
pub fn packed(bytes: &[u8]) {
    let Some((most, packed)) = bytes.split_first_chunk() else { return };
    let most = usize::from(u16::from_le_bytes(*most));
    if let Ok(plain) = unpack_at_most(packed, most, FIELD) {
        assert!(plain.len() <= most, "{} bytes, at most {most} were asked for", plain.len());
        assert_eq!(unpack_exactly(&pack(&plain), plain.len(), FIELD), Ok(plain), "what was packed again");
    }
}

/// A choice, after the number of things (two bytes): ascending things that there are, and written again the same.
pub fn choice(bytes: &[u8]) {
    let Some((count, choice)) = bytes.split_first_chunk() else { return };
    let count = usize::from(u16::from_le_bytes(*count));
    let mut taken: Vec<usize> = Vec::new();
    let read = read_choice(choice, count, FIELD, |run| taken.extend(run));
    assert!(taken.is_sorted_by(|a, b| a < b), "ascending: {taken:?}");
    assert!(taken.last().is_none_or(|&last| last < count), "of {count}: {taken:?}");
    if read.is_ok() {
        let mut writer = ChoiceWriter::default();
        taken.iter().for_each(|&index| writer.take(index));
        let mut again: Vec<usize> = Vec::new();
        let read = read_choice(&writer.finish(count), count, FIELD, |run| again.extend(run));
        assert_eq!((read, again), (Ok(()), taken), "what was written again");
    }
}

/// A silhouette, after its width and height (two bytes each) and its encoding (a byte): of that size, and written
/// again the same.
pub fn runs(bytes: &[u8]) {
    let Some((&[a, b, c, d, encoding], data)) = bytes.split_first_chunk() else { return };
    let size = (u16::from_le_bytes([a, b]).into(), u16::from_le_bytes([c, d]).into());
    let encoding = [
        SilhouetteEncoding::RunsLz4,
        SilhouetteEncoding::Runs,
        SilhouetteEncoding::Mask,
        SilhouetteEncoding::Grey,
    ][usize::from(encoding % 4)];
    if let Ok(silhouette) = silhouette_from_data(data, size, encoding) {
        assert_eq!((silhouette.width(), silhouette.height()), size);
        assert!(silhouette.area() <= u64::from(size.0) * u64::from(size.1));
        let again = silhouette_from_data(&silhouette_data(&silhouette, encoding), size, encoding);
        assert_eq!(again, Ok(silhouette), "what was written again");
    }
}

/// A checkpoint as it comes, and one of these contents.
pub fn checkpoint(bytes: &[u8]) {
    if let Ok(contents) = open_checkpoint(bytes) {
        assert_eq!(seal_checkpoint(contents).as_deref(), Ok(bytes), "there is one way to seal");
    }
    if let Ok(sealed) = seal_checkpoint(bytes) {
        assert_eq!(open_checkpoint(&sealed), Ok(bytes), "what was sealed");
        assert!(open_checkpoint(&sealed[..sealed.len() - 1]).is_err(), "a byte is missing");
    }
}
