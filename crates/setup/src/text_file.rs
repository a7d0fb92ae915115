//! Text files that users write: cluster files, rigs and scenes.

use std::path::Path;
use std::{fs, io};

/// The file's text without a byte-order mark; an error of the kind `InvalidData` names another encoding.
pub fn read_text(path: &Path) -> io::Result<String> {
    let text = hull::text::decoded(fs::read(path)?);
    text.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_is_taken_off_and_utf_16_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("f.toml");
        fs::write(&path, "\u{feff}a = 1").expect("written");
        assert_eq!(read_text(&path).expect("text"), "a = 1");
        fs::write(&path, b"\xff\xfea\0").expect("written");
        assert!(read_text(&path).expect_err("refused").to_string().contains("UTF-16"));
    }
}
