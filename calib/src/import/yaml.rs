//! The subset of YAML that OpenCV's FileStorage writes. It is not standard YAML: the first line is
//! `%YAML:1.0`, matrices carry the tag `!!opencv-matrix`, and numbers may end in a point.

use std::iter;

use super::entry::Entry;
use super::{ImportError, TextFile, numbers};

/// The top-level keys with numbers: scalars, lists in brackets, and maps with rows, cols and data.
pub(super) fn parse(file: &TextFile) -> Result<Vec<Entry>, ImportError> {
    let lines: Vec<(usize, &str)> = file
        .text
        .lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.split(" #").next().unwrap_or(line).trim_end()))
        .filter(|(_, line)| !skipped(line))
        .collect();
    let mut entries: Vec<Entry> = Vec::new();
    let mut at = 0;
    while at < lines.len() {
        let (number, line) = lines[at];
        let (value, next) = value_from(file, &lines, at)?;
        at = next;
        let indented = line.starts_with([' ', '\t']);
        let Some((key, _)) = line.split_once(':') else {
            if indented || line.starts_with('-') {
                // An item of a list in lines: nothing that describes a camera.
                continue;
            }
            return Err(ImportError::syntax(file, number, &format!("{line:?}"), "key: value"));
        };
        let key = key.trim().trim_matches('"');
        if !indented {
            entries.push(Entry { key: key.to_owned(), shape: None, numbers: numbers(&value).ok() });
            continue;
        }
        let Some(entry) = entries.last_mut() else { continue };
        let whole = |text: &str| text.trim().parse::<usize>().ok();
        match key {
            "rows" => entry.shape = whole(&value).map(|rows| (rows, entry.shape.map_or(0, |shape| shape.1))),
            "cols" => entry.shape = whole(&value).map(|cols| (entry.shape.map_or(0, |shape| shape.0), cols)),
            "data" => {
                let found = numbers(&value).map_err(|word| {
                    ImportError::key(&file.path, &entry.key, format!("{word:?} in its data"), "numbers")
                })?;
                entry.numbers = Some(found);
            }
            _ => {}
        }
    }
    Ok(entries)
}

fn skipped(line: &str) -> bool {
    let line = line.trim();
    line.is_empty() || line.starts_with(['%', '#']) || line == "---" || line == "..."
}

/// The value that starts in a line, brackets followed over lines and taken off, and the next line's index.
fn value_from(file: &TextFile, lines: &[(usize, &str)], at: usize) -> Result<(String, usize), ImportError> {
    let value = lines[at].1.split_once(':').map_or("", |(_, value)| value).trim();
    let value =
        if value.starts_with("!!") { value.split_once(' ').map_or("", |(_, rest)| rest) } else { value };
    let Some(list) = value.strip_prefix('[') else { return Ok((value.to_owned(), at + 1)) };
    let mut text = String::new();
    let parts = iter::once(list).chain(lines[at + 1..].iter().map(|&(_, line)| line));
    for (part, next) in parts.zip(at + 1..) {
        if let Some((last, _)) = part.split_once(']') {
            text.push_str(last);
            return Ok((text.replace('[', " "), next));
        }
        text.push_str(part);
        text.push(' ');
    }
    Err(ImportError::syntax(file, lines[at].0, "a list without an end", "]"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Entry>, ImportError> {
        parse(&TextFile { path: "f.yml".to_owned(), text: text.to_owned() })
    }

    #[test]
    fn opencv_s_own_output_is_read() {
        let entries = read(
            "%YAML:1.0\n---\nimage_width: 640\ncalibration_time: \"Thu 09\"\nK: !!opencv-matrix\n   rows: 1\n   \
             cols: 3\n   dt: d\n   data: [ 5.0e+02, 0.,\n       -3.25e+002 ]\nlist: [ 1, 2 ]\n",
        )
        .expect("its subset");
        let found: Vec<_> = entries
            .iter()
            .map(|e| (e.key.as_str(), e.shape, e.numbers.clone().unwrap_or_default()))
            .collect();
        assert_eq!(found[0], ("image_width", None, vec![640.0]));
        assert_eq!(found[2], ("K", Some((1, 3)), vec![500.0, 0.0, -325.0]));
        assert_eq!(found[3], ("list", None, vec![1.0, 2.0]));
    }

    #[test]
    fn broken_lists_and_words_are_refused() {
        let open = read("%YAML:1.0\nK: [ 1, 2\n").expect_err("no end").to_string();
        assert_eq!(open, "f.yml: line 2: found a list without an end, expected ]");
        let word = read("K: !!opencv-matrix\n  rows: 1\n  cols: 1\n  data: [ one ]\n").expect_err("a word");
        assert_eq!(word.to_string(), "f.yml: K: found \"one\" in its data, expected numbers");
        assert!(read("nonsense\n").is_err());
    }

    /// Megabytes: reading them again for every line would take minutes.
    #[test]
    fn a_list_of_many_lines_is_read_once() {
        let lines = "0\n".repeat(1_500_000);
        let list = read(&format!("K: [ {lines} ]\nnext: 1\n")).expect("a list");
        assert_eq!((list.len(), list[0].numbers.as_ref().map(Vec::len)), (2, Some(1_500_000)));
        assert!(read(&format!("K: [ {lines}")).is_err());
    }
}
