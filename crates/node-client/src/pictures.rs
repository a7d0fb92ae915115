//! Pictures from the nodes of a cluster, over connections of their own: however large, they never stand in the
//! way of a probe.

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::{Mutex, MutexGuard};
use proto::convert::{frame_pictures_from_wire, picture_request_to_wire};
use proto::{Address, FramePictures, PictureKind, PictureRequest};
use thiserror::Error;

use crate::agreement::ExpectedNode;
use crate::connection::{Dial, connect_lazily};
use crate::counting::ByteCounters;
use crate::error::NodeError;
use crate::reply_limits::{NodeCalls, ReplyLimits};

/// All cameras of a frame together get so long.
pub const FETCH_TIMEOUT: Duration = Duration::from_millis(500);
/// A node that took too long is not asked for so long, so that it does not hold up every frame of the others.
const REST: Duration = Duration::from_secs(2);

/// Why there are no pictures of a frame.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PicturesError {
    /// No node that could be asked has the cameras.
    #[error("no node has these cameras")]
    NoCamera,
    /// The nodes that answered have other frames.
    #[error("node {node} has frame {found}, expected {expected}")]
    OtherFrame {
        /// The node and its cameras.
        node: String,
        /// Its frame.
        found: u64,
        /// The others'.
        expected: u64,
    },
    /// A node failed.
    #[error("node {node}: {error}")]
    Node {
        /// The node and its cameras.
        node: String,
        /// What failed.
        error: NodeError,
    },
}

/// Pictures of all nodes. Copies are cheap.
#[derive(Clone)]
pub struct NodePictures {
    nodes: Vec<Arc<PictureNode>>,
}

struct PictureNode {
    node: ExpectedNode,
    dial: Arc<dyn Dial>,
    counters: Arc<ByteCounters>,
    limits: Arc<ReplyLimits>,
    /// To the address where the node was found last.
    client: Mutex<Option<(Address, NodeCalls)>>,
    rests_until: Mutex<Option<Instant>>,
}

impl NodePictures {
    /// Connects over such sockets when first asked, and again whenever a connection breaks. Must run within the tokio
    /// runtime that asks.
    pub fn new(nodes: impl IntoIterator<Item = ExpectedNode>, dial: &Arc<dyn Dial>) -> NodePictures {
        // A page's bytes are not the run's.
        let counters = Arc::new(ByteCounters::default());
        let picture_node = |node: ExpectedNode| {
            let (dial, counters) = (Arc::clone(dial), Arc::clone(&counters));
            let limits = ReplyLimits::of(&node.cameras);
            Arc::new(PictureNode {
                node,
                dial,
                counters,
                limits,
                client: Mutex::default(),
                rests_until: Mutex::default(),
            })
        };
        NodePictures { nodes: nodes.into_iter().map(picture_node).collect() }
    }

    /// The pictures of a frame, of as many cameras as have them. Takes [`FETCH_TIMEOUT`] at most; of the newest
    /// frame, where cameras have to agree on one, twice that.
    pub async fn fetch(&self, request: PictureRequest) -> Result<FramePictures, PicturesError> {
        let found = self.fetch_parts(&request).await;
        // The newest of each: if they differ, the newest that all of them have.
        let common = found.iter().flatten().map(|(_, pictures)| pictures.frame).min();
        let differ = found.iter().flatten().any(|(_, pictures)| Some(pictures.frame) != common);
        if differ {
            return merged(self.fetch_parts(&PictureRequest { frame: common, ..request }).await);
        }
        merged(found)
    }

    async fn fetch_parts(&self, request: &PictureRequest) -> Vec<Part> {
        futures::future::join_all(self.nodes.iter().filter_map(|node| node.fetch(request))).await
    }
}

/// A node's name and its pictures.
type Part = Result<(String, FramePictures), PicturesError>;

/// All nodes' pictures of one frame.
fn merged(parts: Vec<Part>) -> Result<FramePictures, PicturesError> {
    let mut all: Option<FramePictures> = None;
    let mut problem = PicturesError::NoCamera;
    for part in parts {
        match (part, &mut all) {
            (Err(why), _) => problem = why,
            (Ok((_, pictures)), None) => all = Some(pictures),
            (Ok((_, pictures)), Some(all)) if pictures.frame == all.frame => {
                all.cameras.extend(pictures.cameras);
            }
            (Ok((node, pictures)), Some(all)) => {
                problem = PicturesError::OtherFrame { node, found: pictures.frame, expected: all.frame };
            }
        }
    }
    let mut all = all.filter(|all| !all.cameras.is_empty()).ok_or(problem)?;
    all.cameras.sort_by_key(|camera| camera.rig_index);
    Ok(all)
}

impl PictureNode {
    /// Asks this node for its part; `None` if it has none, or rests.
    fn fetch(
        self: &Arc<PictureNode>,
        request: &PictureRequest,
    ) -> Option<impl Future<Output = Part> + use<>> {
        let places = self.node.cameras.iter().map(|camera| camera.rig_index);
        let cameras: Vec<u16> = places.filter(|place| request.cameras.contains(place)).collect();
        let is_asked = request.cameras.is_empty() || !cameras.is_empty();
        let rests = self.rests_until().is_some_and(|until| Instant::now() < until);
        if !is_asked || rests {
            return None;
        }
        let (is_whole, asked_for) = (request.kind == PictureKind::Whole, request.frame);
        let message = picture_request_to_wire(&PictureRequest { cameras, ..request.clone() });
        let node = Arc::clone(self);
        Some(async move {
            let fetch = async {
                let mut client = node.client().ok_or(NodeError::NotConnected)?;
                let mut stream = client.fetch_pictures(message).await?.into_inner();
                let mut pictures = Vec::new();
                // One more than there are cameras is enough to refuse them.
                while pictures.len() <= node.node.cameras.len()
                    && let Some(picture) = stream.message().await?
                {
                    pictures.push(picture);
                }
                if pictures.is_empty() {
                    return Err(NodeError::NoPictures);
                }
                let pictures = frame_pictures_from_wire(pictures, &node.node.cameras)?;
                match asked_for {
                    Some(expected) if expected != pictures.frame => {
                        Err(NodeError::OtherFrame { found: pictures.frame, expected })
                    }
                    _ => Ok(pictures),
                }
            };
            let fetched = tokio::time::timeout(FETCH_TIMEOUT, fetch).await.unwrap_or_else(|_| {
                // Whole images are asked for one by one, and hold up no other.
                if !is_whole {
                    *node.rests_until() = Some(Instant::now() + REST);
                }
                Err(NodeError::Timeout(FETCH_TIMEOUT))
            });
            let name = node.node.to_string();
            match fetched {
                Ok(pictures) => Ok((name, pictures)),
                Err(error) => Err(PicturesError::Node { node: name, error }),
            }
        })
    }

    /// A client of the node where it is; none while that is not certain: what finds and checks it is the run's own
    /// connection.
    fn client(&self) -> Option<NodeCalls> {
        let address = self.node.place.checked()?;
        let mut client = self.client.lock();
        if client.as_ref().is_none_or(|(known, _)| *known != address) {
            *client = {
                let to = self.node.at(&address);
                Some((address, connect_lazily(&to, &self.dial, &self.counters, &self.limits)))
            };
        }
        client.as_ref().map(|(_, client)| client.clone())
    }

    fn rests_until(&self) -> MutexGuard<'_, Option<Instant>> {
        self.rests_until.lock()
    }
}
