//! Clusters on this machine: node processes of this very program, or cameras in this process.

use std::collections::VecDeque;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use camera_node::NodeConfig;
use camera_node::capture::{Film, Lesson, Pace};
use camera_node::frames::{FilmState, FrameRing};
use camera_node::pictures::{Darkroom, Picture, PictureKind, PictureOrder};
use coordinator::{CameraFacts, ExpectedCamera, ExpectedNode, FrameFacts, LocalFrames};
use feed::pictures::{CameraPicture, FETCH_PATIENCE, FramePictures, PictureRequest, Pictures};
use futures::future::BoxFuture;
use hull::{Silhouette, ViewSet};
use proto::Address;
use tokio::sync::{mpsc, watch};

use crate::cluster_file::ClusterFile;
use cli::{Failure, Outcome};

/// Learning the background of a long clip at 4K takes a while on a slow machine.
const START_PATIENCE: Duration = Duration::from_secs(300);
/// After this a node that was asked to end is ended.
const END_PATIENCE: Duration = Duration::from_secs(2);
/// Lines of a child's standard error that are kept to explain its end.
const LAST_WORDS: usize = 4;

/// Over which sockets the processes of a local cluster talk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sockets {
    /// Loopback TCP, on free ports.
    Tcp,
    /// Unix sockets in a folder of this user's own: measured a tenth faster than TCP.
    #[default]
    Unix,
}

/// Node processes of this program. They end with it, however it ends: their standard input is a pipe
/// that closes.
pub struct LocalCluster {
    children: Vec<NodeProcess>,
    nodes: Vec<ExpectedNode>,
    /// Where Unix sockets are; removed last.
    _folder: Option<tempfile::TempDir>,
}

struct NodeProcess {
    child: Child,
    cameras: String,
    announced: Receiver<String>,
    last_words: Arc<Mutex<VecDeque<String>>>,
}

impl LocalCluster {
    /// Starts a process for each of the cluster file's nodes and waits until all listen.
    pub fn start(file: &ClusterFile, empty: bool) -> Outcome<LocalCluster> {
        LocalCluster::start_over(Sockets::default(), file, empty)
    }

    /// The same over sockets of a kind.
    pub fn start_over(sockets: Sockets, file: &ClusterFile, empty: bool) -> Outcome<LocalCluster> {
        let folder = match sockets {
            Sockets::Tcp => None,
            Sockets::Unix => Some(tempfile::tempdir().map_err(Failure::run)?),
        };
        let mut cluster = LocalCluster { children: Vec::new(), nodes: Vec::new(), _folder: folder };
        let nodes = file.nodes();
        for (number, (_, indices)) in nodes.iter().enumerate() {
            let listen = match &cluster._folder {
                None => "127.0.0.1:0".to_owned(),
                Some(folder) => format!("unix:{}", folder.path().join(format!("{number}.sock")).display()),
            };
            cluster.children.push(NodeProcess::start(file, indices, empty, &listen)?);
        }
        let deadline = Instant::now() + START_PATIENCE;
        for (process, (_, indices)) in cluster.children.iter_mut().zip(&nodes) {
            let address = process.address(deadline)?;
            cluster.nodes.push(expected_node(file, address, indices));
        }
        Ok(cluster)
    }

    /// The nodes with the addresses that they found.
    pub fn nodes(&self) -> &[ExpectedNode] {
        &self.nodes
    }

    /// The system's numbers of the processes, in the order of the nodes.
    pub fn process_ids(&self) -> impl Iterator<Item = u32> {
        self.children.iter().map(|process| process.child.id())
    }
}

impl Drop for LocalCluster {
    fn drop(&mut self) {
        for process in &mut self.children {
            // Closing the pipe asks it to end.
            drop(process.child.stdin.take());
        }
        let deadline = Instant::now() + END_PATIENCE;
        for process in &mut self.children {
            while Instant::now() < deadline && matches!(process.child.try_wait(), Ok(None)) {
                std::thread::sleep(Duration::from_millis(5));
            }
            // Neither call fails on a child that is not yet reaped.
            let _ = process.child.kill();
            let _ = process.child.wait();
        }
    }
}

