//! Camera names from the names of files and folders, and files that look like two versions of one camera.

use hull::rig::MAX_CAMERAS;

use super::ImportError;
use super::natural_order::natural_key;

/// Endings of calibration files, in lower case; the longest first.
const ENDINGS: [&str; 10] =
    [".pmat.cal", ".qca.txt", ".xml", ".yml", ".yaml", ".txt", ".cal", ".rad", ".dat", ".p"];
/// Words that a second version of a file has in its name.
const VERSION_WORDS: [&str; 56] = [
    "old",
    "bak",
    "backup",
    "copy",
    "kopie",
    "copie",
    "copia",
    "orig",
    "original",
    "tmp",
    "temp",
    "prev",
    "previous",
    "new",
    "final",
    "fixed",
    "bad",
    "wrong",
    "test",
    "save",
    "saved",
    "conflict",
    "latest",
    "outdated",
    "obsolete",
    "deprecated",
    "unused",
    "archive",
    "archived",
    "recalib",
    "recalibrated",
    "updated",
    "alt",
    "alte",
    "neu",
    "vieux",
    "ancien",
    "nouveau",
    "refined",
    "rejected",
    "rejects",
    "discard",
    "discarded",
    "broken",
    "trash",
    "junk",
    "ignore",
    "ignored",
    "excluded",
    "deleted",
    "removed",
    "failed",
    "donotuse",
    "spare",
    "attempt",
    "undistorted",
];
/// Words that say which half of a camera a file or folder holds.
const HALF_WORDS: [&str; 18] = [
    "intrinsics",
    "intrinsic",
    "intri",
    "intr",
    "int",
    "extrinsics",
    "extrinsic",
    "extri",
    "extr",
    "ext",
    "pose",
    "poses",
    "lens",
    "distortion",
    "params",
    "parameters",
    "calib",
    "calibration",
];

/// A camera with the file that it stands in.
pub(super) struct Named<T> {
    pub(super) name: String,
    pub(super) path: String,
    pub(super) value: T,
}

/// The name part of a path: no folders, and without the ending of a calibration file.
pub(super) fn stem(path: &str) -> &str {
    let name = path.rsplit('/').next().unwrap_or(path);
    let lower = name.to_ascii_lowercase();
    let plain = lower.strip_suffix(".gz").unwrap_or(&lower);
    let known = ENDINGS.iter().find_map(|ending| plain.strip_suffix(ending));
    let length = known.or_else(|| plain.rsplit_once('.').map(|(stem, _)| stem)).map_or(0, str::len);
    if length == 0 { name } else { &name[..length] }
}

