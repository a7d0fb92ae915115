//! Every vector path gives the same bits, however many cores read; and nothing is allocated but what is
//! handed out.

use std::alloc::{GlobalAlloc, Layout as Room, System};
use std::cell::Cell;

use hull::VectorPath;
use hull::silhouette::SilhouetteBuilder;
use proptest::prelude::*;
use segment::{
    BackgroundBuilder, Format, Layout, Method, Range, Sampling, SegmentSettings, Segmented, Segmenter,
};

const LAYOUTS: [Layout; 9] = [
    Layout::Rgb,
    Layout::Planar(Sampling::Mono, Range::Full),
    Layout::Planar(Sampling::C420, Range::Limited),
    Layout::Planar(Sampling::C422, Range::Full),
    Layout::Planar(Sampling::C411, Range::Limited),
    Layout::Planar(Sampling::C444, Range::Limited),
    Layout::Nv12(Range::Full),
    Layout::Yuyv(Range::Limited),
    Layout::Uyvy(Range::Full),
];

/// Counts what the thread of a test allocates.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

#[allow(unsafe_code, reason = "an allocator that counts must be one")]
// SAFETY: all work is the system's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, room: Room) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as asked.
        unsafe { System.alloc(room) }
    }

    unsafe fn dealloc(&self, at: *mut u8, room: Room) {
        // SAFETY: as asked.
        unsafe { System.dealloc(at, room) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// A smooth room with a little noise; every `wild`-th stretch of bytes is something else.
fn frame(format: Format, noise: &mut Noise, brightness: u64, wild: u64) -> Vec<u8> {
    let mut something_else = false;
    let byte = |at: usize| {
        if at.is_multiple_of(29) {
            something_else = wild > 0 && noise.next().is_multiple_of(wild);
        }
        let room = 90 + (at / 97 % 60) as u64 * brightness / 8;
        if something_else { noise.next() as u8 } else { (room * brightness / 8 + noise.next() % 7) as u8 }
    };
    (0..format.frame_bytes()).map(byte).collect()
}

fn segmenter(format: Format, settings: &SegmentSettings, noise: &mut Noise) -> Segmenter {
    let mut clip = BackgroundBuilder::new(format);
    (0..5).for_each(|_| clip.push(&frame(format, noise, 8, 0)).expect("a frame"));
    Segmenter::new(settings, format, Some(&clip.finish().expect("frames"))).expect("a segmenter")
}

/// Without clean-up every single bit counts.
fn uncleaned(settings: &SegmentSettings) -> SegmentSettings {
    SegmentSettings {
        open_px: Some(1),
        close_px: Some(1),
        speck_px: Some(0),
        hole_px: Some(0),
        ..settings.clone()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn all_vector_paths_agree(
        layout in 0..LAYOUTS.len(), width in 1u32..300, height in 1u32..40, seed: u64, brightness in 5u64..11,
        wild in 1u64..12, chroma: bool, raw: bool,
    ) {
        let format = Format::new(LAYOUTS[layout], width, height).expect("size");
        let mut noise = Noise(seed | 1);
        let method = if chroma { Method::Chroma } else { Method::Difference };
        let mut settings = SegmentSettings { method, ..SegmentSettings::default() };
        if raw {
            settings = uncleaned(&settings);
        }
        let mut segmenter = segmenter(format, &settings, &mut noise);
        let frame = frame(format, &mut noise, brightness, wild);
        let mut on = |path: VectorPath| -> Segmented {
            segmenter.set_vector_path(path);
            segmenter.segment(&frame).expect("a frame")
        };
        let portable = on(VectorPath::Portable);
        prop_assert_eq!(&on(VectorPath::Avx2), &portable);
        prop_assert_eq!(&on(VectorPath::Avx512), &portable);
    }
}

#[test]
fn several_cores_see_what_one_sees() {
    for layout in [Layout::Rgb, Layout::Planar(Sampling::C420, Range::Limited)] {
        // Odd, and worth three bands.
        let format = Format::new(layout, 2501, 2517).expect("size");
        let mut noise = Noise(77);
        let mut segmenter = segmenter(format, &uncleaned(&SegmentSettings::default()), &mut noise);
        let frame = frame(format, &mut noise, 8, 6);
        let alone = segmenter.segment(&frame).expect("a frame");
        assert!(alone.silhouette.area() > 0);
        segmenter.set_cores(3);
        assert_eq!(segmenter.segment(&frame).expect("a frame"), alone);
    }
}

#[test]
fn only_the_silhouette_is_allocated_once_warm() {
    for layout in LAYOUTS {
        let format = Format::new(layout, 640, 480).expect("size");
        let mut noise = Noise(5);
        let settings = SegmentSettings { keep_largest: Some(2), ..SegmentSettings::default() };
        let mut segmenter = segmenter(format, &settings, &mut noise);
        let frame = frame(format, &mut noise, 8, 6);
        let found = segmenter.segment(&frame).expect("a frame");
        let before = ALLOCATIONS.get();
        let mut copy = SilhouetteBuilder::new(640, 480).expect("size");
        (0..480).for_each(|row| copy.push_runs(found.silhouette.row(row)).expect("a row"));
        let of_silhouette = ALLOCATIONS.get() - before;
        let before = ALLOCATIONS.get();
        let again = segmenter.segment(&frame).expect("a frame");
        let made = ALLOCATIONS.get() - before;
        assert_eq!(again, found);
        assert!(made <= of_silhouette, "{layout:?}: {made} allocations, {of_silhouette} of the silhouette");
    }
}
