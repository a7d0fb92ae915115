//! Where pictures come from: silhouettes and colours of a frame, made by whoever films, and only when asked.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use futures::future::BoxFuture;
use hull::camera::MAX_SIDE_PIXELS;
use hyper_util::rt::TokioIo;
use proto::v1::camera_node_client::CameraNodeClient;
use proto::{Address, MAX_MESSAGE_BYTES, v1};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, UnixStream};
use tonic::transport::{Channel, Endpoint, Uri};

/// JPEG quality of all pictures: eight cameras of 640 × 480 stay within 15 Mbit/s at 30 frames/s.
pub const JPEG_QUALITY: u8 = 80;

/// What of a camera's image is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PictureKind {
    /// Its silhouette.
    Silhouettes,
    /// Its silhouette, and the colours around it.
    Crops,
    /// The whole image.
    Whole,
}

/// A question about one frame.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PictureRequest {
    /// Which frame; `None`: the newest.
    pub frame: Option<u64>,
    /// What of it.
    pub kind: PictureKind,
    /// Both sides are divided by 2 to the power of this, 0 to 3.
    pub scale_log2: u8,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
    /// Places in the rig; empty: all cameras.
    pub cameras: Vec<u16>,
}

/// One camera's part of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraPicture {
    /// Its place in the rig.
    pub camera: u16,
    /// Its silhouette, whole image: the wire's RUNS. Empty if only the image was asked for.
    pub runs: Bytes,
    /// Both sides of the JPEG are divided by 2 to the power of this.
    pub scale_log2: u8,
    /// Left, top, width and height of what the JPEG shows, in the camera's own pixels.
    pub crop: [u16; 4],
    /// The colours; empty if there are none.
    pub jpeg: Bytes,
}

/// A frame of as many cameras as have it.
#[derive(Clone, Debug, PartialEq)]
pub struct FramePictures {
    /// Its number.
    pub frame: u64,
    /// When it was captured, unix seconds.
    pub captured_unix_s: f64,
    /// In rig order.
    pub cameras: Vec<CameraPicture>,
}

/// Makes pictures.
pub trait Pictures: Send + Sync {
    /// The pictures of a frame; the error is one line. Takes half a second at most; of the newest frame, where
    /// cameras have to agree on one, twice that.
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, String>>;
}

/// All cameras of a frame together get so long.
pub const FETCH_PATIENCE: Duration = Duration::from_millis(500);
/// A node that took too long is left alone for so long, so that it does not hold up every frame of the others.
const REST: Duration = Duration::from_secs(2);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// A silent node is noticed within twice this.
const KEEP_ALIVE: Duration = Duration::from_secs(5);

/// Pictures from the nodes of a cluster, over connections of their own: however large, they never stand in the
/// way of a probe.
pub struct NodePictures {
    nodes: Vec<Arc<NodeLink>>,
}

struct NodeLink {
    client: CameraNodeClient<Channel>,
    /// Places in the rig.
    cameras: Vec<u16>,
    rests_until: Mutex<Option<Instant>>,
}

impl NodePictures {
    /// The nodes at these addresses, each with the places in the rig of its cameras. Connects when first asked,
    /// and again whenever a connection breaks. Must run within the tokio runtime that the server runs on.
    pub fn new(nodes: impl IntoIterator<Item = (Address, Vec<u16>)>) -> NodePictures {
        let link = |(address, cameras): (Address, Vec<u16>)| {
            let client = CameraNodeClient::new(channel(address))
                .max_decoding_message_size(MAX_MESSAGE_BYTES)
                .max_encoding_message_size(MAX_MESSAGE_BYTES);
            Arc::new(NodeLink { client, cameras, rests_until: Mutex::default() })
        };
        NodePictures { nodes: nodes.into_iter().map(link).collect() }
    }
}

impl Pictures for NodePictures {
    fn fetch(&self, request: PictureRequest) -> BoxFuture<'static, Result<FramePictures, String>> {
        let nodes = self.nodes.clone();
        Box::pin(async move {
            let found = fetch(&nodes, &request).await;
            // The newest of each: of one that all of them have, if they differ.
            let common = found.iter().flatten().map(|pictures| pictures.frame).min();
            let differ = found.iter().flatten().any(|pictures| Some(pictures.frame) != common);
            if differ {
                let request = PictureRequest { frame: common, ..request };
                return merged(fetch(&nodes, &request).await);
            }
            merged(found)
        })
    }
}

async fn fetch(nodes: &[Arc<NodeLink>], request: &PictureRequest) -> Vec<Result<FramePictures, String>> {
    futures::future::join_all(nodes.iter().filter_map(|node| node.fetch(request))).await
}

/// All nodes' pictures of one frame.
fn merged(told: Vec<Result<FramePictures, String>>) -> Result<FramePictures, String> {
    let mut found: Option<FramePictures> = None;
    let mut problem = String::from("no node has these cameras");
    for told in told {
        match (told, &mut found) {
            (Err(why), _) => problem = why,
            (Ok(pictures), None) => found = Some(pictures),
            (Ok(pictures), Some(all)) if pictures.frame == all.frame => all.cameras.extend(pictures.cameras),
            (Ok(pictures), Some(_)) => problem = format!("frame {} is another one", pictures.frame),
        }
    }
    let mut found = found.filter(|found| !found.cameras.is_empty()).ok_or(problem)?;
    found.cameras.sort_by_key(|camera| camera.camera);
    Ok(found)
}

