//! `hulltouch status`: a room at a glance.

mod json;
mod lacks;
pub mod room;
mod table;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use film_time::unix_now_s;
use proto::NodeStatus;
use setup::ClusterFile;
use setup::cli::{Failure, Outcome, out};

use self::room::Room;
use crate::interrupt::interrupted;
use crate::run::security::SecurityArguments;

/// Between two looks.
const EVERY: Duration = Duration::from_secs(1);
/// To the terminal's upper left corner, and what is below gone.
const HOME: &str = "\x1b[H\x1b[J";

/// Show how the nodes and cameras of a room are; their run does not notice. Exit status 1 if something lacks.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples:\n  \
    hulltouch status studio.cluster.toml --certs /etc/hulltouch/certs --watch\n  \
    hulltouch status studio.cluster.toml --insecure --json\n\n\
    --certs takes the folder of the coordinator or that of viewers. docs/commands.md lists the keys of \
    --json.")]
pub struct StatusArguments {
    /// The cluster file.
    cluster: PathBuf,
    /// Look again every second, until Ctrl-C.
    #[arg(long)]
    watch: bool,
    /// Print one JSON object a look, each in a line.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    security: SecurityArguments,
}

/// Looks once, or until it is interrupted.
pub fn run(arguments: &StatusArguments) -> Outcome {
    let file = ClusterFile::open(&arguments.cluster)?;
    let dial = arguments.security.looking(&file)?;
    let mut room = Room::of(&file, &dial)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    runtime.block_on(async {
        let lacks = arguments.look(&file, &mut room).await?;
        if !arguments.watch {
            return match lacks {
                0 => Ok(()),
                count => Err(Failure::run(format_args!("room {} lacks something ({count})", file.name))),
            };
        }
        let watching = async {
            loop {
                tokio::time::sleep(EVERY).await;
                arguments.look(&file, &mut room).await?;
            }
        };
        tokio::select! {
            failed = watching => failed,
            () = interrupted() => Ok(()),
        }
    })
}

impl StatusArguments {
    /// Looks and prints; how many things lack.
    async fn look(&self, file: &ClusterFile, room: &mut Room) -> Outcome<usize> {
        let samples = room.ask().await;
        let lacks = lacks::lacks(&samples, file.fps);
        let text = if self.json {
            format!("{}\n", json::line(file, &samples, &lacks).map_err(Failure::run)?)
        } else {
            let text = table::text(file, &samples, &lacks);
            match (self.watch, std::io::stdout().is_terminal()) {
                (true, true) => format!("{HOME}{text}"),
                (true, false) => format!("{text}\n"),
                (false, _) => text,
            }
        };
        out!("{text}")?;
        Ok(lacks.len())
    }
}

/// How many whole days the certificate that a node shows is still valid, by our clock; none if it shows none.
pub fn days_left(status: &NodeStatus) -> Option<i64> {
    let ends = status.certificate_ends_unix_s?;
    Some(((ends - unix_now_s()) / 86_400.0).floor() as i64)
}
