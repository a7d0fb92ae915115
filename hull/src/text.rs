//! Text from files and requests, made fit to stand in a message.

/// The most characters of a value that a message quotes.
pub const MAX_QUOTED_CHARS: usize = 80;
/// The most characters of another program's message.
pub const MAX_MESSAGE_CHARS: usize = 300;

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
    fn long_text_is_cut_and_stays_on_its_line() {
        assert_eq!(shortened("a b", 3), "a b");
        assert_eq!(shortened("a\nb\u{1b}c", 9), "a b c");
        assert_eq!(shortened(&"é".repeat(60_000), 8), "ééééé...");
    }
}
