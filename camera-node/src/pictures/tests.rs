use std::sync::mpsc;
use std::time::Duration;

use hull::{Observer, ProbeSettings};
use proto::MAX_SCALE_LOG2;
use segment::{Format, Layout, Range, Sampling, from_rgb};

use super::*;
use crate::frames::{CameraFrame, Stamp};
use crate::source::{Image, ImageKind};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const TIMEOUT: Duration = Duration::from_secs(20);

/// Green room, an orange box from (30, 20) to (60, 50).
fn film_frame(layout: Layout) -> (Image, hull::Silhouette) {
    let (mut rgb, mut mask) = (Vec::new(), Vec::new());
    for (row, column) in (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (row, column))) {
        let is_in = (30..60).contains(&column) && (20..50).contains(&row);
        rgb.extend(if is_in { [220, 120, 40] } else { [20, 200, 30] });
        mask.push(u8::from(is_in));
    }
    let mut data = Vec::new();
    from_rgb(&rgb, Format::new(layout, WIDTH, HEIGHT).expect("size"), &mut data);
    let image = Image { width: WIDTH, height: HEIGHT, kind: ImageKind::Colour(layout), data };
    (image, hull::Silhouette::from_mask(WIDTH, HEIGHT, &mask).expect("size"))
}

struct Set {
    ring: Arc<FrameRing>,
    colours: Arc<ColourRing>,
    encoder: PictureEncoder,
}

impl Set {
    /// One camera, number 3 of its rig.
    fn new() -> Set {
        let ring = Arc::new(FrameRing::new(1));
        let colours = Arc::new(ColourRing::new(1));
        let encoder = PictureEncoder::new(Arc::clone(&ring), Arc::clone(&colours), vec![3]);
        Set { ring, colours, encoder: encoder.expect("a thread") }
    }

    fn film(&self, number: u64, layout: Layout) {
        let (image, silhouette) = film_frame(layout);
        let camera = crate::source::tests::camera(WIDTH, HEIGHT);
        let observer = Arc::new(Observer::new(camera, 3, ProbeSettings::default(), None));
        self.colours.keep(0, number, &image, &silhouette);
        let stamp = Stamp { number, capture_time_s: 0.0, captured_unix_s: 5.0 };
        self.ring.offer(0, stamp, CameraFrame::new(&observer, silhouette, 0.0));
    }

    fn camera(&self, frame: u64, kind: PictureKind, scale_log2: u8) -> CameraPicture {
        self.picture(frame, kind, scale_log2).camera
    }

    fn picture(&self, frame: u64, kind: PictureKind, scale_log2: u8) -> Picture {
        let cameras = vec![3];
        let request = PictureRequest { frame: Some(frame), kind, scale_log2, jpeg_quality: 90, cameras };
        let (sender, pictures) = mpsc::channel();
        let deliver = move |picture| sender.send(picture).expect("the test waits");
        self.encoder.request(request, deliver).expect("accepted");
        pictures.recv_timeout(TIMEOUT).expect("in time")
    }
}

fn decoded(jpeg: &[u8]) -> image::RgbImage {
    image::load_from_memory_with_format(jpeg, image::ImageFormat::Jpeg).expect("a JPEG").to_rgb8()
}

#[track_caller]
fn is_near(found: image::Rgb<u8>, expected: [u8; 3], within: u8) {
    let off = found.0.iter().zip(expected).map(|(found, expected)| found.abs_diff(expected)).max();
    assert!(off <= Some(within), "found {found:?}, expected {expected:?}");
}

#[test]
fn colours_are_kept_only_while_requested() {
    let set = Set::new();
    set.film(0, Layout::Rgb);
    assert_eq!(set.colours.bytes(), 0, "no request yet");
    let early = set.camera(0, PictureKind::Crops, 0);
    assert!(early.jpeg.is_empty() && !early.runs.is_empty(), "too late for the frame that there is");
    set.film(1, Layout::Rgb);
    // The box of 30 x 30 with 16 pixels around, from a multiple of four on.
    assert_eq!(set.colours.bytes(), 3 * (76 - 12) * (64 - 4));
    assert!(!set.camera(1, PictureKind::Crops, 0).jpeg.is_empty());
    assert!(set.camera(1, PictureKind::Whole, 0).jpeg.is_empty(), "only the crop was kept");
    set.film(2, Layout::Rgb);
    assert!(!set.camera(2, PictureKind::Whole, 0).jpeg.is_empty());
    for number in 3..30 {
        set.film(number, Layout::Rgb);
    }
    let whole = 3 * (WIDTH * HEIGHT) as usize;
    assert_eq!(set.colours.bytes(), whole * crate::frames::RING_FRAMES);
    set.colours.clear();
    assert_eq!(set.colours.bytes(), 0);
}

