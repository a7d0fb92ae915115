//! The three layouts behind one face: which frames there are, and a pass over one of them.

use std::collections::HashSet;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use futures::future::BoxFuture;
use hull::pass::{Pass, Round};
use hull::question::Answer;
use hull::view_set::Scratch;
use hull::{Observer, ProbeSettings, Shape, Silhouette, View, ViewSet};
use proto::convert::{Precision, SilhouetteEncoding};
use thiserror::Error;
use tokio::sync::{Notify, mpsc, watch};

use crate::camera_client::{Common, ExpectedNode, Link};
use crate::counting::{ByteCounters, ByteCounts};
use crate::facts::{FilmState, FrameFacts, Pace};
use crate::fanout::Fanout;
use crate::record::Fetching;

/// A picture, or word to the cameras, is not worth more of a step's time.
const PICTURE_PATIENCE: Duration = Duration::from_secs(2);

/// The frames of cameras that are filmed in this very process.
pub trait LocalFrames: Send {
    /// Begins a run.
    fn start(&self, pace: Pace) -> Result<(), String>;
    /// Lets a lock-step run go on up to a frame.
    fn credit(&self, up_to_frame: u64);
    /// Wakes whenever a frame, an end or a failure has come.
    fn watch(&self) -> watch::Receiver<u64>;
    /// The frames there are, ascending.
    fn frames(&self) -> Vec<u64>;
    /// What is known of a frame.
    fn facts(&self, frame: u64) -> Option<FrameFacts>;
    /// How film stands.
    fn film(&self) -> FilmState;
    /// Calls `use_views` with the views of a frame; false if the frame is gone.
    fn with_views(&self, frame: u64, use_views: &mut dyn FnMut(&ViewSet)) -> bool;
    /// The silhouettes of a frame in rig order.
    fn silhouettes(&self, frame: u64) -> Option<Vec<Arc<Silhouette>>>;
    /// Has every camera learn its background anew from so many frames; the error says why one cannot.
    fn take_background(&self, first_frame: u64, frames: u64) -> Result<(), String> {
        let _ = (first_frame, frames);
        Err("these cameras learn no background".into())
    }
}

/// What a node told, for those who want to know how cameras do.
pub(crate) struct NodeTold {
    /// Why it is not there, if so.
    pub problem: Option<String>,
    /// The places of its cameras in the rig.
    pub cameras: Vec<u16>,
    /// What is known of its newest frame.
    pub newest: Option<FrameFacts>,
}

/// Why nodes did not all do what they were told.
#[derive(Debug, Error)]
pub(crate) enum TransportError {
    /// One is not there.
    #[error("{0}")]
    Gone(String),
    /// One will not.
    #[error("{0}")]
    Refused(String),
}

/// A layout, connected.
pub enum Transport {
    /// Nodes that are asked.
    Cluster(Box<Nodes>),
    /// Nodes whose silhouettes are fetched.
    Gather(Box<Gather>),
    /// Cameras of this process.
    InProcess {
        /// Their frames.
        frames: Box<dyn LocalFrames>,
        /// Buffers for probing.
        local: Box<Local>,
        /// What of the news has been seen.
        news: watch::Receiver<u64>,
    },
}

/// The first frame of film that a background is learnt from: one that no camera has filmed before word of it
/// comes, so that all begin at the same one.
#[derive(Clone, Copy, Debug)]
pub(crate) enum First {
    /// This one.
    Frame(u64),
    /// So many after the newest.
    After(u64),
}

impl First {
    fn after(self, newest: Option<u64>) -> u64 {
        match self {
            First::Frame(frame) => frame,
            First::After(frames) => newest.map_or(0, |newest| newest + 1) + frames,
        }
    }
}

/// Buffers for probing in this process, kept from pass to pass.
#[derive(Default)]
pub struct Local {
    scratch: Scratch,
    answer: Answer,
}

/// The nodes of a cluster.
pub struct Nodes {
    fanout: Fanout,
    told: Arc<Notify>,
    common: Arc<Common>,
}

