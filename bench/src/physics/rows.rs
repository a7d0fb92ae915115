//! The rows of the bench `physics`, and how they are printed.

use serde::Serialize;

use super::metric::{Limit, Metric};
use crate::table::{Columns, number, or_dash, words};

/// One figure of one kind of run.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name of the scene.
    pub scene: String,
    /// How bodies answered the hull.
    pub response: String,
    /// Of the images, pixels; none where there are none, or several.
    pub width: Option<u32>,
    /// Of the images, pixels.
    pub height: Option<u32>,
    /// The share of outline pixels that flickered.
    pub noise: f64,
    /// Number of runs, each with a seed of its own.
    pub seeds: u64,
    /// What was measured, with its unit.
    pub metric: &'static str,
    /// The worst of the runs; none: it never came to be.
    pub value: Option<f64>,
    /// What must hold.
    pub limit: Option<String>,
    /// Whether it does.
    pub holds: Option<bool>,
}

/// What rows of one kind of run have in common.
#[derive(Clone, Debug)]
pub struct RowKind {
    /// Name of the scene.
    pub scene: String,
    /// How bodies answered the hull.
    pub response: String,
    /// Of the images, pixels, if they are of one.
    pub size: Option<(u32, u32)>,
    /// The share of outline pixels that flickered.
    pub noise: f64,
    /// Number of runs, each with a seed of its own.
    pub seeds: u64,
}

impl RowKind {
    /// The row of a figure.
    pub fn row(&self, metric: Metric) -> Row {
        Row {
            scene: self.scene.clone(),
            response: self.response.clone(),
            width: self.size.map(|size| size.0),
            height: self.size.map(|size| size.1),
            noise: self.noise,
            seeds: self.seeds,
            metric: metric.name,
            value: metric.value.is_finite().then_some(metric.value),
            limit: metric.limit.map(limit_text),
            holds: metric.limit.map(|limit| limit.holds(metric.value)),
        }
    }
}

/// A limit for people.
fn limit_text(limit: Limit) -> String {
    match limit {
        Limit::Most(most) => format!("<= {most}"),
        Limit::Least(least) => format!(">= {least}"),
        Limit::Within(least, most) => format!("{least} to {most}"),
    }
}

/// The table.
pub const TABLE: Columns<Row> = Columns {
    gap: "  ",
    columns: &[
        words("scene", 20, |row| row.scene.clone()),
        words("response", 11, |row| row.response.clone()),
        number("size", 9, |row| match (row.width, row.height) {
            (Some(width), Some(height)) => format!("{width}x{height}"),
            _ => "-".to_owned(),
        }),
        number("noise", 5, |row| row.noise.to_string()),
        number("seeds", 5, |row| row.seeds.to_string()),
        words("metric", 30, |row| row.metric.to_owned()),
        number("value", 9, |row| or_dash(row.value, 3)),
        number("limit", 12, |row| row.limit.clone().unwrap_or_default()),
        words("holds", 5, |row| match row.holds {
            Some(true) => "yes".to_owned(),
            Some(false) => "NO".to_owned(),
            None => String::new(),
        }),
    ],
};
