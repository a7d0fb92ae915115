//! Whether the numbers of images are frames of film, or times, or numbers that begin elsewhere. Film without images is
//! a run without a hull: that is never begun without a word.

use std::fmt;
use std::num::NonZeroU64;

use thiserror::Error;

/// Longer film without images is worth a warning, seconds …
const NOTED_S: f64 = 1.0;
/// … and longer than that is no film, seconds.
const MOST_S: f64 = 60.0;

/// Times are usually so far apart at least, and a number of frames may be so uneven below.
const LEAST_OF_TIMES: u64 = 3;
/// So many distances tell times from numbers of frames.
const SURE_DISTANCES: usize = 8;

/// How far images are apart, in numbers of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spacing {
    /// The usual distance.
    usual: u64,
    /// Whether all distances are multiples of it.
    is_regular: bool,
}

/// Why the numbers of images are no frames of film.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FilmTimeError {
    /// The first image is long after frame 0.
    #[error("image numbers start at {first}, which is {after_s:.1} s of film after frame 0: {}", start_advice(*.first, *.spacing))]
    Start {
        /// Its number.
        first: u64,
        /// Its film time, seconds.
        after_s: f64,
        /// How far images are apart.
        spacing: Spacing,
    },
    /// Usual neighbours are seconds of film apart, or as unevenly apart as times are.
    #[error("image numbers are usually {} apart, which is {apart_s:.1} s of film: {}", .spacing.usual, apart_advice(*.spacing))]
    Apart {
        /// The usual distance between image numbers, and whether it is regular.
        spacing: Spacing,
        /// The same as film time, seconds.
        apart_s: f64,
    },
    /// A gap that no film has.
    #[error(
        "found no image between numbers {before} and {after}, which is {gap_s:.1} s of film; expected at most \
         {MOST_S:.0} s: move images of another film out of the folder"
    )]
    Gap {
        /// The number before it.
        before: u64,
        /// The number after it.
        after: u64,
        /// Its film time, seconds.
        gap_s: f64,
    },
}

/// What is unusual about the numbers of images.
#[derive(Clone, Debug, PartialEq)]
pub enum FilmNote {
    /// Film begins late, and `start_frame` says so.
    Late { first: u64, after_s: f64 },
    /// The longest of some gaps.
    Gaps { before: u64, after: u64, gap_s: f64, count: usize },
    /// Most frames have no image.
    Sparse(Spacing),
}

impl fmt::Display for FilmNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FilmNote::Late { first, after_s } => {
                write!(f, "its first image is number {first}, {after_s:.1} s of film after start_frame")
            }
            FilmNote::Gaps { before, after, gap_s, count } => {
                write!(f, "no image between numbers {before} and {after}, {gap_s:.1} s of film")?;
                if *count > 1 { write!(f, "; {count} gaps of over {NOTED_S:.0} s") } else { Ok(()) }
            }
            FilmNote::Sparse(spacing) => {
                write!(
                    f,
                    "image numbers are usually {} apart, and frames between them have no image: ",
                    spacing.usual
                )?;
                f.write_str(&apart_advice(*spacing))
            }
        }
    }
}

/// Checks frames of a film of `fps`, ascending: `start_frame` plus `frame_step` times each is its file's number.
pub(super) fn check(
    frames: &[u64],
    start_frame: Option<u64>,
    frame_step: NonZeroU64,
    fps: f64,
) -> Result<Vec<FilmNote>, FilmTimeError> {
    let Some(&first_frame) = frames.first() else { return Ok(Vec::new()) };
    let file = |frame: u64| start_frame.unwrap_or(0).saturating_add(frame.saturating_mul(frame_step.get()));
    // Of slow film the next frame may be seconds later.
    let is_over = |frames: u64, seconds: f64| frames as f64 > (seconds * fps).max(1.0);
    let usual = usual_distance(frames);
    let spacing = Spacing {
        usual: usual.saturating_mul(frame_step.get()),
        is_regular: frames.windows(2).all(|pair| (pair[1] - pair[0]).is_multiple_of(usual)),
    };
    let mut notes = Vec::new();
    let (first, after_s) = (file(first_frame), first_frame as f64 / fps);
    let most_s = if start_frame.is_some() { MOST_S } else { NOTED_S };
    if is_over(first_frame, most_s) {
        return Err(FilmTimeError::Start { first, after_s, spacing });
    }
    if is_over(first_frame, NOTED_S) {
        notes.push(FilmNote::Late { first, after_s });
    }
    if is_over(usual, NOTED_S) || are_times(frames, usual) {
        return Err(FilmTimeError::Apart { spacing, apart_s: usual as f64 / fps });
    }
    if usual > 1 {
        notes.push(FilmNote::Sparse(spacing));
    }
    let gaps = frames.windows(2).filter(|pair| is_over(pair[1] - pair[0], NOTED_S));
    let count = gaps.clone().count();
    if let Some(longest) = gaps.max_by_key(|pair| pair[1] - pair[0]) {
        let (before, after, gap) = (file(longest[0]), file(longest[1]), longest[1] - longest[0]);
        let gap_s = gap as f64 / fps;
        if is_over(gap, MOST_S) {
            return Err(FilmTimeError::Gap { before, after, gap_s });
        }
        notes.push(FilmNote::Gaps { before, after, gap_s, count });
    }
    Ok(notes)
}