/// Nodes whose silhouettes are fetched, and the frame that was fetched last.
pub struct Gather {
    nodes: Nodes,
    observers: Vec<Arc<Observer>>,
    encoding: SilhouetteEncoding,
    fetched: Option<(u64, ViewSet)>,
    silhouette_bytes: u64,
    local: Local,
}

impl Transport {
    /// Connects to nodes; must run within a tokio runtime. Gathering needs the observers of the whole
    /// rig, in rig order.
    pub fn connect(
        nodes: Vec<ExpectedNode>,
        gather: Option<Vec<Arc<Observer>>>,
        settings: ProbeSettings,
        fps: f64,
        shapes: Vec<Arc<Shape>>,
    ) -> Transport {
        let told = Arc::new(Notify::new());
        let common = Arc::new(Common {
            settings,
            fps,
            shapes: std::sync::Mutex::new(shapes),
            counters: Arc::new(ByteCounters::default()),
            pace: std::sync::Mutex::default(),
            told: Arc::clone(&told),
        });
        // Each node has one question at a time; room for its reply and the news that it is down.
        let (sender, events) = mpsc::channel(4 * nodes.len().max(1));
        let links = nodes
            .into_iter()
            .enumerate()
            .map(|(index, node)| Link::spawn(node, index, Arc::clone(&common), sender.clone()))
            .collect();
        let nodes = Nodes { fanout: Fanout::new(links, events, Precision::Exact), told, common };
        match gather {
            None => Transport::Cluster(Box::new(nodes)),
            Some(observers) => Transport::Gather(Box::new(Gather {
                nodes,
                observers,
                encoding: SilhouetteEncoding::default(),
                fetched: None,
                silhouette_bytes: 0,
                local: Local::default(),
            })),
        }
    }

    /// Cameras of this process.
    pub fn in_process(frames: Box<dyn LocalFrames>) -> Transport {
        let news = frames.watch();
        Transport::InProcess { frames, local: Box::default(), news }
    }

    /// Gathers silhouettes in another encoding than runs and LZ4: for measurements.
    pub fn with_silhouettes_as(mut self, encoding: SilhouetteEncoding) -> Transport {
        if let Transport::Gather(gather) = &mut self {
            gather.encoding = encoding;
        }
        self
    }

    /// Asks and answers with rounded numbers, or again with exact ones: see [`Precision`].
    pub fn with_precision(mut self, precision: Precision) -> Transport {
        if let Transport::Cluster(nodes) = &mut self {
            nodes.fanout.set_precision(precision);
        }
        self
    }

    /// How many groups a pass asks.
    pub fn group_count(&self) -> usize {
        match self {
            Transport::Cluster(nodes) => nodes.fanout.links.len(),
            Transport::Gather(_) | Transport::InProcess { .. } => 1,
        }
    }

    fn nodes(&self) -> Option<&Nodes> {
        match self {
            Transport::Cluster(nodes) => Some(nodes),
            Transport::Gather(gather) => Some(&gather.nodes),
            Transport::InProcess { .. } => None,
        }
    }

    fn links(&self) -> &[Arc<Link>] {
        self.nodes().map_or(&[], |nodes| &nodes.fanout.links)
    }

    /// The nodes that are not there, and why.
    pub fn missing(&self) -> Vec<String> {
        let down = self.links().iter().filter(|link| !link.is_up());
        let told = down.map(|link| match link.problem() {
            Some(problem) => format!("node {}: {problem}", link.node.address),
            None => format!("node {} does not answer", link.node.address),
        });
        told.collect()
    }

    /// Waits until every node is there; after `patience`, says which are not and why.
    pub async fn ready(&mut self, patience: Duration) -> Result<(), String> {
        let deadline = tokio::time::Instant::now() + patience;
        loop {
            let missing = self.missing();
            if missing.is_empty() {
                return Ok(());
            }
            if tokio::time::Instant::now() >= deadline {
                return Err(missing.join("; "));
            }
            self.told(Duration::from_millis(50)).await;
        }
    }

