//! What a segmenter does to the frames of a small made-up studio.

use hull::Silhouette;
use proptest::prelude::*;
use segment::{
    BackgroundBuilder, BackgroundModel, Format, Layout, Method, Range, Sampling, SegmentError,
    SegmentSettings, Segmenter, SettingsError, from_rgb,
};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

fn format() -> Format {
    Format::new(Layout::Rgb, WIDTH, HEIGHT).expect("size")
}

/// Noise that depends on nothing but its seed.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// About normal, of the deviation given.
    fn level(&mut self, deviation: f64) -> f64 {
        let sum: u64 = (0..4).map(|_| self.next() % 1000).sum();
        (sum as f64 - 1998.0) / 577.0 * deviation
    }
}

/// A frame from a colour per pixel, with noise of two levels per channel.
fn frame(seed: u64, colour: impl Fn(u32, u32) -> [f64; 3]) -> Vec<u8> {
    let mut noise = Noise(seed | 1);
    let pixels = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (column, row)));
    let levels = pixels.flat_map(|(column, row)| colour(column, row));
    levels.map(|level| (level + noise.level(2.0)).round().clamp(0.0, 255.0) as u8).collect()
}

/// A wall with a gradient over a floor.
fn room(column: u32, row: u32) -> [f64; 3] {
    let light = 0.7 + 0.3 * f64::from(column) / f64::from(WIDTH);
    if row < 80 { [190.0 * light, 180.0 * light, 160.0 * light] } else { [70.0, 110.0, 90.0] }
}

fn is_person(column: u32, row: u32) -> bool {
    (60..90).contains(&column) && (20..100).contains(&row)
}

fn with_person(column: u32, row: u32) -> [f64; 3] {
    if is_person(column, row) { [60.0, 50.0, 120.0] } else { room(column, row) }
}

fn empty_clip() -> BackgroundModel {
    let mut builder = BackgroundBuilder::new(format());
    (1..=20).for_each(|seed| builder.push(&frame(7 * seed, room)).expect("a frame"));
    builder.finish().expect("frames")
}

fn segmenter(settings: &SegmentSettings) -> Segmenter {
    Segmenter::new(settings, format(), Some(&empty_clip())).expect("settings and model")
}

fn mask(of: impl Fn(u32, u32) -> bool) -> Silhouette {
    let pixels = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (column, row)));
    let mask: Vec<u8> = pixels.map(|(column, row)| u8::from(of(column, row))).collect();
    Silhouette::from_mask(WIDTH, HEIGHT, &mask).expect("size")
}

fn silhouette(settings: &SegmentSettings, rgb: &[u8]) -> Silhouette {
    segmenter(settings).segment(rgb).expect("a frame").silhouette
}

#[test]
fn a_person_is_found_to_the_pixel_and_an_empty_room_is_empty() {
    let mut segmenter = segmenter(&SegmentSettings::default());
    let found = segmenter.segment(&frame(99, with_person)).expect("a frame");
    assert_eq!(found.silhouette, mask(is_person));
    let share = f64::from(30 * 80) / f64::from(WIDTH * HEIGHT);
    assert!((found.raw_share - share).abs() < 0.001, "{}", found.raw_share);
    let empty = segmenter.segment(&frame(98, room)).expect("a frame");
    assert_eq!(empty.silhouette.area(), 0);
}

#[test]
fn a_shadow_is_background_but_the_same_place_painted_is_not() {
    let on_floor = |column: u32, row: u32| (20..55).contains(&column) && (90..110).contains(&row);
    let shadow = |column, row| {
        let colour = with_person(column, row);
        if on_floor(column, row) { colour.map(|level| 0.65 * level) } else { colour }
    };
    let settings = SegmentSettings::default();
    assert_eq!(silhouette(&settings, &frame(5, shadow)), mask(is_person));
    let paint = |column, row| {
        if on_floor(column, row) { [70.0, 60.0, 70.0] } else { with_person(column, row) }
    };
    let both = mask(|column, row| is_person(column, row) || on_floor(column, row));
    assert_eq!(silhouette(&settings, &frame(5, paint)), both);
}

/// The layouts whose colours are fine enough for contours on even pixels.
const YUV: [Layout; 6] = [
    Layout::Planar(Sampling::C420, Range::Limited),
    Layout::Planar(Sampling::C422, Range::Full),
    Layout::Planar(Sampling::C444, Range::Limited),
    Layout::Nv12(Range::Full),
    Layout::Yuyv(Range::Limited),
    Layout::Uyvy(Range::Limited),
];

/// A frame in another layout.
fn laid_out(rgb: &[u8], layout: Layout) -> Vec<u8> {
    let mut bytes = Vec::new();
    from_rgb(rgb, format().with_layout(layout), &mut bytes);
    bytes
}

