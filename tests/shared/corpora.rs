//! Runs what fuzzing has left: the files of `tests/fuzz/corpus/TARGET/` and `tests/fuzz/regressions/TARGET/`, through the function that
//! the target calls. With `HULLTOUCH_WRITE_CORPORA=1` the seeds of a corpus, which our own encoders make, are
//! written first.

use std::fs;
use std::panic::{RefUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// A corpus of more files, or a larger file, belongs nowhere: tests run all of them.
const MAX_FILES: usize = 60;
const MAX_FILE_BYTES: usize = 64 << 10;

/// Fails with the name of the first file that does.
#[track_caller]
pub fn run(target: &str, check: impl Fn(&[u8]) + RefUnwindSafe, seeds: &[Vec<u8>]) {
    let corpus = folder("corpus", target);
    if std::env::var_os("HULLTOUCH_WRITE_CORPORA").is_some() {
        fs::create_dir_all(&corpus).expect("a folder");
        for (number, seed) in seeds.iter().enumerate() {
            fs::write(corpus.join(format!("seed-{number:02}")), seed).expect("written");
        }
    }
    let files = files(&corpus);
    assert!(!files.is_empty(), "{target} has no corpus");
    assert!(files.len() <= MAX_FILES, "{target}: {} files, at most {MAX_FILES}: minimise it", files.len());
    for path in files.into_iter().chain(self::files(&folder("regressions", target))) {
        let bytes = fs::read(&path).expect("readable");
        assert!(bytes.len() <= MAX_FILE_BYTES, "{} has {} bytes", path.display(), bytes.len());
        assert!(catch_unwind(|| check(&bytes)).is_ok(), "{} fails, see above", path.display());
    }
    for seed in seeds {
        check(seed);
    }
}

fn folder(kind: &str, target: &str) -> PathBuf {
    let within = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("tests/fuzz"));
    within.into_iter().find(|fuzz| fuzz.is_dir()).expect("tests/fuzz").join(kind).join(target)
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}
