//! Changes `latency_s` of the cameras' sources in the text of a cluster file, and nothing else.

use camera_node::source::SourceConfig;
use toml_edit::{DocumentMut, Item, TableLike, Value};

use super::{ClusterFile, ClusterFileError};
use crate::expand::expand;
use crate::text_file::read_text;

/// A camera's `latency_s`, from exposure to arrival.
#[derive(Clone, Debug, PartialEq)]
pub struct LatencyChange {
    /// The camera's name.
    pub camera: String,
    /// As it was, seconds.
    pub from_s: f64,
    /// As it is to be, seconds.
    pub to_s: f64,
}

impl ClusterFile {
    /// The file's text with every camera's `latency_s` greater by what `late_s` says of its name, seconds; comments
    /// and order stay. Only differences matter: where one would be negative, all are raised alike. An error
    /// if a camera's source is not live, since nothing else has a latency, or if the file has changed under us.
    pub fn change_latencies(
        &self,
        late_s: impl Fn(&str) -> f64,
    ) -> Result<(String, Vec<LatencyChange>), ClusterFileError> {
        let text = read_text(&self.path).map_err(|error| self.refused(error.to_string()))?;
        self.with_latencies(&text, late_s)
    }

    /// The same of the file's text.
    pub(crate) fn with_latencies(
        &self,
        text: &str,
        late_s: impl Fn(&str) -> f64,
    ) -> Result<(String, Vec<LatencyChange>), ClusterFileError> {
        let changes = self.latency_changes(late_s)?;
        let mut document: DocumentMut =
            text.parse().map_err(|error: toml_edit::TomlError| self.refused(error.message().to_owned()))?;
        let mut cameras = document.get_mut("camera").map(tables).unwrap_or_default();
        for change in changes.iter().filter(|change| change.from_s != change.to_s) {
            let camera = cameras.iter_mut().find(|camera| is_called(&***camera, &change.camera));
            let source = camera.and_then(|camera| camera.get_mut("source")?.as_table_like_mut());
            let source = source.ok_or_else(|| {
                self.of_source(&change.camera, "found none any more, expected the one that was read")
            })?;
            set(source, change.to_s);
        }
        Ok((document.to_string(), changes))
    }

    fn refused(&self, problem: String) -> ClusterFileError {
        ClusterFileError::Read { path: self.path.clone(), problem }
    }

    fn latency_changes(&self, late_s: impl Fn(&str) -> f64) -> Result<Vec<LatencyChange>, ClusterFileError> {
        let mut changes = Vec::new();
        for entry in &self.cameras {
            let SourceConfig::Pipe(pipe) = &entry.source else {
                return Err(self.of_source(&entry.name, NOT_LIVE));
            };
            if !pipe.live {
                return Err(self.of_source(&entry.name, NOT_LIVE));
            }
            let from_s = pipe.latency_s;
            changes.push(LatencyChange {
                camera: entry.name.clone(),
                from_s,
                to_s: from_s + late_s(&entry.name),
            });
        }
        let raise_s = changes.iter().map(|change| -change.to_s).fold(0.0, f64::max);
        for change in changes.iter_mut().filter(|change| change.from_s != change.to_s + raise_s) {
            change.to_s = ((change.to_s + raise_s) * PER_S).round() / PER_S;
        }
        Ok(changes)
    }

    fn of_source(&self, camera: &str, problem: &str) -> ClusterFileError {
        let key = format!("camera {camera:?}, source");
        ClusterFileError::Value { path: self.path.clone(), key, problem: problem.to_owned() }
    }
}

const NOT_LIVE: &str = "found film, expected live = true: nothing else has a latency_s";
/// Latencies are written to a tenth of a millisecond.
const PER_S: f64 = 1e4;

/// The tables of an array, however it is written.
fn tables(item: &mut Item) -> Vec<&mut dyn TableLike> {
    match item {
        Item::ArrayOfTables(tables) => tables.iter_mut().map(|table| table as &mut dyn TableLike).collect(),
        Item::Value(Value::Array(values)) => values
            .iter_mut()
            .filter_map(|value| value.as_inline_table_mut().map(|table| table as &mut dyn TableLike))
            .collect(),
        _ => Vec::new(),
    }
}

