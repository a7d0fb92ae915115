//! `hulltouch node`: one camera PC.

pub mod part;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use camera_node::listen::Listen;
use camera_node::service::{Access, Node, ServeError};
use clap::Args;
use net::Identity;
use setup::cli::{Failure, Outcome, outln};
use setup::{Announcement, ClusterFile};
use telemetry::{Endpoint, Telemetry, TelemetryPort, systemd};
use tokio::io::AsyncReadExt as _;

use self::part::Part;
use crate::interrupt::interrupted;
use crate::run::metrics::{self, NodeTelemetry, node_label};
use crate::run::security::SecurityArguments;

/// Serve cameras of a cluster file: film them, keep their silhouettes, answer probes. Without --camera, those of the
/// [[node]] with this host's name, or with that of --host.
#[derive(Debug, Args)]
#[command(after_help = "\
    Examples, on every PC of a cluster file with [[node]] entries; on the PC of `left` and `top` of one \
    without:\n  \
    hulltouch node studio.cluster.toml --certs /etc/hulltouch/certs\n  \
    hulltouch node studio.cluster.toml --camera left --camera top --insecure")]
pub struct NodeArguments {
    /// The cluster file. It runs programs: each `command` of a camera that is served here is started as this user.
    cluster: PathBuf,
    /// The name of the [[node]] whose cameras this process serves [default: this host's, up to the first dot].
    #[arg(long, value_name = "NAME", conflicts_with = "cameras")]
    host: Option<String>,
    /// A camera of the cluster file that this process serves; give it once for each.
    #[arg(long = "camera", value_name = "NAME")]
    cameras: Vec<String>,
    /// Where to listen: IP:PORT, or unix:PATH for a coordinator on this machine [default: the node's address in
    /// the cluster file; where that is a host's name, its port on all addresses; without one, 0.0.0.0:7001].
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<Listen>,
    #[command(flatten)]
    security: SecurityArguments,
    /// Serve metrics of this node at this address by plain HTTP: /metrics, /live and /ready.
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<SocketAddr>,
    /// Send what this node does for the passes that its coordinator traces to this collector (OTLP over gRPC).
    #[arg(long, value_name = "http://HOST:PORT")]
    otlp: Option<Endpoint>,
    /// Film the scene without the person: the studio empty, or a recording's background clip.
    #[arg(long)]
    empty: bool,
    /// End when standard input does: for a parent that may die without saying so.
    #[arg(long)]
    stop_with_stdin: bool,
}

/// Serves until Ctrl-C.
pub fn run(arguments: &NodeArguments) -> Outcome {
    let file = ClusterFile::open(&arguments.cluster)?;
    let part = match &arguments.cameras[..] {
        [] => Part::of_host(&file, arguments.host.as_deref())?,
        cameras => Part::of_cameras(&file, cameras)?,
    };
    let address = match &arguments.listen {
        Some(address) => address.clone(),
        None => part.listen(&file)?,
    };
    let config = file.node_config(&part.cameras, arguments.empty)?;
    let access = access(&file, &part, &arguments.security)?;
    let telemetry = Arc::new(NodeTelemetry::default());
    let _port =
        arguments.metrics.map(|listen| serve_metrics(listen, &file, &part, &telemetry)).transpose()?;
    let _traces = metrics::send_traces(arguments.otlp.as_ref(), "node", (&file.name, &label(&file, &part)))?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    let served = runtime.block_on(async {
        let node = tokio::select! {
            node = Node::open(config, address, access) => node.map_err(serve_failure)?,
            () = stopped(arguments.stop_with_stdin) => return Ok(()),
        };
        let watch = node.watch();
        telemetry.watch(watch.clone());
        let address = node.address().map_err(Failure::run)?;
        say_address(&address);
        let _announcement = announcement(&file, &part, &address);
        systemd::ready(&format!("serves {} at {address}", part.camera_names(&file).join(", ")));
        let stop = async {
            stopped(arguments.stop_with_stdin).await;
            systemd::stopping();
        };
        systemd::watched(watch.pulse(), node.serve(stop)).await.map_err(serve_failure)
    });
    // A clip that is still being read, or a read of standard input, must not hold the process.
    runtime.shutdown_background();
    served
}

/// What the node is called where it is watched.
fn label(file: &ClusterFile, part: &Part) -> String {
    part.name.map_or_else(|| node_label(file, &part.cameras), ToOwned::to_owned)
}

/// Serves metrics, also while backgrounds are still being learnt.
fn serve_metrics(
    listen: SocketAddr,
    file: &ClusterFile,
    part: &Part,
    telemetry: &Arc<NodeTelemetry>,
) -> Outcome<TelemetryPort> {
    let node = label(file, part);
    let telemetry: Arc<dyn Telemetry> = Arc::<NodeTelemetry>::clone(telemetry);
    metrics::serve(listen, &[("room", file.name.clone()), ("node", node)], telemetry)
}

/// Who may connect. A node that shows certificates has a name.
fn access(file: &ClusterFile, part: &Part, security: &SecurityArguments) -> Outcome<Access> {
    let own = Identity::node(&file.name, part.name.unwrap_or_default());
    match security.credentials(file, own)? {
        Some(_) if part.name.is_none() => Err(Failure::input(
            "--certs is for a [[node]] of the cluster file, expected --host NAME instead of --camera",
        )),
        Some(credentials) => Ok(Access::Certified(credentials)),
        None if security.insecure() => Ok(Access::AnyPeer),
        None => Ok(Access::ThisMachine),
    }
}

/// Prints the address at which the node listens: a parent that gave port 0 waits for this line. A node serves whether
/// its line is read or not.
fn say_address(address: &Listen) {
    if let Err(failure) = outln!("listening on {address}") {
        tracing::warn!("{failure}");
    }
}

/// Announces a node that must be found by its name. One that cannot be announced still serves.
fn announcement(file: &ClusterFile, part: &Part, address: &Listen) -> Option<Announcement> {
    let name = part.name.filter(|_| part.is_sought())?;
    let listens = match address {
        Listen::Tcp(listens) if !listens.ip().is_loopback() => *listens,
        Listen::Tcp(_) | Listen::Unix(_) => {
            tracing::warn!(
                "node {name} listens on {address} and has no address in the cluster file: no coordinator finds it"
            );
            return None;
        }
    };
    match Announcement::begin(&file.name, name, listens) {
        Ok(announcement) => Some(announcement),
        Err(error) => {
            tracing::warn!("node {name}: {error}");
            None
        }
    }
}

fn serve_failure(error: ServeError) -> Failure {
    match error {
        ServeError::Exposed(_) => Failure::input(error),
        ServeError::Capture(_)
        | ServeError::Listen { .. }
        | ServeError::Panicked(_)
        | ServeError::Thread(_)
        | ServeError::Transport(_) => Failure::run(error),
    }
}

/// Completes when the program is asked to end, and with `with_stdin` at the end of standard input.
async fn stopped(with_stdin: bool) {
    let stdin_ended = async {
        if !with_stdin {
            return std::future::pending().await;
        }
        let mut stdin = tokio::io::stdin();
        let mut bytes = [0; 64];
        while stdin.read(&mut bytes).await.is_ok_and(|count| count > 0) {}
    };
    tokio::select! {
        () = interrupted() => {},
        () = stdin_ended => {},
    }
}
