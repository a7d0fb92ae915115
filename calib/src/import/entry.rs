//! What OpenCV's FileStorage holds under a key, in XML and in YAML.

use hull::lens_model::{UnknownLensModel, check_general_lens_model, check_lens_model};

/// A key of a FileStorage.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Entry {
    /// The names of the maps around it and its own, with `/` between them.
    pub(super) key: String,
    /// Rows and columns, of matrices.
    pub(super) shape: Option<(usize, usize)>,
    /// Its numbers in row order, if it has numbers.
    pub(super) numbers: Option<Vec<f64>>,
    /// A word, flag or single number as it is written; empty for others.
    pub(super) text: String,
}

impl Entry {
    /// Its own name, without those of the maps around it.
    pub(super) fn name(&self) -> &str {
        self.key.rsplit('/').next().unwrap_or(&self.key)
    }

    /// Whether it stands within a map.
    pub(super) fn is_nested(&self) -> bool {
        self.key.contains('/')
    }

    /// An error if it speaks of another lens model than k1 k2 p1 p2 k3. In maps, and in files that describe no
    /// camera, `type` and `model` also mean other things.
    pub(super) fn check_lens_model(&self, of_camera: bool) -> Result<(), UnknownLensModel> {
        if self.shape.is_some() || self.text.is_empty() {
            return Ok(());
        }
        let check = if of_camera && !self.is_nested() { check_lens_model } else { check_general_lens_model };
        check(self.name(), &self.text)
    }
}