    /// Begins a run everywhere.
    pub async fn start(&self, pace: Pace) -> Result<(), String> {
        if let Some(nodes) = self.nodes() {
            *nodes.common.pace.lock().unwrap_or_else(PoisonError::into_inner) = Some(pace);
        }
        let starts = self.links().iter().map(|link| async move {
            let said = |status: tonic::Status| format!("node {}: {}", link.node.address, status.message());
            link.start(pace).await.map_err(said)
        });
        for started in futures::future::join_all(starts).await {
            started?;
        }
        match self {
            Transport::InProcess { frames, .. } => frames.start(pace),
            _ => Ok(()),
        }
    }

    /// Lets a lock-step run go on up to a frame.
    pub fn credit(&self, up_to_frame: u64) {
        self.links().iter().for_each(|link| link.credit(up_to_frame));
        if let Transport::InProcess { frames, .. } = self {
            frames.credit(up_to_frame);
        }
    }

    /// Waits for news of frames since the last call, at most so long.
    pub async fn told(&mut self, at_most: Duration) {
        let waited = match self {
            Transport::InProcess { news, .. } => {
                tokio::time::timeout(at_most, async { drop(news.changed().await) }).await
            }
            Transport::Cluster(nodes) => tokio::time::timeout(at_most, nodes.told.notified()).await,
            Transport::Gather(gather) => tokio::time::timeout(at_most, gather.nodes.told.notified()).await,
        };
        // Whether news or the clock woke us is for the caller to see.
        drop(waited);
    }

    /// The newest frame that all have and that is not newer than `wanted`.
    pub fn newest_common(&self, wanted: u64) -> Option<u64> {
        if let Transport::InProcess { frames, .. } = self {
            return frames.frames().into_iter().rfind(|&frame| frame <= wanted);
        }
        let mut lists = self.links().iter().map(|link| link.frames());
        let mut common = lists.next()?;
        for list in lists {
            common.retain(|frame| list.contains(frame));
        }
        common.into_iter().rfind(|&frame| frame <= wanted)
    }

    /// The newest frame that any camera told of.
    pub(crate) fn newest(&self) -> Option<u64> {
        if let Transport::InProcess { frames, .. } = self {
            return frames.frames().last().copied();
        }
        self.links().iter().filter_map(|link| link.newest()).map(|facts| facts.frame).max()
    }

    /// What every node told.
    pub(crate) fn nodes_told(&self) -> Vec<NodeTold> {
        if let Transport::InProcess { frames, .. } = self {
            let newest = frames.frames().last().and_then(|&frame| frames.facts(frame));
            let cameras = newest.iter().flat_map(|facts| &facts.cameras).map(|camera| camera.rig_index);
            return vec![NodeTold { problem: None, cameras: cameras.collect(), newest }];
        }
        let told = self.links().iter().map(|link| NodeTold {
            problem: (!link.is_up()).then(|| link.problem().unwrap_or_else(|| "does not answer".into())),
            cameras: link.node.cameras.iter().map(|camera| camera.rig_index).collect(),
            newest: link.newest(),
        });
        told.collect()
    }

    /// Makes shapes known to all nodes, also to those that come back later: these and no others. Nodes are told
    /// those that they may lack, and all of them are told, whatever one of them says.
    pub(crate) async fn register_shapes(&self, shapes: Vec<Arc<Shape>>) -> Result<(), TransportError> {
        let Some(nodes) = self.nodes() else { return Ok(()) };
        let news = {
            let mut known = nodes.common.shapes.lock().unwrap_or_else(PoisonError::into_inner);
            let digests: HashSet<[u8; 32]> = known.iter().map(|shape| shape.digest()).collect();
            let is_new = |shape: &&Arc<Shape>| !digests.contains(&shape.digest());
            let news: Vec<Arc<Shape>> = shapes.iter().filter(is_new).cloned().collect();
            *known = shapes;
            news
        };
        if news.is_empty() {
            return Ok(());
        }
        let news = &news;
        // Where silhouettes are gathered, nobody is asked about shapes.
        let asked: &[Arc<Link>] = if let Transport::Cluster(_) = self { self.links() } else { &[] };
        let told = asked.iter().map(|link| async move {
            let said = |status: tonic::Status| format!("node {}: {}", link.node.address, status.message());
            match link.register(news).await {
                Ok(()) => Ok(()),
                Err(status) if status.code() == tonic::Code::Unavailable => {
                    Err(TransportError::Gone(said(status)))
                }
                Err(status) => Err(TransportError::Refused(said(status))),
            }
        });
        let told = futures::future::join_all(told).await;
        let (refused, rest): (Vec<_>, Vec<_>) =
            told.into_iter().partition(|told| matches!(told, Err(TransportError::Refused(_))));
        refused.into_iter().chain(rest).collect()
    }

