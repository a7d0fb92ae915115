//! Decodes a message only after its entries were counted: an empty entry takes two bytes on the wire and up to a hundred
//! in memory, so a message that is short enough could still take gigabytes.

use std::marker::PhantomData;

use prost::Message;
use prost::bytes::Buf as _;
use thiserror::Error;
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, DecodeBuf, Decoder};
use tonic_prost::{ProstCodec, ProstDecoder, ProstEncoder};

use crate::v1;

/// The most cameras that a node describes: a rig's places have 16 bits, a PC has a dozen.
pub(crate) const MAX_CAMERAS: usize = 1024;
/// Shapes of one call, and bodies of a list whose points stand in it.
const MAX_ENTRIES: usize = 1 << 16;

/// How often a field may occur in a message.
#[derive(Clone, Copy, Debug)]
pub struct Entries {
    /// The message and its field, for refusals.
    name: &'static str,
    /// The field's number, after those of the messages that it stands in.
    path: &'static [u32],
    /// Whether it is a number, of which many stand in one field.
    packed: bool,
    most: usize,
}

/// A message has more entries than it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{name}: {found} entries, expected at most {most}")]
pub struct TooManyEntries {
    name: &'static str,
    found: usize,
    most: usize,
}

/// A message that is decoded once its entries are counted.
pub trait Bounded: Message + Default + Send + 'static {
    /// Its fields that repeat.
    const ENTRIES: &'static [Entries] = &[];
}

/// Messages, and their fields that repeat.
macro_rules! bounded {
    ($($message:ident $([$($name:literal $packed:literal $path:expr => $most:expr),*])?),* $(,)?) => {
        $(impl Bounded for v1::$message {
            $(const ENTRIES: &'static [Entries] =
                &[$(Entries { name: $name, packed: $packed, path: &$path, most: $most }),*];)?
        })*
    };
}

bounded! {
    DescribeRequest,
    DescribeReply ["DescribeReply.cameras" false [2] => MAX_CAMERAS],
    HoldRequest, HoldReply, StartRequest, StartReply, KeepTimeRequest, KeepTimeReply, FrameCredit,
    FrameInfo ["FrameInfo.cameras" false [4] => MAX_CAMERAS],
    RegisterShapesRequest ["RegisterShapesRequest.shapes" false [1] => MAX_ENTRIES],
    RegisterShapesReply,
    ProbeRequest [
        "ProbeRequest.cameras" true [13] => MAX_CAMERAS,
        "Bodies.world" false [5, 3] => MAX_ENTRIES
    ],
    ProbeReply, FetchSilhouettesRequest, Silhouette, TakeBackgroundRequest, TakeBackgroundReply,
    RestoreBackgroundRequest, RestoreBackgroundReply,
    FetchPicturesRequest ["FetchPicturesRequest.cameras" true [5] => MAX_CAMERAS],
    Picture, KeepWorldRequest, KeepWorldReply, FetchWorldRequest, FetchWorldReply, StatusRequest,
    StatusReply [
        "DescribeReply.cameras" false [1, 2] => MAX_CAMERAS,
        "StatusReply.cameras" false [7] => MAX_CAMERAS
    ],
    // Of programs: at most 64 KiB each.
    DescribeWorldRequest, WorldDescription, FollowRequest, WorldState, SpawnRequest, SpawnReply, RemoveRequest,
    PushRequest, GrabRequest, ReleaseRequest, Parameters, PauseRequest, ResumeRequest, StepRequest, ResetRequest,
    ChooseRequest, TakeWorldBackgroundRequest, Done,
}

/// The codec of all services here.
#[derive(Clone, Copy, Debug)]
pub struct BoundedCodec<E, D>(PhantomData<(E, D)>);

impl<E, D> Default for BoundedCodec<E, D> {
    fn default() -> BoundedCodec<E, D> {
        BoundedCodec(PhantomData)
    }
}

impl<E: Message + Send + 'static, D: Bounded> Codec for BoundedCodec<E, D> {
    type Encode = E;
    type Decode = D;
    type Encoder = ProstEncoder<E>;
    type Decoder = BoundedDecoder<D>;

    fn encoder(&mut self) -> ProstEncoder<E> {
        ProstCodec::<E, D>::raw_encoder(BufferSettings::default())
    }

    fn decoder(&mut self) -> BoundedDecoder<D> {
        BoundedDecoder(ProstCodec::<E, D>::raw_decoder(BufferSettings::default()))
    }
}

/// Counts, then decodes.
#[derive(Debug)]
pub struct BoundedDecoder<D>(ProstDecoder<D>);

impl<D: Bounded> Decoder for BoundedDecoder<D> {
    type Item = D;
    type Error = Status;

    fn decode(&mut self, message: &mut DecodeBuf<'_>) -> Result<Option<D>, Status> {
        // A whole message, in one piece.
        check::<D>(message.chunk()).map_err(|error| Status::invalid_argument(error.to_string()))?;
        self.0.decode(message)
    }
}

/// Refuses a message with more entries than it may have. What is no message is left to the decoder.
pub(crate) fn check<D: Bounded>(message: &[u8]) -> Result<(), TooManyEntries> {
    check_entries(D::ENTRIES, message)
}

