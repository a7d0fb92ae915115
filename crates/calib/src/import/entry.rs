//! What OpenCV's FileStorage holds under a key, in XML and in YAML.

use hull::lens_model::{UnknownLensModel, check_general_lens_model, check_lens_model, names_other_lens};

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
    /// The first thing in a list, matrix or map that is no number.
    pub(super) unread: Option<String>,
    /// Whether its value is a list or a map in braces.
    pub(super) is_list: bool,
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
        if of_camera {
            self.check_names()?;
        }
        let numbers = self.numbers.as_deref().unwrap_or(&[]);
        let word = match numbers {
            [single] if self.text.is_empty() => single.to_string(),
            _ if self.shape.is_some() || self.text.is_empty() => return Ok(()),
            _ => self.text.clone(),
        };
        let check = if of_camera && !self.is_nested() { check_lens_model } else { check_general_lens_model };
        check(self.name(), &word)
    }

    /// An error if the name of a matrix, or of a map around an entry, speaks of another lens, and the entry does not
    /// say that this is off: `D_fisheye`, `fisheye: { enabled: 1 }`.
    fn check_names(&self) -> Result<(), UnknownLensModel> {
        let numbers = self.numbers.as_deref().unwrap_or(&[]);
        let is_matrix = self.shape.is_some() || numbers.len() > 1;
        let around = self.key.rsplit_once('/').map_or("", |(around, _)| around);
        let is_named = around.split('/').any(names_other_lens)
            || ((is_matrix || self.is_nested()) && names_other_lens(self.name()));
        if !is_named {
            return Ok(());
        }
        let is_list = numbers.len() > 1 && numbers.iter().any(|&number| number != 0.0);
        let found = match numbers {
            _ if is_list => format!("{} numbers", numbers.len()),
            [single] => single.to_string(),
            [] => self.text.clone(),
            _ => return Ok(()),
        };
        check_lens_model("fisheye", &found)
    }

    /// Its words, or its numbers with blanks between; empty for matrices.
    pub(super) fn value(&self) -> String {
        match self.numbers.as_deref() {
            Some(numbers) if self.text.is_empty() && self.shape.is_none() => {
                numbers.iter().map(f64::to_string).collect::<Vec<String>>().join(" ")
            }
            _ => self.text.clone(),
        }
    }

    /// Whether it has a number that is not zero.
    pub(super) fn has_value(&self) -> bool {
        self.numbers.iter().flatten().any(|&number| number != 0.0)
    }
}
