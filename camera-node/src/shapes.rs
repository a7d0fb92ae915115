//! The shapes that coordinators have registered, by content.

use std::collections::HashMap;
use std::sync::Arc;

use hull::Shape;
use parking_lot::{Mutex, MutexGuard};
use proto::convert::shape_key;
use thiserror::Error;

/// Samples kept in all: 24 MB. A studio's scene has tens of thousands.
const MAX_KEPT_SAMPLES: usize = 2_000_000;
/// What a shape takes beside its samples, as samples: so many small ones take no more memory than a few large ones.
const SHAPE_SAMPLES: usize = 24;

/// Why shapes are not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ShapeError {
    /// No room, even without all others.
    #[error(
        "shapes of {asked} samples at once, each counted with {SHAPE_SAMPLES} more, expected at most \
         {MAX_KEPT_SAMPLES}"
    )]
    Full {
        /// Samples to register, with those that shapes count beside.
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
    by_key: HashMap<u64, KeptShape>,
    /// Counts uses.
    now: u64,
    /// Of all shapes, as they count.
    samples: usize,
}

struct KeptShape {
    shape: Arc<Shape>,
    /// When it was last used.
    used: u64,
    /// The coordinator that registered it last.
    holder: u64,
}

impl Shapes {
    /// Keeps the shapes of one call by a coordinator. Where there is no room, those of other coordinators go first, then
    /// its own, the least recently used before others: bodies come and go for days. A coordinator that uses them again
    /// registers them again.
    pub fn register(&self, shapes: Vec<Shape>, holder: u64) -> Result<(), ShapeError> {
        let distinct: HashMap<u64, Shape> =
            shapes.into_iter().map(|shape| (shape_key(&shape.digest()), shape)).collect();
        let asked = distinct.values().map(samples).sum();
        if asked > MAX_KEPT_SAMPLES {
            return Err(ShapeError::Full { asked });
        }
        let mut kept = self.lock();
        for (&key, shape) in &distinct {
            if kept.by_key.get(&key).is_some_and(|known| known.shape.digest() != shape.digest()) {
                return Err(ShapeError::Clash(key));
            }
        }
        kept.now += 1;
        let used = kept.now;
        for (key, shape) in distinct {
            let new = samples(&shape);
            let shape = KeptShape { shape: Arc::new(shape), used, holder };
            let before = kept.by_key.insert(key, shape);
            kept.samples += new;
            kept.samples -= before.map_or(0, |before| samples(&before.shape));
        }
        if kept.samples > MAX_KEPT_SAMPLES {
            kept.make_room(holder);
        }
        Ok(())
    }

    /// The shape of that key.
    pub fn get(&self, key: u64) -> Option<Arc<Shape>> {
        let mut kept = self.lock();
        kept.now += 1;
        let now = kept.now;
        let found = kept.by_key.get_mut(&key)?;
        found.used = now;
        Some(Arc::clone(&found.shape))
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock()
    }
}

impl Kept {
    /// Those that were registered just now fit, and are the newest of who registered them.
    fn make_room(&mut self, holder: u64) {
        let age = |(&key, kept): (&u64, &KeptShape)| (kept.holder == holder, kept.used, key);
        let mut by_age: Vec<(bool, u64, u64)> = self.by_key.iter().map(age).collect();
        by_age.sort_unstable();
        for (_, _, key) in by_age {
            if self.samples <= MAX_KEPT_SAMPLES {
                break;
            }
            self.samples -= self.by_key.remove(&key).map_or(0, |gone| samples(&gone.shape));
        }
    }
}

/// As a shape counts.
fn samples(shape: &Shape) -> usize {
    shape.samples_body().len() + SHAPE_SAMPLES
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
        assert_eq!(shapes.register(vec![small.clone(), small.clone()], 1), Ok(()));
        assert_eq!(shapes.register(vec![small.clone()], 1), Ok(()));
        assert_eq!(shapes.get(key).as_deref(), Some(&small));
    }

    #[test]
    fn the_least_recently_used_shapes_make_room() {
        let shapes = Shapes::default();
        let large = |x| Shape::new(vec![[x, 0.0, 0.0]; 1 << 19]).expect("finite");
        let key = |x| shape_key(&large(x).digest());
        for x in 1..=3 {
            assert_eq!(shapes.register(vec![large(x as f32)], 1), Ok(()));
        }
        assert!(shapes.get(key(1.0)).is_some());
        assert_eq!(shapes.register(vec![large(4.0)], 1), Ok(()));
        let there = [1.0, 2.0, 3.0, 4.0].map(|x| shapes.get(key(x)).is_some());
        assert_eq!(there, [true, false, true, true]);
        let four = (5..9).map(|x| large(x as f32)).collect();
        assert!(matches!(shapes.register(four, 1), Err(ShapeError::Full { .. })));
        assert!(shapes.get(key(4.0)).is_some(), "what is refused changes nothing");
    }

    #[test]
    fn shapes_of_other_coordinators_make_room_first() {
        let shapes = Shapes::default();
        let large = |x| Shape::new(vec![[x, 0.0, 0.0]; 1 << 19]).expect("finite");
        let key = |x| shape_key(&large(x).digest());
        for (x, holder) in [(1.0, 7), (2.0, 8), (3.0, 8)] {
            assert_eq!(shapes.register(vec![large(x)], holder), Ok(()));
        }
        assert_eq!(shapes.register(vec![large(4.0)], 7), Ok(()));
        assert_eq!([1.0, 2.0, 3.0, 4.0].map(|x| shapes.get(key(x)).is_some()), [true, false, true, true]);
        let again = shapes.register(vec![large(3.0), large(5.0)], 7);
        assert_eq!((again, shapes.get(key(3.0)).is_some()), (Ok(()), true), "it is its own now");
    }

    #[test]
    fn many_small_shapes_take_no_more_memory_than_a_few_large_ones() {
        let shapes = Shapes::default();
        let small = |x: u32| Shape::new(vec![[x as f32, 0.0, 0.0]]).expect("finite");
        let most = (MAX_KEPT_SAMPLES / (SHAPE_SAMPLES + 1)) as u32;
        assert!(shapes.register((0..=most).map(small).collect(), 1).is_err());
        assert_eq!(shapes.register((0..most).map(small).collect(), 1), Ok(()));
        assert_eq!(shapes.register((most..2 * most).map(small).collect(), 1), Ok(()));
        assert_eq!(shapes.lock().by_key.len(), most as usize);
    }
}
