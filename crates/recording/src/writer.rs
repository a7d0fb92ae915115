//! The thread that writes a recording: chunk after chunk, each handed to the disk whole.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Compression, McapError, WriteOptions, Writer};
use prost::Message;
use proto::recording::DESCRIPTORS;
use thiserror::Error;

use crate::channels::Channel;
use crate::queue::{ByteQueue, Received};

/// What may wait for the disk: a minute of eight cameras' silhouettes.
const MAX_WAITING_BYTES: usize = 64 << 20;
/// A chunk is on the disk after at most so long, by the wall clock and by film time: this is what a crash
/// costs.
const CHUNK_LASTS: Duration = Duration::from_millis(500);
/// A chunk of more is closed at once; readers hold one in memory.
const CHUNK_BYTES: u64 = 4 << 20;

/// Why there is no recording.
#[derive(Debug, Error)]
pub enum WriteError {
    /// The file is there already.
    #[error("{} is there already, expected a new file (or --force)", .0.display())]
    Exists(PathBuf),
    /// It cannot be written.
    #[error("cannot write {}: {problem}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        problem: String,
    },
}

/// Whether a recording may take the place of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overwrites {
    /// A file that is there stays.
    Never,
    /// Once the recording is complete.
    AtTheEnd,
}

/// A message with its channel and times, unix nanoseconds.
#[derive(Debug)]
pub(crate) struct Entry {
    pub channel: Channel,
    pub log_ns: u64,
    pub publish_ns: u64,
    pub message: Vec<u8>,
}

/// Where messages for a file go; copies are cheap.
#[derive(Clone, Debug)]
pub(crate) struct Sink {
    queue: Arc<ByteQueue<Vec<Entry>>>,
    problem: Arc<OnceLock<String>>,
    /// Waits for a slow disk instead of giving up.
    waits: bool,
}

/// A file that is being written.
#[derive(Debug)]
pub(crate) struct FileWriter {
    sink: Sink,
    thread: Option<JoinHandle<()>>,
    path: PathBuf,
    writing: PathBuf,
}

impl Entry {
    /// A message of that log time.
    pub fn new(channel: Channel, log_ns: u64, message: &impl Message) -> Entry {
        Entry { channel, log_ns, publish_ns: log_ns, message: message.encode_to_vec() }
    }
}

impl Sink {
    /// Hands in messages that belong together. A disk that is too slow for a run that does not wait ends the
    /// recording, in one loud line.
    pub fn put(&self, entries: Vec<Entry>) {
        let bytes = entries.iter().map(|entry| size_of::<Entry>() + entry.message.len()).sum();
        if self.waits {
            // A file that has failed has logged why.
            self.queue.put(bytes, entries);
        } else if !self.queue.offer(bytes, entries) && !self.queue.is_closed() {
            self.fail(format!("the disk is too slow: {} MB wait for it", MAX_WAITING_BYTES >> 20));
        }
    }

    /// Whether the disk keeps up, or the recording has ended.
    pub fn keeps_up(&self) -> bool {
        self.queue.has_room() || self.queue.is_closed()
    }

    /// Why the recording has ended too early, if so.
    pub fn problem(&self) -> Option<&str> {
        self.problem.get().map(String::as_str)
    }

    fn fail(&self, problem: String) {
        tracing::error!("the recording has ended, the run goes on: {problem}");
        // What is set is the first problem; there is no second.
        let _ = self.problem.set(problem);
        self.queue.close();
    }
}