#[test]
fn a_crop_shows_the_foreground_and_nothing_of_the_room() {
    for scale_log2 in 0..=MAX_SCALE_LOG2 {
        let set = Set::new();
        set.colours.request(0, false);
        set.film(0, Layout::Rgb);
        let Picture { frame, captured_unix_s, camera: picture } =
            set.picture(0, PictureKind::Crops, scale_log2);
        assert_eq!((picture.rig_index, frame, captured_unix_s), (3, 0, 5.0));
        let [left, top, width, height] = picture.crop.map(u32::from);
        let block = 8 << scale_log2;
        assert_eq!((left % block, top % block), (0, 0));
        assert!(left <= 22 && top <= 12 && left + width >= 68 && top + height >= 58, "{:?}", picture.crop);
        let image = decoded(&picture.jpeg);
        let cells = |side: u32| side.div_ceil(1 << scale_log2);
        assert_eq!(image.dimensions(), (cells(width), cells(height)));
        for pixel in image.pixels() {
            is_near(*pixel, [220, 120, 40], 8);
        }
    }
}

#[test]
fn every_layout_gives_its_colours() {
    let i420 = Layout::Planar(Sampling::C420, Range::Limited);
    let nv12 = Layout::Nv12(Range::Full);
    for layout in [Layout::Rgb, i420, nv12, Layout::Yuyv(Range::Limited), Layout::Uyvy(Range::Full)] {
        let set = Set::new();
        set.colours.request(0, false);
        set.film(0, layout);
        let crop = set.camera(0, PictureKind::Crops, 0);
        let [left, top, ..] = crop.crop.map(u32::from);
        is_near(*decoded(&crop.jpeg).get_pixel(45 - left, 35 - top), [220, 120, 40], 8);
        set.colours.request(0, true);
        set.film(1, layout);
        let whole = set.camera(1, PictureKind::Whole, 1);
        assert!(whole.runs.is_empty());
        let image = decoded(&whole.jpeg);
        assert_eq!(whole.crop.map(u32::from), [0, 0, WIDTH, HEIGHT]);
        assert_eq!(image.dimensions(), (WIDTH / 2, HEIGHT / 2));
        is_near(*image.get_pixel(22, 17), [220, 120, 40], 8);
        is_near(*image.get_pixel(4, 4), [20, 200, 30], 8);
    }
}

#[test]
fn runs_are_the_silhouette() {
    let set = Set::new();
    set.film(0, Layout::Rgb);
    let runs = set.camera(0, PictureKind::Silhouettes, 0).runs;
    let back = proto::convert::silhouette_from_data(&runs, (WIDTH, HEIGHT), SilhouetteEncoding::Runs);
    assert_eq!(back.expect("a silhouette"), film_frame(Layout::Rgb).1);
    assert_eq!(set.colours.bytes(), 0, "no viewer requested colours");
}

#[test]
fn a_request_that_cannot_be_met_is_refused_with_the_reason() {
    let set = Set::new();
    let refused = |frame, cameras: &[u16]| {
        let (kind, cameras) = (PictureKind::Crops, cameras.to_vec());
        let request = PictureRequest { frame, kind, scale_log2: 0, jpeg_quality: 80, cameras };
        set.encoder.request(request, drop).expect_err("refused").to_string()
    };
    assert_eq!(refused(Some(0), &[]), "no frame has come yet");
    assert_eq!(refused(None, &[3]), "no frame has come yet");
    set.film(7, Layout::Rgb);
    assert_eq!(refused(Some(u64::MAX), &[]), "frame 18446744073709551615 has not come yet: the newest is 7");
    assert_eq!(refused(None, &[1]), "cameras [1] of a picture, expected some of [3], each once");
    assert_eq!(refused(None, &[3; 60_000]), "cameras [3, 3] of a picture, expected some of [3], each once");
}

#[test]
fn a_thin_foreground_is_shown_as_it_is() {
    let set = Set::new();
    set.colours.request(0, false);
    let (image, _) = film_frame(Layout::Rgb);
    let mut mask = vec![0; (WIDTH * HEIGHT) as usize];
    mask[(40 * WIDTH + 40) as usize] = 1;
    let silhouette = hull::Silhouette::from_mask(WIDTH, HEIGHT, &mask).expect("size");
    set.colours.keep(0, 0, &image, &silhouette);
    let colour = set.colours.get(0, 0).expect("kept");
    let encoded = encode::crop(&colour, &silhouette, 0, 90).expect("a picture");
    is_near(*decoded(&encoded.jpeg).get_pixel(0, 0), [220, 120, 40], 8);
}
