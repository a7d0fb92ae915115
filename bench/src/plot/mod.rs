//! Charts of the tables, as SVG: lines and bars, on linear or logarithmic axes.

mod scale;

use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::prelude::*;

use scale::Scale;
use setup::cli::{Failure, Outcome, write_whole};

/// Size of a chart, pixels.
const SIZE: (u32, u32) = (1120, 520);
/// Room for the legend, pixels.
const LEGEND_WIDTH: u32 = 280;
/// Fonts of the title, of the axes' names, and of their marks and the legend.
const TITLE_FONT: (&str, i32) = ("sans-serif", 24);
const AXIS_FONT: (&str, i32) = ("sans-serif", 19);
const MARK_FONT: (&str, i32) = ("sans-serif", 17);
/// How much of its group's width the bars fill.
const GROUP_SHARE: f64 = 0.8;
/// Colours of the series, in turn; told apart by people who see few colours.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(90, 90, 90),
    RGBColor(160, 60, 40),
];

/// An axis: what it shows, in which unit, and whether it is logarithmic. On a logarithmic axis values that
/// are not above zero are left out.
#[derive(Clone, Debug)]
pub struct Axis {
    /// What it shows, with the unit.
    pub label: String,
    /// Logarithmic rather than linear.
    pub logarithmic: bool,
}

impl Axis {
    /// A linear axis; it begins at zero if no value is below.
    pub fn linear(label: impl Into<String>) -> Axis {
        Axis { label: label.into(), logarithmic: false }
    }

    /// A logarithmic axis.
    pub fn logarithmic(label: impl Into<String>) -> Axis {
        Axis { label: label.into(), logarithmic: true }
    }
}

/// A named curve, or the bars of one colour.
#[derive(Clone, Debug)]
pub struct Series<Value> {
    /// Its name in the legend.
    pub name: String,
    /// Of a line chart `(x, y)`, in order of x; of a bar chart a value for each group, `None` for no bar.
    pub values: Vec<Value>,
}

/// Curves through points.
#[derive(Clone, Debug)]
pub struct LineChart {
    /// What is shown.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The curves.
    pub series: Vec<Series<(f64, f64)>>,
}

/// Groups of bars side by side.
#[derive(Clone, Debug)]
pub struct BarChart {
    /// What is shown.
    pub title: String,
    /// The names of the groups, left to right.
    pub groups: Vec<String>,
    /// The vertical axis.
    pub y: Axis,
    /// The bars, one of each series in every group.
    pub series: Vec<Series<Option<f64>>>,
}

/// Makes the folder of `--plot` before a long run.
pub fn make_folder(folder: &Path) -> Outcome {
    std::fs::create_dir_all(folder)
        .map_err(|error| Failure::input(format_args!("--plot {}: {error}", folder.display())))
}

impl LineChart {
    /// Writes `NAME.svg` into the folder.
    pub fn write(&self, folder: &Path, name: &str) -> Outcome {
        let points = || self.series.iter().flat_map(|series| &series.values);
        let x = Scale::around(&self.x, points().map(|point| point.0));
        let y = Scale::around(&self.y, points().map(|point| point.1));
        let frame = Frame { title: &self.title, x_label: Some(&self.x.label), y_label: &self.y.label };
        let text = frame.draw((x.clone(), y.clone()), &self.series, |chart, series, colour| {
            let shown = series.values.iter().filter(|point| x.shows(point.0) && y.shows(point.1));
            let line = LineSeries::new(shown.clone().copied(), colour.stroke_width(2));
            chart.draw_series(line).map_err(failed)?;
            let dots = shown.map(|&point| Circle::new(point, 3, colour.filled()));
            chart.draw_series(dots).map_err(failed)?;
            Ok(())
        })?;
        write_whole(&folder.join(format!("{name}.svg")), text.as_bytes())
    }
}

impl BarChart {
    /// Writes `NAME.svg` into the folder.
    pub fn write(&self, folder: &Path, name: &str) -> Outcome {
        let values = self.series.iter().flat_map(|series| series.values.iter().copied().flatten());
        let y = Scale::around(&self.y, values);
        let frame = Frame { title: &self.title, x_label: None, y_label: &self.y.label };
        let mut places = 0..self.series.len();
        let scales = (Scale::of_names(&self.groups), y.clone());
        let text = frame.draw(scales, &self.series, |chart, _, colour| {
            let shown = self.bars(places.next().unwrap_or_default()).filter(|bar| y.shows(bar.2));
            let bars = shown.map(|(left, right, value)| {
                Rectangle::new([(left, y.floor()), (right, value)], colour.filled())
            });
            chart.draw_series(bars).map_err(failed)?;
            Ok(())
        })?;
        write_whole(&folder.join(format!("{name}.svg")), text.as_bytes())
    }

