//! Where a sample is written: beside its folder first, then in its place.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};

use setup::cli::{Failure, Outcome};
use tempfile::TempDir;

use super::texts::{CLUSTER, EMPTY, FILMS, README, RIG, SCENE, TITLE};

/// What a sample consists of, in the order in which it is put in place: what the cluster file leads to is there before it.
const ENTRIES: [&str; 6] = [README, RIG, FILMS, EMPTY, SCENE, CLUSTER];
/// The names of temporary folders begin with it.
const PREFIX: &str = "sample.partial-";

/// What is at the place of a sample.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Found {
    Nothing,
    EmptyFolder,
    /// A folder that an earlier `sample` wrote.
    Sample,
    /// Something that stays as it is, in words.
    Other(String),
}

/// A folder that is about to be written. Dropped, it removes what is half-written.
#[derive(Debug)]
pub struct Target {
    folder: PathBuf,
    is_there: bool,
    /// Beside a new folder, and in one that is there: on the same disk, and writable where the folder is.
    partial: TempDir,
}

impl Target {
    /// Refuses what a sample must not replace, and makes the temporary folder.
    pub fn open(folder: &Path, force: bool) -> Outcome<Target> {
        let found = look(folder).map_err(|error| Failure::unreadable(folder, error))?;
        check(folder, &found, force)?;
        let is_there = found != Found::Nothing;
        let parent =
            folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let within = if is_there { folder } else { parent };
        let unwritable =
            |error: io::Error| Failure::input(format_args!("cannot write {}: {error}", folder.display()));
        let partial = tempfile::Builder::new().prefix(PREFIX).tempdir_in(within).map_err(unwritable)?;
        let target = Target { folder: folder.to_owned(), is_there, partial };
        for name in [target.new_folder(), target.writing(FILMS), target.writing(EMPTY)] {
            fs::create_dir(name).map_err(unwritable)?;
        }
        Ok(target)
    }

    /// The folder as the command line names it.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where a file of that name in the sample is written for now.
    pub fn writing(&self, name: &str) -> PathBuf {
        self.new_folder().join(name)
    }

    /// Writes a text.
    pub fn write(&self, name: &str, text: &str) -> Outcome {
        fs::write(self.writing(name), text).map_err(|error| self.unwritable(name, &error))
    }

    /// A file that cannot be written, by its final name.
    pub fn unwritable(&self, name: &str, error: &io::Error) -> Failure {
        Failure::unwritable(&self.folder.join(name), error)
    }

    /// Puts the finished sample in its place. In a folder that is there each entry takes the place of the old one.
    pub fn install(&self) -> Outcome {
        if !self.is_there {
            let moved = fs::rename(self.new_folder(), &self.folder);
            return moved.map_err(|error| Failure::unwritable(&self.folder, error));
        }
        let old = self.partial.path().join("old");
        fs::create_dir(&old).map_err(|error| Failure::unwritable(&self.folder, error))?;
        for name in ENTRIES {
            let place = self.folder.join(name);
            let replaced = match fs::rename(&place, old.join(name)) {
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
                moved => moved,
            };
            let moved = replaced.and_then(|()| fs::rename(self.writing(name), &place));
            moved.map_err(|error| self.unwritable(name, &error))?;
        }
        Ok(())
    }

    /// The sample while it is written: with the rights of any new folder, which the temporary one around it does not have.
    fn new_folder(&self) -> PathBuf {
        self.partial.path().join("new")
    }
}

fn look(folder: &Path) -> io::Result<Found> {
    match fs::metadata(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Found::Nothing),
        Err(error) => return Err(error),
        Ok(metadata) if !metadata.is_dir() => return Ok(Found::Other("a file".to_owned())),
        Ok(_) => {}
    }
    let Some(entry) = fs::read_dir(folder)?.next().transpose()? else { return Ok(Found::EmptyFolder) };
    let mut head = Vec::new();
    let readme = File::open(folder.join(README));
    let read = readme.and_then(|readme| readme.take(TITLE.len() as u64).read_to_end(&mut head));
    Ok(if read.is_ok() && head == TITLE.as_bytes() {
        Found::Sample
    } else {
        Found::Other(format!("a folder that holds {:?}", entry.file_name().to_string_lossy()))
    })
}

