//! Files whose names hold the numbers of their frames.

use std::collections::BTreeSet;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::SourceError;
use super::config::FileConfig;
use super::film::Numbering;
use super::film_numbers::{self, FilmNote};

/// A name whose digits are a larger number than any frame has.
struct TooLarge;

/// The frames that the files are, ascending. `config.path` is a folder (a file's number is the last run of digits in
/// its name), a folder with a pattern as last part (`frame_%06d.png`), or one image, which is frame 0.
pub(super) fn frames(config: &FileConfig) -> Result<Vec<(u64, PathBuf)>, SourceError> {
    let path = &config.path;
    let files = numbered_images(path)?;
    let (first, last) = (files.first().map(|f| f.0), files.last().map(|f| f.0));
    let (start, step) = (config.start_frame.unwrap_or(0), config.frame_step);
    let numbering = Numbering::new(start, step);
    let numbered = files.into_iter().filter_map(|(index, path)| Some((numbering.number(index)?, path)));
    let frames: Vec<(u64, PathBuf)> = numbered.collect();
    match (first, last) {
        _ if !frames.is_empty() => Ok(frames),
        (Some(first), Some(last)) => Err(SourceError::file(
            path,
            format_args!(
                "numbers {first} to {last}, none of them start_frame {start} plus a multiple of frame_step {step}"
            ),
        )),
        _ => Err(SourceError::file(path, "found no numbered image, expected .png or .jpg files")),
    }
}

/// Whether the files' numbers are frames of film at so many a second, and what is worth a warning.
pub(super) fn check(
    config: &FileConfig,
    frames: &[(u64, PathBuf)],
    fps: f64,
) -> Result<Vec<FilmNote>, SourceError> {
    let numbers: Vec<u64> = frames.iter().map(|frame| frame.0).collect();
    film_numbers::check(&numbers, config.start_frame, config.frame_step, fps)
        .map_err(|error| SourceError::file(&config.path, error))
}

/// The images of a folder, a pattern or a single file with their numbers, ascending. An error if two have one number, or
/// if names are decimal numbers.
pub fn numbered_images(path: &Path) -> Result<Vec<(u64, PathBuf)>, SourceError> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let mut files = if name.contains('%') {
        let expected = "expected one %d or %06d in the file name, and no other %";
        let pattern = Pattern::parse(name).ok_or_else(|| SourceError::file(path, expected))?;
        listed(path.parent().unwrap_or(Path::new(".")), |name| pattern.number(name))?
    } else if path.is_dir() {
        listed(path, plain_number)?
    } else if path.is_file() {
        vec![(0, path.to_owned())]
    } else {
        return Err(SourceError::file(path, "no such file or folder"));
    };
    files.sort();
    if path.is_dir() {
        refuse_other_formats(path, &files)?;
    }
    refuse_copies(path, &files)?;
    refuse_twice(path, &files)?;
    refuse_decimals(path, &files)?;
    Ok(files)
}

/// Refuses `12.webp` among PNG and JPEG files that are named as it is, where these have no number 12: passed over, it would
/// be a missing frame.
fn refuse_other_formats(path: &Path, files: &[(u64, PathBuf)]) -> Result<(), SourceError> {
    const OTHERS: [&str; 13] =
        ["webp", "bmp", "tif", "tiff", "gif", "pgm", "ppm", "pbm", "pnm", "jp2", "avif", "heic", "exr"];
    let around = |file: &Path| -> Option<(String, String)> {
        let stem = file.file_stem()?.to_str()?;
        let digits = last_digits(stem)?;
        Some((stem[..digits.start].to_owned(), stem[digits.end..].to_owned()))
    };
    let known: BTreeSet<(String, String)> = files.iter().filter_map(|(_, file)| around(file)).collect();
    let numbers: BTreeSet<u64> = files.iter().map(|(number, _)| *number).collect();
    for entry in fs::read_dir(path).map_err(|error| SourceError::file(path, error))? {
        let file = entry.map_err(|error| SourceError::file(path, error))?.path();
        let extension = file.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        if !OTHERS.iter().any(|other| extension.eq_ignore_ascii_case(other)) {
            continue;
        }
        let stem = file.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        let number = last_digits(stem).and_then(|digits| stem[digits].parse::<u64>().ok());
        let is_named_alike = around(&file).is_some_and(|around| known.contains(&around));
        if is_named_alike && number.is_some_and(|number| !numbers.contains(&number)) {
            let problem = "found an image of another format among the frames, expected .png or .jpg";
            return Err(SourceError::file(&file, problem));
        }
    }
    Ok(())
}

