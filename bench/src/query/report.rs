//! The tables and charts of the figures.

use std::path::Path;

use setup::cli::{Outcome, outln};

use super::bounds::BoundSavings;
use super::engines::{HULLTOUCH, UNPRUNED};
use super::rounds::RoundCosts;
use super::{Report, Row, TwinCheck};
use crate::plot::{Axis, BarChart, LineChart, Series};
use crate::table::{Columns, distinct, number, words};

const BOUNDS: Columns<BoundSavings> = Columns {
    gap: "  ",
    columns: &[
        words("load", 14, |saved| saved.load.clone()),
        number("samples", 8, |saved| saved.samples.to_string()),
        number("body box", 8, |saved| format!("{:.1}", 100.0 * saved.body_box)),
        number("frustum box", 11, |saved| format!("{:.1}", 100.0 * saved.frustum_box)),
        number("frustum planes", 14, |saved| format!("{:.1}", 100.0 * saved.frustum_planes)),
        number("silhouette", 10, |saved| format!("{:.1}", 100.0 * saved.silhouette)),
        number("inside", 6, |saved| format!("{:.1}", 100.0 * saved.inside)),
    ],
};

const ROUNDS: Columns<RoundCosts> = Columns {
    gap: "  ",
    columns: &[
        number("size", 10, |row| row.size.clone()),
        words("load", 14, |row| row.load.clone()),
        words("engine", 18, |row| row.engine.to_owned()),
        number("classes", 8, |row| format!("{:.1}", row.classes_ns)),
        number("edges", 8, |row| format!("{:.1}", row.edges_ns)),
        number("exits", 8, |row| format!("{:.1}", row.exits_ns)),
        number("mean", 8, |row| format!("{:.1}", row.body_exits_ns)),
        number("check", 8, |row| format!("{:.1}", row.check_ns)),
        number("pass", 8, |row| format!("{:.1}", row.pass_ns)),
    ],
};

/// What stands behind a row whose check failed.
fn mark(failed: &Option<String>) -> &'static str {
    if failed.is_some() { ": CHECK FAILED" } else { "" }
}

impl Report {
    /// The machine, and the first table's head.
    pub fn print_head(&self) -> Outcome {
        outln!("{}; one core, million points per second", self.machine.line())?;
        outln!("\n{:>10}  {:14}  {:30}  {:>9}  hulltouch is", "size", "load", "engine", "M/s")
    }

    /// The rows from `first` on, which are of one size and load, beside ours.
    pub fn print_rows(&self, first: usize) -> Outcome {
        let ours = self.rows[first].points_per_s;
        for row in &self.rows[first..] {
            let times = ours / row.points_per_s;
            let ratio = if row.engine == HULLTOUCH { String::new() } else { format!("{times:8.2} x") };
            let rate = row.points_per_s / 1e6;
            outln!("{:>10}  {:14}  {:30}  {rate:9.4}  {ratio}", row.size, row.load, row.engine)?;
        }
        Ok(())
    }

    /// Everything but the rates.
    pub fn print_tail(&self) -> Outcome {
        self.print_flatness()?;
        self.print_rounds()?;
        outln!("\nshare of samples that each stage rejects, % (the paper's set-up)")?;
        BOUNDS.print_titles()?;
        self.bounds.iter().try_for_each(|saved| BOUNDS.print(saved))?;
        for said in &self.agreement {
            outln!(
                "{:>10}  {:14}  OpenCV agrees on {:.2} % of {} points; {} on a pixel's edge or with another edge as near{}",
                said.size,
                said.load,
                100.0 * said.agreeing,
                said.points,
                said.ties,
                mark(&said.failed)
            )?;
        }
        for TwinCheck { size, load, planes, inside, around, failed } in &self.twins {
            outln!(
                "{size:>10}  {load:14}  {inside} samples and offset samples inside, {around} points around with a \
                 plane; {planes} planes compared with the slow twin's{}",
                mark(failed)
            )?;
        }
        Ok(())
    }