    /// The bars of a series: `(left, right, value)` in groups.
    fn bars(&self, series: usize) -> impl Iterator<Item = (f64, f64, f64)> {
        let width = GROUP_SHARE / self.series.len() as f64;
        let values = self.series[series].values.iter().enumerate();
        values.filter_map(move |(group, value)| {
            let left = group as f64 + 0.5 * (1.0 - GROUP_SHARE) + series as f64 * width;
            value.map(|value| (left, left + width, value))
        })
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Scale>>;

/// What all charts have around them.
struct Frame<'a> {
    title: &'a str,
    /// `None` where the marks say it all.
    x_label: Option<&'a str>,
    y_label: &'a str,
}

impl Frame<'_> {
    /// The chart as SVG; `draw` draws a series in its colour.
    fn draw<Value>(
        &self,
        (x, y): (Scale, Scale),
        series: &[Series<Value>],
        mut draw: impl FnMut(&mut Chart, &Series<Value>, RGBColor) -> Outcome,
    ) -> Outcome<String> {
        let mut text = String::new();
        let area = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        let mut chart = ChartBuilder::on(&area)
            .caption(self.title, TITLE_FONT)
            .margin(12)
            .margin_right(LEGEND_WIDTH)
            .x_label_area_size(52)
            .y_label_area_size(84)
            .build_cartesian_2d(x, y)
            .map_err(failed)?;
        let mut mesh = chart.configure_mesh();
        match self.x_label {
            Some(label) => mesh.x_desc(label),
            None => mesh.disable_x_mesh(),
        };
        mesh.y_desc(self.y_label).light_line_style(WHITE);
        mesh.axis_desc_style(AXIS_FONT).label_style(MARK_FONT).draw().map_err(failed)?;
        for (series, colour) in series.iter().zip(COLOURS.into_iter().cycle()) {
            draw(&mut chart, series, colour)?;
        }
        legend(&area, series.iter().map(|series| series.name.as_str()))?;
        area.present().map_err(failed)?;
        drop((chart, area));
        Ok(text)
    }
}

/// The names of the series and their colours, to the right of the chart.
fn legend<'a>(area: &DrawingArea<SVGBackend, Shift>, names: impl Iterator<Item = &'a str>) -> Outcome {
    let left = SIZE.0 as i32 - LEGEND_WIDTH as i32 + 12;
    for (index, name) in names.enumerate() {
        let top = 56 + 26 * index as i32;
        let colour = COLOURS[index % COLOURS.len()].filled();
        area.draw(&Rectangle::new([(left, top), (left + 14, top + 14)], colour)).map_err(failed)?;
        area.draw(&Text::new(name.to_owned(), (left + 20, top), MARK_FONT)).map_err(failed)?;
    }
    Ok(())
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::run(format_args!("drawing a chart: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_hold_their_names_and_leave_out_what_a_logarithm_cannot_show() {
        let folder = tempfile::tempdir().expect("a folder");
        let chart = LineChart {
            title: "rates".into(),
            x: Axis::logarithmic("pixels"),
            y: Axis::logarithmic("points per second"),
            series: vec![Series { name: "ours".into(), values: vec![(1.0, 0.0), (10.0, 3.0), (100.0, 5e6)] }],
        };
        chart.write(folder.path(), "lines").expect("written");
        let text = std::fs::read_to_string(folder.path().join("lines.svg")).expect("a file");
        for part in ["<svg", "rates", "ours", "pixels", "points per second", "1 M"] {
            assert!(text.contains(part), "{part} is missing");
        }
        assert_eq!(text.matches("<circle").count(), 2, "a point at zero has no logarithm");
    }

    #[test]
    fn a_bar_that_is_not_there_leaves_its_place_free() {
        let series = |name: &str, values| Series { name: name.into(), values };
        let chart = BarChart {
            title: "layouts".into(),
            groups: vec!["small".into(), "large".into()],
            y: Axis::linear("MB"),
            series: vec![series("a", vec![Some(1.0), None]), series("b", vec![Some(2.0), Some(3.0)])],
        };
        assert_eq!(chart.bars(0).count(), 1);
        let (left, right, value) = chart.bars(1).nth(1).expect("a bar");
        assert!((left - 1.5).abs() < 1e-9 && (right - 1.9).abs() < 1e-9 && value == 3.0);
        let folder = tempfile::tempdir().expect("a folder");
        chart.write(folder.path(), "bars").expect("written");
        let text = std::fs::read_to_string(folder.path().join("bars.svg")).expect("a file");
        assert!(text.contains("small") && text.contains("large"));
    }
}
