//! A cluster of node processes on this machine, each running this very program.

use std::collections::VecDeque;
use std::io::{self, BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use camera_node::scratch::ScratchFolder;
use hull::rig::MAX_CAMERAS;
use node_client::ExpectedNode;
use parking_lot::Mutex;
use proto::{Address, AddressError, MAX_SOCKET_PATH_BYTES};
use telemetry::Endpoint;
use thiserror::Error;
use wait_timeout::ChildExt as _;

use crate::cluster_file::{ClusterFile, NodeEntry};
use crate::node_config::expected_node;

/// Learning the background of a long clip at 4K takes a while on a slow machine.
const START_TIMEOUT: Duration = Duration::from_secs(300);
/// A node that was asked to end is killed after this.
const SHUTDOWN_GRACE: Duration = Duration::from_secs(2);
/// Lines of a node's standard error that are kept to explain why it ended.
const STDERR_TAIL_LINES: usize = 4;
/// The exit status of a program whose input is wrong.
const INPUT_STATUS: i32 = 2;

/// Over which sockets the processes of a local cluster talk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sockets {
    /// Loopback TCP, on free ports.
    Tcp,
    /// Unix sockets in a folder of this user's own: measured a tenth faster than TCP.
    #[default]
    Unix,
}

/// What every node of a local cluster is told.
#[derive(Clone, Copy, Debug, Default)]
pub struct LocalNodes<'a> {
    /// The scene without the person.
    pub empty: bool,
    /// Where their traces go, if anywhere.
    pub otlp: Option<&'a Endpoint>,
    /// A folder with one for each named node, of its certificates; without, connections are not encrypted.
    pub certs: Option<&'a Path>,
}

/// Why a local cluster does not start.
#[derive(Debug, Error)]
pub enum LocalClusterError {
    /// There is no folder for its sockets.
    #[error("cannot make a folder in {} (TMPDIR): {source}", parent.display())]
    Folder {
        /// Where it was to be.
        parent: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Every folder for sockets has a path that sockets cannot have.
    #[error(
        "TMPDIR: found {}, a path of {} bytes, expected one of at most {MOST} that is UTF-8: sockets are made \
         there", parent.display(), parent.as_os_str().len(), MOST = most_parent_bytes()
    )]
    LongFolder {
        /// Where it was to be.
        parent: PathBuf,
    },
    /// A process does not start.
    #[error("cannot start node {node}: {source}")]
    Start {
        /// Its name and its cameras.
        node: String,
        /// The system's reason.
        source: io::Error,
    },
    /// A node refuses the cluster file.
    #[error("node {node}: {problem}")]
    Input {
        /// Its name and its cameras.
        node: String,
        /// Its own message.
        problem: String,
    },
    /// A node ended, or did not listen in time.
    #[error("node {node}: {problem}")]
    Failed {
        /// Its name and its cameras.
        node: String,
        /// Its own message.
        problem: String,
    },
}

/// Node processes of this program. They end with it, however it ends: their standard input is a pipe
/// that closes.
pub struct LocalCluster {
    processes: Vec<NodeProcess>,
    nodes: Vec<ExpectedNode>,
    /// Where Unix sockets are; removed last.
    _folder: Option<ScratchFolder>,
}

struct NodeProcess {
    child: Child,
    /// Its name, if it has one, and its cameras.
    node: String,
    stdout_lines: Receiver<String>,
    stderr_tail: Arc<Mutex<VecDeque<String>>>,
}

impl LocalCluster {
    /// Starts a process for each of the cluster file's nodes and waits until all listen.
    pub fn start(
        file: &ClusterFile,
        sockets: Sockets,
        told: LocalNodes<'_>,
    ) -> Result<LocalCluster, LocalClusterError> {
        let folder = match sockets {
            Sockets::Tcp => None,
            Sockets::Unix => Some(folder_for_sockets()?),
        };
        let mut cluster = LocalCluster { processes: Vec::new(), nodes: Vec::new(), _folder: folder };
        for (number, node) in file.nodes.iter().enumerate() {
            let listen = match &cluster._folder {
                None => "127.0.0.1:0".to_owned(),
                Some(folder) => format!("unix:{}", folder.path().join(socket_name(number)).display()),
            };
            cluster.processes.push(NodeProcess::start(file, node, told, &listen)?);
        }
        let deadline = Instant::now() + START_TIMEOUT;
        for (process, node) in cluster.processes.iter_mut().zip(&file.nodes) {
            let expected = expected_node(&file.rig, process.address(deadline)?, &node.cameras);
            cluster.nodes.push(ExpectedNode { name: node.name.clone(), ..expected });
        }
        Ok(cluster)
    }

    /// The nodes, with the addresses at which they listen.
    pub fn nodes(&self) -> &[ExpectedNode] {
        &self.nodes
    }

    /// The system's numbers of the processes, in the order of the nodes.
    pub fn process_ids(&self) -> impl Iterator<Item = u32> {
        self.processes.iter().map(|process| process.child.id())
    }
}

/// Of the node of that number, which is under [`MAX_CAMERAS`].
fn socket_name(number: usize) -> String {
    format!("{number}.sock")
}

/// The longest path of a folder in which one of our own can be made for sockets.
fn most_parent_bytes() -> usize {
    // Two separators beside the folder's own name and the longest socket's.
    MAX_SOCKET_PATH_BYTES - 2 - camera_node::scratch::NAME_BYTES - socket_name(MAX_CAMERAS).len()
}

