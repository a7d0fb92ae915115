//! Everything that is measured: a subcommand for each table of docs/performance.md.

mod bandwidth;
mod cluster;
mod crews;
mod feed;
mod loads;
mod outputs;
mod passes;
mod peers;
mod physics;
mod plot;
mod query;
mod random;
mod scale;
mod segment;
mod sync;
mod table;
mod usage;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Measures how fast this machine is. Use a release build.
#[derive(Debug, Parser)]
#[command(name = "hulltouch-bench", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Bandwidth(bandwidth::BandwidthBenchArguments),
    Cluster(cluster::ClusterBenchArguments),
    Feed(feed::FeedBenchArguments),
    Physics(physics::PhysicsBenchArguments),
    Query(query::QueryBenchArguments),
    Segment(segment::SegmentBenchArguments),
    Sync(sync::SyncBenchArguments),
}

fn main() -> ExitCode {
    // Benches of clusters and of the page start nodes and a run: processes of this very program.
    if matches!(std::env::args().nth(1).as_deref(), Some("node" | "demo")) {
        return hulltouch::main();
    }
    let arguments = Arguments::parse();
    hulltouch::run_logged("hulltouch-bench", || {
        if cfg!(debug_assertions) {
            tracing::warn!("this is a debug build: its figures say nothing");
        }
        match &arguments.command {
            Command::Bandwidth(arguments) => bandwidth::run(arguments),
            Command::Cluster(arguments) => cluster::run(arguments),
            Command::Feed(arguments) => feed::run(arguments),
            Command::Physics(arguments) => physics::run(arguments),
            Command::Query(arguments) => query::run(arguments),
            Command::Segment(arguments) => segment::run(arguments),
            Command::Sync(arguments) => sync::run(arguments),
        }
    })
}
