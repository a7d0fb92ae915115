//! Charts of the bench `bandwidth`: bytes a second of every layout, one thing varied at a time.

use std::path::Path;

use setup::cli::Outcome;

use super::layout::{Layout, STEPS};
use super::measure::{AtBodies, FilmMeasurement};
use super::verdict::{BASE_SIZE, base_bodies, plan_name};
use super::{BASE_CAMERAS, CAMERAS_SIZE};
use crate::cluster::film::FilmPlan;
use crate::plot::{Axis, LineChart, Series};
use crate::table::distinct;

/// A chart over the films.
struct Over {
    name: &'static str,
    axis: Axis,
    /// Where a film stands on the axis.
    x: fn(&FilmPlan) -> f64,
    /// Which films differ from the base in that alone.
    fits: fn(&FilmPlan) -> bool,
}

/// A chart over sizes, cameras, noise and bodies each, where there is more than one.
pub fn draw(all: &[FilmMeasurement], folder: &Path) -> Outcome {
    for Over { name, axis, x, fits } in over() {
        let mut shown: Vec<&FilmMeasurement> = all.iter().filter(|measured| fits(&measured.plan)).collect();
        shown.sort_by(|a, b| x(&a.plan).total_cmp(&x(&b.plan)));
        let points: Vec<_> = shown.iter().map(|shown| (x(&shown.plan), base_bodies(shown))).collect();
        if points.len() > 1 {
            let title = format!("Bytes per second by {}", axis.label);
            chart(title, axis, &points).write(folder, name)?;
        }
    }
    let base = all.iter().find(|measured| measured.plan.size == BASE_SIZE).or(all.first());
    let Some(base) = base else { return Ok(()) };
    let points: Vec<_> = base.at.iter().map(|at| (at.bodies as f64, at)).collect();
    let title = format!("Bytes per second by bodies, {}", plan_name(&base.plan));
    chart(title, Axis::logarithmic("bodies"), &points).write(folder, "bandwidth_bodies")
}

fn over() -> [Over; 3] {
    [
        Over {
            name: "bandwidth_size",
            axis: Axis::logarithmic("megapixels of a camera"),
            x: |plan| f64::from(plan.size.0) * f64::from(plan.size.1) * 1e-6,
            fits: |plan| plan.cameras == BASE_CAMERAS && plan.noise == 0.0,
        },
        Over {
            name: "bandwidth_cameras",
            axis: Axis::logarithmic("cameras"),
            x: |plan| plan.cameras as f64,
            fits: |plan| plan.size == CAMERAS_SIZE && plan.noise == 0.0,
        },
        Over {
            name: "bandwidth_noise",
            axis: Axis::linear("noise, % of the pixels"),
            x: |plan| 100.0 * plan.noise,
            fits: |plan| plan.size == BASE_SIZE && plan.cameras == BASE_CAMERAS,
        },
    ]
}

fn chart(title: String, x: Axis, points: &[(f64, &AtBodies)]) -> LineChart {
    let costs = points.iter().flat_map(|(_, at)| &at.costs);
    let names = distinct(costs.map(|cost| (cost.layout, cost.precision)));
    let curve = |&(layout, precision): &(Layout, &'static str)| {
        let value = |&(x, at): &(f64, &AtBodies)| {
            let cost = at.costs.iter().find(|cost| (cost.layout, cost.precision) == (layout, precision))?;
            Some((x, cost.bytes_per_s(STEPS)))
        };
        let name = match layout.is_gathered() {
            true => layout.name().to_owned(),
            false => format!("{}, {precision}", layout.name()),
        };
        Series { name, values: points.iter().filter_map(value).collect() }
    };
    LineChart {
        title,
        x,
        y: Axis::logarithmic("bytes per second"),
        series: names.iter().map(curve).collect(),
    }
}
