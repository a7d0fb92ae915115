//! `hulltouch-bench segment`: megapixels per second of one core, from a camera's bytes to a silhouette.

mod engines;
mod scene;

use std::path::Path;

use clap::Args;
use serde::Serialize;
use serde_json::Value;
use setup::cli::{Failure, Outcome, Progress, outln, parse_size};

use self::engines::{Opponent, Ours, SCRIPT};
use self::scene::{LAYOUTS, Scene};
use super::outputs::Outputs;
use super::peers::Python;
use super::plot::{Axis, BarChart, Series};
use super::table::{Machine, distinct};

/// A figure is the median over the frames of so many turns, in which every engine segments the whole film,
/// after one that does not count.
const TURNS: usize = 9;

/// Megapixels per second of one core, and how good the silhouettes are.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch-bench segment --size 1920x1080 --python python3 --json segment.json --plot charts\n\n\
    Frames are those of the studio, with shadows and sensor noise, compared with its ground truth; and, \
    where HULLTOUCH_DATASETS leads to the recordings and ffmpeg is there, those of uu_horseman, compared \
    with its reference silhouettes. Engines: `hulltouch_rgb`, `hulltouch_i420`, `hulltouch_nv12` and \
    `hulltouch_yuyv` are ours on the same frames in four layouts, from bytes to the cleaned silhouette; \
    `mog2` is OpenCV's on RGB, `mog2_i420` the same on I420 that OpenCV first turns into RGB, and \
    `difference` its absolute difference with a threshold, all from bytes to a mask without clean-up. \
    They are learnt on the same empty room and then frozen; their silhouettes are the better of raw and \
    cleaned ones (clean-up is not timed). They need a Python with the packages of \
    bench/peers/requirements.txt; without it their rows are left out. Seconds are those that the \
    processor gave the thread.")]
pub struct SegmentBenchArguments {
    /// Image sizes of the studio's camera.
    #[arg(long, value_name = "WxH,…", default_value = "1920x1080,3840x2160", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    #[command(flatten)]
    python: Python,
    #[command(flatten)]
    outputs: Outputs,
}

/// One figure.
#[derive(Clone, Debug, Serialize)]
struct Row {
    set: &'static str,
    size: String,
    engine: &'static str,
    mpx_per_s: f64,
    /// Mean intersection over union.
    iou: f64,
    /// That of the worst frame.
    least_iou: f64,
}

/// Everything measured.
#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    machine: Machine,
    /// What the opponent is, or null.
    opencv: Value,
    rows: Vec<Row>,
}

/// Runs it.
pub fn run(arguments: &SegmentBenchArguments) -> Outcome {
    arguments.outputs.prepare()?;
    let mut opponent = arguments.python.start(SCRIPT)?.map(|peer| Opponent { peer });
    let opencv = opponent.as_ref().map_or(Value::Null, |opponent| opponent.peer.greeting().clone());
    let mut report = Report { bench: "segment", machine: Machine::here(), opencv, rows: Vec::new() };
    let measured = report.measure_all(&arguments.size, opponent.as_mut());
    arguments.outputs.write(measured, &report, |folder| report.draw(folder))
}

fn recording() -> Outcome<Vec<Scene>> {
    let datasets = std::env::var_os("HULLTOUCH_DATASETS");
    let datasets = datasets.ok_or_else(|| Failure::input("HULLTOUCH_DATASETS is not set"))?;
    Scene::recording(Path::new(&datasets))
}

/// What was measured of one engine so far.
#[derive(Default)]
struct EngineFigures {
    mpx_per_s: Vec<f64>,
    overlaps: Vec<f64>,
}

impl EngineFigures {
    fn add(&mut self, pixels: f64, turns: &[Vec<f64>], overlaps: Vec<f64>) {
        self.mpx_per_s.extend(turns.iter().flatten().map(|seconds| pixels / seconds / 1e6));
        self.overlaps.extend(overlaps);
    }

    fn row(mut self, set: &'static str, size: (u32, u32), engine: &'static str) -> Row {
        self.mpx_per_s.sort_by(f64::total_cmp);
        Row {
            set,
            size: format!("{}x{}", size.0, size.1),
            engine,
            mpx_per_s: self.mpx_per_s[self.mpx_per_s.len() / 2],
            iou: self.overlaps.iter().sum::<f64>() / self.overlaps.len() as f64,
            least_iou: self.overlaps.iter().copied().fold(f64::INFINITY, f64::min),
        }
    }
}