/// The folder of a path; empty for files beside each other.
pub(super) fn folder(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Names of cameras that have a file each: that of the folder where it holds one camera, else that of the file.
/// An error if some folders hold one camera and others several, which may be one in several versions.
pub(super) fn file_names(paths: &[&str]) -> Result<Vec<String>, ImportError> {
    let beside = |path: &str| paths.iter().filter(|other| folder(other) == folder(path)).count();
    let alone = paths.iter().find(|path| !folder(path).is_empty() && beside(path) == 1);
    let crowded = paths.iter().find(|path| !folder(path).is_empty() && beside(path) > 1);
    if let (Some(_), Some(one)) = (alone, crowded)
        && let Some(other) = paths.iter().find(|other| folder(other) == folder(one) && other != &one)
    {
        return Err(ImportError::conflict(
            one,
            other,
            "two cameras in a folder where other folders hold one",
            "one camera per folder: move one away",
        ));
    }
    // `old/cam1.yml` beside `cam1.yml` is no camera named "old".
    let is_again = |path: &str| {
        let mut elsewhere = paths.iter().filter(|other| {
            folder(other).is_empty() || folder(path).starts_with(&format!("{}/", folder(other)))
        });
        elsewhere.any(|other| folder(other) != folder(path) && stem(other).eq_ignore_ascii_case(stem(path)))
    };
    let name = |path: &&str| match folder(path) {
        "" => stem(path).to_owned(),
        folder if beside(path) == 1 && !is_again(path) => {
            folder.rsplit('/').next().unwrap_or(folder).to_owned()
        }
        _ => stem(path).to_owned(),
    };
    let names: Vec<String> = paths.iter().map(name).collect();
    let is_twice = |index: usize| names.iter().filter(|name| **name == names[index]).count() > 1;
    let whole = |index: usize| match folder(paths[index]) {
        folder if is_twice(index) && folder.contains('/') && beside(paths[index]) == 1 => {
            folder.replace('/', "_")
        }
        _ => names[index].clone(),
    };
    Ok((0..paths.len()).map(whole).collect())
}

/// The camera that a half of one belongs to: its path without the words that say which half it is.
pub(super) fn half_key(path: &str) -> String {
    let folders = folder(path).split('/').filter(|part| !part.is_empty());
    let parts = folders.chain([stem(path)]).map(|part| {
        let words = part.split(['_', '-', '.', ' ']).filter(|word| !word.is_empty());
        let kept = words.filter(|word| !HALF_WORDS.contains(&word.to_ascii_lowercase().as_str()));
        kept.collect::<Vec<&str>>().join("_")
    });
    parts.filter(|part| !part.is_empty()).collect::<Vec<String>>().join("/")
}

/// Whether two files are of two cameras by their own names: numbers that differ, or halves of which each names a camera.
pub(super) fn are_two_cameras(one: &str, other: &str) -> bool {
    let (one, other) = (stem(one), stem(other));
    let (one_kept, other_kept) = (half_key(one), half_key(other));
    let are_halves = || one_kept.len() < one.len() && other_kept.len() < other.len();
    let are_numbered = || ends_in_digit(&one_kept) && ends_in_digit(&other_kept);
    one_kept != other_kept
        && !one_kept.is_empty()
        && !other_kept.is_empty()
        && (are_numbered() || are_halves())
}

/// Cameras in the order people count, an error if two files look like one camera and differ. Of two that hold
/// the same camera one is kept, with a warning.
pub(super) fn settled<T>(
    mut cameras: Vec<Named<T>>,
    same: impl Fn(&T, &T) -> bool,
    warnings: &mut Vec<String>,
) -> Result<Vec<Named<T>>, ImportError> {
    cameras.sort_by_cached_key(|camera| (natural_key(&camera.name), camera.path.len(), camera.path.clone()));
    if cameras.len() > MAX_CAMERAS {
        // The rig refuses them; comparing each with each would take long.
        return Ok(cameras);
    }
    let mut at = 0;
    while at < cameras.len() {
        let version = &cameras[at];
        let base = cameras.iter().enumerate().find(|(index, base)| {
            let equal = version.name.to_lowercase() == base.name.to_lowercase();
            (*index < at && equal) || (!equal && is_version(&version.name, &base.name))
        });
        let Some((_, base)) = base else {
            at += 1;
            continue;
        };
        if !same(&version.value, &base.value) {
            let found = format!("two versions of camera {} that differ", base.name);
            return Err(ImportError::conflict(&base.path, &version.path, found, ONE));
        }
        if version.path != base.path {
            warnings.push(format!("{}: left out, it holds the same camera as {}", version.path, base.path));
        }
        cameras.remove(at);
    }
    check_folders(&cameras)?;
    Ok(cameras)
}

/// An error for a camera that stands only in a folder of old versions, beside cameras outside of it.
fn check_folders<T>(cameras: &[Named<T>]) -> Result<(), ImportError> {
    let is_old = |camera: &&Named<T>| {
        let mut parts = folder(&camera.path).split('/').filter(|part| !part.is_empty());
        parts.any(|part| {
            let part = part.to_lowercase();
            unversioned(&part).is_empty() || is_version_word(&part.replace(['_', '-', ' '], ""))
        })
    };
    let base = cameras.iter().find(|camera| !is_old(camera));
    match cameras.iter().find(is_old).zip(base) {
        Some((old, base)) => {
            let found =
                "a camera in a folder of another version, which is not among the cameras outside of it";
            Err(ImportError::conflict(&base.path, &old.path, found, "one version: move one folder away"))
        }
        None => Ok(()),
    }
}

const ONE: &str = "one file per camera: move one away, or rename it";

/// Whether a name is another with a word like "old", a number in brackets, or something after a point.
fn is_version(name: &str, base: &str) -> bool {
    let (name, base) = (name.to_lowercase(), base.to_lowercase());
    let rest = name.strip_prefix(&base);
    let dated = |rest: &str| rest.starts_with(['_', '-']) && rest[1..].starts_with("20") && rest.len() >= 9;
    if rest.is_some_and(|rest| rest.starts_with(['.', '~']) || dated(rest)) {
        return true;
    }
    // A copy that a file manager made: "cam1 2".
    let is_number = |rest: &str| !rest.is_empty() && rest.bytes().all(|byte| byte.is_ascii_digit());
    if rest.and_then(|rest| rest.strip_prefix(' ')).is_some_and(is_number) && ends_in_digit(&base) {
        return true;
    }
    let kept = unversioned(&base);
    if name == base || kept.is_empty() || unversioned(&name) != kept {
        return false;
    }
    kept == words(&base) || are_versions(&kept, &version_words(&name), &version_words(&base))
}

/// Whether two names that share their other words are versions of one camera that has no plain file: cam1_old and
/// cam1_new, cam1_v1 and cam1_v2. room_v1 and room_v2 may be two views.
fn are_versions(kept: &[&str], one: &[&str], other: &[&str]) -> bool {
    let is_camera =
        |word: &&str| ends_in_digit(word) && word.starts_with(|c: char| c == 'c' || c.is_ascii_digit());
    !one.is_empty() && !other.is_empty() && (one != other || kept.iter().any(is_camera))
}

fn ends_in_digit(text: &str) -> bool {
    text.ends_with(|c: char| c.is_ascii_digit())
}

fn words(name: &str) -> Vec<&str> {
    name.split(['.', '_', '-', ' ', '~', '(', ')', '[', ']']).filter(|word| !word.is_empty()).collect()
}

/// The words of a name in lower case without those of a version.
fn unversioned(name: &str) -> Vec<&str> {
    let name = name.strip_prefix("copy of ").unwrap_or(name);
    let name = name.rsplit_once(" (").filter(|(_, rest)| rest.ends_with(')')).map_or(name, |(base, _)| base);
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let copied = name.rsplit_once('(').filter(|(_, rest)| rest.strip_suffix(')').is_some_and(is_number));
    let name = copied.map_or(name, |(base, _)| base);
    undated(&words(name)).into_iter().filter(|word| !is_version_word(word)).collect()
}

/// Words without dates (2021, 05, 03 or 20210503) and what follows a version's number (v1, 2).
fn undated<'a>(words: &[&'a str]) -> Vec<&'a str> {
    let is_of =
        |word: &str, digits: usize| word.len() == digits && word.bytes().all(|byte| byte.is_ascii_digit());
    let mut kept: Vec<&str> = Vec::new();
    let mut rest = words;
    while let [word, behind @ ..] = rest {
        rest = match behind {
            [month, day, after @ ..]
                if is_of(word, 4) && word.starts_with("20") && is_of(month, 2) && is_of(day, 2) =>
            {
                after
            }
            _ if is_of(word, 8) && word.starts_with("20") && is_date(word) => behind,
            [minor, after @ ..]
                if is_version_number(word)
                    && minor.len() < 3
                    && minor.bytes().all(|byte| byte.is_ascii_digit()) =>
            {
                kept.push(word);
                after
            }
            _ => {
                kept.push(word);
                behind
            }
        };
    }
    kept
}