/// Every layout finds the same as RGB does, but for a few pixels at contours.
#[track_caller]
fn check_layouts(settings: &SegmentSettings, rgb: &[u8], expected: &Silhouette) {
    for layout in YUV {
        let mut clip = BackgroundBuilder::new(format().with_layout(layout));
        (1..=20).for_each(|seed| clip.push(&laid_out(&frame(7 * seed, room), layout)).expect("a frame"));
        let model = clip.finish().expect("frames");
        let mut segmenter =
            Segmenter::new(settings, format().with_layout(layout), Some(&model)).expect("settings and model");
        let found = segmenter.segment(&laid_out(rgb, layout)).expect("a frame").silhouette;
        let wrong = found.to_mask().iter().zip(expected.to_mask()).filter(|(a, b)| **a != *b).count();
        assert!(wrong <= 12, "{layout:?}: {wrong} pixels are wrong");
    }
}

#[test]
fn a_person_is_found_and_her_shadow_is_not_in_the_camera_s_own_layout() {
    let shadow = |column: u32, row: u32| {
        let dark = (20..56).contains(&column) && (90..110).contains(&row);
        with_person(column, row).map(|level| if dark { 0.65 * level } else { level })
    };
    check_layouts(&SegmentSettings::default(), &frame(5, shadow), &mask(is_person));
}

#[test]
fn drifting_exposure_and_white_balance_are_taken_out_in_the_camera_s_own_layout() {
    let warmer = |column, row| {
        let [red, green, blue] = with_person(column, row);
        [0.9 * red, 0.85 * green, 0.75 * blue]
    };
    check_layouts(&SegmentSettings::default(), &frame(4, warmer), &mask(is_person));
}

#[test]
fn a_green_room_is_keyed_in_the_camera_s_own_layout() {
    let settings = SegmentSettings { method: Method::Chroma, ..SegmentSettings::default() };
    let green = |column: u32, row: u32| {
        if is_person(column, row) { [150.0, 120.0, 100.0] } else { [40.0, 170.0, 70.0] }
    };
    check_layouts(&settings, &frame(2, green), &mask(is_person));
}

#[test]
fn a_plate_in_colours_serves_a_film_in_yuv() {
    let plate = BackgroundModel::from_plate(format(), &frame(70, room)).expect("a plate");
    let layout = Layout::Planar(Sampling::C420, Range::Limited);
    let mut segmenter =
        Segmenter::new(&SegmentSettings::default(), format().with_layout(layout), Some(&plate))
            .expect("settings and model");
    let found = segmenter.segment(&laid_out(&frame(71, with_person), layout)).expect("a frame").silhouette;
    assert_eq!(found, mask(is_person));
}

#[test]
fn specks_vanish_and_small_holes_fill_but_a_bent_arm_stays_open() {
    let settings = SegmentSettings { speck_px: Some(30), hole_px: Some(30), ..SegmentSettings::default() };
    let hole = |column: u32, row: u32| (70..75).contains(&column) && (40..45).contains(&row);
    let gap = |column: u32, row: u32| (70..80).contains(&column) && (60..90).contains(&row);
    let speck = |column: u32, row: u32| (10..15).contains(&column) && (20..25).contains(&row);
    let dirty = |column, row| match is_person(column, row) {
        true if hole(column, row) || gap(column, row) => room(column, row),
        false if speck(column, row) || (column * 31 + row * 17) % 53 == 0 => [250.0, 30.0, 30.0],
        _ => with_person(column, row),
    };
    let expected = mask(|column, row| is_person(column, row) && !gap(column, row));
    let found = segmenter(&settings).segment(&frame(3, dirty)).expect("a frame");
    let wrong = found.silhouette.to_mask().iter().zip(expected.to_mask()).filter(|(a, b)| **a != *b).count();
    // A red pixel beside the person may join her outline.
    assert!(wrong <= 12, "{wrong} pixels are wrong");
    let share = found.silhouette.area() as f64 / f64::from(WIDTH * HEIGHT);
    assert!(found.raw_share > share + 0.01);
}

#[test]
fn exposure_that_drifts_is_taken_out() {
    let darker = |column, row| with_person(column, row).map(|level| 0.8 * level);
    let found = segmenter(&SegmentSettings::default()).segment(&frame(4, darker)).expect("a frame");
    assert_eq!(found.silhouette, mask(is_person));
    assert!(found.gains.iter().all(|gain| (gain - 0.8).abs() < 0.02), "{:?}", found.gains);
}

#[test]
fn a_broken_background_shows_in_the_raw_share() {
    let mut segmenter = segmenter(&SegmentSettings::default());
    let moved = |column: u32, row: u32| room((column + 80) % WIDTH, row + 50);
    let found = segmenter.segment(&frame(6, moved)).expect("a frame");
    assert!(found.raw_share > 0.4, "{}", found.raw_share);
}

