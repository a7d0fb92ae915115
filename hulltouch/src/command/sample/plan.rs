//! The numbers of a sample, checked, and what follows from them.

use std::fmt::Display;
use std::ops::RangeInclusive;

use hull::Rig;
use segment::{Format, Layout, Range, Sampling};
use setup::cli::{Failure, Outcome};
use stage::{Motion, StageSettings, studio_rig};

/// Each of the two nodes needs a camera.
const CAMERAS: RangeInclusive<usize> = 2..=64;
/// A side of an image, pixels.
const SIDE_PX: RangeInclusive<u32> = 64..=4096;
/// A film's length, seconds.
const SECONDS: RangeInclusive<f64> = 0.1..=600.0;
/// Frames a second.
const FPS: RangeInclusive<u32> = 1..=1000;
/// Frames of an empty room: the deviation of a pixel is then known to an eighth.
pub const EMPTY_FRAMES: u64 = 32;
/// What the person does: the motion of the scene.
pub const MOTION: Motion = Motion::Sweep;
/// The line before each frame of a film.
pub const FRAME_LINE: &[u8] = b"FRAME\n";

/// What the command line gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleNumbers {
    /// How many cameras the room has.
    pub cameras: usize,
    /// Width and height of their images, pixels.
    pub size: (u32, u32),
    /// The films' length, seconds.
    pub seconds: f64,
    /// Frames a second.
    pub fps: u32,
    /// Of the films' noise and of the cluster file.
    pub seed: u64,
}

/// A sample that can be written.
#[derive(Debug)]
pub struct Plan {
    /// The checked numbers.
    pub numbers: SampleNumbers,
    /// The studio's cameras.
    pub rig: Rig,
    /// Of every frame.
    pub format: Format,
    /// Frames of each film.
    pub frames: u64,
}

impl Plan {
    /// Refuses numbers out of range.
    pub fn checked(numbers: SampleNumbers) -> Outcome<Plan> {
        let SampleNumbers { cameras, size: (width, height), seconds, fps, .. } = numbers;
        within("--cameras", &cameras, &CAMERAS)?;
        within("--seconds", &seconds, &SECONDS)?;
        within("--fps", &fps, &FPS)?;
        if !SIDE_PX.contains(&width) || !SIDE_PX.contains(&height) {
            let (least, most) = SIDE_PX.into_inner();
            return Err(Failure::input(format_args!(
                "--size is {width}x{height}, expected {least}x{least} to {most}x{most} pixels"
            )));
        }
        let rig = studio_rig(cameras, numbers.size)
            .map_err(|error| Failure::input(format_args!("--size: {error}")))?;
        let format = Format::new(Layout::Planar(Sampling::C420, Range::Limited), width, height)
            .map_err(|error| Failure::input(format_args!("--size: {error}")))?;
        let frames = ((seconds * f64::from(fps)).round() as u64).max(1);
        Ok(Plan { numbers, rig, format, frames })
    }

    /// The sample in a few words.
    pub fn title(&self) -> String {
        let SampleNumbers { cameras, size: (width, height), seconds, fps, .. } = self.numbers;
        format!("{cameras} cameras of {width}x{height}, {seconds} s at {fps} frames/s")
    }

    /// The studio as the cameras film it.
    pub fn stage(&self) -> StageSettings {
        StageSettings {
            seed: self.numbers.seed,
            motion: MOTION,
            fps: f64::from(self.numbers.fps),
            ..StageSettings::default()
        }
    }

    /// The first line of every film, as ffmpeg writes it.
    pub fn film_header(&self) -> String {
        let SampleNumbers { size: (width, height), fps, .. } = self.numbers;
        format!("YUV4MPEG2 W{width} H{height} F{fps}:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n")
    }

    /// Frames of all films and empty rooms.
    pub fn all_frames(&self) -> u64 {
        self.numbers.cameras as u64 * (self.frames + EMPTY_FRAMES)
    }

    /// Bytes of all films and empty rooms.
    pub fn film_bytes(&self) -> u64 {
        let headers = 2 * self.numbers.cameras as u64 * self.film_header().len() as u64;
        headers + self.all_frames() * (FRAME_LINE.len() + self.format.frame_bytes()) as u64
    }
}

fn within<T: PartialOrd + Display>(option: &str, found: &T, range: &RangeInclusive<T>) -> Outcome {
    if range.contains(found) {
        return Ok(());
    }
    let (least, most) = (range.start(), range.end());
    Err(Failure::input(format_args!("{option} is {found}, expected {least} to {most}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: SampleNumbers =
        SampleNumbers { cameras: 4, size: (320, 240), seconds: 2.0, fps: 30, seed: 1 };

    #[test]
    fn numbers_out_of_range_are_refused_with_both_bounds() {
        for (numbers, message) in [
            (SampleNumbers { cameras: 1, ..SMALL }, "--cameras is 1, expected 2 to 64"),
            (SampleNumbers { cameras: 65, ..SMALL }, "--cameras is 65, expected 2 to 64"),
            (
                SampleNumbers { size: (63, 480), ..SMALL },
                "--size is 63x480, expected 64x64 to 4096x4096 pixels",
            ),
            (
                SampleNumbers { size: (640, 4097), ..SMALL },
                "--size is 640x4097, expected 64x64 to 4096x4096 pixels",
            ),
            (SampleNumbers { seconds: 0.0, ..SMALL }, "--seconds is 0, expected 0.1 to 600"),
            (SampleNumbers { seconds: f64::NAN, ..SMALL }, "--seconds is NaN, expected 0.1 to 600"),
            (SampleNumbers { seconds: 601.0, ..SMALL }, "--seconds is 601, expected 0.1 to 600"),
            (SampleNumbers { fps: 0, ..SMALL }, "--fps is 0, expected 1 to 1000"),
        ] {
            assert_eq!(Plan::checked(numbers).expect_err(message), Failure::Input(message.to_owned()));
        }
    }

    #[test]
    fn sizes_are_known_before_anything_is_written() {
        let plan = Plan::checked(SMALL).expect("in range");
        assert_eq!((plan.frames, plan.all_frames()), (60, 4 * (60 + 32)));
        let frame = 6 + 320 * 240 * 3 / 2;
        let header = "YUV4MPEG2 W320 H240 F30:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\n";
        assert_eq!(plan.film_header(), header);
        assert_eq!(plan.film_bytes(), 4 * (2 * header.len() as u64 + 92 * frame));
        assert_eq!(plan.title(), "4 cameras of 320x240, 2 s at 30 frames/s");
        let short = Plan::checked(SampleNumbers { seconds: 0.1, fps: 1, ..SMALL }).expect("in range");
        assert_eq!(short.frames, 1);
    }
}
