//! What OpenCV's FileStorage holds under a key, in XML and in YAML.

/// A top-level key of a FileStorage.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    pub(super) key: String,
    /// Rows and columns, of matrices.
    pub(super) shape: Option<(usize, usize)>,
    /// Its numbers in row order, if it has numbers.
    pub(super) numbers: Option<Vec<f64>>,
}
