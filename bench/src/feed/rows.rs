//! The rows of `bench feed`, and how they are printed.

use serde::Serialize;

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

/// The head of the table.
#[allow(clippy::print_stdout, reason = "the table is the command's output")]
pub fn print_header() {
    println!(
        "{:<20} {:>7} {:>8} {:>7} {:>7} {:>8} {:>11} {:>25} {:>8} {:>17}",
        "source",
        "cameras",
        "link",
        "Mbit/s",
        "sets/s",
        "KB/set",
        "at film fps",
        "delay p50 / p99 / max, ms",
        "colours",
        "step p50 / alone",
    );
}

/// A row of the table.
#[allow(clippy::print_stdout, reason = "the table is the command's output")]
pub fn print_row(row: &Row) {
    let or_dash = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let delays = [row.delay_p50_ms, row.delay_p99_ms, row.delay_max_ms].map(|delay| or_dash(delay, 0));
    let steps = [row.step_p50_ms, row.step_p50_alone_ms].map(|step| or_dash(step, 2));
    println!(
        "{:<20} {:>7} {:>8} {:>7.2} {:>7.1} {:>8.1} {:>11} {:>25} {:>8} {:>17}",
        row.source,
        row.cameras,
        or_dash(row.link_mbit_per_s, 1),
        row.mbit_per_s,
        row.sets_per_s,
        1e-3 * row.bytes_per_set,
        format!("{:.1} @ {:.0}", row.mbit_per_s_at_fps, row.fps),
        delays.join(" / "),
        row.tier,
        steps.join(" / "),
    );
}