/// The median distance of neighbours, of ascending numbers; 1 of one image.
pub fn usual_distance(frames: &[u64]) -> u64 {
    let mut distances: Vec<u64> = frames.windows(2).map(|pair| pair[1] - pair[0]).collect();
    distances.sort_unstable();
    // The lower one of two: a gap is no rule.
    distances.get(distances.len().saturating_sub(1) / 2).copied().unwrap_or(1).max(1)
}

/// Whether numbers are times, as milliseconds of 60 images a second (0, 16, 33, 50) are: nearly all about as far apart,
/// and many of these not exactly. Numbers of frames are a multiple of a step apart, or picked.
fn are_times(frames: &[u64], usual: u64) -> bool {
    let distances = || frames.windows(2).map(|pair| pair[1] - pair[0]);
    let count = distances().count();
    let alike = || distances().filter(|distance| distance.abs_diff(usual) <= (usual / 4).max(1));
    let uneven = alike().filter(|&distance| distance != usual).count();
    usual >= LEAST_OF_TIMES
        && count >= SURE_DISTANCES
        && 4 * alike().count() >= 3 * count
        && 10 * uneven >= count
}

fn start_advice(first: u64, spacing: Spacing) -> String {
    match spacing {
        Spacing { usual: 1, .. } => {
            format!("set start_frame = {first}, in every camera the number of the same moment")
        }
        Spacing { usual, is_regular: true } => format!(
            "set start_frame = {first}, in every camera the number of the same moment, and frame_step = {usual} if \
             these images are consecutive frames"
        ),
        Spacing { usual, is_regular: false } => format!("start_frame cannot help: {}", of_times(usual)),
    }
}

fn apart_advice(spacing: Spacing) -> String {
    match spacing {
        Spacing { usual, is_regular: true } => {
            format!("set frame_step = {usual} if these images are consecutive frames")
        }
        Spacing { usual, is_regular: false } => of_times(usual),
    }
}

