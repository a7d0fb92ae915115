//! `traceparent`, version 00 of W3C's Trace Context.

use crate::TraceParent;

/// The field's length in version 00. Later versions may go on after a hyphen.
const LENGTH: usize = 55;

/// The span that a message belongs to: `None` if it belongs to none, to a trace that is not sampled, or if the text is
/// invalid, which the standard wants ignored.
pub fn trace_parent_from_wire(text: &str) -> Option<TraceParent> {
    let bytes = text.as_bytes();
    let (field, rest) = (bytes.get(..LENGTH)?, &bytes[LENGTH..]);
    let (version, trace_id) = (hex(field, 0, 2)?, hex(field, 3, 32)?);
    let (span_id, flags) = (u64::try_from(hex(field, 36, 16)?).ok()?, hex(field, 53, 2)?);
    let is_known = match version {
        0 => rest.is_empty(),
        0xff => false,
        _ => rest.is_empty() || rest[0] == b'-',
    };
    let is_one = is_known && [2, 35, 52].iter().all(|&at| field[at] == b'-');
    (is_one && trace_id != 0 && span_id != 0 && flags & 1 == 1).then_some(TraceParent { trace_id, span_id })
}

/// Lower-case hexadecimal digits.
fn hex(field: &[u8], from: usize, digits: usize) -> Option<u128> {
    field.get(from..from + digits)?.iter().try_fold(0, |number, &digit| {
        let value = match digit {
            b'0'..=b'9' => digit - b'0',
            b'a'..=b'f' => digit - b'a' + 10,
            _ => return None,
        };
        Some(number << 4 | u128::from(value))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: &str = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

    #[test]
    fn a_span_is_read_as_it_was_written() {
        let parent = trace_parent_from_wire(EXAMPLE).expect("the standard's own example");
        assert_eq!(parent.trace_id, 0x4bf9_2f35_77b3_4da6_a3ce_929d_0e0e_4736);
        assert_eq!(parent.span_id, 0x00f0_67aa_0ba9_02b7);
        assert_eq!(parent.to_string(), EXAMPLE);
        let later = format!("cc{}-what-comes-later", &EXAMPLE[2..]);
        assert_eq!(trace_parent_from_wire(&later), Some(parent));
    }

    #[test]
    fn what_is_none_or_not_sampled_is_ignored() {
        let zeros = |from: usize, to: usize| {
            EXAMPLE.char_indices().map(|(at, c)| if (from..to).contains(&at) { '0' } else { c }).collect()
        };
        let refused: [String; 11] = [
            String::new(),
            "00".into(),
            EXAMPLE[..54].into(),
            format!("{EXAMPLE}-more"),
            format!("ff{}", &EXAMPLE[2..]),
            EXAMPLE.to_uppercase(),
            EXAMPLE.replace('-', "_"),
            EXAMPLE.replace("4bf9", "+bf9"),
            zeros(3, 35),
            zeros(36, 52),
            format!("{}00", &EXAMPLE[..53]),
        ];
        for text in refused {
            assert_eq!(trace_parent_from_wire(&text), None, "{text}");
        }
        assert_eq!(trace_parent_from_wire(&"é".repeat(40)), None);
    }
}
