//! The rows of the bench `sync`, and how they are printed.

use serde::Serialize;

use crate::table::{Columns, number, or_dash, words};

/// What was found over some runs.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Row {
    /// What the person does.
    pub motion: &'static str,
    /// How far one camera of each run was turned, degrees.
    pub turned_deg: f64,
    /// How many runs, each with other offsets and other noise.
    pub runs: usize,
    /// Runs that were refused because there was too little motion.
    pub refused: usize,
    /// Runs that named a camera as out of its place: the turned one …
    pub named_rightly: usize,
    /// … or another.
    pub named_wrongly: usize,
    /// Root mean square error of a camera's time, milliseconds.
    pub rms_ms: Option<f64>,
    /// The worst, milliseconds.
    pub worst_ms: Option<f64>,
    /// The uncertainty as it was said, root mean square, milliseconds.
    pub said_ms: Option<f64>,
    /// Root mean square of error over uncertainty: 1 if that is true.
    pub error_over_said: Option<f64>,
    /// What a check took, seconds.
    pub check_s: f64,
}

/// Sums that become a row.
#[derive(Default)]
pub struct Errors {
    errors_ms: Vec<f64>,
    said_ms: Vec<f64>,
}

impl Errors {
    /// One camera of one run.
    pub fn add(&mut self, error_s: f64, said_s: f64) {
        self.errors_ms.push(1e3 * error_s);
        self.said_ms.push(1e3 * said_s);
    }

    /// Fills a row in.
    pub fn fill(&self, row: &mut Row) {
        let ratios: Vec<f64> =
            self.errors_ms.iter().zip(&self.said_ms).map(|(error, said)| error / said).collect();
        row.rms_ms = root_mean_square(&self.errors_ms);
        row.worst_ms = self.errors_ms.iter().map(|error| error.abs()).reduce(f64::max);
        row.said_ms = root_mean_square(&self.said_ms);
        row.error_over_said = root_mean_square(&ratios);
    }
}

fn root_mean_square(values: &[f64]) -> Option<f64> {
    let squares: f64 = values.iter().map(|value| value * value).sum();
    (!values.is_empty()).then(|| (squares / values.len() as f64).sqrt())
}

/// The table.
pub const TABLE: Columns<Row> = Columns {
    gap: "  ",
    columns: &[
        words("motion", 7, |row| row.motion.to_owned()),
        number("turned, °", 9, |row| format!("{:.1}", row.turned_deg)),
        number("runs", 4, |row| row.runs.to_string()),
        number("refused", 7, |row| row.refused.to_string()),
        number("named right / wrong", 19, |row| format!("{} / {}", row.named_rightly, row.named_wrongly)),
        number("rms, ms", 7, |row| or_dash(row.rms_ms, 2)),
        number("worst", 6, |row| or_dash(row.worst_ms, 2)),
        number("said", 5, |row| or_dash(row.said_ms, 2)),
        number("error / said", 12, |row| or_dash(row.error_over_said, 2)),
        number("check, s", 8, |row| format!("{:.1}", row.check_s)),
    ],
};