fn of_times(usual: u64) -> String {
    format!(
        "they are unevenly apart (usually {usual}), as times are; rename the images to consecutive numbers \
         (000000.png, 000001.png, …), in every camera the same number for the same moment"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const FPS: f64 = 30.0;

    fn checked(
        frames: impl IntoIterator<Item = u64>,
        start_frame: Option<u64>,
    ) -> Result<Vec<FilmNote>, FilmTimeError> {
        let frames: Vec<u64> = frames.into_iter().collect();
        check(&frames, start_frame, NonZeroU64::MIN, FPS)
    }

    fn noted(frames: impl IntoIterator<Item = u64>, start_frame: Option<u64>) -> Vec<String> {
        let notes = checked(frames, start_frame).expect("film");
        notes.iter().map(ToString::to_string).collect()
    }

    #[track_caller]
    fn refused(frames: impl IntoIterator<Item = u64>, start_frame: Option<u64>, words: &[&str]) {
        let error = checked(frames, start_frame).expect_err("refused").to_string();
        for word in words {
            assert!(error.contains(word) && !error.contains('\n'), "{word:?} in {error}");
        }
    }

    #[test]
    fn film_from_0_or_from_its_first_second_is_film() {
        for first in [0, 1, 30] {
            assert_eq!(checked(first..first + 90, None), Ok(vec![]), "{first}");
        }
        assert_eq!(checked([0], None), Ok(vec![]));
        assert_eq!(checked([0, 1, 2, 5, 6, 7, 8, 31, 32], None), Ok(vec![]));
        assert_eq!(check(&[1, 2, 3], None, NonZeroU64::MIN, 0.5), Ok(vec![]), "slow film that counts from 1");
    }

    #[test]
    fn numbers_that_begin_elsewhere_name_the_key_to_set() {
        refused(
            1000..1200,
            None,
            &["image numbers start at 1000", "33.3 s", "set start_frame = 1000, in every"],
        );
        refused([31], None, &["image numbers start at 31"]);
        let eighths = (0..20).map(|image| 4000 + 8 * image);
        refused(eighths, None, &["set start_frame = 4000", "frame_step = 8 if these images are consecutive"]);
    }

    #[test]
    fn times_are_refused_with_what_to_do() {
        let jitter = |image: u64| image * 7919 % 1000;
        let nanoseconds = |image: u64| 1_403_636_579_763_555_584 + image * 33_333_333 + jitter(image);
        let words =
            ["image numbers start at 1403636579763555584", "start_frame cannot help", "rename the images"];
        refused((0..40).map(nanoseconds), None, &words);
        let milliseconds = |image: u64| image * 1000 / 30;
        refused((0..40).map(milliseconds), None, &["usually 33 apart", "rename the images"]);
        refused((0..40).map(nanoseconds).map(|time| time - nanoseconds(0)), Some(0), &["rename the images"]);
        refused((0..40).map(|image| 50 * image), None, &["usually 50 apart", "1.7 s", "set frame_step = 50"]);
        let steady = |image: u64| 1_403_636_579_763_555_584 + image * 50_000_000;
        refused(
            (0..40).map(steady),
            None,
            &["set start_frame = 1403636579763555584", "frame_step = 50000000"],
        );
    }

    #[test]
    fn times_of_fast_film_are_refused_and_uneven_numbers_of_frames_noted() {
        for per_second in [60, 90, 120, 240] {
            let milliseconds = (0..60).map(|image| image * 1000 / per_second);
            let numbers: Vec<u64> = milliseconds.collect();
            let error = check(&numbers, None, NonZeroU64::MIN, per_second as f64).expect_err("refused");
            assert!(error.to_string().contains("as times are; rename the images"), "{error}");
        }
        refused((0..60).map(|image| image * 100 / 30), None, &["usually 3 apart", "as times are"]);
        let eighths = (0..40).map(|image| 8 * image).chain([9, 100, 201]);
        let mut numbers: Vec<u64> = eighths.filter(|number| *number != 64).collect();
        numbers.sort_unstable();
        assert_eq!(noted(numbers, None).len(), 1, "every eighth image and three more");
        let picked = (0..40).map(|image: u64| 4 * image + image * image % 4 + image * 7919 % 3);
        assert_eq!(noted(picked, None).len(), 1, "images that were picked");
    }

    #[test]
    fn the_step_of_the_file_counts_in_what_is_advised() {
        let step = NonZeroU64::new(8).expect("not zero");
        let error = check(&[100, 101, 102], None, step, FPS).expect_err("refused").to_string();
        assert!(error.contains("image numbers start at 800") && error.contains("frame_step = 8"), "{error}");
    }

    #[test]
    fn every_eighth_image_is_film_with_a_note() {
        let notes = noted((0..20).map(|image| 8 * image), None);
        assert_eq!(notes.len(), 1, "{notes:?}");
        assert!(notes[0].contains("usually 8 apart") && notes[0].contains("frame_step = 8"), "{notes:?}");
    }

    #[test]
    fn gaps_of_seconds_are_noted_and_gaps_of_minutes_refused() {
        let notes = noted((0..90).chain(200..290).chain(401..410), None);
        assert_eq!(notes, ["no image between numbers 289 and 401, 3.7 s of film; 2 gaps of over 1 s"]);
        refused((0..90).chain([20_240_101]), None, &["between numbers 89 and 20240101", "at most 60 s"]);
    }

    #[test]
    fn a_start_that_was_set_is_taken_with_a_note() {
        let notes = noted(150..300, Some(10));
        assert_eq!(notes, ["its first image is number 160, 5.0 s of film after start_frame"]);
        refused(150_000..150_100, Some(0), &["image numbers start at 150000"]);
    }
}
