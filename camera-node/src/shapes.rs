//! The shapes that coordinators have registered, by content.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use hull::Shape;
use proto::convert::shape_key;
use thiserror::Error;

/// Samples kept in all: 48 MB. A studio's scene has tens of thousands.
pub const MAX_KEPT_SAMPLES: usize = 4_000_000;

/// Why a shape is not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ShapeError {
    /// No room.
    #[error("{asked} samples beside {kept}, at most {MAX_KEPT_SAMPLES} are kept")]
    Full {
        /// Samples to register.
        asked: usize,
        /// Samples there.
        kept: usize,
    },
    /// Two shapes begin with the same eight bytes of digest.
    #[error("shape {0:016x} is registered with other samples")]
    Clash(u64),
}

/// Registered shapes.
#[derive(Default)]
pub struct Shapes {
    kept: Mutex<HashMap<u64, Arc<Shape>>>,
}

impl Shapes {
    /// Keeps a shape; one that is there already costs nothing.
    pub fn register(&self, shape: Shape) -> Result<(), ShapeError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let key = shape_key(&shape.digest());
        if let Some(known) = kept.get(&key) {
            return if known.digest() == shape.digest() { Ok(()) } else { Err(ShapeError::Clash(key)) };
        }
        let samples: usize = kept.values().map(|shape| shape.samples_body().len()).sum();
        let asked = shape.samples_body().len();
        if samples + asked > MAX_KEPT_SAMPLES {
            return Err(ShapeError::Full { asked, kept: samples });
        }
        kept.insert(key, Arc::new(shape));
        Ok(())
    }

    /// The shape of that key.
    pub fn get(&self, key: u64) -> Option<Arc<Shape>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_found_by_content_and_bounded() {
        let shapes = Shapes::default();
        let small = Shape::new(vec![[0.0; 3]; 10]).expect("finite");
        let key = shape_key(&small.digest());
        assert!(shapes.get(key).is_none());
        assert_eq!(shapes.register(small.clone()), Ok(()));
        assert_eq!(shapes.register(small.clone()), Ok(()));
        assert_eq!(shapes.get(key).as_deref(), Some(&small));
        let large = |x| Shape::new(vec![[x, 0.0, 0.0]; 1 << 20]).expect("finite");
        for x in 1..=3 {
            assert_eq!(shapes.register(large(x as f32)), Ok(()));
        }
        assert!(matches!(shapes.register(large(4.0)), Err(ShapeError::Full { .. })));
    }
}