#[test]
fn a_smaller_bystander_can_be_left_out() {
    let bystander = |column: u32, row: u32| (130..145).contains(&column) && (30..80).contains(&row);
    let both = |column, row| {
        if bystander(column, row) { [20.0, 60.0, 30.0] } else { with_person(column, row) }
    };
    let rgb = frame(8, both);
    let two = mask(|column, row| is_person(column, row) || bystander(column, row));
    assert_eq!(silhouette(&SegmentSettings::default(), &rgb), two);
    let settings = SegmentSettings { keep_largest: Some(1), ..SegmentSettings::default() };
    assert_eq!(silhouette(&settings, &rgb), mask(is_person));
}

#[test]
fn a_person_with_a_belt_like_the_wall_is_one_piece() {
    let belt = |column: u32, row: u32| is_person(column, row) && (55..58).contains(&row);
    let bystander = |column: u32, row: u32| (130..145).contains(&column) && (30..80).contains(&row);
    let colour = |column, row| {
        if bystander(column, row) {
            [20.0, 60.0, 30.0]
        } else if belt(column, row) {
            room(column, row)
        } else {
            with_person(column, row)
        }
    };
    let settings = SegmentSettings {
        keep_largest: Some(1),
        join_px: Some(5),
        close_px: Some(1),
        ..SegmentSettings::default()
    };
    let found = silhouette(&settings, &frame(12, colour));
    assert_eq!(found, mask(|column, row| is_person(column, row) && !belt(column, row)));
    let alone = SegmentSettings { join_px: Some(1), ..settings };
    let found = silhouette(&alone, &frame(12, colour));
    assert_eq!(found, mask(|column, row| is_person(column, row) && row >= 58), "only her larger part");
}

#[test]
fn a_green_room_needs_no_clip() {
    let settings = SegmentSettings { method: Method::Chroma, ..SegmentSettings::default() };
    let green = |column: u32, row: u32| {
        let light = 0.5 + f64::from(row) / 240.0;
        if is_person(column, row) {
            [150.0, 120.0, 100.0]
        } else {
            [40.0, 170.0, 70.0].map(|level| level * light)
        }
    };
    let mut segmenter = Segmenter::new(&settings, format(), None).expect("no model needed");
    assert_eq!(segmenter.segment(&frame(2, green)).expect("a frame").silhouette, mask(is_person));
}

#[test]
fn one_plate_is_enough() {
    let plate = BackgroundModel::from_plate(format(), &frame(70, room)).expect("a plate");
    let mut segmenter =
        Segmenter::new(&SegmentSettings::default(), format(), Some(&plate)).expect("settings and model");
    assert_eq!(segmenter.segment(&frame(71, with_person)).expect("a frame").silhouette, mask(is_person));
}

#[test]
fn what_does_not_fit_is_named() {
    let settings = SegmentSettings::default();
    let model = empty_clip();
    let error = Segmenter::new(&settings, format(), None).err();
    assert_eq!(error, Some(SegmentError::NoBackground));
    let taller = Format::new(Layout::Rgb, WIDTH, HEIGHT + 1).expect("size");
    let error = Segmenter::new(&settings, taller, Some(&model)).expect_err("another size");
    assert_eq!(error.to_string(), "background of 160 x 120, expected 160 x 121 as the frames");
    let mut segmenter = segmenter(&settings);
    let error = segmenter.segment(&[0; 100]).expect_err("a short frame");
    assert_eq!(error.to_string(), "frame of 100 bytes, expected 57600: RGB of 160 x 120");
    let wrong = SegmentSettings { high: 0.0, ..settings };
    let error = Segmenter::new(&wrong, format(), Some(&model)).err();
    assert!(matches!(error, Some(SegmentError::Settings(SettingsError { key: "high", .. }))));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn a_frame_gives_the_same_silhouette_whatever_came_before(seed in any::<u64>(), before in any::<u64>()) {
        let mut noise = Noise(seed | 1);
        let wild: Vec<u8> = (0..3 * WIDTH * HEIGHT).map(|_| (noise.next() % 256) as u8).collect();
        let mut used = segmenter(&SegmentSettings::default());
        used.segment(&frame(before, with_person)).expect("a frame");
        let first = used.segment(&wild).expect("a frame");
        prop_assert_eq!(&used.segment(&wild).expect("a frame"), &first);
        let fresh = segmenter(&SegmentSettings::default()).segment(&wild).expect("a frame");
        prop_assert_eq!(&fresh, &first);
        // What clean-up leaves has no speck and no small hole.
        let pixels = u64::from(WIDTH * HEIGHT);
        prop_assert!(first.silhouette.area() == 0 || first.silhouette.area() >= pixels / 2048);
    }
}
