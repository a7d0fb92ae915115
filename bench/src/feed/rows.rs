//! The rows of the bench `feed`, and how they are printed.

use serde::Serialize;

use crate::table::{Columns, number, or_dash, words};

/// What was measured of one source over one link.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What is filmed.
    pub source: String,
    /// By how many cameras.
    pub cameras: usize,
    /// Frames a second of the film.
    pub fps: f64,
    /// What the page's link carries; none: whatever comes.
    pub link_mbit_per_s: Option<f64>,
    /// At the page's socket while it looks.
    pub mbit_per_s: f64,
    /// Frame sets received a second.
    pub sets_per_s: f64,
    /// Of a frame set, in the mean.
    pub bytes_per_set: f64,
    /// What it would be if every frame of the film came, at this size of frame sets.
    pub mbit_per_s_at_fps: f64,
    /// From the film's capture to the frame set at the page: the median.
    pub delay_p50_ms: Option<f64>,
    /// The slowest hundredth.
    pub delay_p99_ms: Option<f64>,
    /// The slowest.
    pub delay_max_ms: Option<f64>,
    /// How much of the colours the page got at last.
    pub tier: String,
    /// Frame sets that the link did not take.
    pub sets_dropped: u64,
    /// A step of the run while the page looked: the median of what each quarter of a second had
    /// as median.
    pub step_p50_ms: Option<f64>,
    /// The same while it looked away.
    pub step_p50_alone_ms: Option<f64>,
}

/// The table.
pub const TABLE: Columns<Row> = Columns {
    gap: " ",
    columns: &[
        words("source", 20, |row| row.source.clone()),
        number("cameras", 7, |row| row.cameras.to_string()),
        number("link", 8, |row| or_dash(row.link_mbit_per_s, 1)),
        number("Mbit/s", 7, |row| format!("{:.2}", row.mbit_per_s)),
        number("sets/s", 7, |row| format!("{:.1}", row.sets_per_s)),
        number("KB/set", 8, |row| format!("{:.1}", 1e-3 * row.bytes_per_set)),
        number("at film fps", 11, |row| format!("{:.1} @ {:.0}", row.mbit_per_s_at_fps, row.fps)),
        number("delay p50 / p99 / max, ms", 25, |row| {
            [row.delay_p50_ms, row.delay_p99_ms, row.delay_max_ms].map(|delay| or_dash(delay, 0)).join(" / ")
        }),
        number("colours", 8, |row| row.tier.clone()),
        number("step p50 / alone", 17, |row| {
            [row.step_p50_ms, row.step_p50_alone_ms].map(|step| or_dash(step, 2)).join(" / ")
        }),
    ],
};
