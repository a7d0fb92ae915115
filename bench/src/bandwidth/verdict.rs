//! Where each layout wins: crossing points, what links carry, and which pass is done sooner.

use serde::Serialize;
use setup::cli::{Outcome, outln};

use super::layout::{Cost, Crossing, FRAMES_ONLY, Layout, Rates, STEPS, crossing};
use super::measure::{AtBodies, FilmMeasurement};
use super::rows::bytes;
use crate::cluster::film::FilmPlan;
use crate::scale::report::{LATENCY_S, LINKS_BITS_PER_S, link_name};

/// The size that most is said about.
pub const BASE_SIZE: (u32, u32) = (3840, 2160);
const BASE_BODIES: usize = 30;
/// A round trip beside what bytes take.
const TRIP_S: f64 = 2.0 * LATENCY_S;

/// A film in words.
pub fn plan_name(plan: &FilmPlan) -> String {
    format!("{}x{}, {} cameras, noise {} %", plan.size.0, plan.size.1, plan.cameras, 100.0 * plan.noise)
}

/// The number of bodies nearest to the base's.
pub fn base_bodies(measured: &FilmMeasurement) -> &AtBodies {
    let nearest = measured.at.iter().min_by_key(|at| at.bodies.abs_diff(BASE_BODIES));
    nearest.expect("a measurement has at least one number of bodies")
}

/// For how many bodies asking about registered bodies sends fewer bytes than a layout that gathers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CrossingRow {
    width: u32,
    height: u32,
    cameras: usize,
    noise: f64,
    precision: &'static str,
    passes_per_s: f64,
    against: &'static str,
    /// `None` if asking sends more even for the fewest bodies.
    bodies: Option<f64>,
    /// True if it lies beyond the bodies measured.
    beyond_measured: bool,
}

/// All crossings of all films.
pub fn crossings(all: &[FilmMeasurement]) -> Vec<CrossingRow> {
    let mut rows = Vec::new();
    for (measured, rates) in all.iter().flat_map(|measured| [(measured, STEPS), (measured, FRAMES_ONLY)]) {
        for precision in precisions(measured) {
            rows.extend(Layout::GATHERED.map(|layout| {
                let found = crossing_of(measured, precision, layout, rates);
                CrossingRow {
                    width: measured.plan.size.0,
                    height: measured.plan.size.1,
                    cameras: measured.plan.cameras,
                    noise: measured.plan.noise,
                    precision,
                    passes_per_s: rates.passes_per_s,
                    against: layout.name(),
                    bodies: found.map(|found| found.bodies),
                    beyond_measured: found.is_some_and(|found| found.beyond),
                }
            }));
        }
    }
    rows
}

/// Prints everything.
pub fn print(all: &[FilmMeasurement]) -> Outcome {
    print_crossings(all)?;
    print_sooner(all)?;
    if let Some(base) = all.iter().find(|measured| measured.plan.size == BASE_SIZE).or(all.first()) {
        print_links(base)?;
    }
    Ok(())
}

/// The precisions that registered bodies were asked with.
fn precisions(measured: &FilmMeasurement) -> Vec<&'static str> {
    let costs = base_bodies(measured).costs.iter();
    costs.filter(|cost| cost.layout == Layout::RegisteredBodies).map(|cost| cost.precision).collect()
}

fn cost_of<'a>(at: &'a AtBodies, layout: Layout, precision: &str) -> Option<&'a Cost> {
    at.costs
        .iter()
        .find(|cost| cost.layout == layout && (layout.is_gathered() || cost.precision == precision))
}

/// For how many bodies asking sends fewer bytes than gathering.
fn crossing_of(
    measured: &FilmMeasurement,
    precision: &str,
    gathered: Layout,
    rates: Rates,
) -> Option<Crossing> {
    let asked = measured.at.iter().filter_map(|at| {
        let cost = cost_of(at, Layout::RegisteredBodies, precision)?;
        Some((at.bodies, cost.bytes_per_s(rates)))
    });
    let gathered = cost_of(base_bodies(measured), gathered, precision)?.bytes_per_s(rates);
    crossing(&asked.collect::<Vec<_>>(), gathered)
}

