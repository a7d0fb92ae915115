//! The nodes are the coordinator's memory: they keep its world, and one that starts goes on from the newest of which two
//! nodes have the same bytes. No disk.

mod agreement;
mod checkpoint;
mod message;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytes::Bytes;
use film_time::unix_now_s;
use hull::Observer;
use node_client::{NodeClient, NodeError};
use proto::text::{MAX_MESSAGE_CHARS, clean};
use sim::{Scene, World};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::{Instant, timeout};

pub(crate) use agreement::Home;
use agreement::Recalled;
use checkpoint::Moment;
pub(crate) use checkpoint::{Checkpoint, Place};

/// Nodes are handed the world so often. A killed coordinator's successor lacks this and its way to a node: together less
/// than a second.
const KEEP_EVERY: Duration = Duration::from_millis(900);
/// A node that does not take it in this time is not waited for.
const KEEP_TIMEOUT: Duration = Duration::from_secs(5);
/// A starting coordinator waits so long for what its nodes remember.
const FETCH_TIMEOUT: Duration = Duration::from_secs(1);

/// What a run does with the memory of its nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MemoryUse {
    /// Nothing: it is reproducible, or its nodes end with it.
    #[default]
    Off,
    /// Goes on from what they remember, and hands them its own world.
    GoOn,
    /// Begins with its scene, and hands them its own world.
    Fresh,
}

/// The way of worlds to a node.
#[derive(Debug)]
struct Way {
    /// A world on its way holds it.
    free: Arc<Semaphore>,
    /// How often the node was connected when it was last handed a world.
    connections: u64,
}

/// Hands the nodes the world, once a second.
pub(crate) struct Memory {
    home: Home,
    moment: Moment,
    due: Instant,
    ways: Vec<Way>,
    /// What the nodes were handed last; empty before.
    latest: watch::Sender<Bytes>,
    /// Whether it was said that the world is too large.
    is_warned: Arc<AtomicBool>,
}

impl Way {
    /// Whether a world may go to the node, if it was connected so often: all get one that is due, one that has come back any.
    fn admit(&mut self, connections: u64, is_due: bool) -> Option<OwnedSemaphorePermit> {
        let permit = Arc::clone(&self.free).try_acquire_owned().ok()?;
        let is_back = std::mem::replace(&mut self.connections, connections) != connections;
        (is_due || is_back).then_some(permit)
    }
}

impl Memory {
    /// A memory of so many nodes for a run of these cameras that begins with this scene.
    pub fn new(observers: &[Arc<Observer>], scene: &Scene, nodes: usize) -> Memory {
        // Only tells runs apart that began at the same instant.
        let run = getrandom::u64().unwrap_or_default();
        Memory {
            home: Home::new(Place::of(observers, scene), scene),
            moment: Moment { term: 1, run, sequence: 0, unix_s: 0.0 },
            due: Instant::now() + KEEP_EVERY,
            ways: (0..nodes).map(|_| Way { free: Arc::new(Semaphore::new(1)), connections: 0 }).collect(),
            latest: watch::Sender::default(),
            is_warned: Arc::default(),
        }
    }

    /// Once a second puts the world on its way to all nodes that have taken the one before. A node that was connected again since,
    /// by the counts of `connections`, is handed what the others have: until it has the same, one node less remembers it. Never
    /// waits; the bytes are made on another thread.
    pub fn keep(
        &mut self,
        world: &World,
        clients: &[Arc<NodeClient>],
        connections: impl Iterator<Item = u64>,
    ) {
        let is_due = Instant::now() >= self.due;
        let free = |((way, client), connections): ((&mut Way, &Arc<NodeClient>), u64)| {
            let permit = way.admit(connections, is_due)?;
            Some((permit, Arc::clone(client)))
        };
        let ways: Vec<_> = self.ways.iter_mut().zip(clients).zip(connections).filter_map(free).collect();
        if !is_due {
            let latest = self.latest.borrow().clone();
            if !latest.is_empty() {
                ways.into_iter().for_each(|(way, client)| send(latest.clone(), way, client));
            }
            return;
        }
        self.due = Instant::now() + KEEP_EVERY;
        if ways.is_empty() {
            return;
        }
        self.moment.sequence += 1;
        self.moment.unix_s = unix_now_s();
        let checkpoint = Checkpoint { place: self.home.place(), kept: self.moment, world: world.snapshot() };
        let (latest, is_warned) = (self.latest.clone(), Arc::clone(&self.is_warned));
        tokio::spawn(hand_out(checkpoint, ways, latest, is_warned));
    }

