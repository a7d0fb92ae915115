//! What can be known of films in image files before a run begins: whether their numbers are frames of film, whether
//! their first mask is one, and whether the cameras have frames in common.

use std::collections::BTreeSet;

use thiserror::Error;

use crate::config::{NodeCamera, NodeConfig};
use crate::source::{Image, OpenContext, SourceError};

/// Why a run over these films would have no hull.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FilmCheckError {
    /// One camera's files.
    #[error("camera {camera:?}: {error}")]
    Source {
        /// Its name.
        camera: String,
        /// What is wrong with them.
        error: SourceError,
    },
    /// No frame has an image of each camera.
    #[error(
        "camera {camera:?} has images of frames {} to {}, none of which has an image of every camera before it ({}): \
         expected the same numbers for the same moments, or start_frame and frame_step that make them so",
        .range.0, .range.1, .others.join(", ")
    )]
    NothingInCommon {
        /// The first camera that has no frame in common with the others.
        camera: String,
        /// Its first and last frame.
        range: (u64, u64),
        /// The cameras before it.
        others: Vec<String>,
    },
    /// A lock-step run would wait for ever.
    #[error(
        "camera {camera:?} has no image from frame {from} on before frame {up_to}, and others have: a lock-step run \
         (--unpaced) goes {ahead} frames ahead and would wait for ever: expected the same numbers for the same moments \
         (start_frame and frame_step shift them), or a run without --unpaced"
    )]
    Stalls {
        /// The camera that lacks frames.
        camera: String,
        /// The first frame that the run would wait for.
        from: u64,
        /// The frame with which it would go on.
        up_to: u64,
        /// How far cameras film ahead of the frame in use.
        ahead: u64,
    },
}

/// A film that ends a run early.
#[derive(Clone, Debug, PartialEq, Error)]
#[error(
    "camera {camera:?} has images up to frame {last}, and {longest:?} up to {longest_last}: film ends {early_s:.1} s \
     early, with the shortest"
)]
pub struct ShortFilm {
    /// Whose film is the shortest.
    camera: String,
    last: u64,
    /// Whose film is the longest.
    longest: String,
    longest_last: u64,
    early_s: f64,
}

/// A camera whose film is numbered images.
struct ImageFilm<'a> {
    camera: &'a str,
    frames: Vec<u64>,
}

impl NodeConfig {
    /// Checks the cameras' image files, and against each other. Returns what is worth a warning. Of a lock-step run
    /// `ahead` is how many frames cameras film ahead of the one in use.
    pub fn check_films(&self, ahead: Option<u64>) -> Result<Option<ShortFilm>, FilmCheckError> {
        let mut films = Vec::new();
        for camera in &self.cameras {
            let name = camera.camera.name();
            let refused = |error| FilmCheckError::Source { camera: name.to_owned(), error };
            let Some(frames) = camera.source.image_frames(self.fps) else { continue };
            let frames = frames.map_err(refused)?;
            check_first_mask(camera, self.fps).map_err(refused)?;
            // A single image is a plate, held for the run.
            if frames.len() > 1 {
                films.push(ImageFilm { camera: name, frames });
            }
        }
        let common = check_common(&films)?;
        ahead.map_or(Ok(()), |ahead| check_lock_step(&films, &common, ahead))?;
        Ok(short_film(&films, self.fps))
    }
}

fn check_first_mask(camera: &NodeCamera, fps: f64) -> Result<(), SourceError> {
    if !camera.source.gives_masks() {
        return Ok(());
    }
    let context = OpenContext::outside_runs(fps);
    let mut source = camera.source.open(&camera.camera, usize::from(camera.rig_index), &context)?;
    source.next(0, &mut Image::default()).map(|_| ())
}