    /// Has every camera of every node learn its background anew from so many frames of film. If one cannot, none
    /// does. What is returned holds on to the nodes by itself.
    pub(crate) fn take_background(
        &self,
        first: First,
        frames: u64,
    ) -> BoxFuture<'static, Result<(), String>> {
        if let Transport::InProcess { frames: cameras, .. } = self {
            let taken = cameras.take_background(first.after(self.newest()), frames);
            return Box::pin(futures::future::ready(taken));
        }
        let links = self.links().to_vec();
        Box::pin(async move {
            tell_of_background(&links, 0, frames, true).await?;
            let newest = links.iter().filter_map(|link| link.newest()).map(|facts| facts.frame).max();
            tell_of_background(&links, first.after(newest), frames, false).await
        })
    }

    /// What all cameras told of a frame.
    pub fn facts(&self, frame: u64) -> Option<Vec<FrameFacts>> {
        match self {
            Transport::InProcess { frames, .. } => frames.facts(frame).map(|facts| vec![facts]),
            _ => self.links().iter().map(|link| link.facts(frame)).collect(),
        }
    }

    /// How film stands for whoever wants a frame: failed, or ended, or running. It has ended once some
    /// camera's has without that frame. A node that is done early must not cut off what the others
    /// have yet to tell: in lock-step a fast node ends several frames ahead of the one in use.
    pub fn film(&self, wanted: u64) -> FilmState {
        // The state is read before the frames: a film that has ended has all its frames.
        let films: Vec<(FilmState, Option<u64>)> = match self {
            Transport::InProcess { frames, .. } => vec![(frames.film(), frames.frames().last().copied())],
            _ => self.links().iter().map(|link| (link.film(), link.frames().last().copied())).collect(),
        };
        if let Some((failed, _)) = films.iter().find(|(film, _)| matches!(film, FilmState::Failed(_))) {
            return failed.clone();
        }
        let ended_before_it = |(film, last): &(FilmState, Option<u64>)| {
            *film == FilmState::Ended && last.is_none_or(|last| last < wanted)
        };
        if films.iter().any(ended_before_it) { FilmState::Ended } else { FilmState::Running }
    }

    /// Answers a pass over a frame. `took` is told each round and its milliseconds; `Err` says why there
    /// is no result.
    pub async fn run_pass(
        &mut self,
        pass: &mut Pass,
        frame: u64,
        patience: Duration,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), String> {
        self.run_passes(&mut [pass], frame, patience, took).await
    }

    /// Answers several passes over a frame, at most [`LISTS`](proto::convert::LISTS). Their rounds overlap at the nodes of a cluster.
    pub async fn run_passes(
        &mut self,
        passes: &mut [&mut Pass],
        frame: u64,
        patience: Duration,
        took: &mut dyn FnMut(Round, f64),
    ) -> Result<(), String> {
        match self {
            Transport::Cluster(nodes) => {
                nodes.fanout.run(passes, frame, patience, took).await.map_err(|error| error.to_string())
            }
            Transport::Gather(gather) => {
                if passes.iter().any(|pass| pass.question().is_some()) {
                    let fetched = tokio::time::timeout(patience, gather.fetch(frame)).await;
                    fetched.map_err(|_| format!("silhouettes of frame {frame} did not come in time"))??;
                }
                let Gather { fetched: Some((_, views)), local, .. } = &mut **gather else { return Ok(()) };
                passes.iter_mut().for_each(|pass| run_locally(pass, views, local, took));
                Ok(())
            }
            Transport::InProcess { frames, local, .. } => {
                let found = frames.with_views(frame, &mut |views| {
                    passes.iter_mut().for_each(|pass| run_locally(pass, views, local, took));
                });
                if found { Ok(()) } else { Err(format!("frame {frame} is gone")) }
            }
        }
    }

    /// The silhouettes of a frame in rig order, fetched if need be: for pictures, not for probes.
    pub async fn silhouettes(&self, frame: u64) -> Result<Vec<Arc<Silhouette>>, String> {
        if let Transport::InProcess { frames, .. } = self {
            return frames.silhouettes(frame).ok_or_else(|| format!("frame {frame} is gone"));
        }
        let fetched =
            tokio::time::timeout(PICTURE_PATIENCE, fetch(self.links(), frame, SilhouetteEncoding::RunsLz4))
                .await;
        let (silhouettes, _) = fetched.map_err(|_| "silhouettes did not come in time".to_owned())??;
        Ok(silhouettes.into_iter().map(Arc::new).collect())
    }

    /// The same as something to wait for elsewhere.
    pub(crate) fn fetching(&self, frame: u64) -> Fetching {
        if let Transport::InProcess { frames, .. } = self {
            let found = frames.silhouettes(frame).ok_or_else(|| format!("frame {frame} is gone"));
            return Box::pin(futures::future::ready(found));
        }
        let links = self.links().to_vec();
        Box::pin(async move {
            let (silhouettes, _) = fetch(&links, frame, SilhouetteEncoding::RunsLz4).await?;
            Ok(silhouettes.into_iter().map(Arc::new).collect())
        })
    }

    /// Bytes at the sockets so far.
    pub fn bytes(&self) -> ByteCounts {
        self.nodes().map_or_else(ByteCounts::default, |nodes| nodes.common.counters.read())
    }

    /// Bytes of silhouettes fetched to answer probes.
    pub fn silhouette_bytes(&self) -> u64 {
        if let Transport::Gather(gather) = self { gather.silhouette_bytes } else { 0 }
    }
}

