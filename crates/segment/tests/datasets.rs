//! Real people: silhouettes of two multi-camera recordings against the reference ones.
//!
//! The settings are those of the cluster files that play the recordings.

#![allow(clippy::disallowed_macros, reason = "a test says what it measured")]
// The figures are what this test is read for.
#![allow(clippy::print_stdout)]

mod common;

use std::path::{Path, PathBuf};

use hull::Silhouette;
use segment::{BackgroundBuilder, Format, Layout, Range, Sampling, SegmentSettings, Segmenter};

/// As in the cluster files: all else is the default. Panels, bystanders and flicker are smaller than the person.
const SETTINGS: &str = "keep_largest = 1";

/// One camera of a recording.
struct Recorded {
    name: String,
    size: (u32, u32),
    background: PathBuf,
    video: PathBuf,
    /// Holds a reference for every so many frames, up to and with the last.
    references: PathBuf,
    every: usize,
    last: usize,
}

/// What films are decoded to, with ffmpeg's name.
const LAYOUTS: [(Layout, &str); 3] = [
    (Layout::Rgb, "rgb24"),
    (Layout::Planar(Sampling::C420, Range::Limited), "yuv420p"),
    (Layout::Yuyv(Range::Limited), "yuyv422"),
];

/// Intersection over union of every reference frame.
fn overlaps(recorded: &Recorded, (layout, pixel_format): (Layout, &str)) -> Vec<f64> {
    let Recorded { name, size: (width, height), every, last, .. } = recorded;
    let format = Format::new(layout, *width, *height).expect("size");
    // A plate is a picture and comes as RGB; a clip is a film like the other.
    let is_plate = recorded.background.extension().is_some_and(|extension| extension == "png");
    let of_background = if is_plate { LAYOUTS[0] } else { (layout, pixel_format) };
    let empty = format.with_layout(of_background.0);
    let mut builder = BackgroundBuilder::new(empty);
    for frame in common::frames(&recorded.background, empty, of_background.1, "null") {
        builder.push(&frame).expect("a frame");
    }
    let settings: SegmentSettings = toml::from_str(SETTINGS).expect("settings");
    let background = builder.finish().expect("a background");
    let mut segmenter = Segmenter::new(&settings, format, Some(&background)).expect("settings and model");
    let chosen = format!("select='not(mod(n,{every}))*lte(n,{last})'");
    let frames = common::frames(&recorded.video, format, pixel_format, &chosen);
    assert_eq!(frames.len(), last / every + 1, "frames of {name}");
    let overlap = |(at, frame): (usize, &Vec<u8>)| {
        let found = segmenter.segment(frame).expect("a frame");
        assert!(found.raw_share < 0.2, "{name}: {} of the image moves", found.raw_share);
        let picture = recorded.references.join(format!("{:06}.png", at * every));
        intersection_over_union(&found.silhouette, &reference(&picture))
    };
    frames.iter().enumerate().map(overlap).collect()
}

fn reference(path: &Path) -> Silhouette {
    let image = image::open(path).expect("a reference silhouette").into_luma8();
    let mask: Vec<u8> = image.iter().map(|&level| u8::from(level > 127)).collect();
    Silhouette::from_mask(image.width(), image.height(), &mask).expect("a silhouette")
}

fn intersection_over_union(a: &Silhouette, b: &Silhouette) -> f64 {
    assert_eq!((a.width(), a.height()), (b.width(), b.height()));
    let both = a.to_mask().iter().zip(b.to_mask()).filter(|(a, b)| **a != 0 && *b != 0).count() as f64;
    both / ((a.area() + b.area()) as f64 - both)
}

/// Prints a line per camera and fails if one falls short in the mean or in its worst frame.
#[track_caller]
fn check(cameras: &[Recorded], least_mean: f64, least_frame: f64) {
    for (recorded, layout) in cameras.iter().flat_map(|camera| LAYOUTS.map(|layout| (camera, layout))) {
        let overlaps = overlaps(recorded, layout);
        let mean = overlaps.iter().sum::<f64>() / overlaps.len() as f64;
        let least = overlaps.iter().copied().fold(f64::INFINITY, f64::min);
        println!(
            "{}, {}: intersection over union {mean:.4}, {least:.4} in the worst frame",
            recorded.name, layout.1
        );
        assert!(mean >= least_mean && least >= least_frame, "{}: {overlaps:.3?}", recorded.name);
    }
}

#[test]
fn a_man_on_a_chair_is_cut_out_as_in_the_reference() {
    let Some(datasets) = common::datasets() else { return };
    let folder = datasets.join("uu_horseman");
    let cameras = ["cam1", "cam2", "cam3", "cam4"].map(|camera| Recorded {
        name: format!("uu_horseman {camera}"),
        size: (644, 486),
        background: folder.join(format!("videos/{camera}/background.avi")),
        video: folder.join(format!("videos/{camera}/video.avi")),
        references: folder.join("silhouettes").join(camera),
        every: 45,
        last: 405,
    });
    check(&cameras, 0.91, 0.90);
}

/// The references have halos of a few pixels around the arms in cam01 and cam02; against the hull of all
/// four, these silhouettes are as consistent as the references are.
#[test]
fn a_walking_man_is_cut_out_of_a_crowded_room_by_its_plates() {
    let Some(datasets) = common::datasets() else { return };
    let folder = datasets.join("pose2sim_balance");
    let cameras = [("cam01", 1080), ("cam02", 1080), ("cam03", 1088), ("cam04", 1088)];
    let cameras = cameras.map(|(camera, width)| Recorded {
        name: format!("pose2sim_balance {camera}"),
        size: (width, 1920),
        background: folder.join(format!("background/{camera}.png")),
        video: folder.join(format!("videos/{camera}.mp4")),
        references: folder.join("silhouettes").join(camera),
        every: 8,
        last: 72,
    });
    check(&cameras, 0.90, 0.88);
}
