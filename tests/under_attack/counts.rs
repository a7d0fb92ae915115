//! What untrusted peers did in a test, so that no attack is one in name alone.

use std::sync::atomic::{AtomicU64, Ordering};

use testkit::{Watch, timely};

/// How much of one kind of attack was made since it was last checked.
pub struct Count {
    kind: &'static str,
    made: AtomicU64,
}

impl Count {
    pub const fn new(kind: &'static str) -> Count {
        Count { kind, made: AtomicU64::new(0) }
    }

    pub fn add(&self, much: usize) {
        self.made.fetch_add(much as u64, Ordering::Relaxed);
    }
}

/// Each of these attacks was made since the last check, unless attackers had no time for it.
pub fn check_made(watch: &Watch, counts: &[&Count]) {
    let made: Vec<_> =
        counts.iter().map(|count| (count.kind, count.made.swap(0, Ordering::Relaxed))).collect();
    eprintln!("{made:?}");
    timely!(watch, made.iter().all(|(_, made)| *made > 0), "attacks made: {made:?}");
}
