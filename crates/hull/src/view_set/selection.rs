//! Some points of a chunk, selected without branches: they could not be predicted.

use super::projections::CHUNK;
use crate::probe::edge_ray::LANES;

/// Points of a chunk, in order. Places beyond the last one may be read.
#[derive(Clone, Debug)]
pub(super) struct Selection {
    places: [u8; CHUNK],
    count: usize,
}

impl Default for Selection {
    fn default() -> Selection {
        Selection { places: [0; CHUNK], count: 0 }
    }
}

impl Selection {
    /// Empties it.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a point; there must be room.
    #[inline(always)]
    pub fn push(&mut self, at: usize) {
        self.places[self.count] = at as u8;
        self.count += 1;
    }

    /// Selects those of the first `count` points that fit, instead of the former selection.
    #[inline(always)]
    pub fn select(&mut self, count: usize, fits: impl Fn(usize) -> bool) {
        let mut fitting = [0u8; CHUNK];
        for (at, fitting) in fitting[..count].iter_mut().enumerate() {
            *fitting = u8::from(fits(at));
        }
        let mut kept = 0;
        for (at, &fits) in fitting[..count].iter().enumerate() {
            self.places[kept] = at as u8;
            kept += usize::from(fits);
        }
        self.count = kept;
    }

    /// One of them.
    #[inline(always)]
    pub fn place(&self, index: usize) -> usize {
        usize::from(self.places[index])
    }

    /// How many there are.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.count
    }

    /// The points eight by eight; the last eight are filled up with their first.
    #[inline(always)]
    pub fn blocks(&self) -> impl Iterator<Item = (usize, [u8; LANES])> {
        let (blocks, _) = self.places.as_chunks::<LANES>();
        blocks[..self.count.div_ceil(LANES)].iter().enumerate().map(|(index, block)| {
            let count = self.count - index * LANES;
            (index, std::array::from_fn(|lane| block[if lane < count { lane } else { 0 }]))
        })
    }

    /// The points.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = usize> {
        self.places[..self.count].iter().map(|&at| usize::from(at))
    }
}