/// Where the last run of digits of a name is.
fn last_digits(stem: &str) -> Option<Range<usize>> {
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        // The character before the digits may be longer than a byte.
        at + stem[at..].chars().next().map_or(1, char::len_utf8)
    });
    Some(start..end)
}

/// Refuses a copy that a browser or a file manager made, `12 (1).png` beside `12.png`: it is not image 1.
fn refuse_copies(path: &Path, files: &[(u64, PathBuf)]) -> Result<(), SourceError> {
    let stem =
        |path: &'_ Path| path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default().to_owned();
    let stems: BTreeSet<String> = files.iter().map(|(_, file)| stem(file)).collect();
    let original = |file: &Path| {
        let name = stem(file);
        let (base, number) = name.strip_suffix(')')?.rsplit_once('(')?;
        let is_copy = number.bytes().all(|byte| byte.is_ascii_digit()) && stems.contains(base.trim_end());
        is_copy.then(|| base.trim_end().to_owned())
    };
    match files.iter().find_map(|(_, file)| Some((file, original(file)?))) {
        Some((copy, base)) => {
            let problem = format!(
                "{} is a copy of {base:?} by its name, expected one image: remove it",
                copy.display()
            );
            Err(SourceError::file(path, problem))
        }
        None => Ok(()),
    }
}

/// Refuses files of one number, and names the pattern that tells them apart.
fn refuse_twice(path: &Path, files: &[(u64, PathBuf)]) -> Result<(), SourceError> {
    let Some(twice) = files.windows(2).find(|pair| pair[0].0 == pair[1].0) else { return Ok(()) };
    let (one, other) = (&twice[0].1, &twice[1].1);
    let name = |path: &Path| path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
    let hint = pattern_between(&name(one), &name(other)).map_or_else(String::new, |pattern| {
        format!(" (the last digits of a name): if others are, end path with a pattern, as in {pattern:?}")
    });
    let problem = format!("{} and {} are both number {}{hint}", one.display(), other.display(), twice[0].0);
    Err(SourceError::file(path, problem))
}

/// The pattern of two names that differ in one run of digits.
fn pattern_between(one: &str, other: &str) -> Option<String> {
    let is_digit = |c: &char| c.is_ascii_digit();
    let (one_runs, other_runs) = (runs(one), runs(other));
    let is_alike = |(a, b): (&&str, &&str)| {
        a == b || (a.starts_with(|c| is_digit(&c)) && b.starts_with(|c| is_digit(&c)))
    };
    if one.contains('%')
        || one_runs.len() != other_runs.len()
        || !one_runs.iter().zip(&other_runs).all(is_alike)
    {
        return None;
    }
    let mut differ = one_runs.iter().zip(&other_runs).enumerate().filter(|(_, (a, b))| a != b);
    let (at, (run, other_run)) = differ.next().filter(|_| differ.next().is_none())?;
    let digits = if run.len() == other_run.len() { format!("%0{}d", run.len()) } else { "%d".to_owned() };
    Some(format!("{}{digits}{}", one_runs[..at].concat(), one_runs[at + 1..].concat()))
}

