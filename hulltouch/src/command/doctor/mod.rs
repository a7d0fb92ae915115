//! `hulltouch doctor`: what keeps a room from running, and what to do about it.

mod checks;
mod facts;
mod finding;
mod gather;

use std::path::PathBuf;

use clap::Args;
use proto::text::clean;
use serde::Serialize;
use setup::ClusterFile;
use setup::cli::{Failure, Outcome, out};

use self::finding::{Finding, Level};
use self::gather::Scope;
use crate::run::security::SecurityArguments;

/// The longest text of a line; texts of other machines are cut and cleaned before.
const MAX_CHARS: usize = 600;

/// Check everything that a room needs, a line each with its cure: files, names, ports, certificates, versions, clocks,
/// cameras, disks. Cameras of nodes without a coordinator film for some seconds. Exit status 1 if a check fails.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples, on a camera PC before its node runs, and on the coordinator's PC when all do:\n  \
    hulltouch doctor studio.cluster.toml --host left --certs /etc/hulltouch/certs\n  \
    hulltouch doctor studio.cluster.toml --certs /etc/hulltouch/certs")]
pub struct DoctorArguments {
    /// The cluster file.
    cluster: PathBuf,
    /// Check the PC of this node alone, whether it runs yet or not.
    #[arg(long, value_name = "NAME")]
    host: Option<String>,
    /// Only look: cameras of nodes without a coordinator do not film.
    #[arg(long)]
    no_film: bool,
    /// Where recordings will go.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    recordings: PathBuf,
    /// Print one JSON object instead: `ok`, and `checks`, each with `check`, `level` (ok, skip, warn, fail), `what` and `cure`.
    #[arg(long)]
    json: bool,
    /// Where /dev and /sys are.
    #[arg(long, value_name = "FOLDER", default_value = "/", hide = true)]
    root: PathBuf,
    #[command(flatten)]
    security: SecurityArguments,
}

#[derive(Serialize)]
struct Line {
    check: &'static str,
    #[serde(flatten)]
    finding: Finding,
}

#[derive(Serialize)]
struct Report {
    ok: bool,
    checks: Vec<Line>,
}

/// Gathers, checks and prints.
pub fn run(arguments: &DoctorArguments) -> Outcome {
    let file = ClusterFile::open(&arguments.cluster)?;
    let scope = Scope {
        file: &file,
        host: arguments.host.as_deref(),
        security: &arguments.security,
        may_film: !arguments.no_film,
        recordings: arguments.recordings.clone(),
        root: arguments.root.clone(),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    let facts = runtime.block_on(gather::gather(&scope))?;
    runtime.shutdown_background();
    let lines: Vec<Line> = checks::ALL
        .iter()
        .flat_map(|(check, find)| find(&facts).into_iter().map(|finding| Line { check, finding }))
        .collect();
    let mut failed: Vec<&str> =
        lines.iter().filter(|line| line.finding.level == Level::Fail).map(|line| line.check).collect();
    failed.dedup();
    let mut text = String::new();
    if arguments.json {
        text =
            serde_json::to_string(&Report { ok: failed.is_empty(), checks: lines }).map_err(Failure::run)?;
        text.push('\n');
    } else {
        lines.iter().for_each(|line| text += &line.text());
    }
    out!("{text}")?;
    match &failed[..] {
        [] => Ok(()),
        failed => Err(Failure::run(format_args!("checks failed: {}", failed.join(", ")))),
    }
}

impl Line {
    fn text(&self) -> String {
        let Finding { level, what, cure } = &self.finding;
        let cure = cure.as_ref().map_or_else(String::new, |cure| format!("; {cure}"));
        let what = clean(&format!("{what}{cure}"), MAX_CHARS);
        format!("{:<5} {:<13} {what}\n", level.word(), self.check)
    }
}
