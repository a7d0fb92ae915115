//! Files that a command writes.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::failure::{Failure, Outcome};

/// What of a file says whether it is JSON.
const HEAD_BYTES: u64 = 256;

/// Writes a file whole or not at all: beside it first, then in its place. What is no regular file (a
/// device, a pipe) is written to as it is.
pub fn write_whole(path: &Path, contents: &[u8]) -> Outcome {
    if is_special(path) {
        return std::fs::write(path, contents).map_err(|error| Failure::unwritable(path, error));
    }
    let beside = beside(path);
    let written = std::fs::write(&beside, contents).and_then(|()| std::fs::rename(&beside, path));
    written.map_err(|error| {
        // What is left of a failed attempt is of no use.
        let _ = std::fs::remove_file(&beside);
        Failure::unwritable(path, error)
    })
}

/// Asks before a long run, not after it, whether the figures of `--json` can be written, and whether they would take the
/// place of something else than figures: of a rig, a mask, a recording. All figures are one JSON object.
pub fn check_json_writable(path: &Path) -> Outcome {
    if path.is_file() {
        let mut found = Vec::new();
        let read = File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut found));
        read.map_err(|error| Failure::input(format_args!("--json {}: {error}", path.display())))?;
        if !found.is_empty() && found.trim_ascii_start().first() != Some(&b'{') {
            let problem =
                "found a file that holds no figures, expected a new file, or JSON of an earlier run";
            return Err(Failure::input(format_args!("--json {}: {problem}", path.display())));
        }
    }
    check_writable("--json", path)
}

/// Asks before a long run, not after it, whether a file can be written.
pub fn check_writable(flag: &str, path: &Path) -> Outcome {
    if is_special(path) {
        return Ok(());
    }
    let beside = beside(path);
    let tried = std::fs::write(&beside, b"").and_then(|()| std::fs::remove_file(&beside));
    tried.map_err(|error| Failure::input(format_args!("{flag} {}: {error}", path.display())))
}

fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|metadata| !metadata.is_file())
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_take_the_place_of_figures_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let holds = |name: &str, bytes: &[u8]| std::fs::write(at(name), bytes).expect("written");
        holds("figures.json", b"\n{ \"steps\": 3 }");
        holds("empty", b"");
        for name in ["new.json", "figures.json", "empty"] {
            assert_eq!(check_json_writable(&at(name)), Ok(()), "{name}");
        }
        assert_eq!(check_json_writable(Path::new("/dev/null")), Ok(()));
        for (name, bytes) in [
            ("rig.toml", &b"[cam_0]\nname = \"a\"\n"[..]),
            ("cam_0.png", b"\x89PNG\r\n\x1a\n"),
            ("a.mcap", b"\x89MCAP0\r\n"),
            ("points.csv", b"x,y,z\n"),
        ] {
            holds(name, bytes);
            let refused = check_json_writable(&at(name)).expect_err(name).to_string();
            assert!(refused.contains(name) && refused.contains("holds no figures"), "{refused}");
            assert_eq!(std::fs::read(at(name)).expect("there"), bytes);
        }
    }
}