    /// The newest world that can go on here, of what the nodes remember. From now on this run's are newer than all of that.
    pub async fn recall(&mut self, clients: &[Arc<NodeClient>]) -> Option<Checkpoint> {
        let fetched = futures::future::join_all(clients.iter().map(|client| fetch(client))).await;
        for (client, fetched) in clients.iter().zip(&fetched) {
            if let Err(why) = fetched {
                let why = clean(&why.to_string(), MAX_MESSAGE_CHARS);
                tracing::warn!("node {}: its world cannot be fetched: {why}", client.node());
            }
        }
        let recalled = read(self.home.clone(), fetched).await;
        self.moment.term = recalled.highest_term + 1;
        if let (None, Some(why)) = (&recalled.newest, recalled.unfit) {
            let why = clean(&why.to_string(), MAX_MESSAGE_CHARS);
            tracing::warn!("nodes remember a world, but {why}: this run begins with its scene");
        }
        recalled.newest
    }
}

/// The newest world that nodes remember of a run of this home.
pub(crate) async fn newest_world(home: Home, clients: Vec<Arc<NodeClient>>) -> Option<Checkpoint> {
    let fetched = futures::future::join_all(clients.iter().map(|client| fetch(client))).await;
    read(home, fetched).await.newest
}

/// What one node remembers.
async fn fetch(client: &NodeClient) -> Result<Vec<Bytes>, NodeError> {
    let fetched = timeout(FETCH_TIMEOUT, client.fetch_worlds()).await;
    fetched.unwrap_or(Err(NodeError::Timeout(FETCH_TIMEOUT)))
}

/// Reads what nodes remember, apart from the thread that steps.
async fn read(home: Home, fetched: Vec<Result<Vec<Bytes>, NodeError>>) -> Recalled {
    let nodes: Vec<Vec<Bytes>> = fetched.into_iter().map(Result::unwrap_or_default).collect();
    film_time::apart(move || home.recall(&nodes)).await.unwrap_or_default()
}

/// Sends a world along the ways that are free.
async fn hand_out(
    checkpoint: Checkpoint,
    ways: Vec<(OwnedSemaphorePermit, Arc<NodeClient>)>,
    latest: watch::Sender<Bytes>,
    is_warned: Arc<AtomicBool>,
) {
    let bytes = match film_time::apart(move || checkpoint.to_bytes()).await {
        Some(Ok(bytes)) => Bytes::from(bytes),
        Some(Err(error)) => {
            if !is_warned.swap(true, Ordering::Relaxed) {
                tracing::warn!("nodes cannot remember this world: {error}");
            }
            return;
        }
        // The run ends.
        None => return,
    };
    latest.send_replace(bytes.clone());
    ways.into_iter().for_each(|(way, client)| send(bytes.clone(), way, client));
}

/// Sends a node a world. Its way is free again once the node has taken it, or failed to.
fn send(bytes: Bytes, way: OwnedSemaphorePermit, client: Arc<NodeClient>) {
    tokio::spawn(async move {
        let kept = timeout(KEEP_TIMEOUT, client.keep_world(bytes)).await;
        if let Err(error) = kept.unwrap_or(Err(NodeError::Timeout(KEEP_TIMEOUT))) {
            tracing::debug!("node {} does not remember the world: {error}", client.node());
        }
        drop(way);
    });
}
