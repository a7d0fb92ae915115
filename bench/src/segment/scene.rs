//! What is segmented: the studio with its shadows and its noise, and the recording of a man on a chair.

use std::path::Path;
use std::process::Command;

use hull::Silhouette;
use segment::{Format, Layout, Range, Sampling, SegmentSettings, from_rgb};
use stage::{CameraStage, StageSettings, studio_rig, true_silhouette};

use setup::cli::{Failure, Outcome, Progress};

/// Cameras of the studio, and the one that films.
const STUDIO: (usize, usize) = (8, 1);
/// Frames of the empty room, as many as give its noise; and of the film, with every how many-th taken.
const EMPTY_FRAMES: u64 = 16;
const FILM_FRAMES: u64 = 4;
const FILM_STEP: u64 = 25;
const FILM_START: u64 = 15;

/// Cameras of the recording, every how many-th frame has a reference, and the last that has.
const RECORDED_CAMERAS: [&str; 4] = ["cam1", "cam2", "cam3", "cam4"];
const RECORDED_SIZE: (u32, u32) = (644, 486);
const RECORDED_STEP: usize = 45;
const RECORDED_LAST: usize = 405;

/// The layouts that frames come in, by our engine's name and ffmpeg's.
pub const LAYOUTS: [(&str, Layout, &str); 4] = [
    ("hulltouch_rgb", Layout::Rgb, "rgb24"),
    ("hulltouch_i420", Layout::Planar(Sampling::C420, Range::Limited), "yuv420p"),
    ("hulltouch_nv12", Layout::Nv12(Range::Limited), "nv12"),
    ("hulltouch_yuyv", Layout::Yuyv(Range::Limited), "yuyv422"),
];

/// The frames of one layout.
#[derive(Clone, Debug, Default)]
pub struct Frames {
    /// Of the empty room.
    pub background: Vec<Vec<u8>>,
    /// With the person.
    pub film: Vec<Vec<u8>>,
}

/// One camera's frames in all layouts, and what is true.
pub struct Scene {
    /// Which set it is of.
    pub set: &'static str,
    /// Pixels across and down.
    pub size: (u32, u32),
    /// Settings of our engines.
    pub settings: SegmentSettings,
    /// In the order of [`LAYOUTS`].
    pub frames: Vec<Frames>,
    /// A silhouette for each frame of the film.
    pub truth: Vec<Silhouette>,
}

impl Scene {
    /// The studio at some size: a person who moves, shadows, sensor noise.
    pub fn studio(size: (u32, u32)) -> Outcome<Scene> {
        let input = |problem: &dyn std::fmt::Display| Failure::input(format_args!("--size: {problem}"));
        let rig = studio_rig(STUDIO.0, size).map_err(|error| input(&error))?;
        let settings = StageSettings::default();
        let mut camera = CameraStage::new(&settings, &rig.cameras()[STUDIO.1], STUDIO.1);
        let mut progress = Progress::new("filming", EMPTY_FRAMES + FILM_FRAMES);
        let (mut frames, mut truth) = (vec![Frames::default(); LAYOUTS.len()], Vec::new());
        let mut rgb = vec![0; camera.frame_bytes()];
        for number in 0..EMPTY_FRAMES {
            camera.render_empty(number, &mut rgb);
            for (frames, bytes) in frames.iter_mut().zip(in_layouts(&rgb, size)?) {
                frames.background.push(bytes);
            }
            progress.step();
        }
        for number in (0..FILM_FRAMES).map(|at| FILM_START + FILM_STEP * at) {
            camera.render(number, &mut rgb);
            for (frames, bytes) in frames.iter_mut().zip(in_layouts(&rgb, size)?) {
                frames.film.push(bytes);
            }
            truth.push(
                true_silhouette(&settings, camera.camera(), settings.time_s(number)).map_err(Failure::run)?,
            );
            progress.step();
        }
        Ok(Scene { set: "stage", size, settings: SegmentSettings::default(), frames, truth })
    }

    /// The cameras of `uu_horseman`, decoded by ffmpeg into each layout; the failure says why not.
    pub fn recording(datasets: &Path) -> Outcome<Vec<Scene>> {
        let folder = datasets.join("uu_horseman");
        let mut progress = Progress::new("decoding", RECORDED_CAMERAS.len() as u64);
        let scene = |camera: &&str| {
            let videos = folder.join("videos").join(camera);
            let chosen = format!("select='not(mod(n,{RECORDED_STEP}))*lte(n,{RECORDED_LAST})'");
            let decoded = LAYOUTS.iter().map(|&(_, layout, pixel_format)| {
                let format = Format::new(layout, RECORDED_SIZE.0, RECORDED_SIZE.1);
                let bytes = format.map_err(Failure::run)?.frame_bytes();
                Ok(Frames {
                    background: decoded(&videos.join("background.avi"), bytes, pixel_format, "null")?,
                    film: decoded(&videos.join("video.avi"), bytes, pixel_format, &chosen)?,
                })
            });
            let frames = decoded.collect::<Outcome<Vec<Frames>>>()?;
            let numbers = (0..=RECORDED_LAST).step_by(RECORDED_STEP);
            let references = folder.join("silhouettes").join(camera);
            let truth = numbers.map(|number| reference(&references.join(format!("{number:06}.png"))));
            let truth = truth.collect::<Outcome<Vec<Silhouette>>>()?;
            if frames.iter().any(|frames| frames.film.len() != truth.len()) {
                return Err(Failure::unreadable(&videos, "other frames than references"));
            }
            progress.step();
            // The chair and the flicker of lamps are smaller than the man, as the cluster file says.
            let settings = SegmentSettings { keep_largest: Some(1), ..SegmentSettings::default() };
            Ok(Scene { set: "uu_horseman", size: RECORDED_SIZE, settings, frames, truth })
        };
        RECORDED_CAMERAS.iter().map(scene).collect()
    }
}

/// One picture in every layout.
fn in_layouts(rgb: &[u8], (width, height): (u32, u32)) -> Outcome<Vec<Vec<u8>>> {
    let bytes = LAYOUTS.map(|(_, layout, _)| {
        let mut bytes = Vec::new();
        from_rgb(rgb, Format::new(layout, width, height).map_err(Failure::run)?, &mut bytes);
        Ok(bytes)
    });
    bytes.into_iter().collect()
}

fn decoded(video: &Path, frame_bytes: usize, pixel_format: &str, filter: &str) -> Outcome<Vec<Vec<u8>>> {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-nostdin", "-i"]).arg(video);
    ffmpeg.args(["-vf", filter, "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", pixel_format, "-"]);
    let output = ffmpeg.output().map_err(|error| Failure::run(format_args!("ffmpeg: {error}")))?;
    if !output.status.success() || output.stdout.is_empty() || output.stdout.len() % frame_bytes != 0 {
        let words = String::from_utf8_lossy(&output.stderr);
        let last = words.lines().last().unwrap_or("frames of another size");
        return Err(Failure::unreadable(video, last));
    }
    Ok(output.stdout.chunks_exact(frame_bytes).map(<[u8]>::to_vec).collect())
}

fn reference(path: &Path) -> Outcome<Silhouette> {
    let image = image::open(path).map_err(|error| Failure::unreadable(path, error))?.into_luma8();
    let mask: Vec<u8> = image.iter().map(|&level| u8::from(level > 127)).collect();
    Silhouette::from_mask(image.width(), image.height(), &mask).map_err(Failure::run)
}