/// A folder of this user alone, in TMPDIR unless paths of sockets there would be too long for the system: then in
/// the user's folder for sockets or in `/tmp`.
fn folder_for_sockets() -> Result<ScratchFolder, LocalClusterError> {
    let fits = |parent: &Path| parent.to_str().is_some_and(|text| text.len() <= most_parent_bytes());
    // Nodes are told the path as a text, and may not share our working folder.
    let first = std::env::temp_dir();
    let first = std::path::absolute(&first).unwrap_or(first);
    if fits(&first) {
        let made = ScratchFolder::new_in(&first);
        return made.map_err(|source| LocalClusterError::Folder { parent: first, source });
    }
    let others = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).into_iter().chain(["/tmp".into()]);
    let made = others
        .filter(|parent| parent.is_absolute() && fits(parent))
        .find_map(|parent| ScratchFolder::new_in(&parent).ok());
    made.ok_or(LocalClusterError::LongFolder { parent: first })
}

impl Drop for LocalCluster {
    fn drop(&mut self) {
        for process in &mut self.processes {
            // Closing the pipe asks it to end.
            drop(process.child.stdin.take());
        }
        let deadline = Instant::now() + SHUTDOWN_GRACE;
        for process in &mut self.processes {
            let left = deadline.saturating_duration_since(Instant::now());
            if !matches!(process.child.wait_timeout(left), Ok(Some(_))) {
                // Neither call fails on a child that is not yet reaped.
                let _ = process.child.kill();
                let _ = process.child.wait();
            }
        }
    }
}

impl NodeProcess {
    fn start(
        file: &ClusterFile,
        node: &NodeEntry,
        told: LocalNodes<'_>,
        listen: &str,
    ) -> Result<NodeProcess, LocalClusterError> {
        let names: Vec<&str> = node.cameras.iter().map(|&index| &file.cameras[index].name[..]).collect();
        let cameras = names.join(", ");
        let label = match &node.name {
            Some(name) => format!("{name} ({cameras})"),
            None => format!("({cameras})"),
        };
        let refused = |source| LocalClusterError::Start { node: label.clone(), source };
        let mut command = Command::new(std::env::current_exe().map_err(refused)?);
        command.arg("node").arg(&file.path).args(["--listen", listen, "--stop-with-stdin"]);
        match (told.certs, &node.name) {
            (Some(certs), Some(name)) => {
                command.args(["--host", name, "--certs"]).arg(certs.join(name));
            }
            _ => names.iter().for_each(|name| {
                command.args(["--camera", name]);
            }),
        }
        if told.empty {
            command.arg("--empty");
        }
        if let Some(otlp) = told.otlp {
            command.args(["--otlp", &otlp.to_string()]);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(refused)?;
        let (sender, stdout_lines) = channel();
        if let Some(stdout) = child.stdout.take() {
            std::thread::spawn(move || {
                for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                    // The parent stops listening after the first line.
                    let _ = sender.send(line);
                }
            });
        }
        let stderr_tail = Arc::default();
        if let Some(stderr) = child.stderr.take() {
            let (tail, tag) = (Arc::clone(&stderr_tail), node.name.clone().unwrap_or(cameras));
            std::thread::spawn(move || forward_stderr(stderr, &tag, &tail));
        }
        Ok(NodeProcess { child, node: label, stdout_lines, stderr_tail })
    }

    /// Waits for the line that names the address at which the node listens.
    fn address(&mut self, deadline: Instant) -> Result<Address, LocalClusterError> {
        let left = deadline.saturating_duration_since(Instant::now());
        let node = self.node.clone();
        if let Ok(line) = self.stdout_lines.recv_timeout(left)
            && let Some(address) = line.strip_prefix("listening on ")
        {
            let refused =
                |error: AddressError| LocalClusterError::Failed { node, problem: error.to_string() };
            return address.parse().map_err(refused);
        }
        let status = self.child.wait_timeout(SHUTDOWN_GRACE).ok().flatten();
        // Its last line is on its way through a thread.
        std::thread::sleep(Duration::from_millis(50));
        let problem = self.last_message();
        Err(if status.and_then(|status| status.code()) == Some(INPUT_STATUS) {
            LocalClusterError::Input { node, problem }
        } else {
            LocalClusterError::Failed { node, problem }
        })
    }

    /// The reason that the process gave for its end.
    fn last_message(&self) -> String {
        let lines = self.stderr_tail.lock();
        let message = lines.iter().rev().find_map(|line| line.strip_prefix("hulltouch: "));
        message.map_or_else(|| "it ended without an error message".to_owned(), ToOwned::to_owned)
    }
}

/// Forwards a node's standard error, and keeps its last lines. The line with its reason to end is left to the
/// parent's own message.
fn forward_stderr(stderr: impl io::Read, tag: &str, tail: &Mutex<VecDeque<String>>) {
    use io::Write as _;
    for line in BufReader::new(stderr).lines().map_while(Result::ok) {
        if !line.starts_with("hulltouch: ") {
            // A closed standard error is no reason to stop draining the child's.
            let _ = writeln!(io::stderr(), "[{tag}] {line}");
        }
        let mut lines = tail.lock();
        lines.push_back(line);
        if lines.len() > STDERR_TAIL_LINES {
            lines.pop_front();
        }
    }
}