fn check(folder: &Path, found: &Found, force: bool) -> Outcome {
    let problem = match (found, force) {
        (Found::Nothing | Found::EmptyFolder, _) | (Found::Sample, true) => return Ok(()),
        (Found::Sample, false) => "found a sample, expected a new or an empty folder (or --force)".to_owned(),
        (Found::Other(found), false) => format!("found {found}, expected a new or an empty folder"),
        (Found::Other(found), true) => {
            format!("found {found}, expected a sample that --force replaces, or a new or an empty folder")
        }
    };
    Err(Failure::unreadable(folder, problem))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn names(folder: &Path) -> BTreeSet<String> {
        let entries = fs::read_dir(folder).expect("listed").flatten();
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
    }

    fn all_entries() -> BTreeSet<String> {
        BTreeSet::from(ENTRIES.map(str::to_owned))
    }

    /// Writes a sample whose films say this.
    fn write_sample(folder: &Path, force: bool, film: &str) {
        let target = Target::open(folder, force).expect("it may");
        target.write(README, TITLE).expect("written");
        [RIG, SCENE, CLUSTER].iter().for_each(|name| target.write(name, "").expect("written"));
        target.write("films/cam_0.y4m", film).expect("written");
        target.install().expect("moved");
    }

    #[test]
    fn a_new_and_an_empty_folder_are_filled_and_nothing_else_is_left() {
        let parent = tempfile::tempdir().expect("a folder");
        let (new, empty) = (parent.path().join("new"), parent.path().join("empty"));
        fs::create_dir(&empty).expect("made");
        for folder in [&new, &empty] {
            write_sample(folder, false, "film");
            assert_eq!(names(folder), all_entries());
        }
        assert_eq!(names(parent.path()), BTreeSet::from(["empty", "new"].map(str::to_owned)));
    }

    #[test]
    fn a_sample_is_replaced_with_force_alone_and_other_files_stay() {
        let parent = tempfile::tempdir().expect("a folder");
        let folder = parent.path().join("room");
        write_sample(&folder, false, "first");
        fs::write(folder.join("run.mcap"), "mine").expect("written");
        let refused = Target::open(&folder, false).expect_err("refused").to_string();
        assert!(refused.ends_with("room: found a sample, expected a new or an empty folder (or --force)"));
        write_sample(&folder, true, "second");
        let mut expected = all_entries();
        expected.insert("run.mcap".to_owned());
        assert_eq!(names(&folder), expected);
        assert_eq!(fs::read_to_string(folder.join("films/cam_0.y4m")).expect("there"), "second");
    }

    #[test]
    fn what_is_no_sample_stays_also_with_force() {
        let parent = tempfile::tempdir().expect("a folder");
        let (folder, file) = (parent.path().join("room"), parent.path().join("file"));
        fs::create_dir(&folder).expect("made");
        fs::write(folder.join("README.txt"), "of another program").expect("written");
        fs::write(&file, "").expect("written");
        for force in [false, true] {
            for (place, found) in [(&folder, "a folder that holds \"README.txt\""), (&file, "a file")] {
                let refused = Target::open(place, force).expect_err("refused").to_string();
                assert!(refused.contains(&format!(": found {found}, expected ")), "{refused}");
                assert!(refused.contains("a new or an empty folder"), "{refused}");
            }
        }
        let nowhere = parent.path().join("no/room");
        let refused = Target::open(&nowhere, false).expect_err("refused").to_string();
        assert!(
            refused.starts_with(&format!("cannot write {}: No such file", nowhere.display())),
            "{refused}"
        );
    }

    #[test]
    fn a_sample_that_is_not_finished_leaves_nothing() {
        let parent = tempfile::tempdir().expect("a folder");
        let target = Target::open(&parent.path().join("room"), false).expect("it may");
        target.write(README, TITLE).expect("written");
        assert_eq!(names(parent.path()).len(), 1);
        drop(target);
        assert!(names(parent.path()).is_empty());
    }
}
