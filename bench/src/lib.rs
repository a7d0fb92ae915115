//! `hulltouch bench`: the tables of the README.

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
mod response;
mod scale;
mod segment;
mod sync;
mod table;
mod usage;

use clap::{Args, Subcommand};

use setup::cli::Outcome;

/// Measures how fast this machine is. Use a release build.
#[derive(Debug, Args)]
pub struct BenchArguments {
    #[command(subcommand)]
    command: BenchCommand,
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    Bandwidth(bandwidth::BandwidthBenchArguments),
    Cluster(cluster::ClusterBenchArguments),
    Feed(feed::FeedBenchArguments),
    Physics(physics::PhysicsBenchArguments),
    Query(query::QueryBenchArguments),
    Segment(segment::SegmentBenchArguments),
    Sync(sync::SyncBenchArguments),
}

/// Runs it.
pub fn run(arguments: &BenchArguments) -> Outcome {
    if cfg!(debug_assertions) {
        tracing::warn!("this is a debug build: its figures say nothing");
    }
    match &arguments.command {
        BenchCommand::Bandwidth(arguments) => bandwidth::run(arguments),
        BenchCommand::Cluster(arguments) => cluster::run(arguments),
        BenchCommand::Feed(arguments) => feed::run(arguments),
        BenchCommand::Physics(arguments) => physics::run(arguments),
        BenchCommand::Query(arguments) => query::run(arguments),
        BenchCommand::Segment(arguments) => segment::run(arguments),
        BenchCommand::Sync(arguments) => sync::run(arguments),
    }
}