    fn print_rounds(&self) -> Outcome {
        outln!("\nnanoseconds of a point by round, over all groups of cameras")?;
        ROUNDS.print_titles()?;
        self.rounds.iter().try_for_each(|row| ROUNDS.print(row))?;
        // The rounds are measured in pairs.
        for pair in self.rounds.chunks_exact(2) {
            outln!(
                "{:>10}  {:14}  a node of one camera answers at {:.2} of the rate a camera of all together",
                pair[0].size,
                pair[0].load,
                pair[0].answers_ns() / pair[1].answers_ns()
            )?;
        }
        Ok(())
    }

    /// What the targets speak of: the last size beside the first, lenses, and cameras alone.
    fn print_flatness(&self) -> Outcome {
        let sizes = self.sizes();
        let (Some(first), Some(last)) = (sizes.first(), sizes.last()) else { return Ok(()) };
        outln!()?;
        for load in ["inside", "contacts", "anywhere", "touching"] {
            let rate = |size: &str, load: &str, engine: &str| self.rate(size, load, engine);
            let ratio = |a: Option<f64>, b: Option<f64>| {
                a.zip(b).map_or_else(|| "-".to_owned(), |(a, b)| format!("{:.2}", a / b))
            };
            outln!(
                "{load:9} {last} at {} of {first}'s rate; at {first} distorted lenses at {}, cameras alone at \
                 {} of the rate of all together",
                ratio(rate(last, load, HULLTOUCH), rate(first, load, HULLTOUCH)),
                ratio(rate(first, &format!("{load}_bent"), HULLTOUCH), rate(first, load, HULLTOUCH)),
                ratio(rate(first, load, UNPRUNED), rate(first, load, HULLTOUCH)),
            )?;
        }
        Ok(())
    }

    fn rate(&self, size: &str, load: &str, engine: &str) -> Option<f64> {
        let row = self.rows.iter().find(|row| row.size == size && row.load == load && row.engine == engine);
        row.map(|row| row.points_per_s)
    }

    /// The sizes of the eight cameras, in the order measured.
    fn sizes(&self) -> Vec<&str> {
        distinct(self.rows.iter().filter(|row| row.load == "inside").map(|row| &row.size[..]))
    }

    fn engines(&self, load: &str) -> Vec<&'static str> {
        distinct(self.rows.iter().filter(|row| row.load == load).map(|row| row.engine))
    }

    /// Charts: rate over pixels by load, the loads of the first size, and what bounds save.
    pub fn draw(&self, folder: &Path) -> Outcome {
        for load in ["inside", "contacts", "anywhere", "touching"] {
            let of_engine = |engine: &'static str| {
                let rows = self.rows.iter().filter(|row| row.load == load && row.engine == engine);
                Series {
                    name: engine.to_owned(),
                    values: rows.map(|row| (megapixels(row), row.points_per_s)).collect(),
                }
            };
            LineChart {
                title: format!("query, {load}: one core"),
                x: Axis::logarithmic("image, megapixels"),
                y: Axis::logarithmic("points per second"),
                series: self.engines(load).into_iter().map(of_engine).collect(),
            }
            .write(folder, &format!("query_{load}"))?;
        }
        let stages = ["body box", "frustum box", "frustum planes", "silhouette", "inside"];
        let bars = stages.into_iter().enumerate().map(|(stage, name)| Series {
            name: name.to_owned(),
            values: self.bounds.iter().map(|saved| Some(100.0 * saved.shares()[stage])).collect(),
        });
        BarChart {
            title: "which stage rejects a sample first".to_owned(),
            groups: self.bounds.iter().map(|saved| saved.load.clone()).collect(),
            y: Axis::linear("% of samples"),
            series: bars.collect(),
        }
        .write(folder, "query_bounds")
    }
}

fn megapixels(row: &Row) -> f64 {
    let sides = row.size.split('x').filter_map(|side| side.parse::<f64>().ok());
    sides.product::<f64>() / 1e6
}
