//! The records of a file: where its chunks are, and the messages of one. A message or a channel that stands in no chunk,
//! as in files without chunks, is one of its own.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};

use hull::text::{MAX_QUOTED_CHARS, shortened};
use mcap::records::{MessageHeader, Record as McapRecord, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError, parse_record};

use super::error::ReadProblem;

/// No record is larger, packed or not: sixteen times what we write, for files that other tools have packed
/// again.
const MAX_RECORD_BYTES: u64 = 64 << 20;
/// A record's kind and length.
const HEAD_BYTES: u64 = 9;

/// Where a record stands in the file, its head included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    offset: u64,
    bytes: u64,
}

/// The chunks of a file, from its beginning as far as it can be read.
#[derive(Debug)]
pub(super) struct Chunks {
    file: File,
    offset: u64,
    /// Why it cannot be read any farther: it was cut off, or damaged.
    pub problem: Option<ReadProblem>,
    ended: bool,
}

/// A record of a chunk that is of interest.
#[derive(Debug, PartialEq)]
pub(super) enum Record {
    /// A channel's number and topic.
    Channel(u16, String),
    /// A message.
    Message(MessageHeader, Vec<u8>),
}

impl Chunks {
    /// Fails if the file is no MCAP at all.
    pub fn begin(mut file: File) -> Result<Chunks, ReadProblem> {
        let mut magic = [0; MAGIC.len()];
        let read = file.rewind().and_then(|()| file.read_exact(&mut magic));
        if read.is_err() || magic != MAGIC {
            return Err(ReadProblem::NotMcap);
        }
        Ok(Chunks { file, offset: MAGIC.len() as u64, problem: None, ended: false })
    }

    /// The next chunk and its records. After the last, `problem` is why the file ends there, if it is not its end.
    pub fn next(&mut self) -> Option<(Place, Vec<Record>)> {
        while !self.ended && self.problem.is_none() {
            match self.step() {
                Ok(Some(found)) => return Some(found),
                Ok(None) => {}
                Err(problem) => self.problem = Some(problem),
            }
        }
        None
    }

    /// Passes over a record, or reads it if messages can be in it.
    fn step(&mut self) -> Result<Option<(Place, Vec<Record>)>, ReadProblem> {
        let mut head = [0; HEAD_BYTES as usize];
        self.file.seek(SeekFrom::Start(self.offset))?;
        self.file.read_exact(&mut head).map_err(|_| ReadProblem::CutOff)?;
        let kind = head[0];
        let length = u64::from_le_bytes([1, 2, 3, 4, 5, 6, 7, 8].map(|at| head[at]));
        if kind == op::DATA_END || kind == op::FOOTER {
            self.ended = true;
            return Ok(None);
        }
        let place = Place { offset: self.offset, bytes: HEAD_BYTES.saturating_add(length) };
        let is_read = [op::CHUNK, op::CHANNEL, op::MESSAGE].contains(&kind);
        let found = if is_read { Some((place, read(&mut self.file, place)?)) } else { None };
        self.offset = self.offset.saturating_add(place.bytes);
        Ok(found)
    }
}

fn problem(error: McapError) -> ReadProblem {
    match error {
        McapError::UnsupportedCompression(found) => {
            ReadProblem::Compression(shortened(&found, MAX_QUOTED_CHARS))
        }
        other => other.into(),
    }
}

/// Refuses a chunk that is not compressed and whose last record goes on beyond it: `mcap` would count its bytes below
/// zero. All else that can be wrong with a chunk it finds itself.
fn check_plain(chunk: &[u8]) -> Result<(), ReadProblem> {
    /// The record's head, two times, a size and a checksum.
    const BEFORE_COMPRESSION: usize = HEAD_BYTES as usize + 3 * 8 + 4;
    let rest = chunk.get(BEFORE_COMPRESSION..).and_then(<[u8]>::split_first_chunk);
    let Some((&[0, 0, 0, 0], rest)) = rest else { return Ok(()) };
    let Some((size, rest)) = rest.split_first_chunk() else { return Ok(()) };
    let mut records = usize::try_from(u64::from_le_bytes(*size)).ok().and_then(|size| rest.get(..size));
    while let Some((&[_, length @ ..], rest)) = records.and_then(<[u8]>::split_first_chunk::<9>) {
        let length = usize::try_from(u64::from_le_bytes(length)).ok();
        records = Some(length.and_then(|length| rest.get(length..)).ok_or(McapError::UnexpectedEoc)?);
    }
    match records {
        Some([_, ..]) => Err(McapError::UnexpectedEoc.into()),
        _ => Ok(()),
    }
}

/// The channels and messages of a chunk; all of it, or why not.
pub(super) fn read(file: &mut File, place: Place) -> Result<Vec<Record>, ReadProblem> {
    if place.bytes > MAX_RECORD_BYTES {
        return Err(ReadProblem::RecordSize { found: place.bytes, most: MAX_RECORD_BYTES });
    }
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(place.offset))?;
    file.take(place.bytes).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != place.bytes {
        return Err(ReadProblem::CutOff);
    }
    check_plain(&bytes)?;
    // The chunk alone, as if it were the whole file: checked before anything of it is used.
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut left = &bytes[..];
    let mut found = Vec::new();
    while let Some(event) = reader.next_event() {
        match event.map_err(problem)? {
            LinearReadEvent::ReadRequest(need) => {
                let count = need.min(left.len());
                reader.insert(count).copy_from_slice(&left[..count]);
                reader.notify_read(count);
                left = &left[count..];
            }
            LinearReadEvent::Record { data, opcode } => match parse_record(opcode, data)? {
                McapRecord::Channel(channel) => found.push(Record::Channel(channel.id, channel.topic)),
                McapRecord::Message { header, data } => {
                    found.push(Record::Message(header, data.into_owned()));
                }
                _ => {}
            },
        }
    }
    Ok(found)
}
