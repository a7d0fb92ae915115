//! From the cluster file's keys to values that can be trusted.

mod nodes;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use camera_node::source::SourceConfig;
use coordinator::GoingOn;
use hull::Rig;
use hull::rule::{HullRule, NormalWindow, OutOfView, ProbeSettings};
use proto::convert::Precision;
use segment::{Method, SegmentSettings};
use toml::{Table, Value};

use self::nodes::{NamedNode, NodeKey};
use super::{
    CameraEntry, CameraKeys, ClusterFile, ClusterFileError, File, OutOfViewKey, PrecisionKey, SceneChoice,
};
use crate::expand::{Variables, expand};
use crate::text_file::read_text;

/// The room of a file without `name`.
const DEFAULT_ROOM: &str = "room";

/// Gives the keys their meaning, and errors their place.
pub(super) struct Checker<'a> {
    /// As the user named it, for messages.
    pub path: &'a Path,
    pub absolute: &'a Path,
    pub variables: Variables<'a>,
}

impl Checker<'_> {
    pub fn cluster(&self, file: &File) -> Result<ClusterFile, ClusterFileError> {
        let beside = self.absolute.parent().unwrap_or(Path::new("/"));
        let folder = match &file.folder {
            Some(folder) => self.existing("folder", beside, folder, Path::is_dir, "a folder")?,
            None => beside.to_owned(),
        };
        let whole = self.rig(&folder, &file.rig)?;
        let rig = self.used(&whole, &file.unused_cameras)?;
        let named = self.named_nodes(&folder, file)?;
        let (cameras, node_keys): (Vec<_>, Vec<_>) =
            self.cameras(&folder, &whole, &rig, file, &named)?.into_iter().unzip();
        let probes = self.probes(file)?;
        Ok(ClusterFile {
            path: self.absolute.to_owned(),
            name: self.label("name", file.name.as_deref().unwrap_or(DEFAULT_ROOM))?,
            rig,
            scene: self.scene(beside, &file.scene)?,
            fps: self.within("fps", file.fps, 0.01, 1000.0)?,
            latency_s: self.latency_s(file.latency_s.as_ref())?,
            hold_s: self.within("hold_s", file.hold_s, 0.0, 3600.0)?,
            seed: file.seed,
            gravity_m_s2: file.gravity.map(|gravity| self.gravity(gravity)).transpose()?,
            going_on: self.going_on(file, &probes, cameras.len())?,
            probes,
            precision: match file.wire.precision {
                PrecisionKey::Exact => Precision::Exact,
                PrecisionKey::Quantised => Precision::Quantised,
            },
            max_connection_age_s: self.within(
                "wire.max_connection_age_s",
                file.wire.max_connection_age_s.unwrap_or(3600.0),
                2.0,
                86_400.0,
            )?,
            nodes: self.nodes(&named, &node_keys)?,
            cameras,
        })
    }

    /// An entry for each camera of `rig`, in its order, and by what it knows its node.
    fn cameras(
        &self,
        folder: &Path,
        whole: &Rig,
        rig: &Rig,
        file: &File,
        named: &[NamedNode],
    ) -> Result<Vec<(CameraEntry, NodeKey)>, ClusterFileError> {
        let mut cameras: Vec<(CameraEntry, NodeKey)> = Vec::new();
        // Two paths may lead to one film.
        let mut places: BTreeMap<(&str, PathBuf), Vec<(NodeKey, String)>> = BTreeMap::new();
        for keys in &file.camera {
            let entry = self.camera(folder, whole, rig, &file.segmentation, keys)?;
            if cameras.iter().any(|(other, _)| other.name == entry.name) {
                return Err(
                    self.wrong("camera", format!("found {:?} twice, expected every name once", entry.name))
                );
            }
            let node = self.node_key(&format!("camera {:?}, node", entry.name), folder, named, keys)?;
            let at_its_node = cameras.iter().filter(|(_, other)| *other == node);
            at_its_node.map(|(other, _)| other).try_for_each(|other| self.films_apart(&entry, other))?;
            for (key, film) in [("source", Some(&entry.source)), ("background", entry.background.as_ref())] {
                let Some(place) = film.and_then(SourceConfig::place) else { continue };
                let there = places.entry((key, place)).or_default();
                if let Some((_, other)) = there.iter().find(|(other, _)| *other == node) {
                    return Err(self.same_film(&entry.name, key, other));
                }
                there.push((node.clone(), entry.name.clone()));
            }
            cameras.push((entry, node));
        }
        if let Some(missing) =
            rig.cameras().iter().find(|camera| cameras.iter().all(|(e, _)| e.name != camera.name()))
        {
            let problem = "found no [[camera]] entry, expected one, or its name in unused_cameras";
            return Err(self.wrong(&format!("camera {:?} of the rig", missing.name()), problem));
        }
        cameras.sort_by_key(|(entry, _)| entry.rig_index);
        Ok(cameras)
    }

    fn rig(&self, folder: &Path, text: &str) -> Result<Rig, ClusterFileError> {
        let path = self.existing("rig", folder, text, Path::is_file, "a rig file")?;
        let refused = |problem: String| self.wrong("rig", format!("{}: {problem}", path.display()));
        let text = read_text(&path).map_err(|error| refused(error.to_string()))?;
        Rig::from_toml(&text).map_err(|error| refused(error.to_string()))
    }

    /// The rig without the cameras that take no part.
    fn used(&self, rig: &Rig, unused: &[String]) -> Result<Rig, ClusterFileError> {
        if let Some(unknown) = unused.iter().find(|name| rig.index_of(name).is_none()) {
            return Err(self.wrong("unused_cameras", unknown_camera(rig, unknown)));
        }
        let used = rig.cameras().iter().filter(|camera| unused.iter().all(|name| name != camera.name()));
        Rig::new(used.cloned().collect())
            .map_err(|_| self.wrong("unused_cameras", "found all cameras of the rig, expected some left"))
    }

    fn camera(
        &self,
        folder: &Path,
        whole: &Rig,
        rig: &Rig,
        defaults: &Table,
        keys: &CameraKeys,
    ) -> Result<CameraEntry, ClusterFileError> {
        let name = self.text("camera name", &keys.name)?;
        let key = |key: &str| format!("camera {name:?}, {key}");
        let rig_index = rig.index_of(&name).ok_or_else(|| match whole.index_of(&name) {
            Some(_) => self.wrong(&key("name"), "found in unused_cameras too, expected one of the two"),
            None => self.wrong(&key("name"), unknown_camera(whole, &name)),
        })?;
        let segmentation = self.segmentation(&key("segmentation"), defaults, &keys.segmentation)?;
        let source = self.source(&key("source"), folder, &keys.source)?;
        self.stamps(&key("stamps"), keys.stamps.as_deref(), &source)?;
        let background = match &keys.background {
            Some(background) => Some(self.background(&key("background"), folder, background)?),
            None => source.empty_room(),
        };
        let needs_none = source.gives_masks() || segmentation.method == Method::Chroma;
        if background.is_none() && !needs_none {
            let problem = "found nothing, expected a source of the empty room (only masks and method = \"chroma\" \
                           do without)";
            return Err(self.wrong(&key("background"), problem));
        }
        let mask = |mask| self.existing(&key("ignore_mask"), folder, mask, Path::is_file, "a mask image");
        let ignore_mask = keys.ignore_mask.as_deref().map(mask).transpose()?;
        Ok(CameraEntry { rig_index, source, background, segmentation, ignore_mask, name: name.clone() })
    }

    /// An error for two cameras of one machine with the same film or background.
    fn films_apart(&self, one: &CameraEntry, other: &CameraEntry) -> Result<(), ClusterFileError> {
        let backgrounds = one.background.as_ref().zip(other.background.as_ref());
        let films = [("source", Some((&one.source, &other.source))), ("background", backgrounds)];
        let is_same = |film: &Option<(&SourceConfig, &SourceConfig)>| {
            film.is_some_and(|(its, others)| its.is_film_of(others))
        };
        match films.iter().find(|(_, film)| is_same(film)) {
            None => Ok(()),
            Some((key, _)) => Err(self.same_film(&one.name, key, &other.name)),
        }
    }

    fn same_film(&self, name: &str, key: &str, other: &str) -> ClusterFileError {
        let problem = format!("found that of camera {other:?} too, expected its own");
        self.wrong(&format!("camera {name:?}, {key}"), problem)
    }

    fn source(
        &self,
        key: &str,
        folder: &Path,
        config: &SourceConfig,
    ) -> Result<SourceConfig, ClusterFileError> {
        let mut config = config.clone();
        config.resolve(folder, |path| self.resolved(key, folder, path), |text| self.text(key, text))?;
        match config.misplaced_side() {
            Some(problem) => Err(self.wrong(key, problem)),
            None => Ok(config),
        }
    }

    /// By what frames are numbered follows from the source; a file that says it must say the same.
    fn stamps(&self, key: &str, said: Option<&str>, source: &SourceConfig) -> Result<(), ClusterFileError> {
        let known = source.stamps().word();
        let Some(said) = said.filter(|said| *said != known) else { return Ok(()) };
        let problem = format!(
            "found {said:?}, expected {known:?} of this source (the command of a live pipe with {{times}} gives \
             \"capture\", with {{counts}} \"counter\", with neither \"arrival\"; all else gives \"index\")"
        );
        Err(self.wrong(key, problem))
    }

    fn background(
        &self,
        key: &str,
        folder: &Path,
        config: &SourceConfig,
    ) -> Result<SourceConfig, ClusterFileError> {
        if config.gives_masks() {
            return Err(self.wrong(key, "found masks, expected colour images of the empty room"));
        }
        if config.is_endless() {
            return Err(self.wrong(key, "found a source without end, expected a clip"));
        }
        self.source(key, folder, config)
    }

    fn segmentation(
        &self,
        key: &str,
        defaults: &Table,
        own: &Table,
    ) -> Result<SegmentSettings, ClusterFileError> {
        let mut merged = defaults.clone();
        merged.extend(own.clone());
        let settings: SegmentSettings = Value::Table(merged)
            .try_into()
            .map_err(|error: toml::de::Error| self.wrong(key, error.message().replace('\n', ", ")))?;
        settings.validate().map_err(|error| self.wrong(key, error.to_string()))?;
        Ok(settings)
    }

    fn scene(&self, beside: &Path, text: &str) -> Result<SceneChoice, ClusterFileError> {
        let is_file = text.contains(['/', '$']) || text.ends_with(".toml");
        Ok(if is_file {
            SceneChoice::File(self.existing("scene", beside, text, Path::is_file, "a scene file")?)
        } else {
            SceneChoice::Named(text.to_owned())
        })
    }

    fn probes(&self, file: &File) -> Result<ProbeSettings, ClusterFileError> {
        let defaults = ProbeSettings::default();
        let out_of_view = match file.out_of_view {
            OutOfViewKey::Outside => OutOfView::Outside,
            OutOfViewKey::Abstain => OutOfView::Abstain,
        };
        let rule = HullRule { out_of_view, min_views: file.min_views.unwrap_or(defaults.rule().min_views) };
        let window = match &file.normal_window {
            None => defaults.normal_window(),
            Some(Value::String(auto)) if auto == "auto" => NormalWindow::Auto,
            Some(Value::Integer(k)) => NormalWindow::Pixels(u32::try_from(*k).unwrap_or(0)),
            Some(other) => {
                return Err(
                    self.wrong("normal_window", format!("found {other}, expected \"auto\" or pixels"))
                );
            }
        };
        ProbeSettings::new(rule, window, file.max_depth_m.unwrap_or(defaults.max_depth_m()))
            .map_err(|error| self.wrong("the hull rule", error.to_string()))
    }

    fn latency_s(&self, found: Option<&Value>) -> Result<Option<f64>, ClusterFileError> {
        let found_s = match found {
            None => return Ok(None),
            Some(Value::String(auto)) if auto == "auto" => return Ok(None),
            Some(Value::Float(found_s)) => *found_s,
            Some(Value::Integer(found_s)) => *found_s as f64,
            Some(other) => {
                return Err(self.wrong("latency_s", format!("found {other}, expected \"auto\" or seconds")));
            }
        };
        Ok(Some(self.within("latency_s", found_s, 0.0, 60.0)?))
    }

    /// How many cameras must remain, and how fast bodies are moved when one goes.
    fn going_on(
        &self,
        file: &File,
        probes: &ProbeSettings,
        cameras: usize,
    ) -> Result<GoingOn, ClusterFileError> {
        let (defaults, min_views) = (GoingOn::default(), probes.rule().min_views as usize);
        let least = defaults.min_cameras.min(cameras).max(min_views);
        let min_cameras = file.min_cameras.unwrap_or(least);
        if file.min_cameras.is_some() && !(min_views..=cameras).contains(&min_cameras) {
            let expected = format!("at least min_views, {min_views}, and at most the {cameras} cameras");
            return Err(self.wrong("min_cameras", format!("found {min_cameras}, expected {expected}")));
        }
        let push_m_s = file.push_m_s.unwrap_or(defaults.push_m_s);
        Ok(GoingOn { min_cameras, push_m_s: self.within("push_m_s", push_m_s, 0.0, 100.0)? })
    }

    fn gravity(&self, gravity_m_s2: [f64; 3]) -> Result<[f64; 3], ClusterFileError> {
        for component in gravity_m_s2 {
            self.within("gravity", component, -100.0, 100.0)?;
        }
        Ok(gravity_m_s2)
    }

    fn within(&self, key: &str, found: f64, low: f64, high: f64) -> Result<f64, ClusterFileError> {
        if (low..=high).contains(&found) {
            return Ok(found);
        }
        Err(self.wrong(key, format!("found {found}, expected a number from {low} to {high}")))
    }

    pub(super) fn text(&self, key: &str, text: &str) -> Result<String, ClusterFileError> {
        expand(text, self.variables)
            .map(|expanded| expanded.text)
            .map_err(|error| self.wrong(key, error.to_string()))
    }

    pub(super) fn resolved(&self, key: &str, folder: &Path, text: &str) -> Result<PathBuf, ClusterFileError> {
        let refused = |problem: String| self.wrong(key, problem);
        let expanded = expand(text, self.variables).map_err(|error| refused(error.to_string()))?;
        if !expanded.starts_with_variable {
            return Ok(folder.join(expanded.text));
        }
        std::path::absolute(&expanded.text).map_err(|error| refused(format!("{:?}: {error}", expanded.text)))
    }

    fn existing(
        &self,
        key: &str,
        folder: &Path,
        text: &str,
        is_right: impl Fn(&Path) -> bool,
        expected: &str,
    ) -> Result<PathBuf, ClusterFileError> {
        let path = self.resolved(key, folder, text)?;
        if is_right(&path) {
            return Ok(path);
        }
        let found = if path.exists() { "something else" } else { "nothing" };
        Err(self
            .wrong(key, format!("found {found} at {} (from {text:?}), expected {expected}", path.display())))
    }

    pub(super) fn wrong(&self, key: &str, problem: impl Into<String>) -> ClusterFileError {
        ClusterFileError::Value { path: self.path.to_owned(), key: key.to_owned(), problem: problem.into() }
    }
}

fn unknown_camera(rig: &Rig, name: &str) -> String {
    let known: Vec<&str> = rig.cameras().iter().map(hull::Camera::name).collect();
    format!("found {name:?}, expected a camera of the rig: {}", known.join(", "))
}