impl FileWriter {
    /// Creates the file and all its channels; `first` is on the disk when this returns. A file that is there
    /// stays as it is until the new one is complete, and is replaced only if it may be. With `waits` a slow disk
    /// holds up the sender.
    pub fn create(
        path: &Path,
        overwrites: Overwrites,
        waits: bool,
        names: &[String],
        first: Entry,
    ) -> Result<FileWriter, WriteError> {
        let writing = if path.exists() { partial(path) } else { path.to_owned() };
        if writing != path && overwrites == Overwrites::Never {
            return Err(WriteError::Exists(path.to_owned()));
        }
        let unwritable = |problem: String| WriteError::Unwritable { path: writing.clone(), problem };
        let file = File::create_new(&writing).map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => {
                unwritable("a run that did not end left this file; keep it elsewhere, or remove it".into())
            }
            _ => unwritable(error.to_string()),
        })?;
        let mut chunks = Chunks::begin(file, names).map_err(|error| unwritable(explained(&error)))?;
        chunks.add(&[first]).and_then(|()| chunks.flush()).map_err(|error| unwritable(explained(&error)))?;
        let sink =
            Sink { queue: Arc::new(ByteQueue::new(MAX_WAITING_BYTES)), problem: Arc::default(), waits };
        let thread = {
            let sink = sink.clone();
            std::thread::spawn(move || {
                if let Err(error) = chunks.write_all(&sink.queue) {
                    sink.fail(explained(&error));
                }
            })
        };
        Ok(FileWriter { sink, thread: Some(thread), path: path.to_owned(), writing })
    }

    /// Where messages go.
    pub fn sink(&self) -> &Sink {
        &self.sink
    }

    /// Writes what waits and completes the file.
    pub fn finish(mut self) -> Result<(), WriteError> {
        self.join();
        let unwritable = |problem: String| WriteError::Unwritable { path: self.writing.clone(), problem };
        if let Some(problem) = self.sink.problem() {
            return Err(unwritable(problem.to_owned()));
        }
        if self.writing != self.path {
            std::fs::rename(&self.writing, &self.path).map_err(|error| unwritable(error.to_string()))?;
        }
        Ok(())
    }

    /// Removes the file: nothing was recorded.
    pub fn abandon(mut self) {
        self.join();
        // A file that cannot be removed does no harm.
        let _ = std::fs::remove_file(&self.writing);
    }

    fn join(&mut self) {
        self.sink.queue.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            let _ = self.sink.problem.set("its thread panicked".into());
        }
    }
}

impl Drop for FileWriter {
    fn drop(&mut self) {
        // A run that fails leaves what it has recorded.
        self.join();
    }
}

fn partial(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    path.with_file_name(name)
}

fn explained(error: &McapError) -> String {
    match error {
        McapError::Io(error) => error.to_string(),
        error => error.to_string(),
    }
}

/// The file in its format.
struct Chunks {
    writer: Writer<NoSeek<BufWriter<File>>>,
    /// The same file, for what only a file can.
    file: File,
    ids: HashMap<Channel, (u16, u32)>,
    /// When the open chunk must be closed, and the log time that it must not reach.
    due: Option<(Instant, u64)>,
}

impl Chunks {
    fn begin(file: File, names: &[String]) -> Result<Chunks, McapError> {
        // Chunks are made in memory and written whole: whatever is cut off leaves chunks that are.
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .profile("hulltouch")
            .library(concat!("hulltouch/", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(NoSeek::new(BufWriter::new(file.try_clone()?)))?;
        let mut ids = HashMap::new();
        for channel in Channel::all(names.len()) {
            let schema = writer.add_schema(&channel.schema(), "protobuf", DESCRIPTORS)?;
            let id = writer.add_channel(schema, &channel.topic(names), "protobuf", &BTreeMap::new())?;
            ids.insert(channel, (id, 0));
        }
        Ok(Chunks { writer, file, ids, due: None })
    }

    fn write_all(mut self, queue: &ByteQueue<Vec<Entry>>) -> Result<(), McapError> {
        loop {
            match queue.take(self.due.map(|(deadline, _)| deadline)) {
                Received::Next(entries) => self.add(&entries)?,
                Received::Timeout => self.flush()?,
                Received::Closed => break,
            }
        }
        self.writer.finish()?;
        self.writer.into_inner().into_inner().flush()?;
        // What only the system knows of is lost when the power goes.
        Ok(self.file.sync_data()?)
    }

    fn add(&mut self, entries: &[Entry]) -> Result<(), McapError> {
        let newest_ns = entries.iter().map(|entry| entry.log_ns).max().unwrap_or_default();
        let is_due =
            |&(deadline, until_ns): &(Instant, u64)| newest_ns >= until_ns || Instant::now() >= deadline;
        if self.due.as_ref().is_some_and(is_due) {
            self.flush()?;
        }
        if self.due.is_none() {
            let until_ns = newest_ns.saturating_add(CHUNK_LASTS.as_nanos() as u64);
            self.due = Some((Instant::now() + CHUNK_LASTS, until_ns));
        }
        for entry in entries {
            let Some((id, count)) = self.ids.get_mut(&entry.channel) else { continue };
            let header = MessageHeader {
                channel_id: *id,
                sequence: *count,
                log_time: entry.log_ns,
                publish_time: entry.publish_ns,
            };
            *count = count.wrapping_add(1);
            self.writer.write_to_known_channel(&header, &entry.message)?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), McapError> {
        self.due = None;
        self.writer.flush()?;
        Ok(self.file.sync_data()?)
    }
}
