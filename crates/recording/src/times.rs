//! From film time to log time.

/// When a recording began, and its frames per second.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Times {
    pub began_unix_s: f64,
    pub fps: f64,
}

impl Times {
    /// Unix nanoseconds of a film time.
    pub fn log_ns(self, film_s: f64) -> u64 {
        unix_ns(self.began_unix_s + film_s)
    }
}

/// Nanoseconds of unix seconds.
pub(crate) fn unix_ns(unix_s: f64) -> u64 {
    (unix_s * 1e9) as u64
}
