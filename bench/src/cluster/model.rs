//! What the model of larger clusters starts from.

use super::rows::Row;
use super::{BASE_BODIES, BASE_SIZE};
use crate::scale::PassMeasurement;

/// What the model starts from: the row nearest the middle of all with a camera a node, or of all, and how the
/// coordinator's time grows with the nodes if that was measured.
pub fn model_of(rows: &[&Row]) -> Option<PassMeasurement> {
    let alone: Vec<&Row> = rows.iter().copied().filter(|row| row.nodes == row.cameras).collect();
    let alone = if alone.is_empty() { rows.to_vec() } else { alone };
    let is_base = |row: &&&Row| row.bodies == BASE_BODIES && (row.width, row.height) == BASE_SIZE;
    let base = *alone.iter().find(is_base).or(alone.first())?;
    let key = |row: &Row| (row.bodies, row.width, row.height, row.response, row.precision, row.sockets);
    let alike = |row: &&&Row| key(row) == key(base) && row.cameras / row.nodes == base.cameras / base.nodes;
    let others = alone.iter().filter(alike).map(|row| (row.nodes as f64, row.busiest_thread_ms));
    let (fixed_ms, per_node_ms) = line(&others.collect::<Vec<_>>());
    Some(PassMeasurement {
        rounds: (base.trips_per_pass.round() as u32).max(1),
        bytes_to_node: base.bytes_to_node_pass,
        bytes_from_node: base.bytes_from_node_pass,
        node_ms: base.node_cpu_ms?,
        coordinator_per_node_ms: per_node_ms,
        coordinator_fixed_ms: fixed_ms,
    })
}

/// The line `fixed + slope · x` through points, neither below zero; of one point, through the origin.
fn line(points: &[(f64, f64)]) -> (f64, f64) {
    let count = points.len().max(1) as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |sum, point| (sum.0 + point.0, sum.1 + point.1));
    let (x, y) = (x / count, y / count);
    let spread: f64 = points.iter().map(|point| (point.0 - x) * (point.0 - x)).sum();
    let rise: f64 = points.iter().map(|point| (point.0 - x) * (point.1 - y)).sum();
    let slope = if spread > 0.0 { rise / spread } else { y / x.max(1.0) };
    let slope = slope.clamp(0.0, y / x.max(1.0));
    (y - slope * x, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_goes_through_its_points_and_never_below_zero() {
        assert_eq!(line(&[(8.0, 5.0), (16.0, 9.0)]), (1.0, 0.5));
        assert_eq!(line(&[(8.0, 4.0)]), (0.0, 0.5));
        assert_eq!(line(&[(8.0, 4.0), (16.0, 3.0)]), (3.5, 0.0));
        let (fixed_ms, per_node_ms) = line(&[(8.0, 1.0), (16.0, 9.0)]);
        assert!(fixed_ms.abs() < 1e-9 && per_node_ms > 0.0);
    }
}
