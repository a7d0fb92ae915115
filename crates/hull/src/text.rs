//! Text from files and requests: decoded, and made fit to stand in a message.

use thiserror::Error;

/// The most characters of a value that a message quotes.
pub const MAX_QUOTED_CHARS: usize = 80;
/// The most characters of another program's message.
pub const MAX_MESSAGE_CHARS: usize = 300;

/// Bytes of a file that are no text that is read here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum EncodingError {
    /// Text of 16 bits a character, as some editors of Windows save it.
    #[error("found UTF-16 text, expected UTF-8: save the file as UTF-8")]
    Utf16,
    /// Anything else.
    #[error("found bytes that are no UTF-8, expected text")]
    Bytes,
}

/// The text of a file's bytes, without the byte-order mark that some editors put in front.
pub fn decoded(bytes: Vec<u8>) -> Result<String, EncodingError> {
    if is_utf16(&bytes) {
        return Err(EncodingError::Utf16);
    }
    let text = String::from_utf8(bytes).map_err(|_| EncodingError::Bytes)?;
    Ok(match without_mark(&text) {
        plain if plain.len() == text.len() => text,
        plain => plain.to_owned(),
    })
}

/// The text without a byte-order mark in front.
pub fn without_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// A mark of UTF-16, or Latin letters of 16 bits without one.
pub fn is_utf16(bytes: &[u8]) -> bool {
    let zeros_at = |odd: usize| {
        bytes.len() >= 4 && bytes[..4].chunks(2).all(|pair| pair[odd] == 0 && pair[1 - odd] != 0)
    };
    bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) || zeros_at(0) || zeros_at(1)
}

/// The text on one line, without control characters; what is longer than `most_chars` ends in "...".
pub fn shortened(text: &str, most_chars: usize) -> String {
    let plain = |character: char| if character.is_control() { ' ' } else { character };
    let mut short: String = text.chars().take(most_chars).map(plain).collect();
    if text.chars().nth(most_chars).is_some() {
        short.truncate(short.char_indices().nth(most_chars.saturating_sub(3)).map_or(0, |(at, _)| at));
        short.push_str("...");
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_is_taken_off_and_other_encodings_are_named() {
        assert_eq!(decoded(b"\xef\xbb\xbfa = 1".to_vec()).as_deref(), Ok("a = 1"));
        assert_eq!(decoded(b"a = 1".to_vec()).as_deref(), Ok("a = 1"));
        assert_eq!(decoded(b"\xff\xfea\0".to_vec()), Err(EncodingError::Utf16));
        assert_eq!(decoded(b"\0a\0 ".to_vec()), Err(EncodingError::Utf16));
        assert_eq!(decoded(b"a\0b\0".to_vec()), Err(EncodingError::Utf16));
        assert_eq!(decoded(b"caf\xe9".to_vec()), Err(EncodingError::Bytes));
        assert_eq!(decoded(Vec::new()).as_deref(), Ok(""));
    }

    #[test]
    fn long_text_is_cut_and_stays_on_its_line() {
        assert_eq!(shortened("a b", 3), "a b");
        assert_eq!(shortened("a\nb\u{1b}c", 9), "a b c");
        assert_eq!(shortened(&"é".repeat(60_000), 8), "ééééé...");
    }
}
