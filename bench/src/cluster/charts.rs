//! Charts of the bench `cluster`.

use std::path::Path;

use setup::cli::Outcome;

use super::rows::{Row, Varied, series};
use crate::plot::{Axis, LineChart, Series};
use crate::table::distinct;

/// A chart for each thing that the rows vary, and each response.
pub fn draw(rows: &[Row], folder: &Path) -> Outcome {
    for response in distinct(rows.iter().map(|row| row.response)) {
        let of_response: Vec<Row> = rows.iter().filter(|row| row.response == response).cloned().collect();
        draw_response(response, &of_response, folder)?;
    }
    Ok(())
}

fn draw_response(response: &str, rows: &[Row], folder: &Path) -> Outcome {
    for (varied, name, label) in [
        (Varied::Nodes, "cluster_nodes", "nodes"),
        (Varied::Bodies, "cluster_bodies", "bodies"),
        (Varied::Size, "cluster_size", "megapixels of a camera"),
    ] {
        let rows = series(rows, varied);
        if rows.len() < 2 {
            continue;
        }
        let curve = |name: &str, y: fn(&Row) -> f64| Series {
            name: name.to_owned(),
            values: rows.iter().map(|row| (varied.of(row), y(row))).collect(),
        };
        let chart = LineChart {
            title: format!("A pass over local node processes, {response}, by {label}"),
            x: Axis::logarithmic(label),
            y: Axis::logarithmic("milliseconds"),
            series: vec![
                curve("median", |row| row.p50_ms),
                curve("slowest hundredth", |row| row.p99_ms),
                curve("slowest", |row| row.max_ms),
            ],
        };
        chart.write(folder, &format!("{name}_{response}"))?;
    }
    Ok(())
}
