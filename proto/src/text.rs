//! Text from an untrusted peer, made fit for a terminal, a log or a page.

/// The most characters that are kept of a peer's message.
pub const MAX_MESSAGE_CHARS: usize = 300;
/// The most characters that are kept of a name.
pub const MAX_NAME_CHARS: usize = 200;

/// One line of at most `max_chars` characters: runs of white space, line breaks and control characters become
/// one space; marks that reorder or hide text are dropped. What is cut ends in "…".
pub fn clean(text: &str, max_chars: usize) -> String {
    let mut line = String::new();
    let (mut count, mut is_gap) = (0, false);
    // Bounds the work too: a peer may send megabytes of spaces.
    for character in text.chars().take(8 * max_chars.max(1)) {
        if is_hidden(character) {
            continue;
        }
        if character.is_whitespace() || character.is_control() {
            is_gap = count > 0;
            continue;
        }
        if count + usize::from(is_gap) >= max_chars {
            line.push('…');
            return line;
        }
        if is_gap {
            line.push(' ');
            count += 1;
        }
        line.push(character);
        (count, is_gap) = (count + 1, false);
    }
    line
}

/// Marks without a glyph: direction of text, joiners, fillers, tags, private use.
fn is_hidden(character: char) -> bool {
    matches!(character,
        '\u{ad}' | '\u{61c}' | '\u{115f}' | '\u{1160}' | '\u{180e}' | '\u{3164}' | '\u{ffa0}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e000}'..='\u{f8ff}'
        | '\u{e0000}'..='\u{10ffff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_becomes_one_short_line_without_control_characters() {
        for (text, expected) in [
            ("a node", "a node"),
            ("\x1b[31mred\x1b[0m", "[31mred [0m"),
            ("first\nERROR forged line\r\n\tthird", "first ERROR forged l…"),
            ("  spaces   end  ", "spaces end"),
            ("\u{202e}esrever\u{200b} \u{feff}x", "esrever x"),
            ("", ""),
            ("\u{9b}31m", "31m"),
            ("0123456789abcdefghij!", "0123456789abcdefghij…"),
            ("Grüße, 世界", "Grüße, 世界"),
        ] {
            assert_eq!(clean(text, 20), expected, "{text:?}");
        }
    }

    #[test]
    fn length_is_bounded_whatever_comes() {
        assert_eq!(clean(&"x".repeat(200_000), 300).chars().count(), 301);
        assert_eq!(clean(&" ".repeat(200_000), 300), "");
        assert_eq!(clean(&"a ".repeat(200_000), 10), "a a a a a…");
    }
}