fn print_crossings(all: &[FilmMeasurement]) -> Outcome {
    outln!(
        "\nRegistered bodies send fewer bytes than gathering up to so many bodies (beyond the measured: ~)"
    )?;
    for (rates, words) in [(STEPS, "passes at every step"), (FRAMES_ONLY, "one pass a frame")] {
        outln!("  {words}, {} passes/s on {} frames/s:", rates.passes_per_s, rates.frames_per_s)?;
        for measured in all {
            for precision in precisions(measured) {
                let cell = |layout: Layout| {
                    let found = crossing_of(measured, precision, layout, rates);
                    format!("{} {}", layout.name(), crossing_words(found))
                };
                let cells = Layout::GATHERED.map(cell).join(", ");
                outln!("    {} ({precision}): {cells}", plan_name(&measured.plan))?;
            }
        }
    }
    outln!("\nOne pass a frame, at the measured bodies nearest {BASE_BODIES}: the cluster against runs+lz4")?;
    for measured in all {
        let at = base_bodies(measured);
        for precision in precisions(measured) {
            let mean =
                |layout| cost_of(at, layout, precision).map(|cost| cost.mean_bytes_per_pass(FRAMES_ONLY));
            if let Some((asked, gathered)) = mean(Layout::RegisteredBodies).zip(mean(Layout::RunsLz4)) {
                outln!(
                    "    {} ({precision}), {} bodies: {} against {}: {}",
                    plan_name(&measured.plan),
                    at.bodies,
                    bytes(asked),
                    bytes(gathered),
                    factor_words(asked / gathered)
                )?;
            }
        }
    }
    Ok(())
}

fn crossing_words(found: Option<Crossing>) -> String {
    match found {
        None => "nowhere".to_owned(),
        Some(Crossing { bodies, .. }) if !bodies.is_finite() => "always".to_owned(),
        Some(Crossing { bodies, beyond }) => format!("{}{bodies:.0}", if beyond { "~" } else { "" }),
    }
}

fn factor_words(factor: f64) -> String {
    if factor <= 1.0 {
        format!("{:.0} % of it", 100.0 * factor)
    } else {
        format!("{factor:.2} times as much")
    }
}

fn print_sooner(all: &[FilmMeasurement]) -> Outcome {
    outln!(
        "\nWhich pass is done sooner, ms: bytes over the coordinator's link, measured computation, and {:.0} µs \
         a round trip;\ngathering runs+lz4 as first pass of a frame (mean of all passes) / asking about \
         registered bodies",
        TRIP_S * 1e6
    )?;
    for measured in all {
        // All numbers of bodies where most is said, the base's elsewhere.
        let is_base = measured.plan.size == BASE_SIZE && measured.plan.noise == 0.0 || all.len() == 1;
        let shown = measured.at.iter().filter(|at| is_base || at.bodies == base_bodies(measured).bodies);
        for at in shown {
            for precision in precisions(measured) {
                let cells = LINKS_BITS_PER_S.map(|link| sooner(at, precision, link)).join("   ");
                outln!("    {}, {:>3} bodies ({precision}): {cells}", plan_name(&measured.plan), at.bodies)?;
            }
        }
    }
    Ok(())
}

fn sooner(at: &AtBodies, precision: &str, link_bits_per_s: f64) -> String {
    let takes = |layout| {
        cost_of(at, layout, precision).map(|cost| cost.pass_takes_ms(link_bits_per_s, TRIP_S, STEPS))
    };
    let Some(((first_ms, mean_ms), (asked_ms, _))) =
        takes(Layout::RunsLz4).zip(takes(Layout::RegisteredBodies))
    else {
        return String::new();
    };
    let winner = match (asked_ms < first_ms, asked_ms < mean_ms) {
        (true, true) => "asking",
        (true, false) => "asking, on new frames",
        (false, _) => "gathering",
    };
    format!("{}: {first_ms:.1} ({mean_ms:.1}) / {asked_ms:.1} {winner}", link_name(link_bits_per_s))
}

fn print_links(measured: &FilmMeasurement) -> Outcome {
    let at = base_bodies(measured);
    outln!(
        "\nWhat the coordinator's link carries, {}, {} bodies: passes/s, and cameras at {} passes/s",
        plan_name(&measured.plan),
        at.bodies,
        STEPS.passes_per_s
    )?;
    outln!(
        "    {:<28}{}",
        "layout",
        LINKS_BITS_PER_S.map(|link| format!("{:>24}", link_name(link))).concat()
    )?;
    for cost in &at.costs {
        let carried = |link: f64| {
            let cameras = link / 8.0 / (cost.bytes_per_s(STEPS) / measured.plan.cameras as f64);
            let told = format!("{:.0}/s, {cameras:.0} cameras", cost.passes_per_s_on(link, STEPS));
            format!("{told:>24}")
        };
        let precision = if cost.layout.is_gathered() { "" } else { cost.precision };
        let name = format!("{} {precision}", cost.layout.name());
        outln!("    {name:<28}{}", LINKS_BITS_PER_S.map(carried).concat())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_say_where_a_crossing_lies() {
        assert_eq!(crossing_words(None), "nowhere");
        assert_eq!(crossing_words(Some(Crossing { bodies: 12.4, beyond: false })), "12");
        assert_eq!(crossing_words(Some(Crossing { bodies: 400.0, beyond: true })), "~400");
        assert_eq!(crossing_words(Some(Crossing { bodies: f64::INFINITY, beyond: true })), "always");
        assert_eq!(
            (factor_words(0.5), factor_words(1.5)),
            ("50 % of it".into(), "1.50 times as much".into())
        );
    }
}
