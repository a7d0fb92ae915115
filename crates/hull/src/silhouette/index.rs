//! A silhouette made ready for searching, once per frame.

use super::{BitMap, Depth, Silhouette};

/// A bit map and how deep its pixels lie.
#[derive(Clone, Debug)]
pub struct Index {
    map: BitMap,
    depth: Depth,
}

impl Index {
    /// The index of a map over an image whose longer side has so many pixels.
    pub fn new(map: BitMap, longer_side_pixels: u32) -> Index {
        let depth = Depth::new(&map, longer_side_pixels);
        Index { map, depth }
    }

    /// The index of a silhouette's foreground, with at least `pad` pixels of background around it.
    pub fn foreground(silhouette: &Silhouette, pad: u32) -> Index {
        let map = BitMap::foreground(silhouette, pad);
        Index::new(map, silhouette.width().max(silhouette.height()))
    }

    /// The bits.
    #[inline]
    pub fn map(&self) -> &BitMap {
        &self.map
    }

    /// The depths.
    #[inline]
    pub fn depth(&self) -> &Depth {
        &self.depth
    }

    /// Heap memory, bytes.
    pub fn heap_bytes(&self) -> usize {
        self.map.heap_bytes() + self.depth.heap_bytes()
    }
}