/// Whether eight digits have a month and a day: 20010192 is the serial number of a camera.
fn is_date(digits: &str) -> bool {
    let number = |at: std::ops::Range<usize>| digits.get(at).and_then(|part| part.parse::<u32>().ok());
    number(4..6).is_some_and(|month| (1..=12).contains(&month))
        && number(6..8).is_some_and(|day| (1..=31).contains(&day))
}

/// The words of a name that tell of a version, without numbers behind them.
fn version_words(name: &str) -> Vec<&str> {
    let plain = |word: &'_ str| word.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    let has_date = undated(&words(name)).len() < words(name).len();
    let date = has_date.then_some("date");
    let words = words(name).into_iter().filter(|word| is_version_word(word)).map(|word| &word[..plain(word)]);
    words.chain(date).collect()
}

fn is_version_number(word: &str) -> bool {
    word.strip_prefix('v').is_some_and(|rest| rest.parse::<u32>().is_ok())
}

/// Whether a word in lower case tells of a version: "old", "v2".
pub(super) fn is_version_word(word: &str) -> bool {
    is_version_number(word) || VERSION_WORDS.contains(&word.trim_end_matches(|c: char| c.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stem_keeps_its_points() {
        for (path, expected) in [
            ("room.cam1.yml", "room.cam1"),
            ("a/192.168.1.11.YML", "192.168.1.11"),
            ("cam1.yml.gz", "cam1"),
            ("camera2.Pmat.cal", "camera2"),
            ("a.P", "a"),
            ("plain", "plain"),
            (".yml", ".yml"),
            ("cam1 (copy).yaml", "cam1 (copy)"),
        ] {
            assert_eq!(stem(path), expected);
        }
    }

    #[test]
    fn versions_of_a_name_are_known_and_other_names_are_not() {
        for version in [
            "cam1.old",
            "cam1_old",
            "old_cam1",
            "cam1 (copy)",
            "cam1 (1)",
            "copy of cam1",
            "cam1-v2",
            "cam1~",
            "cam1(1)",
            "cam1 2",
        ] {
            assert!(is_version(version, "cam1"), "{version}");
        }
        for (other, base) in [
            ("cam10", "cam1"),
            ("cam1", "cam2"),
            ("cam (2)", "cam (1)"),
            ("192.168.1.11", "192.168.1.1"),
            ("cam_2", "cam"),
            ("cam 2", "cam"),
            ("cam(2)", "cam(1)"),
            ("room_v1", "room_v2"),
            ("test1", "test2"),
            ("cam1_v1", "cam2_v1"),
            ("Chameleon3_20010192", "Chameleon3_20010186"),
        ] {
            assert!(!is_version(other, base) && !is_version(base, other), "{other} {base}");
        }
        for (one, other) in [("cam1_old", "cam1_new"), ("cam1_v1", "cam1_v2"), ("left_old", "left_new")] {
            assert!(is_version(one, other) && is_version(other, one), "{one} {other}");
        }
    }

    #[test]
    fn halves_of_a_camera_share_their_key() {
        for (one, other) in [
            ("cam1/intrinsics.xml", "cam1/extrinsics.xml"),
            ("cam1_intrinsics.yml", "cam1-extrinsics.yml"),
            ("intrinsics/cam1.xml", "extrinsics/cam1.xml"),
            ("intri.yml", "extri.yml"),
        ] {
            assert_eq!(half_key(one), half_key(other));
        }
        assert_ne!(half_key("cam1_intr.yml"), half_key("cam2_extr.yml"));
    }

    #[test]
    fn folders_of_one_camera_name_it() {
        let names = |paths: &[&str]| file_names(paths).expect("names");
        assert_eq!(names(&["cam1/a.yml", "cam2/a.yml"]), ["cam1", "cam2"]);
        assert_eq!(names(&["cam1/c.yml", "cam10/c.yml"]), ["cam1", "cam10"]);
        assert_eq!(names(&["room/cam1.yml", "room/cam2.yml"]), ["cam1", "cam2"]);
        assert_eq!(names(&["a/cam1/c.yml", "b/cam1/c.yml"]), ["a_cam1", "b_cam1"]);
        assert!(file_names(&["cam1/a.yml", "cam1/b.yml", "cam2/a.yml"]).is_err());
    }
}
