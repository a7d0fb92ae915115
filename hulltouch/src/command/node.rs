//! `hulltouch node`: one camera PC.

use std::io::Write as _;
use std::path::PathBuf;

use camera_node::listen::Listen;
use camera_node::service::{Node, ServeError};
use clap::Args;
use cli::{Failure, Outcome};
use cluster::ClusterFile;
use proto::Address;
use tokio::io::AsyncReadExt as _;

use crate::interrupt::interrupted;

/// Serve cameras of a cluster file: film them, keep their silhouettes, answer probes.
#[derive(Debug, Args)]
#[command(after_help = "Example, on the PC of the cameras `left` and `top`:\n  \
    hulltouch node studio.cluster.toml --camera left --camera top --insecure")]
pub struct NodeArguments {
    /// The cluster file.
    cluster: PathBuf,
    /// A camera of the cluster file that this process serves; give it once for each.
    #[arg(long = "camera", required = true, value_name = "NAME")]
    cameras: Vec<String>,
    /// Where to listen: IP:PORT, or unix:PATH for a coordinator on this machine [default: the cameras'
    /// `node` in the cluster file].
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<Listen>,
    /// Allow an address that other machines reach: there is no encryption and no password.
    #[arg(long)]
    insecure: bool,
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
    let indices = camera_indices(&file, &arguments.cameras)?;
    let address = match &arguments.listen {
        Some(address) => address.clone(),
        None => address_in_file(&file, &indices)?,
    };
    let config = file.node_config(&indices, arguments.empty)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    let served = runtime.block_on(async {
        let node = tokio::select! {
            node = Node::open(config, address, arguments.insecure) => node.map_err(serve_failure)?,
            () = stopped(arguments.stop_with_stdin) => return Ok(()),
        };
        let address = node.address().map_err(Failure::run)?;
        announce(&address)?;
        node.serve(stopped(arguments.stop_with_stdin)).await.map_err(serve_failure)
    });
    // A clip that is still being read, or a read of standard input, must not hold the process.
    runtime.shutdown_background();
    served
}

/// Prints the address at which the node listens: a parent that gave port 0 waits for this line.
fn announce(address: &Listen) -> Outcome {
    let mut stdout = std::io::stdout().lock();
    writeln!(stdout, "listening on {address}").and_then(|()| stdout.flush()).map_err(Failure::run)
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

fn camera_indices(file: &ClusterFile, names: &[String]) -> Outcome<Vec<usize>> {
    let mut indices = Vec::new();
    for name in names {
        let index = file.rig.index_of(name).ok_or_else(|| {
            let known: Vec<&str> = file.cameras.iter().map(|entry| &entry.name[..]).collect();
            let path = file.path.display();
            Failure::input(format_args!("--camera {name:?}: {path} has {}", known.join(", ")))
        })?;
        if indices.contains(&index) {
            return Err(Failure::input(format_args!("--camera {name:?} is given twice")));
        }
        indices.push(index);
    }
    indices.sort_unstable();
    Ok(indices)
}

fn address_in_file(file: &ClusterFile, indices: &[usize]) -> Outcome<Listen> {
    let mut addresses = indices.iter().map(|&index| file.cameras[index].node.as_ref());
    let first = addresses.next().flatten().ok_or_else(|| {
        let name = &file.cameras[indices[0]].name;
        Failure::input(format_args!(
            "{}, camera {name:?} has no node, expected one or --listen",
            file.path.display()
        ))
    })?;
    if addresses.any(|address| address != Some(first)) {
        return Err(Failure::input(
            "the cameras have different nodes in the cluster file, expected --listen",
        ));
    }
    match first {
        Address::Unix(path) => Ok(Listen::Unix(path.clone())),
        Address::Tcp(address) => address.parse().map(Listen::Tcp).map_err(|_| {
            let port = address.rsplit(':').next().unwrap_or_default();
            Failure::input(format_args!(
                "node {address:?} is no IP address with port: give --listen IP:{port}"
            ))
        }),
    }
}
