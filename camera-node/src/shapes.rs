//! The shapes that coordinators have registered, by content.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hull::Shape;
use proto::convert::shape_key;
use thiserror::Error;

/// Samples kept in all: 24 MB. A studio's scene has tens of thousands.
const MAX_KEPT_SAMPLES: usize = 2_000_000;

/// Why shapes are not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ShapeError {
    /// No room, even without all others.
    #[error("{asked} samples at once, at most {MAX_KEPT_SAMPLES} are kept")]
    Full {
        /// Samples to register.
        asked: usize,
    },
    /// Two shapes begin with the same eight bytes of digest.
    #[error("shape {0:016x} is registered with other samples")]
    Clash(u64),
}

/// Registered shapes.
#[derive(Default)]
pub struct Shapes {
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    /// Each shape, and when it was last used.
    by_key: HashMap<u64, (Arc<Shape>, u64)>,
    /// Counts uses.
    now: u64,
}

impl Shapes {
    /// Keeps the shapes of one call. Where there is no room, the least recently used go: bodies come and go for
    /// days. A coordinator that uses them again registers them again.
    pub fn register(&self, shapes: Vec<Shape>) -> Result<(), ShapeError> {
        let distinct: HashMap<u64, Shape> =
            shapes.into_iter().map(|shape| (shape_key(&shape.digest()), shape)).collect();
        let asked = distinct.values().map(samples).sum();
        if asked > MAX_KEPT_SAMPLES {
            return Err(ShapeError::Full { asked });
        }
        let mut kept = self.lock();
        for (&key, shape) in &distinct {
            if kept.by_key.get(&key).is_some_and(|(known, _)| known.digest() != shape.digest()) {
                return Err(ShapeError::Clash(key));
            }
        }
        kept.now += 1;
        let now = kept.now;
        for (key, shape) in distinct {
            kept.by_key.entry(key).or_insert_with(|| (Arc::new(shape), now)).1 = now;
        }
        // Equal ages are this call's, which fit: an older one goes first.
        let age = |(&key, (shape, used)): (&u64, &(Arc<Shape>, u64))| (*used, key, samples(shape));
        let mut by_age: Vec<(u64, u64, usize)> = kept.by_key.iter().map(age).collect();
        by_age.sort_unstable();
        let mut total: usize = by_age.iter().map(|(_, _, samples)| samples).sum();
        for (_, key, samples) in by_age {
            if total <= MAX_KEPT_SAMPLES {
                break;
            }
            kept.by_key.remove(&key);
            total -= samples;
        }
        Ok(())
    }

    /// The shape of that key.
    pub fn get(&self, key: u64) -> Option<Arc<Shape>> {
        let mut kept = self.lock();
        kept.now += 1;
        let now = kept.now;
        let (shape, asked) = kept.by_key.get_mut(&key)?;
        *asked = now;
        Some(Arc::clone(shape))
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn samples(shape: &Shape) -> usize {
    shape.samples_body().len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_found_by_content() {
        let shapes = Shapes::default();
        let small = Shape::new(vec![[0.0; 3]; 10]).expect("finite");
        let key = shape_key(&small.digest());
        assert!(shapes.get(key).is_none());
        assert_eq!(shapes.register(vec![small.clone(), small.clone()]), Ok(()));
        assert_eq!(shapes.register(vec![small.clone()]), Ok(()));
        assert_eq!(shapes.get(key).as_deref(), Some(&small));
    }

    #[test]
    fn the_least_recently_used_shapes_make_room() {
        let shapes = Shapes::default();
        let large = |x| Shape::new(vec![[x, 0.0, 0.0]; 1 << 19]).expect("finite");
        let key = |x| shape_key(&large(x).digest());
        for x in 1..=3 {
            assert_eq!(shapes.register(vec![large(x as f32)]), Ok(()));
        }
        assert!(shapes.get(key(1.0)).is_some());
        assert_eq!(shapes.register(vec![large(4.0)]), Ok(()));
        let there = [1.0, 2.0, 3.0, 4.0].map(|x| shapes.get(key(x)).is_some());
        assert_eq!(there, [true, false, true, true]);
        let four = (5..9).map(|x| large(x as f32)).collect();
        assert!(matches!(shapes.register(four), Err(ShapeError::Full { .. })));
        assert!(shapes.get(key(4.0)).is_some(), "what is refused changes nothing");
    }
}
