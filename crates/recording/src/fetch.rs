//! Fetches the silhouettes of the frames that a run uses, and their colours if wanted, beside the run.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use coordinator::hooks::FrameRecord;
use coordinator::{BoxError, Fetching, Silhouettes};
use film_time::{CameraReport, FrameReport};
use hull::Silhouette;
use proto::convert::{SilhouetteEncoding, silhouette_data};
use proto::recording as messages;
use tokio::sync::mpsc;

use crate::channels::Channel;
use crate::times::{Times, unix_ns};
use crate::writer::{Entry, Sink};

/// Frames on their way at most: as many as a node keeps; what waits longer is gone there.
const MAX_FETCHING: usize = 8;
/// A lock-step run brings a frame into use while at most so many are on their way.
const MAX_AHEAD: usize = 1;
/// A frame that has not come by then has been dropped by its node long ago.
const FETCH_TIMEOUT: Duration = Duration::from_secs(2);

/// What was cut out of a camera's image around its foreground.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColourCrop {
    /// The camera's place in the rig.
    pub camera: u16,
    /// Left, top, width and height of the cut in the camera's own full-resolution pixels.
    pub crop: [u32; 4],
    /// The JPEG shows it 2 to this power times smaller.
    pub scale_log2: u32,
    /// The JPEG.
    pub jpeg: Vec<u8>,
}

/// Colours of a frame on their way; cameras that have none are left out.
pub type FetchingColours = Pin<Box<dyn Future<Output = Result<Vec<ColourCrop>, BoxError>> + Send>>;
/// Begins to fetch the colours of a frame.
pub type Colours = Box<dyn Fn(u64) -> FetchingColours + Send>;
/// Makes that, on the thread and within the runtime where it is used.
pub type ColourSource = Box<dyn FnOnce() -> Colours + Send>;

/// Hands frames to a thread that waits for them.
#[derive(Debug)]
pub(crate) struct Fetcher {
    requests: Option<mpsc::Sender<FrameRequest>>,
    counts: Arc<Counts>,
}

/// The thread that waits for frames.
#[derive(Debug)]
pub(crate) struct Fetches {
    thread: JoinHandle<()>,
    counts: Arc<Counts>,
}

#[derive(Debug, Default)]
struct Counts {
    fetching: AtomicUsize,
    frames: AtomicU64,
    lost: AtomicU64,
    colourless: AtomicU64,
}

struct FrameRequest {
    frame: u64,
    /// When each camera captured it (unix seconds) and how long that took to segment, milliseconds.
    facts: Vec<(u16, f64, f64)>,
    silhouettes: Fetching,
}

impl Fetcher {
    /// A fetcher and its thread.
    pub fn begin(sink: Sink, times: Times, colours: Option<ColourSource>) -> (Fetcher, Fetches) {
        let (requests, received) = mpsc::channel(MAX_FETCHING);
        let counts = Arc::new(Counts::default());
        let thread = {
            let counts = Arc::clone(&counts);
            std::thread::spawn(move || {
                let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
                match runtime {
                    Ok(runtime) => runtime.block_on(async {
                        let colours = colours.map(|source| source());
                        fetch_all(received, sink, times, colours, &counts).await;
                    }),
                    Err(error) => tracing::error!("silhouettes are not recorded: {error}"),
                }
            })
        };
        (Fetcher { requests: Some(requests), counts: Arc::clone(&counts) }, Fetches { thread, counts })
    }

    /// Begins to wait for a frame.
    pub fn fetch(&mut self, record: FrameRecord<'_>) {
        let of_node = |report: &&FrameReport| {
            let captured_unix_s = report.captured_unix_s;
            let camera = move |camera: &CameraReport| (camera.rig_index, captured_unix_s, camera.segment_ms);
            report.cameras.iter().map(camera).collect::<Vec<_>>()
        };
        let facts = record.reports.iter().flat_map(of_node).collect();
        let request = FrameRequest { frame: record.frame, facts, silhouettes: record.silhouettes };
        self.counts.fetching.fetch_add(1, Ordering::Relaxed);
        let sent = self.requests.as_ref().is_some_and(|sender| sender.try_send(request).is_ok());
        if !sent {
            self.counts.lose(record.frame, "too many frames are on their way");
        }
    }

    /// Whether few frames are on their way.
    pub fn keeps_up(&self) -> bool {
        self.counts.fetching.load(Ordering::Relaxed) <= MAX_AHEAD
    }

    /// No more frames come.
    pub fn close(&mut self) {
        self.requests = None;
    }
}

