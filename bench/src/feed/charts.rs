//! The chart of the bench `feed`.

use std::path::Path;

use setup::cli::Outcome;

use super::rows::Row;
use crate::plot::{Axis, BarChart, Series};

/// What each source sends over each link.
pub fn draw(rows: &[Row], folder: &Path) -> Outcome {
    let group = |row: &Row| match row.link_mbit_per_s {
        Some(link) => format!("{}, {link} Mbit/s", row.source),
        None => row.source.clone(),
    };
    let bars = |name: &str, value: fn(&Row) -> f64| Series {
        name: name.to_owned(),
        values: rows.iter().map(|row| Some(value(row))).collect(),
    };
    let chart = BarChart {
        title: "What a page is sent".to_owned(),
        groups: rows.iter().map(group).collect(),
        y: Axis::linear("Mbit/s"),
        series: vec![
            bars("as it came", |row| row.mbit_per_s),
            bars("with every frame", |row| row.mbit_per_s_at_fps),
        ],
    };
    chart.write(folder, "feed")
}