impl NodeProcess {
    fn start(file: &ClusterFile, indices: &[usize], empty: bool, listen: &str) -> Outcome<NodeProcess> {
        let names: Vec<&str> = indices.iter().map(|&index| &file.cameras[index].name[..]).collect();
        let program = std::env::current_exe().map_err(Failure::run)?;
        let mut command = Command::new(&program);
        command.arg("node").arg(&file.path).args(["--listen", listen, "--stop-with-stdin"]);
        for name in &names {
            command.args(["--camera", name]);
        }
        if empty {
            command.arg("--empty");
        }
        let cameras = names.join(", ");
        let mut child =
            command
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .map_err(|error| Failure::run(format_args!("cannot start the node of {cameras}: {error}")))?;
        let (sender, announced) = channel();
        if let Some(stdout) = child.stdout.take() {
            std::thread::spawn(move || {
                for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                    // The parent stops listening after the first line.
                    let _ = sender.send(line);
                }
            });
        }
        let last_words = Arc::new(Mutex::new(VecDeque::new()));
        if let Some(stderr) = child.stderr.take() {
            let (last_words, cameras) = (Arc::clone(&last_words), cameras.clone());
            std::thread::spawn(move || pass_on(stderr, &cameras, &last_words));
        }
        Ok(NodeProcess { child, cameras, announced, last_words })
    }

    /// Waits for the line that tells where the node listens.
    fn address(&mut self, deadline: Instant) -> Outcome<Address> {
        let patience = deadline.saturating_duration_since(Instant::now());
        if let Ok(line) = self.announced.recv_timeout(patience)
            && let Some(address) = line.strip_prefix("listening on ")
        {
            return address.parse().map_err(Failure::run);
        }
        let ended = self.child.wait_timeout(END_PATIENCE);
        // Its last line is on its way through a thread.
        std::thread::sleep(Duration::from_millis(50));
        let words = self.last_words.lock().unwrap_or_else(PoisonError::into_inner);
        let told = words.iter().rev().find_map(|line| line.strip_prefix("hulltouch: "));
        let told = told.map_or_else(|| "it said nothing".to_owned(), ToOwned::to_owned);
        let problem = format!("node of {}: {told}", self.cameras);
        Err(if ended == Some(2) { Failure::Input(problem) } else { Failure::Run(problem) })
    }
}

trait WaitTimeout {
    fn wait_timeout(&mut self, patience: Duration) -> Option<i32>;
}