/// The frames that all films have.
fn check_common(films: &[ImageFilm<'_>]) -> Result<BTreeSet<u64>, FilmCheckError> {
    let Some((first, others)) = films.split_first() else { return Ok(BTreeSet::new()) };
    let mut common: BTreeSet<u64> = first.frames.iter().copied().collect();
    for (before, film) in (1..).zip(others) {
        let here: BTreeSet<u64> = film.frames.iter().copied().collect();
        common = common.intersection(&here).copied().collect();
        if common.is_empty() {
            let range = (film.frames[0], film.frames[film.frames.len() - 1]);
            let others = films[..before].iter().map(|film| film.camera.to_owned()).collect();
            return Err(FilmCheckError::NothingInCommon { camera: film.camera.to_owned(), range, others });
        }
    }
    Ok(common)
}

/// Refuses films over which a lock-step run would wait for ever. A step wants the frame after the newest common one.
/// Cameras may then film `ahead` frames further, and each gives its next image once the frame after its last is allowed.
fn check_lock_step(
    films: &[ImageFilm<'_>],
    common: &BTreeSet<u64>,
    ahead: u64,
) -> Result<(), FilmCheckError> {
    let mut wanted = 0;
    for &frame in common {
        let allowed = wanted + ahead;
        let next_after = |film: &ImageFilm<'_>| {
            let at = film.frames.partition_point(|&number| number < frame);
            at.checked_sub(1).map_or(0, |before| film.frames[before] + 1)
        };
        if films.iter().any(|film| next_after(film) > allowed) {
            // The camera whose gap before the frame is the longest.
            let Some(camera) = films.iter().min_by_key(|film| next_after(film)) else { return Ok(()) };
            let from = next_after(camera);
            return Err(FilmCheckError::Stalls {
                camera: camera.camera.to_owned(),
                from,
                up_to: frame,
                ahead,
            });
        }
        wanted = frame.saturating_add(1);
    }
    Ok(())
}

/// The shortest film, if it ends over a second before the longest.
fn short_film(films: &[ImageFilm<'_>], fps: f64) -> Option<ShortFilm> {
    let last = |film: &&ImageFilm<'_>| film.frames.last().copied();
    let (shortest, longest) = (films.iter().min_by_key(last)?, films.iter().max_by_key(last)?);
    let (shortest_last, longest_last) = (last(&shortest)?, last(&longest)?);
    let early = longest_last - shortest_last;
    let is_early = early as f64 > fps.max(1.0);
    is_early.then(|| ShortFilm {
        camera: shortest.camera.to_owned(),
        last: shortest_last,
        longest: longest.camera.to_owned(),
        longest_last,
        early_s: early as f64 / fps,
    })
}

#[cfg(test)]
mod tests {
    use std::ops::Range;
    use std::path::Path;

    use hull::ProbeSettings;
    use segment::SegmentSettings;

    use super::*;
    use crate::source::{FileConfig, SourceConfig};

    /// A node of cameras whose masks have these numbers.
    fn node(folder: &Path, numbers: &[Vec<u64>]) -> NodeConfig {
        let camera = |(index, numbers): (usize, &Vec<u64>)| {
            let path = folder.join(index.to_string());
            std::fs::create_dir_all(&path).expect("a folder");
            for number in numbers {
                image::GrayImage::new(8, 4).save(path.join(format!("{number}.png"))).expect("written");
            }
            NodeCamera {
                camera: crate::source::tests::camera(8, 4),
                rig_index: index as u16,
                source: SourceConfig::Masks(FileConfig::new(path)),
                background: None,
                segmentation: SegmentSettings::default(),
                ignored: None,
            }
        };
        let cameras = numbers.iter().enumerate().map(camera).collect();
        NodeConfig { cameras, settings: ProbeSettings::default(), fps: 30.0 }
    }

    fn check(numbers: &[Vec<u64>]) -> Result<Option<ShortFilm>, FilmCheckError> {
        let folder = tempfile::tempdir().expect("folder");
        node(folder.path(), numbers).check_films(None)
    }

    fn every(range: Range<u64>, step: usize) -> Vec<u64> {
        range.step_by(step).collect()
    }

    #[test]
    fn cameras_that_share_frames_are_film() {
        assert_eq!(check(&[every(0..20, 1), every(1..21, 1), every(0..20, 2)]), Ok(None));
        assert_eq!(check(&[every(0..20, 1), vec![0]]), Ok(None), "a plate is held");
    }

    #[test]
    fn cameras_without_a_common_frame_are_named() {
        let error =
            check(&[every(0..20, 1), every(0..20, 2), every(1..20, 2)]).expect_err("refused").to_string();
        assert!(
            error.contains("frames 1 to 19, none of which has an image of every camera before it"),
            "{error}"
        );
        assert!(check(&[every(0..10, 1), every(11..30, 1)]).is_err());
    }

    #[test]
    fn a_camera_that_begins_later_is_refused_by_name() {
        let error = check(&[every(0..90, 1), every(60..90, 1)]).expect_err("refused").to_string();
        assert!(
            error.starts_with("camera \"cam\": ") && error.contains("image numbers start at 60"),
            "{error}"
        );
    }

    #[test]
    fn a_film_that_ends_seconds_before_the_others_is_noted() {
        let note = check(&[every(0..90, 1), every(0..30, 1)]).expect("film").expect("a note").to_string();
        assert!(
            note.contains("up to frame 29") && note.contains("up to 89: film ends 2.0 s early"),
            "{note}"
        );
    }

    #[test]
    fn films_over_which_a_lock_step_run_would_wait_for_ever_are_refused_at_once() {
        let lock_step = |numbers: &[Vec<u64>]| {
            let folder = tempfile::tempdir().expect("folder");
            node(folder.path(), numbers).check_films(Some(4))
        };
        let with_gap =
            |gap: Range<u64>| -> Vec<u64> { (0..40).filter(|frame| !gap.contains(frame)).collect() };
        for numbers in [
            [every(0..40, 1), every(4..40, 1)],
            [every(0..40, 1), with_gap(8..12)],
            [with_gap(8..30), with_gap(8..30)],
            [every(0..40, 1), every(0..40, 5)],
        ] {
            assert_eq!(lock_step(&numbers), Ok(None), "{numbers:?}");
        }
        for (numbers, message) in [
            ([every(0..40, 1), every(5..40, 1)], "no image from frame 0 on before frame 5"),
            ([every(0..40, 1), with_gap(8..13)], "no image from frame 8 on before frame 13"),
            ([every(0..40, 1), with_gap(8..30)], "no image from frame 8 on before frame 30"),
        ] {
            assert!(check(&numbers).is_ok(), "real time does not wait");
            let error = lock_step(&numbers).expect_err("refused").to_string();
            assert!(error.contains(message) && error.starts_with("camera \"cam\" "), "{error}");
        }
    }

    #[test]
    fn a_first_mask_that_is_none_is_refused_before_a_run() {
        let folder = tempfile::tempdir().expect("folder");
        let node = node(folder.path(), &[vec![0, 1]]);
        let labels = image::GrayImage::from_fn(8, 4, |x, _| image::Luma([x as u8 / 3]));
        labels.save(folder.path().join("0/0.png")).expect("written");
        let error = node.check_films(None).expect_err("refused").to_string();
        assert!(error.contains("0/0.png: found the grey values 0, 1, 2"), "{error}");
    }
}
