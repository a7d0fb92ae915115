//! All that a run needs besides its film.

use std::ops::RangeInclusive;
use std::sync::Arc;

use coordinator::AskEvery;
use hull::rule::{HullRule, NormalWindow, OutOfView, ProbeSettings};
use hull::surface::HullTime;
use hull::{Observer, Rig, Silhouette};
use proto::convert::{Precision, SilhouetteEncoding, silhouette_data, silhouette_from_data};
use proto::recording::Header;
use sim::{ResponseMode, Scene, WorldSettings};
use world_encodings::recording::{ConvertError, scene_of_text, scene_text};

use super::numbers::{UNIX_S, within};

const NAME: &str = "Header";
const VERSION: u32 = 1;

const FRAMES_PER_S: RangeInclusive<f64> = 0.1..=10_000.0;
// That of the cluster file; film is held for as long as a run is told to last.
const LATENCY_S: RangeInclusive<f64> = 0.0..=60.0;
const HOLD_S: RangeInclusive<f64> = 0.0..=1e9;

/// All that a run needs besides its film.
#[derive(Clone, Debug, PartialEq)]
pub struct RunHeader {
    /// The version of the program that recorded.
    pub program: String,
    /// When the recording began, unix seconds.
    pub began_unix_s: f64,
    /// The cameras.
    pub rig: Rig,
    /// Static occluders of each camera, if it has any; of the camera's size.
    pub ignored: Vec<Option<Silhouette>>,
    /// Frames of the cluster per second.
    pub fps: f64,
    /// From capture to use, seconds; 0 if it was measured as the run went.
    pub latency_s: f64,
    /// How long the last frame is held when film ends, seconds.
    pub hold_s: f64,
    /// The hull rule and the probes' settings.
    pub probes: ProbeSettings,
    /// What happens, under the gravity of the run.
    pub scene: Scene,
    /// The world's settings.
    pub world: WorldSettings,
    /// How numbers travelled between coordinator and nodes.
    pub precision: Precision,
    /// How often the hull was asked.
    pub asks: AskEvery,
    /// Where probes were computed, as on the command line.
    pub transport: String,
    /// Every frame, as fast as it could be made, instead of in real time.
    pub lock_step: bool,
}

impl RunHeader {
    /// The fixed side of every camera, in rig order.
    pub fn observers(&self) -> Vec<Arc<Observer>> {
        let cameras = self.rig.cameras().iter().zip(&self.ignored).enumerate();
        let observer = |(index, (camera, ignored)): (usize, (&hull::Camera, &Option<Silhouette>))| {
            Arc::new(Observer::new(camera.clone(), index as u16, self.probes, ignored.as_ref()))
        };
        cameras.map(observer).collect()
    }

    /// The cameras' names, in rig order.
    pub fn names(&self) -> Vec<String> {
        self.rig.cameras().iter().map(|camera| camera.name().to_owned()).collect()
    }

    pub(crate) fn to_message(&self) -> Header {
        let ignored = |mask: &Option<Silhouette>| {
            mask.as_ref().map_or_else(Vec::new, |mask| silhouette_data(mask, SilhouetteEncoding::Runs).into())
        };
        let rule = self.probes.rule();
        Header {
            version: VERSION,
            program: self.program.clone(),
            began_unix_s: self.began_unix_s,
            rig_toml: self.rig.to_toml(),
            ignored_runs: self.ignored.iter().map(ignored).collect(),
            frames_per_s: self.fps,
            latency_s: self.latency_s,
            hold_s: self.hold_s,
            abstain: rule.out_of_view == OutOfView::Abstain,
            min_views: rule.min_views,
            normal_window: match self.probes.normal_window() {
                NormalWindow::Auto => 0,
                NormalWindow::Pixels(k) => k,
            },
            max_depth_m: self.probes.max_depth_m(),
            scene: Some(scene_text(&self.scene)),
            seed: self.world.seed,
            dt_s: self.world.dt_s,
            response: self.world.response.name().into(),
            mirror_restitution: self.world.mirror_restitution,
            hull_friction: self.world.hull_friction,
            covering_radius_m: self.world.covering_radius_m,
            precision: match self.precision {
                Precision::Exact => "exact".into(),
                Precision::Quantised => "quantised".into(),
            },
            ask: match self.asks {
                AskEvery::Frame => "frame".into(),
                AskEvery::Step => "step".into(),
            },
            transport: self.transport.clone(),
            lock_step: self.lock_step,
            hull_time: self.world.hull_time.name().into(),
        }
    }

