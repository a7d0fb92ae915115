//! The file of points.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use csv::{ReaderBuilder, StringRecord, Trim};
use hull::question::Points;
use proto::MAX_POINTS;

use hull::text::{EncodingError, is_utf16};
use setup::cli::{Failure, Outcome};

/// Points of the world, metres, in the order of the file, and which body each is of.
#[derive(Clone, Debug, PartialEq)]
pub struct PointsFile {
    /// The points.
    pub points_m: Vec<[f64; 3]>,
    /// The bodies in order of first appearance, each with the indices of its points, ascending; without
    /// the column `body` a single one without a name.
    pub groups: Vec<(Option<String>, Vec<usize>)>,
}

impl PointsFile {
    /// Reads a CSV file with the header `x,y,z` or `x,y,z,body`.
    pub fn read(path: &Path) -> Outcome<PointsFile> {
        let bytes = std::fs::read(path).map_err(|error| Failure::unreadable(path, error))?;
        if is_utf16(&bytes) {
            return Err(Failure::unreadable(path, EncodingError::Utf16));
        }
        PointsFile::parse(path, bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes))
    }

    /// The same from what the file holds; `path` is for messages.
    fn parse(path: &Path, bytes: &[u8]) -> Outcome<PointsFile> {
        let refused = |error: csv::Error| Failure::unreadable(path, described(&error));
        let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(bytes);
        let header = reader.headers().map_err(refused)?;
        let has_bodies = match header.iter().collect::<Vec<_>>()[..] {
            ["x", "y", "z"] => false,
            ["x", "y", "z", "body"] => true,
            _ => {
                let found = header.iter().collect::<Vec<_>>().join(",");
                let problem =
                    format_args!("line 1: found header {:?}, expected x,y,z or x,y,z,body", cut(&found));
                return Err(Failure::unreadable(path, problem));
            }
        };
        let mut file = PointsFile { points_m: Vec::new(), groups: Vec::new() };
        if !has_bodies {
            file.groups.push((None, Vec::new()));
        }
        let mut known: HashMap<String, usize> = HashMap::new();
        let mut record = StringRecord::new();
        while reader.read_record(&mut record).map_err(refused)? {
            let (index, line) = (file.points_m.len(), line(bytes, &record));
            if index == MAX_POINTS {
                let problem = format_args!("line {line}: found more than {MAX_POINTS} points");
                return Err(Failure::unreadable(path, format_args!("{problem}, expected at most so many")));
            }
            file.points_m.push(point(path, line, &record)?);
            let group = if has_bodies { file.group(path, line, &record[3], &mut known)? } else { 0 };
            file.groups[group].1.push(index);
        }
        Ok(file)
    }

    fn group(
        &mut self,
        path: &Path,
        line: u64,
        name: &str,
        known: &mut HashMap<String, usize>,
    ) -> Outcome<usize> {
        if name.is_empty() {
            let problem = format_args!("line {line}, body: found nothing, expected a name");
            return Err(Failure::unreadable(path, problem));
        }
        if let Some(&group) = known.get(name) {
            return Ok(group);
        }
        known.insert(name.to_owned(), self.groups.len());
        self.groups.push((Some(name.to_owned()), Vec::new()));
        Ok(self.groups.len() - 1)
    }

    /// The points of each body.
    pub fn bodies(&self) -> Vec<Points> {
        let body = |(_, indices): &(Option<String>, Vec<usize>)| {
            let points: Arc<[[f64; 3]]> = indices.iter().map(|&index| self.points_m[index]).collect();
            Points::World(points)
        };
        self.groups.iter().map(body).collect()
    }
}

fn point(path: &Path, line: u64, record: &StringRecord) -> Outcome<[f64; 3]> {
    let mut point_m = [0.0; 3];
    for (axis, key) in ["x", "y", "z"].into_iter().enumerate() {
        let text = &record[axis];
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        point_m[axis] = number.ok_or_else(|| {
            let found = if text.is_empty() { "nothing".to_owned() } else { format!("{:?}", cut(text)) };
            let problem = format_args!("line {line}, {key}: found {found}");
            Failure::unreadable(path, format_args!("{problem}, expected a finite number, metres"))
        })?;
    }
    Ok(point_m)
}

/// The line of a record, from 1: the reader counts empty lines before a record as part of it.
fn line(bytes: &[u8], record: &StringRecord) -> u64 {
    let Some(position) = record.position() else { return 0 };
    let rest = bytes.get(position.byte() as usize..).unwrap_or_default();
    let empty = rest.iter().take_while(|byte| matches!(byte, b'\r' | b'\n'));
    position.line() + empty.filter(|&&byte| byte == b'\n').count() as u64
}

fn cut(text: &str) -> String {
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).collect::<String>() + "..."
    }
}

/// What the reader found wrong, with its line.
fn described(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos: Some(pos), expected_len, len } => {
            format!("line {}: found {len} fields, expected {expected_len}", pos.line())
        }
        csv::ErrorKind::Utf8 { pos: Some(pos), .. } => {
            format!("line {}: found bytes that are no UTF-8, expected text", pos.line())
        }
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Outcome<PointsFile> {
        PointsFile::parse(Path::new("p.csv"), text.as_bytes())
    }

    #[track_caller]
    fn refused(text: &str, expected: &str) {
        assert_eq!(parse(text), Err(Failure::Input(format!("p.csv: {expected}"))));
    }

    #[test]
    fn bodies_come_in_order_of_first_appearance() {
        let file = parse("x,y,z,body\n1,2,3,b\n4, 5 ,6e-1,a\r\n7,8,9,b\n").expect("points");
        assert_eq!(file.points_m, [[1.0, 2.0, 3.0], [4.0, 5.0, 0.6], [7.0, 8.0, 9.0]]);
        let name = |name: &str| Some(name.to_owned());
        assert_eq!(file.groups, [(name("b"), vec![0, 2]), (name("a"), vec![1])]);
        assert_eq!(file.bodies()[0], Points::World([[1.0, 2.0, 3.0], [7.0, 8.0, 9.0]].into()));
    }

    #[test]
    fn without_the_column_all_points_are_of_one_nameless_body() {
        let file = parse("x,y,z\n1,2,3\n4,5,6\n").expect("points");
        assert_eq!(file.groups, [(None, vec![0, 1])]);
        assert_eq!(parse("x,y,z\n").expect("no points").points_m, [[0.0; 3]; 0]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        refused("", "line 1: found header \"\", expected x,y,z or x,y,z,body");
        refused("1,2,3\n", "line 1: found header \"1,2,3\", expected x,y,z or x,y,z,body");
        refused("x,y,z\n1,2,3\n1,2\n", "line 3: found 2 fields, expected 3");
        refused("x,y,z\n1,2,nan\n", "line 2, z: found \"nan\", expected a finite number, metres");
        refused("x,y,z\n\n-inf,2,3\n", "line 3, x: found \"-inf\", expected a finite number, metres");
        refused("x,y,z\n1,,3\n", "line 2, y: found nothing, expected a finite number, metres");
        refused("x,y,z,body\n1,2,3,\n", "line 2, body: found nothing, expected a name");
        let many = "x,y,z\n".to_owned() + &"0,0,0\n".repeat(MAX_POINTS + 1);
        refused(&many, "line 1000002: found more than 1000000 points, expected at most so many");
    }
}