/// A name cut into digits and what stands between them.
fn runs(name: &str) -> Vec<&str> {
    let mut rest = name;
    let mut runs = Vec::new();
    while let Some(first) = rest.chars().next() {
        let is_digits = first.is_ascii_digit();
        let end = rest.find(|c: char| c.is_ascii_digit() != is_digits).unwrap_or(rest.len());
        let (run, after) = rest.split_at(end);
        runs.push(run);
        rest = after;
    }
    runs
}

/// Refuses names like `1403636579.763.png`: what follows the point is no number of a frame.
fn refuse_decimals(path: &Path, files: &[(u64, PathBuf)]) -> Result<(), SourceError> {
    let mut wholes = files.iter().filter_map(|(_, file)| {
        let (whole, part) = file.file_stem()?.to_str()?.split_once('.')?;
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        (is_number(whole) && is_number(part)).then_some(whole)
    });
    let Some(first) = wholes.next() else { return Ok(()) };
    let Some(other) = wholes.find(|whole| *whole != first) else { return Ok(()) };
    let problem = format!(
        "names are decimal numbers ({first}.… and {other}.…), as times are; expected whole numbers of frames, as in \
         000012.png"
    );
    Err(SourceError::file(path, problem))
}

fn listed(
    folder: &Path,
    number: impl Fn(&str) -> Option<Result<u64, TooLarge>>,
) -> Result<Vec<(u64, PathBuf)>, SourceError> {
    let refused = |error: std::io::Error| SourceError::file(folder, error);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(refused)? {
        let entry = entry.map_err(refused)?;
        let Some(number) = entry.file_name().to_str().and_then(&number) else { continue };
        let too_large = |TooLarge| {
            SourceError::file(
                &entry.path(),
                "the digits of its name are a number over 2⁶⁴, expected a frame's",
            )
        };
        files.push((number.map_err(too_large)?, entry.path()));
    }
    Ok(files)
}

/// The last run of digits in the name of a PNG or JPEG file. Hidden files are none: macOS writes `._000000.png` beside
/// `000000.png` on disks of other systems.
fn plain_number(name: &str) -> Option<Result<u64, TooLarge>> {
    if name.starts_with('.') {
        return None;
    }
    let (stem, extension) = name.rsplit_once('.')?;
    if !["png", "jpg", "jpeg"].iter().any(|known| extension.eq_ignore_ascii_case(known)) {
        return None;
    }
    Some(stem[last_digits(stem)?].parse().map_err(|_| TooLarge))
}

/// A pattern of file names: `before%0<width>dafter`.
struct Pattern<'a> {
    before: &'a str,
    width: usize,
    after: &'a str,
}

