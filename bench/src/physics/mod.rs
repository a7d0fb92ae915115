//! `hulltouch bench physics`: whether bodies behave as a physicist expects.

mod film;
mod judge;
mod response;
mod rows;
mod track;

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use clap::Args;
use sim::{Scene, StageHint};
use stage::{Motion, Prop, StageSettings};

use self::film::StageFilm;
use self::judge::{Conditions, Metric, judge, seconds_of};
use self::response::Response;
use self::rows::{Row, TABLE};
use self::track::{RunPlan, Track};
use super::outputs::within;
use super::table::{Machine, Table, write_json};
use cli::{ArgumentError, Failure, Outcome, check_writable, parse_size};

/// Scenes as their bodies went, against what they must keep to.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  hulltouch bench physics --scene rest,lift --size 640x480,1280x720 --noise 0,0.01 --seeds 3

Every run sees the true silhouettes of the studio, in lock-step; with noise, a share of the pixels on either side of
every outline is inverted in every frame. Of several seeds each figure is the worst.")]
pub struct PhysicsBenchArguments {
    /// The scenes.
    #[arg(
        long,
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "rest,lift,tray,push,punch,drops,squeeze"
    )]
    scene: Vec<String>,
    /// How bodies answer the hull.
    #[arg(
        long,
        value_enum,
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "paper,contacts,one-contact"
    )]
    response: Vec<Response>,
    /// Image sizes.
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', default_value = "640x480,1280x720", value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// The share of outline pixels that flicker.
    #[arg(long, value_name = "SHARE,…", value_delimiter = ',', default_value = "0", value_parser = parse_share)]
    noise: Vec<f64>,
    /// Runs of each kind, each with another flicker and other drops.
    #[arg(long, value_name = "N", default_value = "1", value_parser = parse_seeds)]
    seeds: u64,
    /// Cameras of the studio.
    #[arg(long, value_name = "N", default_value = "8", value_parser = super::cluster::parse_nodes)]
    cameras: usize,
    /// Film of each run, seconds [default: what the scene needs].
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    seconds: Option<f64>,
    /// Write the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn parse_share(text: &str) -> Result<f64, ArgumentError> {
    within(text, 0.0, 1.0)
}

fn parse_seeds(text: &str) -> Result<u64, ArgumentError> {
    within(text, 1, 1000)
}

fn parse_seconds(text: &str) -> Result<f64, ArgumentError> {
    within(text, 3.0, 3600.0)
}

/// Runs it.
#[allow(clippy::print_stdout, reason = "the table is the command's output")]
pub fn run(arguments: &PhysicsBenchArguments) -> Outcome {
    if let Some(path) = &arguments.json {
        check_writable("--json", path)?;
    }
    let scenes: Vec<Scene> = arguments
        .scene
        .iter()
        .map(|name| Scene::named(name).map_err(|error| Failure::input(format_args!("--scene: {error}"))))
        .collect::<Outcome<_>>()?;
    let machine = Machine::here();
    println!("{}", machine.line());
    TABLE.print_titles();
    let mut rows: Vec<Row> = Vec::new();
    for scene in &scenes {
        for &size in &arguments.size {
            let film = Arc::new(StageFilm::new(stage_of(scene)?, arguments.cameras, size)?);
            for &response in &arguments.response {
                for &noise in &arguments.noise {
                    let kind = Kind { scene, response, size, noise };
                    let found = kind.rows(&film, arguments)?;
                    found.iter().for_each(|row| TABLE.print(row));
                    rows.extend(found);
                }
            }
        }
    }
    let table = Table { bench: "physics", machine, rows };
    write_json(&table, arguments.json.as_deref())
}

/// The studio that a scene wants.
fn stage_of(scene: &Scene) -> Outcome<StageSettings> {
    fn named<T: FromStr<Err: std::fmt::Display>>(text: &str) -> Outcome<T> {
        text.parse().map_err(Failure::input)
    }
    let Some(StageHint { motion, props, person }) = scene.stage() else {
        return Err(Failure::input(format_args!("scene {}: found no [stage], expected one", scene.name())));
    };
    Ok(StageSettings {
        motion: if motion.is_empty() { Motion::default() } else { named::<Motion>(motion)? },
        person: *person,
        props: props.iter().map(|prop| named::<Prop>(prop)).collect::<Outcome<_>>()?,
        ..StageSettings::default()
    })
}

/// Runs that differ by their seeds alone.
struct Kind<'a> {
    scene: &'a Scene,
    response: Response,
    size: (u32, u32),
    noise: f64,
}

impl Kind<'_> {
    fn rows(&self, film: &Arc<StageFilm>, arguments: &PhysicsBenchArguments) -> Outcome<Vec<Row>> {
        let Kind { scene, response, size, noise } = *self;
        // Without noise all seeds are one, but where bodies fall at random.
        let seeds = if noise > 0.0 || scene.name() == "drops" { arguments.seeds } else { 1 };
        let mut worst: Vec<Metric> = Vec::new();
        for seed in 1..=seeds {
            let seconds = arguments.seconds.unwrap_or_else(|| seconds_of(scene.name()));
            let track = Track::of(RunPlan { film, scene, response, flicker: noise, seed, seconds })?;
            let conditions = Conditions { width: size.0, flicker: noise };
            let found = judge(scene.name(), &track, film, conditions);
            worst = if worst.is_empty() {
                found
            } else {
                worst.into_iter().zip(found).map(|(a, b)| Metric { value: worse(a, b.value), ..a }).collect()
            };
        }
        let row = |metric: Metric| Row {
            scene: scene.name().to_owned(),
            response: response.name(),
            width: size.0,
            height: size.1,
            noise,
            seeds,
            metric: metric.name,
            value: metric.value.is_finite().then_some(metric.value),
            limit: metric.limit.map(rows::limit_text),
            holds: metric.limit.map(|limit| limit.holds(metric.value)),
        };
        Ok(worst.into_iter().map(row).collect())
    }
}

/// The worse of two figures of a kind: the greater where nothing must hold.
fn worse(a: Metric, b: f64) -> f64 {
    a.limit.map_or(a.value.max(b), |limit| limit.worse(a.value, b))
}
