//! `hulltouch-bench feed`: what a page costs its link and the run that it looks at.

mod charts;
mod link;
mod page;
mod rows;
mod run;

use std::path::PathBuf;

use clap::Args;
use setup::cli::{ArgumentError, Failure, Outcome, outln, parse_size};

use self::rows::{Row, TABLE};
use self::run::{Setting, measured};
use super::outputs::{Outputs, within};
use super::table::{Machine, Table};

const SIZES: [(u32, u32); 2] = [(640, 480), (1920, 1080)];

/// Bytes and delay of a page, and what it costs the run.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example:\n  \
    hulltouch-bench feed --size 640x480 --link 1 --seconds 60 --json feed.json\n\n\
    Each row is a demo of its own: cameras, coordinator and physics as processes, and a page that reads \
    all it is sent and draws nothing. Of the studio, the page looks for a while and looks away for a \
    while in turn, so that steps with it and without it are of one run; every step asks for a pass. A \
    recording is watched to its end. A link is a relay that passes on so many megabits a second and no \
    more.")]
pub struct FeedBenchArguments {
    /// Image sizes of the studio's cameras [default: 640x480,1920x1080, without --recording].
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse_size)]
    size: Vec<(u32, u32)>,
    /// Cluster files of recordings.
    #[arg(long, value_name = "CLUSTER.toml,…", value_delimiter = ',')]
    recording: Vec<PathBuf>,
    /// Cameras of the studio.
    #[arg(long, value_name = "N", default_value = "8", value_parser = super::cluster::parse_nodes)]
    cameras: usize,
    /// What the page's link carries, megabits a second; 0: whatever comes.
    #[arg(long, value_name = "M,…", value_delimiter = ',', default_value = "0", value_parser = parse_link)]
    link: Vec<f64>,
    /// How long the page looks at the studio, seconds.
    #[arg(long, value_name = "S", default_value = "20", value_parser = parse_seconds)]
    seconds: f64,
    #[command(flatten)]
    outputs: Outputs,
}

fn parse_link(text: &str) -> Result<f64, ArgumentError> {
    within(text, 0.0, 100_000.0)
}

fn parse_seconds(text: &str) -> Result<f64, ArgumentError> {
    within(text, 1.0, 3600.0)
}

/// Runs it.
pub fn run(arguments: &FeedBenchArguments) -> Outcome {
    arguments.outputs.prepare()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    let machine = Machine::here();
    let mut rows: Vec<Row> = Vec::new();
    let mut measure = || {
        outln!("{}; cameras, coordinator and page share its cores", machine.line())?;
        TABLE.print_titles()?;
        for setting in settings(arguments) {
            let row = runtime.block_on(measured(&setting))?;
            TABLE.print(&row)?;
            rows.push(row);
        }
        Ok(())
    };
    let measured = measure();
    let table = Table { bench: "feed", machine, rows };
    arguments.outputs.write(measured, &table, |folder| charts::draw(&table.rows, folder))
}

/// Every source over every link.
fn settings(arguments: &FeedBenchArguments) -> Vec<Setting> {
    let sizes: &[(u32, u32)] = match (&arguments.size[..], &arguments.recording[..]) {
        ([], []) => &SIZES,
        (sizes, _) => sizes,
    };
    let studio = |&(width, height): &(u32, u32)| {
        let (cameras, size) = (arguments.cameras.to_string(), format!("{width}x{height}"));
        let program = ["--cameras", &cameras, "--size", &size, "--ask", "step"].map(str::to_owned).to_vec();
        (format!("studio {size}"), program, Some(arguments.seconds))
    };
    let recording = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name = name.trim_end_matches(".cluster.toml").to_owned();
        (name, vec!["--recording".to_owned(), path.to_string_lossy().into_owned()], None)
    };
    let sources = sizes.iter().map(studio).chain(arguments.recording.iter().map(recording));
    let over_links = |(source, program, seconds): (String, Vec<String>, Option<f64>)| {
        let setting = move |&link: &f64| Setting {
            source: source.clone(),
            program: program.clone(),
            seconds,
            link_mbit_per_s: (link > 0.0).then_some(link),
        };
        arguments.link.iter().map(setting).collect::<Vec<_>>()
    };
    sources.flat_map(over_links).collect()
}