impl<'a> Pattern<'a> {
    fn parse(name: &'a str) -> Option<Pattern<'a>> {
        let (before, rest) = name.split_once('%')?;
        let (width, after) = rest.split_once('d')?;
        let width = match width {
            "" => 0,
            zeros => zeros.strip_prefix('0')?.parse().ok().filter(|width| *width <= 20)?,
        };
        (!after.contains('%')).then_some(Pattern { before, width, after })
    }

    fn number(&self, name: &str) -> Option<Result<u64, TooLarge>> {
        let digits = name.strip_prefix(self.before)?.strip_suffix(self.after)?;
        if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
            return None;
        }
        let Ok(number) = digits.parse::<u64>() else { return Some(Err(TooLarge)) };
        (format!("{number:0width$}", width = self.width) == digits).then_some(Ok(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_in_another_format_is_refused_and_neighbours_are_passed_over() {
        let mixed = files(&["a_000.png", "a_001.webp", "a_002.png"]);
        let error = numbered_images(mixed.path()).expect_err("refused").to_string();
        assert!(error.contains("a_001.webp: found an image of another format among the frames"), "{error}");
        let padded = files(&["a_000.png", "a_1.webp", "a_002.png"]);
        assert!(numbered_images(padded.path()).is_err());
        let beside = files(&[
            "a_000.png",
            "a_000.bmp",
            "logo_1.gif",
            "cover.webp",
            "a_001.png",
            "b_000.tif",
            "a2_7.tif",
        ]);
        assert_eq!(numbered_images(beside.path()).expect("two frames").len(), 2);
    }

    fn files(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("folder");
        for name in names {
            fs::write(folder.path().join(name), "").expect("written");
        }
        folder
    }

    #[track_caller]
    fn refused(names: &[&str], message: &str) {
        let folder = files(names);
        let error = frames(&FileConfig::new(folder.path())).expect_err("refused").to_string();
        assert!(error.contains(message) && !error.contains('\n'), "{error}");
    }

    #[test]
    fn numbers_are_the_last_digits_of_a_name() {
        for (name, expected) in [
            ("000045.png", Some(45)),
            ("cam1_0045.PNG", Some(45)),
            ("cam1-45é.jpeg", Some(45)),
            ("é7.jpg", Some(7)),
            ("cam.png", None),
            ("._000045.png", None),
            (".000045.png", None),
            ("7.txt", None),
        ] {
            let number = plain_number(name).map(|number| number.unwrap_or(u64::MAX));
            assert_eq!(number, expected, "{name}");
        }
    }

    #[test]
    fn copies_are_refused_and_numbers_in_brackets_are_read() {
        refused(&["000012.png", "000012 (1).png"], "000012 (1).png is a copy of \"000012\" by its name");
        refused(&["a_7.png", "a_7(2).png"], "is a copy of \"a_7\" by its name");
        let folder = files(&["cam1 (1).png", "cam1 (2).png"]);
        let frames = frames(&FileConfig::new(folder.path())).expect("frames");
        assert_eq!(frames.iter().map(|frame| frame.0).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn hidden_files_are_passed_over() {
        let folder = files(&["000000.png", "._000000.png", "000001.png", "._000001.png"]);
        for path in [folder.path().to_owned(), folder.path().join("%06d.png")] {
            let frames = frames(&FileConfig::new(&path)).expect("frames");
            assert_eq!(frames.iter().map(|frame| frame.0).collect::<Vec<_>>(), [0, 1], "{}", path.display());
        }
    }

    #[test]
    fn a_number_that_no_frame_has_is_refused_by_name() {
        refused(
            &["1.png", "99999999999999999999999.png"],
            "99999999999999999999999.png: the digits of its name",
        );
        let folder = files(&["f99999999999999999999999.png"]);
        let error = frames(&FileConfig::new(folder.path().join("f%d.png"))).expect_err("refused").to_string();
        assert!(error.contains("over 2⁶⁴"), "{error}");
    }

    #[test]
    fn names_that_end_with_another_number_name_the_pattern_that_would_do() {
        let names = ["video_0001_cam2.png", "video_0002_cam2.png"];
        refused(
            &names,
            "are both number 2 (the last digits of a name): if others are, end path with a pattern, as in \
                         \"video_%04d_cam2.png\"",
        );
        refused(&["f9-h264.jpg", "f10-h264.jpg"], "\"f%d-h264.jpg\"");
        refused(&["7.png", "7.jpg"], "are both number 7");
        let folder = files(&names);
        let frames = frames(&FileConfig::new(folder.path().join("video_%04d_cam2.png"))).expect("frames");
        assert_eq!(frames.iter().map(|frame| frame.0).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn decimal_times_are_refused_and_dots_before_a_number_are_not() {
        refused(&["1403636579.763.png", "1403636580.013.png"], "names are decimal numbers (");
        let folder = files(&["shot.1.0001.png", "shot.1.0002.png"]);
        assert_eq!(frames(&FileConfig::new(folder.path())).expect("frames").len(), 2);
        let folder = files(&["3.0001.png", "3.0002.png"]);
        assert_eq!(frames(&FileConfig::new(folder.path())).expect("frames").len(), 2);
    }
}