impl WaitTimeout for Child {
    fn wait_timeout(&mut self, patience: Duration) -> Option<i32> {
        let deadline = Instant::now() + patience;
        while Instant::now() < deadline {
            if let Ok(Some(status)) = self.try_wait() {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    }
}

/// Passes a child's complaints on, and keeps the last. Its final line is for the parent to tell.
fn pass_on(stderr: impl std::io::Read, cameras: &str, last_words: &Mutex<VecDeque<String>>) {
    use std::io::Write as _;
    for line in BufReader::new(stderr).lines().map_while(Result::ok) {
        if !line.starts_with("hulltouch: ") {
            // A closed standard error is no reason to stop draining the child's.
            let _ = writeln!(std::io::stderr(), "[{cameras}] {line}");
        }
        let mut words = last_words.lock().unwrap_or_else(PoisonError::into_inner);
        words.push_back(line);
        if words.len() > LAST_WORDS {
            words.pop_front();
        }
    }
}

/// What a coordinator must find at an address.
pub fn expected_node(file: &ClusterFile, address: Address, indices: &[usize]) -> ExpectedNode {
    let camera = |&index: &usize| {
        let camera = &file.rig.cameras()[index];
        ExpectedCamera {
            name: camera.name().to_owned(),
            rig_index: index as u16,
            size: (camera.width(), camera.height()),
            calibration_digest: camera.digest(),
        }
    };
    ExpectedNode { address, cameras: indices.iter().map(camera).collect() }
}

/// Cameras filmed in this process.
pub struct InProcess {
    film: Film,
    ring: Arc<FrameRing>,
}

impl InProcess {
    /// Learns the backgrounds of all cameras.
    pub fn prepare(config: &NodeConfig) -> Outcome<InProcess> {
        let ring = Arc::new(FrameRing::new(config.cameras.len()));
        let film = Film::prepare(config, Arc::clone(&ring)).map_err(Failure::run)?;
        Ok(InProcess { film, ring })
    }

    /// Pictures of its frames, made on a thread of their own.
    pub fn pictures(&self, config: &NodeConfig) -> Outcome<LocalPictures> {
        let rig_indices = config.cameras.iter().map(|camera| camera.rig_index).collect();
        Darkroom::new(Arc::clone(&self.ring), rig_indices).map(LocalPictures).map_err(Failure::run)
    }
}

/// Pictures of cameras filmed in this process.
pub struct LocalPictures(Darkroom);

impl Pictures for LocalPictures {
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, String>> {
        let PictureRequest { frame, kind, scale_log2, jpeg_quality, cameras } = request;
        let kind = match kind {
            feed::pictures::PictureKind::Silhouettes => PictureKind::Silhouettes,
            feed::pictures::PictureKind::Crops => PictureKind::Crops,
            feed::pictures::PictureKind::Whole => PictureKind::Whole,
        };
        // More cameras than any rig has.
        let (sender, mut pictures) = mpsc::channel(usize::from(u16::MAX));
        let deliver = move |picture: Picture| {
            // Who asked may have gone.
            let _ = sender.try_send(picture);
        };
        let order = PictureOrder { frame, kind, scale_log2, jpeg_quality, cameras };
        let ordered = self.0.order(order, deliver).map_err(|error| error.to_string());
        Box::pin(async move {
            ordered?;
            let (mut frame, mut captured_unix_s, mut cameras) = (0, 0.0, Vec::new());
            let deadline = tokio::time::Instant::now() + FETCH_PATIENCE;
            loop {
                let picture = tokio::time::timeout_at(deadline, pictures.recv()).await;
                let Some(picture) = picture.map_err(|_| "no pictures in time")? else { break };
                let Picture { rig_index: camera, frame: of, captured_unix_s: captured, .. } = picture;
                (frame, captured_unix_s) = (of, captured);
                let Picture { runs, crop, scale_log2, jpeg, .. } = picture;
                let crop = crop.map(|side| side as u16);
                cameras.push(CameraPicture { camera, runs, scale_log2, crop, jpeg });
            }
            if cameras.is_empty() {
                return Err("no camera has this frame".into());
            }
            Ok(FramePictures { frame, captured_unix_s, cameras })
        })
    }
}

impl LocalFrames for InProcess {
    fn start(&self, pace: coordinator::Pace) -> Result<(), String> {
        let coordinator::Pace { epoch_unix_s, lock_step } = pace;
        self.film.start(Pace { epoch_unix_s, lock_step }).map_err(|error| error.to_string())
    }

    fn credit(&self, up_to_frame: u64) {
        self.film.credit(up_to_frame);
    }

    fn watch(&self) -> watch::Receiver<u64> {
        self.ring.watch()
    }

    fn frames(&self) -> Vec<u64> {
        self.ring.news(None).1.iter().map(|frame| frame.number).collect()
    }

    fn facts(&self, frame: u64) -> Option<FrameFacts> {
        let frame = self.ring.get(frame).ok()?;
        let camera = |camera: &camera_node::frames::CameraFrame| CameraFacts {
            rig_index: camera.rig_index,
            admitted: camera.admitted,
            area: camera.silhouette.area(),
            silhouette_bytes: camera.bytes.len() as u32,
            segment_ms: camera.segment_ms,
        };
        Some(FrameFacts {
            frame: frame.number,
            capture_time_s: frame.capture_time_s,
            captured_unix_s: frame.captured_unix_s,
            cameras: frame.cameras.iter().map(camera).collect(),
            skipped: frame.skipped,
        })
    }

    fn film(&self) -> coordinator::FilmState {
        match self.ring.state() {
            FilmState::Running => coordinator::FilmState::Running,
            FilmState::Ended => coordinator::FilmState::Ended,
            FilmState::Failed(why) => coordinator::FilmState::Failed(why),
        }
    }

    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool {
        let found = self.ring.get(frame);
        found.is_ok_and(|frame| {
            use_views(&frame.views);
            true
        })
    }

    fn silhouettes(&self, frame: u64) -> Option<Vec<Arc<Silhouette>>> {
        let frame = self.ring.get(frame).ok()?;
        Some(frame.cameras.iter().map(|camera| Arc::clone(&camera.silhouette)).collect())
    }

    fn take_background(&self, first_frame: u64, frames: u64) -> Result<(), String> {
        self.film.take_background(Lesson { first_frame, frames })
    }
}