fn is_called(camera: &dyn TableLike, name: &str) -> bool {
    let written = camera.get("name").and_then(Item::as_str);
    let variables = |name: &str| std::env::var(name).ok();
    written.is_some_and(|written| expand(written, &variables).is_ok_and(|expanded| expanded.text == name))
}

/// Sets the key, with the spaces and the comment beside it as they are.
fn set(source: &mut dyn TableLike, latency_s: f64) {
    let mut value = Value::from(latency_s);
    if let Some(old) = source.get_mut("latency_s").and_then(Item::as_value_mut) {
        *value.decor_mut() = old.decor().clone();
        *old = value;
        return;
    }
    // The space before a closing brace belongs to the last value.
    if let Some(last) = source.iter_mut().last().and_then(|(_, item)| item.as_value_mut()) {
        let space = last.decor().suffix().and_then(|suffix| suffix.as_str()).unwrap_or_default().to_owned();
        if !space.is_empty() && space.trim().is_empty() {
            last.decor_mut().set_suffix("");
            value = value.decorated(" ", space);
        }
    }
    source.insert("latency_s", Item::Value(value));
}

#[cfg(test)]
mod tests {
    use std::fs;

    use hull::Rig;

    use super::*;

    const CLUSTER: &str = r#"# The studio.
rig = "rig.toml"
scene = "topple"
fps = 30   # as the cameras do

[[camera]] # the left one
name = "left"
source = { kind = "pipe", live = true, latency_s = 0.06, command = ["film", "0"] } # on the wall
background = { kind = "images", path = "left.png" }

[[camera]]
name = "right"
background = { kind = "images", path = "right.png" }
[camera.source]
kind = "pipe"
live = true
latency_s = 0.01 # measured
command = ["film", "1"]

[[camera]]
name = "top"
source = { kind = "pipe", live = true, command = ["film", "2"] }
background = { kind = "images", path = "top.png" }
"#;

    fn camera(name: &str) -> hull::Camera {
        let k = nalgebra::Matrix3::new(50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0);
        hull::Camera::new(name, (64, 48), k, [0.0; 5], nalgebra::Vector3::zeros(), nalgebra::Vector3::z())
            .expect("valid")
    }

    fn opened(folder: &std::path::Path, text: &str) -> ClusterFile {
        let path = folder.join("studio.cluster.toml");
        let rig = Rig::new(["left", "right", "top"].map(camera).to_vec()).expect("a rig");
        fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
        fs::write(&path, text).expect("written");
        ClusterFile::open(&path).expect("valid")
    }

    #[test]
    fn latencies_change_and_every_other_byte_stays() {
        let folder = tempfile::tempdir().expect("a folder");
        let cluster = opened(folder.path(), CLUSTER);
        let late_s = |name: &str| match name {
            "left" => 0.0123,
            "right" => -0.0123,
            _ => 0.0,
        };
        let (text, changes) = cluster.change_latencies(late_s).expect("live");
        // The second would be negative: all are raised by as much.
        let expected = CLUSTER
            .replace("latency_s = 0.06,", "latency_s = 0.0746,")
            .replace("latency_s = 0.01 #", "latency_s = 0.0 #");
        let top = r#"source = { kind = "pipe", live = true, command = ["film", "2"] }"#;
        let top_after =
            r#"source = { kind = "pipe", live = true, command = ["film", "2"], latency_s = 0.0023 }"#;
        let expected = expected.replace(top, top_after);
        assert_eq!(text, expected);
        let to_s: Vec<f64> = changes.iter().map(|change| change.to_s).collect();
        assert_eq!(to_s, [0.0746, 0.0, 0.0023]);
        fs::write(&cluster.path, &text).expect("written");
        let again = ClusterFile::open(&cluster.path).expect("still valid");
        let (same, _) = again.change_latencies(|_| 0.0).expect("live");
        assert_eq!(same, text);
    }

    #[test]
    fn film_that_is_not_live_has_no_latency_to_change() {
        let folder = tempfile::tempdir().expect("a folder");
        let cluster = opened(folder.path(), &CLUSTER.replace("live = true, command", "command"));
        let error = cluster.change_latencies(|_| 0.0).expect_err("refused").to_string();
        assert!(error.ends_with(&format!(", camera \"top\", source: {NOT_LIVE}")), "{error}");
    }
}
