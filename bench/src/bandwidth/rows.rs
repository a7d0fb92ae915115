//! The rows of the bench `bandwidth`, and how they are printed.

use serde::Serialize;
use setup::cli::{Outcome, out, outln};

use super::layout::{Cost, FRAMES_ONLY, STEPS};
use super::measure::{AtBodies, FilmMeasurement};

/// One layout in one setting.
#[derive(Debug, Serialize)]
pub struct Row {
    layout: &'static str,
    width: u32,
    height: u32,
    cameras: usize,
    bodies: usize,
    noise: f64,
    precision: &'static str,
    /// The share of the samples that was inside.
    inside_share: f64,
    frames_per_s: f64,
    passes_per_s: f64,
    /// Bytes of a second, divided by its passes.
    bytes_per_pass: f64,
    bytes_per_s: f64,
    /// The same with one pass for every frame.
    bytes_per_pass_one_a_frame: f64,
    bytes_per_s_one_a_frame: f64,
    /// Processor time for a new frame, and of a pass on its longest way, milliseconds.
    frame_cpu_ms: f64,
    pass_cpu_ms: f64,
    /// Round trips of a pass.
    pass_trips: f64,
}

/// The rows of one film.
pub fn of(measured: &FilmMeasurement) -> Vec<Row> {
    let row = |at: &AtBodies, cost: &Cost| Row {
        layout: cost.layout.name(),
        width: measured.plan.size.0,
        height: measured.plan.size.1,
        cameras: measured.plan.cameras,
        bodies: at.bodies,
        noise: measured.plan.noise,
        precision: cost.precision,
        inside_share: at.inside_share,
        frames_per_s: STEPS.frames_per_s,
        passes_per_s: STEPS.passes_per_s,
        bytes_per_pass: cost.mean_bytes_per_pass(STEPS),
        bytes_per_s: cost.bytes_per_s(STEPS),
        bytes_per_pass_one_a_frame: cost.mean_bytes_per_pass(FRAMES_ONLY),
        bytes_per_s_one_a_frame: cost.bytes_per_s(FRAMES_ONLY),
        frame_cpu_ms: cost.frame_ms,
        pass_cpu_ms: cost.pass_ms,
        pass_trips: cost.pass_trips,
    };
    measured.at.iter().flat_map(|at| at.costs.iter().map(move |cost| row(at, cost))).collect()
}

/// The head of the table.
pub fn print_header() -> Outcome {
    let (frames, passes) = (STEPS.frames_per_s, STEPS.passes_per_s);
    outln!("bytes a pass / a second, {frames} frames/s and {passes} passes/s")?;
    out!("{:>9} {:>4} {:>5} {:>6}", "size", "cams", "noise", "bodies")?;
    let names =
        ["raw images", "bit masks", "runs", "runs+lz4", "raw points", "bodies, exact", "bodies, quant."];
    outln!("{}", names.map(|name| format!(" {name:>15}")).concat())
}

/// A line for each number of bodies.
pub fn print_rows(measured: &FilmMeasurement) -> Outcome {
    let plan = &measured.plan;
    for at in &measured.at {
        out!(
            "{:>9} {:>4} {:>4}% {:>6}",
            format!("{}x{}", plan.size.0, plan.size.1),
            plan.cameras,
            100.0 * plan.noise,
            at.bodies
        )?;
        let cell = |cost: &Cost| {
            let (a_pass, a_second) = (cost.mean_bytes_per_pass(STEPS), cost.bytes_per_s(STEPS));
            format!(" {:>15}", format!("{}/{}", bytes(a_pass), bytes(a_second)))
        };
        outln!("{}", at.costs.iter().map(cell).collect::<String>())?;
    }
    Ok(())
}

/// A number of bytes in three digits.
pub fn bytes(count: f64) -> String {
    let (value, unit) = match count {
        count if count < 1e3 => (count, " B"),
        count if count < 1e6 => (count * 1e-3, " k"),
        count if count < 1e9 => (count * 1e-6, " M"),
        count => (count * 1e-9, " G"),
    };
    let digits = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
    format!("{value:.digits$}{unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_three_digits() {
        let told = [0.0, 999.0, 1_234.0, 56_789.0, 999_000.0, 1.5e6, 2.34e9].map(bytes);
        assert_eq!(told, ["0.00 B", "999 B", "1.23 k", "56.8 k", "999 k", "1.50 M", "2.34 G"]);
    }
}
