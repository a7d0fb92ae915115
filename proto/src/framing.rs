//! Where gRPC messages begin and end in the bytes of a call, so that one which is too long is refused at its announcement and
//! not once it has filled memory.

use thiserror::Error;

/// Before each message: whether it is compressed, and its length.
pub const PREFIX_BYTES: usize = 5;

/// How a plain message of so many bytes is announced.
pub fn announcement(bytes: u32) -> [u8; PREFIX_BYTES] {
    let [a, b, c, d] = bytes.to_be_bytes();
    [0, a, b, c, d]
}

/// A message announces more bytes than it may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a message of {found} bytes, expected at most {most}")]
pub struct TooLong {
    found: usize,
    most: usize,
}

/// The messages of one call, one way. Lengths include the prefix.
#[derive(Debug, Default)]
pub struct Messages {
    prefix: [u8; PREFIX_BYTES],
    partial: usize,
    /// The whole length of the message that has begun, once it is known.
    length: usize,
    longest: usize,
    count: usize,
}

impl Messages {
    /// Reads on, where a message may have `most` bytes without its prefix; returns how many messages have become whole.
    pub fn read(&mut self, mut data: &[u8], most: usize) -> Result<usize, TooLong> {
        let mut whole = 0;
        while !data.is_empty() {
            if self.partial < PREFIX_BYTES {
                let take = data.len().min(PREFIX_BYTES - self.partial);
                self.prefix[self.partial..self.partial + take].copy_from_slice(&data[..take]);
                self.partial += take;
                data = &data[take..];
                if self.partial < PREFIX_BYTES {
                    break;
                }
                let [_, length @ ..] = self.prefix;
                let found = u32::from_be_bytes(length) as usize;
                if found > most {
                    return Err(TooLong { found, most });
                }
                self.length = PREFIX_BYTES + found;
            }
            let take = data.len().min(self.length - self.partial);
            self.partial += take;
            data = &data[take..];
            if self.partial == self.length {
                self.longest = self.longest.max(self.length);
                (self.partial, whole) = (0, whole + 1);
            }
        }
        self.count += whole;
        Ok(whole)
    }

    /// Bytes that have come of the message that has begun; zero between messages.
    pub fn partial(&self) -> usize {
        self.partial
    }

    /// Bytes of the longest message that was whole.
    pub fn longest(&self) -> usize {
        self.longest
    }

    /// How many messages were whole.
    pub fn count(&self) -> usize {
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(length: usize) -> Vec<u8> {
        let mut bytes = announcement(length as u32).to_vec();
        bytes.resize(PREFIX_BYTES + length, 7);
        bytes
    }

    #[test]
    fn messages_are_found_however_they_are_cut() {
        let stream = [message(3), message(0), message(900), message(1)].concat();
        for part in [1, 2, 4, 5, 7, 100, 2000] {
            let mut messages = Messages::default();
            let whole: usize =
                stream.chunks(part).map(|data| messages.read(data, 1000).expect("short")).sum();
            assert_eq!((whole, messages.partial()), (4, 0), "in parts of {part}");
            assert_eq!((messages.count(), messages.longest()), (4, PREFIX_BYTES + 900));
        }
        let mut messages = Messages::default();
        assert_eq!(messages.read(&stream[..20], 1000), Ok(2));
        assert_eq!(messages.partial(), 20 - 13);
    }

    #[test]
    fn a_long_message_is_refused_at_its_announcement() {
        let announced = announcement(65);
        assert_eq!(Messages::default().read(&announced, 65), Ok(0));
        let refused = Messages::default().read(&announced, 64).expect_err("too long");
        assert_eq!(refused.to_string(), "a message of 65 bytes, expected at most 64");
    }
}