impl NodeLink {
    /// Asks this node for its part; `None` if it has none, or rests.
    fn fetch(
        self: &Arc<NodeLink>,
        request: &PictureRequest,
    ) -> Option<impl Future<Output = Result<FramePictures, String>> + use<>> {
        let cameras: Vec<u32> = self
            .cameras
            .iter()
            .filter(|camera| request.cameras.contains(camera))
            .map(|&c| c.into())
            .collect();
        let is_asked = request.cameras.is_empty() || !cameras.is_empty();
        let rests = self.rests_until().is_some_and(|until| Instant::now() < until);
        if !is_asked || rests {
            return None;
        }
        let is_whole = request.kind == PictureKind::Whole;
        let request = to_wire(request, cameras);
        let (link, mut client) = (Arc::clone(self), self.client.clone());
        Some(async move {
            let fetch = async {
                let mut told = client.fetch_pictures(request).await?.into_inner();
                let mut pictures = Vec::new();
                while let Some(picture) = told.message().await? {
                    pictures.push(picture);
                }
                Ok(pictures)
            };
            match tokio::time::timeout(FETCH_PATIENCE, fetch).await {
                Ok(Ok(pictures)) => from_wire(pictures, &link.cameras),
                Ok(Err(status)) => Err(one_line(&status)),
                Err(_) => {
                    // Whole images are asked for one by one, and hold up nobody.
                    if !is_whole {
                        *link.rests_until() = Some(Instant::now() + REST);
                    }
                    Err(format!("no pictures within {} ms", FETCH_PATIENCE.as_millis()))
                }
            }
        })
    }

    fn rests_until(&self) -> MutexGuard<'_, Option<Instant>> {
        self.rests_until.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn one_line(status: &tonic::Status) -> String {
    status.message().lines().collect::<Vec<_>>().join(", ")
}

/// A channel that connects when it is used.
fn channel(address: Address) -> Channel {
    let endpoint = Endpoint::from_static("http://node.invalid")
        .connect_timeout(CONNECT_TIMEOUT)
        .http2_keep_alive_interval(KEEP_ALIVE)
        .keep_alive_timeout(KEEP_ALIVE);
    endpoint.connect_with_connector_lazy(tower::service_fn(move |_: Uri| {
        let address = address.clone();
        async move {
            let stream: Box<dyn Stream> = match address {
                Address::Tcp(host_port) => {
                    let stream = TcpStream::connect(host_port).await?;
                    stream.set_nodelay(true)?;
                    Box::new(stream)
                }
                Address::Unix(path) => Box::new(UnixStream::connect(path).await?),
            };
            std::io::Result::Ok(TokioIo::new(stream))
        }
    }))
}

trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}
impl<S: AsyncRead + AsyncWrite + Send + Unpin> Stream for S {}

fn to_wire(request: &PictureRequest, cameras: Vec<u32>) -> v1::FetchPicturesRequest {
    use v1::fetch_pictures_request::Kind;
    let &PictureRequest { frame, kind, scale_log2, jpeg_quality, cameras: _ } = request;
    let kind = match kind {
        PictureKind::Silhouettes => Kind::Silhouettes,
        PictureKind::Crops => Kind::Crops,
        PictureKind::Whole => Kind::Whole,
    };
    v1::FetchPicturesRequest {
        frame: frame.unwrap_or(u64::MAX),
        scale_log2: scale_log2.into(),
        jpeg_quality: jpeg_quality.into(),
        kind: kind.into(),
        cameras,
    }
}

/// A node's pictures, all of one frame and of cameras that it has.
fn from_wire(pictures: Vec<v1::Picture>, cameras: &[u16]) -> Result<FramePictures, String> {
    let (mut frame, mut captured) = (0, 0.0);
    let mut found: Vec<CameraPicture> = Vec::new();
    for picture in pictures {
        let v1::Picture {
            rig_index,
            runs,
            left,
            top,
            width,
            height,
            jpeg,
            frame: of,
            captured_unix_s,
            scale_log2,
        } = picture;
        let camera = cameras.iter().find(|camera| u32::from(**camera) == rig_index).copied();
        let camera =
            camera.ok_or_else(|| format!("Picture.rig_index is {rig_index}, expected one of {cameras:?}"))?;
        let sides = [left, top, width, height];
        let is_image = sides.iter().all(|&side| side <= MAX_SIDE_PIXELS) && scale_log2 <= 3;
        if !is_image || !captured_unix_s.is_finite() || found.iter().any(|other| other.camera == camera) {
            return Err(format!("Picture of camera {camera} is none: {sides:?} at {captured_unix_s}"));
        }
        (frame, captured) = (of, captured_unix_s);
        let crop = sides.map(|side| side as u16);
        found.push(CameraPicture { camera, runs, scale_log2: scale_log2 as u8, crop, jpeg });
    }
    Ok(FramePictures { frame, captured_unix_s: captured, cameras: found })
}
