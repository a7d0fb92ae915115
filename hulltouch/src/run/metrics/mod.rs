//! What Prometheus and probes of a process are told, on a port of its own: what nodes and runs have in common.

mod node;
mod run;

use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use setup::ClusterFile;
use setup::cli::{Failure, Outcome};
use telemetry::{
    Buckets, Endpoint, Exporter, Histogram, Labels, PortError, Process, Telemetry, TelemetryPort,
};

pub use node::NodeTelemetry;
pub use run::metrics;

/// Answers at an address until what is returned is dropped, and says where.
pub fn serve(
    listen: SocketAddr,
    labels: &[(&'static str, String)],
    telemetry: Arc<dyn Telemetry>,
) -> Outcome<TelemetryPort> {
    let port = TelemetryPort::start(listen, labels, telemetry).map_err(|error| match error {
        PortError::Listen { .. } => Failure::input(format_args!("--metrics: {error}")),
        PortError::System(_) => Failure::run(error),
    })?;
    // A closed standard error is no reason not to run.
    let _ = writeln!(std::io::stderr(), "metrics: http://{}/metrics", port.address());
    Ok(port)
}

/// Sends traces of this process, if they are to go anywhere, until what is returned is dropped. Of a room, and by a name
/// there; either may be empty.
pub fn send_traces(
    to: Option<&Endpoint>,
    role: &'static str,
    (room, name): (&str, &str),
) -> Outcome<Option<Exporter>> {
    let process = Process { role, room, name };
    to.map(|to| Exporter::begin(to, process)).transpose().map_err(Failure::run)
}

/// What a node is called: by its name in the cluster file, or without one by its cameras.
pub fn node_label(file: &ClusterFile, cameras: &[usize]) -> String {
    let node = file.nodes.iter().find(|node| node.cameras == cameras);
    node.and_then(|node| node.name.clone()).unwrap_or_else(|| {
        let rig = file.rig.cameras();
        let names: Vec<&str> = cameras.iter().filter_map(|&place| Some(rig.get(place)?.name())).collect();
        names.join(",")
    })
}

fn buckets(histogram: &Histogram) -> Buckets {
    Buckets { sum: histogram.sum_s(), buckets: histogram.buckets().collect() }
}

fn one(value: f64) -> [(Labels, f64); 1] {
    [(Labels::new(), value)]
}

fn flag(is_so: bool) -> f64 {
    f64::from(u8::from(is_so))
}

fn unix_s(time: SystemTime) -> f64 {
    time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs_f64()
}
