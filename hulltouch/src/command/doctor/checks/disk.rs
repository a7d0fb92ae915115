//! Is there room for film?

use super::super::facts::{DiskFacts, Facts};
use super::super::finding::{Finding, or_ok};

/// Less than a film of an empty room, or some minutes of a recording.
const FAILS_BELOW: u64 = 256 << 20;
const WARNS_BELOW: u64 = 2 << 30;

/// Fails where nothing can be written; warns where it soon cannot.
pub fn check(facts: &Facts) -> Vec<Finding> {
    let wrong = facts.disks.iter().filter_map(of_disk).collect();
    let least = facts.disks.iter().filter_map(|disk| disk.free.as_ref().ok()).min().copied();
    or_ok(wrong, || Finding::ok(format!("{} free or more", size(least.unwrap_or_default()))))
}

fn of_disk(disk: &DiskFacts) -> Option<Finding> {
    let (folder, what) = (disk.folder.display(), disk.what);
    match &disk.free {
        Err(why) => Some(Finding::fail(
            format!("{folder}, where {what} go: {why}"),
            "make the folder and give it to the user who runs hulltouch, or name another",
        )),
        Ok(free) if *free < WARNS_BELOW => {
            let found = format!("{folder}, where {what} go, has {} free", size(*free));
            let cure = "make room there, or write to another disk";
            Some(if *free < FAILS_BELOW { Finding::fail(found, cure) } else { Finding::warn(found, cure) })
        }
        Ok(_) => None,
    }
}

fn size(bytes: u64) -> String {
    match bytes {
        0..0x4000_0000 => format!("{} MiB", bytes >> 20),
        more => format!("{} GiB", more >> 30),
    }
}