/// The same of a message of another protocol, by its fields that repeat.
pub fn check_entries(fields: &[Entries], message: &[u8]) -> Result<(), TooManyEntries> {
    let counted = fields.iter().map(|entries| (entries, entries.count(message, entries.path)));
    let too_many = counted.into_iter().find(|(entries, found)| *found > entries.most);
    let refused = too_many.map(|(&Entries { name, most, .. }, found)| TooManyEntries { name, found, most });
    refused.map_or(Ok(()), Err)
}

/// How many entries of each field that repeats a message has: never fewer than are decoded.
pub(crate) fn counts<D: Bounded>(message: &[u8]) -> impl Iterator<Item = (&'static Entries, usize)> {
    D::ENTRIES.iter().map(|entries| (entries, entries.count(message, entries.path)))
}

impl Entries {
    /// At most so many of a field, by its number after those of the messages that it stands in.
    pub const fn new(name: &'static str, path: &'static [u32], most: usize) -> Entries {
        Entries { name, path, packed: false, most }
    }

    /// The same of numbers, of which many stand in one field.
    pub const fn packed(self) -> Entries {
        Entries { packed: true, ..self }
    }

    /// How many of them a message has, up to what is no field: there the decoder ends, too.
    fn count(&self, mut message: &[u8], path: &[u32]) -> usize {
        let Some((&sought, rest)) = path.split_first() else { return 0 };
        let mut found: usize = 0;
        while let Some((number, content)) = next_field(&mut message) {
            let more = match content {
                _ if number != sought => 0,
                Some(content) if !rest.is_empty() => self.count(content, rest),
                // Each ends in a byte below 128.
                Some(numbers) if self.packed => numbers.iter().filter(|&&byte| byte < 0x80).count(),
                _ => 1,
            };
            found = found.saturating_add(more);
        }
        found
    }
}

/// Takes a field off a message: its number, and its content if that has a length.
fn next_field<'a>(message: &mut &'a [u8]) -> Option<(u32, Option<&'a [u8]>)> {
    let key = varint(message)?;
    let number = u32::try_from(key >> 3).ok()?;
    let (skipped, content) = match key & 7 {
        0 => {
            varint(message)?;
            (0, None)
        }
        1 => (8, None),
        2 => {
            let length = usize::try_from(varint(message)?).ok()?;
            (length, Some(message.get(..length)?))
        }
        5 => (4, None),
        // Groups are of an older time, and none of ours: what stands in one is a field like others.
        3 | 4 => (0, None),
        _ => return None,
    };
    *message = message.get(skipped..)?;
    Some((number, content))
}

fn varint(message: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for place in 0..10 {
        let (&byte, rest) = message.split_first()?;
        *message = rest;
        number |= u64::from(byte & 0x7f) << (7 * place);
        if byte < 0x80 {
            return Some(number);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_counted_before_anything_is_made_of_them() {
        let shapes =
            |count| v1::RegisterShapesRequest { shapes: vec![v1::Shape::default(); count], holder: 7 };
        assert_eq!(check::<v1::RegisterShapesRequest>(&shapes(MAX_ENTRIES).encode_to_vec()), Ok(()));
        let refused = check::<v1::RegisterShapesRequest>(&shapes(MAX_ENTRIES + 1).encode_to_vec());
        assert_eq!(
            refused.expect_err("one too many").to_string(),
            "RegisterShapesRequest.shapes: 65537 entries, expected at most 65536"
        );
    }

    #[test]
    fn numbers_and_nested_entries_count_too() {
        let question = |cameras, world| v1::ProbeRequest {
            id: 300,
            frame: u64::MAX,
            cameras: (0..cameras).collect(),
            bodies: Some(v1::Bodies { world: vec![Default::default(); world], ..v1::Bodies::default() }),
            holder: 1,
            ..v1::ProbeRequest::default()
        };
        let refused = |question: v1::ProbeRequest| {
            check::<v1::ProbeRequest>(&question.encode_to_vec()).err().map(|refused| refused.name)
        };
        assert_eq!(refused(question(1024, MAX_ENTRIES)), None);
        assert_eq!(refused(question(1025, 0)), Some("ProbeRequest.cameras"));
        assert_eq!(refused(question(0, MAX_ENTRIES + 1)), Some("Bodies.world"));
        let status = v1::StatusReply {
            node: Some(v1::DescribeReply { cameras: vec![Default::default(); 1025], ..Default::default() }),
            ..v1::StatusReply::default()
        };
        assert!(check::<v1::StatusReply>(&status.encode_to_vec()).is_err());
    }

    #[test]
    fn parts_of_one_message_add_up_as_the_decoder_adds_them() {
        let half = v1::ProbeRequest {
            bodies: Some(v1::Bodies { world: vec![Default::default(); 40_000], ..v1::Bodies::default() }),
            ..v1::ProbeRequest::default()
        };
        let mut twice = half.encode_to_vec();
        twice.extend(half.encode_to_vec());
        assert_eq!(check::<v1::ProbeRequest>(&twice).expect_err("80,000").found, 80_000);
    }

    #[test]
    fn what_is_no_message_is_left_to_the_decoder() {
        for bytes in [&[0xff; 12][..], &[0x0a], &[0x0a, 200, 1], &[0x0f], &[0x08]] {
            assert_eq!(check::<v1::RegisterShapesRequest>(bytes), Ok(()));
            assert!(v1::RegisterShapesRequest::decode(bytes).is_err());
        }
    }
}
