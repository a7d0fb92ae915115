//! Files that users name: regular ones only, and never more bytes than the caller allows.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use hull::text::{EncodingError, decoded};
use thiserror::Error;

/// Why a file was not read.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The file system refuses.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A folder.
    #[error("found a folder, expected a file")]
    Folder,
    /// A pipe, device or socket: reading it might never end.
    #[error("found a pipe, device or socket, expected a regular file")]
    Special,
    /// Too large to be what is expected, whatever size the file system reports.
    #[error("found more than {0} bytes, expected at most as many")]
    TooLarge(u64),
    /// Bytes that are no text.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
    /// A packed file that does not unpack.
    #[error("found a gzip file that does not unpack: {0}")]
    Packed(io::Error),
}

/// All bytes of a regular file of at most `most_bytes`.
pub fn read(path: &Path, most_bytes: u64) -> Result<Vec<u8>, ReadError> {
    // Before it is opened: opening a pipe waits for a writer.
    let metadata = fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(ReadError::Folder);
    }
    if !metadata.is_file() {
        return Err(ReadError::Special);
    }
    if metadata.len() > most_bytes {
        return Err(ReadError::TooLarge(most_bytes));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    // The file may grow meanwhile, and the size of some is not known before.
    File::open(path)?.take(most_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes { Err(ReadError::TooLarge(most_bytes)) } else { Ok(bytes) }
}

/// The same of a text file, packed with gzip or not; `most_bytes` bounds what it holds unpacked too.
pub fn read_text(path: &Path, most_bytes: u64) -> Result<String, ReadError> {
    Ok(decoded(read_unpacked(path, most_bytes)?)?)
}

/// The bytes of a file, unpacked if it begins as gzip does, whatever its name.
pub fn read_unpacked(path: &Path, most_bytes: u64) -> Result<Vec<u8>, ReadError> {
    let bytes = read(path, most_bytes)?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes);
    }
    let mut unpacked = Vec::new();
    let decoder = MultiGzDecoder::new(bytes.as_slice());
    decoder.take(most_bytes.saturating_add(1)).read_to_end(&mut unpacked).map_err(ReadError::Packed)?;
    if unpacked.len() as u64 > most_bytes { Err(ReadError::TooLarge(most_bytes)) } else { Ok(unpacked) }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn a_file_is_read_up_to_its_bound() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("f.txt");
        fs::write(&path, "12345").expect("written");
        assert_eq!(read_text(&path, 5).expect("small enough"), "12345");
        assert!(matches!(read(&path, 4), Err(ReadError::TooLarge(4))));
        fs::write(&path, [0xff, 0xfe]).expect("written");
        assert!(matches!(read_text(&path, 5), Err(ReadError::Encoding(EncodingError::Utf16))));
        assert!(matches!(read(folder.path(), 5), Err(ReadError::Folder)));
        assert!(matches!(read(&folder.path().join("none"), 5), Err(ReadError::Io(_))));
    }

    #[test]
    fn a_packed_file_is_read_up_to_its_bound_unpacked() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("f.yml");
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
        packed.write_all(&vec![b'a'; 100_000]).expect("packed");
        let packed = packed.finish().expect("packed");
        fs::write(&path, &packed).expect("written");
        assert_eq!(read_text(&path, 100_000).expect("small enough").len(), 100_000);
        assert!(matches!(read_text(&path, 99_999), Err(ReadError::TooLarge(_))));
        fs::write(&path, &packed[..packed.len() / 2]).expect("written");
        assert!(matches!(read_text(&path, 100_000), Err(ReadError::Packed(_))));
    }

    /// A socket stands for what has no end: it needs no other program to be made.
    #[test]
    #[cfg(unix)]
    fn what_has_no_end_is_refused_before_it_is_opened() {
        let folder = tempfile::tempdir().expect("a folder");
        let socket = folder.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).expect("bound");
        assert!(matches!(read(&socket, 5), Err(ReadError::Special)));
        assert!(matches!(read(Path::new("/dev/zero"), 5), Err(ReadError::Special)));
    }

    /// `/proc` reports a size of zero for files that are not empty.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_size_that_is_not_true_does_not_help() {
        assert!(matches!(read(Path::new("/proc/self/maps"), 5), Err(ReadError::TooLarge(5))));
    }
}