/// One scene: the engines take turns, so that what else the machine does meets them alike.
fn measure_scene(
    scene: &Scene,
    engines: &[&'static str],
    mut opponent: Option<&mut Opponent>,
    figures: &mut [EngineFigures],
    progress: &mut Progress,
) -> Outcome {
    if let Some(opponent) = opponent.as_deref_mut() {
        opponent.take(scene)?;
    }
    let mut ours = (0..LAYOUTS.len()).map(|layout| Ours::new(scene, layout)).collect::<Outcome<Vec<_>>>()?;
    let mut turns: Vec<Vec<Vec<f64>>> = vec![Vec::new(); engines.len()];
    for _ in 0..=TURNS {
        for (at, engine) in engines.iter().enumerate() {
            turns[at].push(match (ours.get_mut(at), opponent.as_deref_mut()) {
                (Some(ours), _) => ours.turn()?,
                (None, Some(opponent)) => opponent.turn(engine)?,
                (None, None) => Vec::new(),
            });
        }
        progress.step();
    }
    let pixels = f64::from(scene.size.0) * f64::from(scene.size.1);
    for (at, engine) in engines.iter().enumerate() {
        let overlaps = match (ours.get_mut(at), opponent.as_deref_mut()) {
            (Some(ours), _) => ours.overlaps(&scene.truth)?,
            (None, Some(opponent)) => opponent.overlaps(engine, scene)?,
            (None, None) => Vec::new(),
        };
        figures[at].add(pixels, &turns[at][1..], overlaps);
    }
    Ok(())
}

impl Report {
    /// Everything, with the table.
    fn measure_all(&mut self, sizes: &[(u32, u32)], mut opponent: Option<&mut Opponent>) -> Outcome {
        outln!("{}; one core", self.machine.line())?;
        outln!(
            "{:12}  {:>10}  {:15}  {:>8}  {:>9}  {:>7}  worst frame",
            "set",
            "size",
            "engine",
            "Mpx/s",
            "of mog2",
            "IoU"
        )?;
        for &size in sizes {
            self.measure(&[Scene::studio(size)?], opponent.as_deref_mut())?;
        }
        match recording() {
            Ok(scenes) => self.measure(&scenes, opponent),
            Err(problem) => outln!("no rows of uu_horseman: {problem}"),
        }
    }

    /// All engines on scenes of one set and size.
    fn measure(&mut self, scenes: &[Scene], mut opponent: Option<&mut Opponent>) -> Outcome {
        let Some(first) = scenes.first() else { return Ok(()) };
        let peers = if opponent.is_some() { Opponent::engines(first.size) } else { Vec::new() };
        let engines: Vec<&'static str> = LAYOUTS.iter().map(|layout| layout.0).chain(peers).collect();
        let mut figures: Vec<EngineFigures> = engines.iter().map(|_| EngineFigures::default()).collect();
        let mut progress = Progress::new("segmenting", (scenes.len() * (TURNS + 1)) as u64);
        for scene in scenes {
            measure_scene(scene, &engines, opponent.as_deref_mut(), &mut figures, &mut progress)?;
        }
        drop(progress);
        let rows = figures.into_iter().zip(engines);
        let rows = rows.map(|(figures, engine)| figures.row(first.set, first.size, engine));
        let from = self.rows.len();
        self.rows.extend(rows);
        self.print(from)
    }

    /// The rows from `from` on, which are of one set and size.
    fn print(&self, from: usize) -> Outcome {
        let rows = &self.rows[from..];
        let mog2 = rows.iter().find(|row| row.engine == "mog2").map(|row| row.mpx_per_s);
        for row in rows {
            let times = mog2.map_or_else(String::new, |mog2| format!("{:.1} x", row.mpx_per_s / mog2));
            outln!(
                "{:12}  {:>10}  {:15}  {:8.0}  {times:>9}  {:7.4}  {:.4}",
                row.set,
                row.size,
                row.engine,
                row.mpx_per_s,
                row.iou,
                row.least_iou
            )?;
        }
        Ok(())
    }

    /// Rates and quality, a group of bars for each set and size.
    fn draw(&self, folder: &Path) -> Outcome {
        let groups = distinct(self.rows.iter().map(|row| (row.set, &row.size[..])));
        let engines = distinct(self.rows.iter().map(|row| row.engine));
        let chart = |title: &str, y: Axis, value: &dyn Fn(&Row) -> f64| {
            let bar = |engine: &str, group: &(&str, &str)| {
                let found =
                    self.rows.iter().find(|row| row.engine == engine && (row.set, &row.size[..]) == *group);
                found.map(value)
            };
            let series = engines.iter().map(|engine| Series {
                name: (*engine).to_owned(),
                values: groups.iter().map(|group| bar(engine, group)).collect(),
            });
            BarChart {
                title: title.to_owned(),
                groups: groups.iter().map(|(set, size)| format!("{set} {size}")).collect(),
                y,
                series: series.collect(),
            }
        };
        let rates = Axis::logarithmic("megapixels per second, one core");
        chart("From a camera's bytes to a silhouette", rates, &|row| row.mpx_per_s)
            .write(folder, "segment")?;
        let quality = Axis::linear("intersection over union");
        chart("Silhouettes against the truth", quality, &|row| row.iou).write(folder, "segment_quality")
    }
}