    pub(crate) fn from_message(header: &Header) -> Result<RunHeader, ConvertError> {
        let wrong = |problem: String| ConvertError::new(NAME, problem);
        if header.version != VERSION {
            return Err(wrong(format!("version is {}, expected {VERSION}", header.version)));
        }
        let rig = Rig::from_toml(&header.rig_toml).map_err(|error| ConvertError::new(NAME, error))?;
        let scene = header.scene.as_ref().ok_or_else(|| ConvertError::missing(NAME, "scene"))?;
        Ok(RunHeader {
            program: header.program.clone(),
            began_unix_s: within(NAME, "began_unix_s", header.began_unix_s, UNIX_S)?,
            ignored: ignored(&rig, &header.ignored_runs)?,
            rig,
            fps: within(NAME, "frames_per_s", header.frames_per_s, FRAMES_PER_S)?,
            latency_s: within(NAME, "latency_s", header.latency_s, LATENCY_S)?,
            hold_s: within(NAME, "hold_s", header.hold_s, HOLD_S)?,
            probes: probes(header)?,
            scene: scene_of_text(scene)?,
            world: world(header)?,
            precision: match &header.precision[..] {
                "exact" => Precision::Exact,
                "quantised" => Precision::Quantised,
                other => return Err(wrong(format!("precision is {other:?}, expected exact or quantised"))),
            },
            asks: match &header.ask[..] {
                "frame" => AskEvery::Frame,
                "step" => AskEvery::Step,
                other => return Err(wrong(format!("ask is {other:?}, expected frame or step"))),
            },
            transport: header.transport.clone(),
            lock_step: header.lock_step,
        })
    }
}

fn probes(header: &Header) -> Result<ProbeSettings, ConvertError> {
    let out_of_view = if header.abstain { OutOfView::Abstain } else { OutOfView::Outside };
    let rule = HullRule { out_of_view, min_views: header.min_views };
    let window = match header.normal_window {
        0 => NormalWindow::Auto,
        k => NormalWindow::Pixels(k),
    };
    ProbeSettings::new(rule, window, header.max_depth_m).map_err(|error| ConvertError::new(NAME, error))
}

fn world(header: &Header) -> Result<WorldSettings, ConvertError> {
    let response = match &header.response[..] {
        "paper" => ResponseMode::Paper,
        "contacts" => ResponseMode::Contacts,
        other => {
            let problem = format_args!("response is {other:?}, expected paper or contacts");
            return Err(ConvertError::new(NAME, problem));
        }
    };
    let hull_time = match &header.hull_time[..] {
        "newest" | "" => HullTime::Newest,
        "between" => HullTime::Between,
        other => {
            let problem = format_args!("hull_time is {other:?}, expected newest or between");
            return Err(ConvertError::new(NAME, problem));
        }
    };
    let settings = WorldSettings {
        dt_s: header.dt_s,
        seed: header.seed,
        response,
        hull_time,
        mirror_restitution: header.mirror_restitution,
        hull_friction: header.hull_friction,
        covering_radius_m: header.covering_radius_m,
    };
    settings.check().map_err(|error| ConvertError::new(NAME, error))?;
    Ok(settings)
}

fn ignored(rig: &Rig, masks: &[Vec<u8>]) -> Result<Vec<Option<Silhouette>>, ConvertError> {
    let (found, expected) = (masks.len(), rig.cameras().len());
    if found != expected {
        return Err(ConvertError::new(NAME, format_args!("{found} ignored_runs, expected {expected}")));
    }
    let mask = |(camera, runs): (&hull::Camera, &Vec<u8>)| {
        if runs.is_empty() {
            return Ok(None);
        }
        let size = (camera.width(), camera.height());
        let mask = silhouette_from_data(runs, size, SilhouetteEncoding::Runs);
        mask.map(Some).map_err(|error| ConvertError::new(NAME, error))
    };
    rig.cameras().iter().zip(masks).map(mask).collect()
}