impl Fetches {
    /// Waits for all frames; how many came and how many did not.
    pub fn finish(self) -> (u64, u64) {
        if self.thread.join().is_err() {
            tracing::error!("the thread that fetches silhouettes panicked");
        }
        (self.counts.frames.load(Ordering::Relaxed), self.counts.lost.load(Ordering::Relaxed))
    }
}

impl Counts {
    fn lack_colour(&self, frame: u64, why: &str) {
        if self.colourless.fetch_add(1, Ordering::Relaxed) == 0 {
            tracing::warn!("the recording lacks the colours of frame {frame}: {why} (logged once)");
        }
    }

    fn lose(&self, frame: u64, why: &str) {
        self.fetching.fetch_sub(1, Ordering::Relaxed);
        if self.lost.fetch_add(1, Ordering::Relaxed) == 0 {
            tracing::warn!(
                "the recording lacks frame {frame}: {why} (logged once; the file's end counts them)"
            );
        }
    }
}

async fn fetch_all(
    mut requests: mpsc::Receiver<FrameRequest>,
    sink: Sink,
    times: Times,
    colours: Option<Colours>,
    counts: &Arc<Counts>,
) {
    let mut fetches = tokio::task::JoinSet::new();
    while let Some(request) = requests.recv().await {
        while fetches.len() >= MAX_FETCHING {
            fetches.join_next().await;
        }
        while fetches.try_join_next().is_some() {}
        let (sink, counts) = (sink.clone(), Arc::clone(counts));
        let colours = colours.as_ref().map(|fetch| fetch(request.frame));
        fetches.spawn(fetch(request, colours, sink, times, counts));
    }
    while fetches.join_next().await.is_some() {}
}

async fn fetch(
    request: FrameRequest,
    colours: Option<FetchingColours>,
    sink: Sink,
    times: Times,
    counts: Arc<Counts>,
) {
    let FrameRequest { frame, facts, silhouettes } = request;
    let colours = async {
        match colours {
            Some(colours) => in_time(colours).await,
            None => Ok(Vec::new()),
        }
    };
    let (silhouettes, colours) = tokio::join!(in_time(silhouettes), colours);
    match silhouettes {
        Ok(silhouettes) => {
            let mut all = entries(frame, &facts, &silhouettes, times);
            match colours {
                Ok(colours) => all.extend(colours.into_iter().map(|crop| colour_entry(frame, crop, times))),
                Err(why) => counts.lack_colour(frame, &why.to_string()),
            }
            sink.put(all);
            counts.frames.fetch_add(1, Ordering::Relaxed);
            counts.fetching.fetch_sub(1, Ordering::Relaxed);
        }
        Err(why) => counts.lose(frame, &why.to_string()),
    }
}

/// What comes before the timeout.
async fn in_time<T, E: Into<BoxError>>(fetching: impl Future<Output = Result<T, E>>) -> Result<T, BoxError> {
    tokio::time::timeout(FETCH_TIMEOUT, fetching).await?.map_err(Into::into)
}

fn colour_entry(frame: u64, crop: ColourCrop, times: Times) -> Entry {
    let ColourCrop { camera, crop: [left, top, width, height], scale_log2, jpeg } = crop;
    let message =
        messages::Colour { frame, camera: camera.into(), left, top, width, height, scale_log2, jpeg };
    Entry::new(Channel::Colour(camera.into()), times.log_ns(frame as f64 / times.fps), &message)
}

fn entries(frame: u64, facts: &[(u16, f64, f64)], silhouettes: &Silhouettes, times: Times) -> Vec<Entry> {
    let log_ns = times.log_ns(frame as f64 / times.fps);
    let entry = |(camera, silhouette): &(u16, Arc<Silhouette>)| {
        let known = facts.iter().find(|(rig_index, ..)| rig_index == camera);
        let (captured_unix_s, segment_ms) = known.map_or((0.0, 0.0), |&(_, unix_s, ms)| (unix_s, ms));
        let message = messages::Silhouette {
            frame,
            camera: (*camera).into(),
            width: silhouette.width(),
            height: silhouette.height(),
            runs: silhouette_data(silhouette, SilhouetteEncoding::Runs).into(),
            captured_unix_s,
            segment_ms,
            cameras: silhouettes.len() as u32,
        };
        let mut entry = Entry::new(Channel::Silhouette((*camera).into()), log_ns, &message);
        if known.is_some() {
            entry.publish_ns = unix_ns(captured_unix_s);
        }
        entry
    };
    silhouettes.iter().map(entry).collect()
}
