//! The subset of YAML that OpenCV's FileStorage writes. It is not standard YAML: the first line is
//! `%YAML:1.0`, matrices carry the tag `!!opencv-matrix`, and numbers may end in a point.

use std::iter;

use super::entry::Entry;
use super::{ImportError, TextFile, numbers};

/// A line without its comment: its number from 1, the columns in front of it, and its text.
struct Line<'a> {
    number: usize,
    indent: usize,
    text: &'a str,
}

/// All keys, those of maps in maps too: scalars, lists in brackets, and matrices with rows, cols and data.
pub(super) fn parse(file: &TextFile) -> Result<Vec<Entry>, ImportError> {
    let lines: Vec<Line> = lines(&file.text).collect();
    let mut entries: Vec<Entry> = Vec::new();
    // The maps around the line: their indents and places among the entries.
    let mut open: Vec<(usize, usize)> = Vec::new();
    // Whether the last entry's value follows in further lines.
    let mut is_unfinished = false;
    let mut at = 0;
    while at < lines.len() {
        let line = &lines[at];
        let (value, next) = value_from(file, &lines, at)?;
        at = next;
        let item = line.text.strip_prefix("- ").map(str::trim_start);
        let text = item.unwrap_or(line.text);
        let indent = line.indent + line.text.len() - text.len();
        let Some((key, _)) = text.split_once(':') else {
            if indent > 0 || line.text.starts_with('-') {
                if let Some(entry) = entries.last_mut().filter(|_| is_unfinished) {
                    add_line(entry, line.text);
                }
                continue;
            }
            return Err(ImportError::syntax(file, line.number, &format!("{:?}", line.text), "key: value"));
        };
        let key = key.trim().trim_matches(['"', '\'']);
        while open.last().is_some_and(|&(outer, _)| outer >= indent) {
            open.pop();
        }
        let parent = open.last().map(|&(_, index)| index);
        if let Some(parent) = parent.and_then(|index| entries.get_mut(index))
            && describes(file, parent, key, &value)?
        {
            is_unfinished = key == "data" && value.is_empty();
            continue;
        }
        let key = parent.map_or_else(|| key.to_owned(), |parent| format!("{}/{key}", entries[parent].key));
        let is_list = value.starts_with(['[', '{']);
        let bare = value.trim_matches(['"', '\'']).trim();
        is_unfinished = value.is_empty();
        open.push((indent, entries.len()));
        if open.len() > MAX_DEPTH {
            return Err(ImportError::syntax(
                file,
                line.number,
                "maps nested too deep",
                "at most 16 maps in maps",
            ));
        }
        let found =
            if is_list { list(&value) } else { numbers(bare).map_err(|word| NoNumber(word.to_owned())) };
        entries.push(Entry {
            key,
            shape: None,
            text: if is_list { plain(bare) } else { bare.to_owned() },
            unread: found.as_ref().err().filter(|_| is_list).map(|NoNumber(word)| word.clone()),
            numbers: found.ok().filter(|found| !found.is_empty()),
            is_list,
        });
    }
    Ok(entries)
}

/// Adds a value, or an item of a list, that stands in a line below its key.
fn add_line(entry: &mut Entry, line: &str) {
    let (mut item, mut is_item) = (line.trim(), false);
    while let Some(inner) = item.strip_prefix('-').filter(|inner| inner.is_empty() || inner.starts_with(' '))
    {
        (item, is_item) = (inner.trim_start(), true);
    }
    entry.is_list |= is_item || item.starts_with('[');
    // In an item of its own a comma is none between numbers.
    let found = match item {
        "" => Err(NoNumber("an item without a value".to_owned())),
        _ if !is_item || item.contains(['[', ']']) => list(item),
        _ => item.parse().map(|number| vec![number]).map_err(|_| NoNumber(item.to_owned())),
    };
    let (numbers, words) = match found {
        Ok(found) if entry.unread.is_none() => (found, String::new()),
        Ok(_) => (Vec::new(), plain(item)),
        Err(NoNumber(word)) => {
            let first = entry.unread.get_or_insert(word);
            (Vec::new(), if item.is_empty() { first.clone() } else { plain(item) })
        }
    };
    if entry.unread.is_some() {
        // Text of numbers before it is not needed: a list of numbers has none.
        entry.numbers = None;
    } else {
        entry.numbers.get_or_insert_default().extend(numbers);
    }
    if !words.is_empty() && entry.text.len() < MAX_TEXT_BYTES {
        entry.text.push_str(if entry.text.is_empty() { "" } else { " " });
        entry.text.push_str(&words);
    }
}

/// What is kept of the words in a list: names of cameras.
const MAX_TEXT_BYTES: usize = 64 << 10;

/// The words of a list, without what stands around them.
fn plain(list: &str) -> String {
    let bare = list.replace(['[', ']', '"', '\'', ','], " ");
    bare.split_whitespace().collect::<Vec<&str>>().join(" ")
}

/// What stands in a list and is no number.
#[derive(Clone)]
struct NoNumber(String);

