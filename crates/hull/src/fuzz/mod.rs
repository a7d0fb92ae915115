//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

use crate::rig::Rig;

/// A rig file: what is read is written, and read again as the same rig.
pub fn rig(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match Rig::from_toml(text) {
        Ok(rig) => assert_eq!(Rig::from_toml(&rig.to_toml()).ok().as_ref(), Some(&rig), "what was written"),
        Err(error) => assert!(!error.to_string().contains('\n'), "an error of one line: {error}"),
    }
}