impl Gather {
    async fn fetch(&mut self, frame: u64) -> Result<(), String> {
        if self.fetched.as_ref().is_some_and(|(fetched, _)| *fetched == frame) {
            return Ok(());
        }
        let (silhouettes, bytes) = fetch(&self.nodes.fanout.links, frame, self.encoding).await?;
        self.silhouette_bytes += bytes;
        let views = self.observers.iter().zip(&silhouettes);
        let views = views.map(|(observer, silhouette)| View::new(Arc::clone(observer), silhouette));
        self.fetched = Some((frame, ViewSet::new(views.collect())));
        Ok(())
    }
}

/// Silhouettes of all links in rig order, and the bytes they travelled as.
async fn fetch(
    links: &[Arc<Link>],
    frame: u64,
    encoding: SilhouetteEncoding,
) -> Result<(Vec<Silhouette>, u64), String> {
    let asked = links.iter().map(|link| link.silhouettes(frame, encoding));
    let mut all = Vec::new();
    let mut bytes = 0;
    for (link, fetched) in links.iter().zip(futures::future::join_all(asked).await) {
        let (silhouettes, more) = fetched.map_err(|error| format!("node {}: {error}", link.node.address))?;
        all.extend(silhouettes);
        bytes += more;
    }
    all.sort_by_key(|(rig_index, _)| *rig_index);
    Ok((all.into_iter().map(|(_, silhouette)| silhouette).collect(), bytes))
}

async fn tell_of_background(
    links: &[Arc<Link>],
    first_frame: u64,
    frames: u64,
    check_only: bool,
) -> Result<(), String> {
    let told = links.iter().map(|link| async move {
        let taken = link.take_background(first_frame, frames, check_only);
        let taken = tokio::time::timeout(PICTURE_PATIENCE, taken).await;
        taken
            .unwrap_or_else(|_| Err("it did not answer in time".into()))
            .map_err(|why| format!("node {}: {why}", link.node.address))
    });
    futures::future::join_all(told).await.into_iter().collect()
}

fn run_locally(pass: &mut Pass, views: &ViewSet, local: &mut Local, took: &mut dyn FnMut(Round, f64)) {
    while let Some(question) = pass.question() {
        let (round, began) = (pass.round(), Instant::now());
        views.answer(question, &mut local.scratch, &mut local.answer);
        pass.answer(0, &local.answer).expect("the one group answers every question once");
        took(round, began.elapsed().as_secs_f64() * 1e3);
    }
}