/// The numbers of a list in brackets, lists in lists too, in their order; the error is the first thing that is none.
fn list(text: &str) -> Result<Vec<f64>, NoNumber> {
    if text.starts_with('{') {
        return Err(NoNumber(text.to_owned()));
    }
    let bare = text.replace(['[', ']', ';'], " ");
    let mut items: Vec<&str> = bare.split(',').collect();
    // `[]`, and a comma before the end.
    if items.last().is_some_and(|last| last.trim().is_empty()) {
        items.pop();
    }
    let mut numbers = Vec::with_capacity(items.len());
    for item in items {
        if item.trim().is_empty() {
            return Err(NoNumber("nothing between two commas".to_owned()));
        }
        for word in item.split_whitespace() {
            numbers.push(word.parse().map_err(|_| NoNumber(word.to_owned()))?);
        }
    }
    Ok(numbers)
}

/// OpenCV's files nest three deep; keys are joined, so depth costs memory.
const MAX_DEPTH: usize = 16;

/// Whether a key describes the matrix that it stands in; then it is noted there.
fn describes(file: &TextFile, matrix: &mut Entry, key: &str, value: &str) -> Result<bool, ImportError> {
    let whole = |text: &str| text.trim().parse::<usize>().ok();
    match key {
        "rows" => matrix.shape = whole(value).map(|rows| (rows, matrix.shape.map_or(0, |shape| shape.1))),
        "cols" => matrix.shape = whole(value).map(|cols| (matrix.shape.map_or(0, |shape| shape.0), cols)),
        "dt" => {}
        "data" => {
            let found = if value.is_empty() { Ok(Vec::new()) } else { list(value) };
            matrix.numbers = Some(found.map_err(|NoNumber(word)| {
                ImportError::key(&file.path, &matrix.key, format!("{word:?} in its data"), "numbers")
            })?);
        }
        _ => return Ok(false),
    }
    matrix.text.clear();
    Ok(true)
}

fn lines(text: &str) -> impl Iterator<Item = Line<'_>> {
    text.lines().enumerate().filter_map(|(index, line)| {
        let comment = line.find(" #").into_iter().chain(line.find("\t#")).min();
        let line = line[..comment.unwrap_or(line.len())].trim_end();
        let text = line.trim_start();
        let skipped = text.is_empty() || text.starts_with(['%', '#']) || text == "---" || text == "...";
        (!skipped).then_some(Line { number: index + 1, indent: line.len() - text.len(), text })
    })
}

/// The value that starts in a line, a list or map in brackets followed over lines, and the next line's index. Tags and
/// anchors are left out.
fn value_from(file: &TextFile, lines: &[Line], at: usize) -> Result<(String, usize), ImportError> {
    let mut value = lines[at].text.split_once(':').map_or("", |(_, value)| value).trim();
    while value.starts_with(['!', '&']) {
        value = value.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim_start());
    }
    let below = lines.get(at + 1).filter(|below| below.indent > lines[at].indent).map(|below| below.text);
    let (begins, first) = match below {
        Some(below) if value.is_empty() && below.starts_with('[') => (at + 1, below),
        _ => (at, value),
    };
    if !first.starts_with(['[', '{']) {
        return Ok((value.to_owned(), at + 1));
    }
    let mut text = String::new();
    let (mut depth, mut quote) = (0_usize, None);
    let parts = iter::once(first).chain(lines[begins + 1..].iter().map(|line| line.text));
    for (part, next) in parts.zip(begins + 1..) {
        for (place, c) in part.char_indices() {
            match (quote, c) {
                (Some(open), _) => quote = Some(open).filter(|open| *open != c),
                (None, '"' | '\'') => quote = Some(c),
                (None, '[' | '{') => depth += 1,
                (None, ']' | '}') => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                let (inside, behind) = part.split_at(place + c.len_utf8());
                if !behind.trim().is_empty() {
                    let found = format!("{behind:?} behind a list");
                    return Err(ImportError::syntax(
                        file,
                        lines[next - 1].number,
                        &found,
                        "the end of the line",
                    ));
                }
                text.push_str(inside);
                return Ok((text, next));
            }
        }
        text.push_str(part);
        text.push(' ');
    }
    Err(ImportError::syntax(file, lines[at].number, "a list without an end", "]"))
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
    fn keys_of_maps_in_maps_keep_their_path() {
        let text = "%YAML:1.0\ncamera_0:\n   camera_matrix: !!opencv-matrix\n      rows: 1\n      cols: 1\n      \
                    dt: d\n      data: [ 5. ]\n   distortion_type: 1\nnames:\n   - \"01\"\n   - model: x\nlast: \"a b\"\n";
        let entries = read(text).expect("its subset");
        let found: Vec<_> = entries.iter().map(|e| (e.key.as_str(), e.shape, e.text.as_str())).collect();
        assert_eq!(
            found,
            [
                ("camera_0", None, ""),
                ("camera_0/camera_matrix", Some((1, 1)), ""),
                ("camera_0/distortion_type", None, "1"),
                ("names", None, "01"),
                ("names/model", None, "x"),
                ("last", None, "a b"),
            ]
        );
        let lines = read("model:\n   equidistant\nkinds:\n- a\n- \"b c\"\nD:\n- - -0.1\n  - 0.5\n- - 2\n")
            .expect("lists");
        let found: Vec<_> = lines.iter().map(|e| (e.text.as_str(), e.numbers.clone())).collect();
        let expected = [("equidistant", None), ("a b c", None), ("", Some(vec![-0.1, 0.5, 2.0]))];
        assert_eq!(found, expected);
        let deep: String = (0..50_000).map(|depth| format!("{}k:\n", " ".repeat(depth.min(40)))).collect();
        assert!(read(&deep).expect_err("too deep").to_string().contains("nested"));
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
