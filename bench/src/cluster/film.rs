//! A short film of silhouettes, made once and read by nodes from files: filming must not disturb what is
//! measured.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use camera_node::scratch::ScratchFolder;
use hull::cull::WorldBox;
use hull::{Camera, Observer, ProbeSettings, Rig, Silhouette, View, ViewSet};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use setup::ClusterFile;
use setup::cli::{Failure, Outcome, temporary_folder};
use stage::{CameraStage, StageSettings, studio_rig};

use crate::crews::all_see;
use crate::random::Random;

/// Frames of the film a second.
pub const FPS: f64 = 30.0;
/// The room of its nodes.
pub const ROOM: &str = "bench";
/// The instant of the stage's film that is frame 0, seconds: an arm waves.
const START_S: f64 = 2.0;

/// What is filmed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmPlan {
    /// Cameras of the studio.
    pub cameras: usize,
    /// How many processes they are spread over, each with as many neighbours.
    pub nodes: usize,
    /// Width and height of their images, pixels.
    pub size: (u32, u32),
    /// Number of frames.
    pub frames: u64,
    /// The share of pixels that are inverted, each independently.
    pub noise: f64,
    /// Cameras abstain about what they do not see, instead of rejecting it.
    pub abstain: bool,
}

/// Silhouettes of a person who waves, in files and here.
pub struct Film {
    /// What was filmed.
    pub plan: FilmPlan,
    /// The cluster file of its nodes.
    pub file: ClusterFile,
    /// The box around the person in frame 0, metres.
    pub person_world: WorldBox,
    silhouettes: Vec<Vec<Silhouette>>,
    folder: ScratchFolder,
}

impl Film {
    /// Looks at the studio from every camera and writes what its nodes will read.
    pub fn make(plan: FilmPlan) -> Outcome<Film> {
        let rig = studio_rig(plan.cameras, plan.size)
            .map_err(|error| Failure::input(format_args!("--size: {error}")))?;
        let folder = temporary_folder()?;
        let settings = StageSettings { fps: FPS, ..StageSettings::default() };
        let look = |index| filmed_by(&plan, &rig, &settings, folder.path(), index);
        let of_cameras = all_see("filming the studio", plan.cameras, look)?;
        let frames = 0..plan.frames as usize;
        let silhouettes = frames.map(|frame| of_cameras.iter().map(|film| film[frame].clone()).collect());
        let silhouettes = silhouettes.collect();
        let (low, high) =
            settings.bounds_world(START_S).ok_or_else(|| Failure::run("no person is on the stage"))?;
        let file = ClusterFile::open(&write_cluster(folder.path(), &rig, &plan)?)?;
        let person_world = WorldBox { min: low.into(), max: high.into() };
        Ok(Film { plan, file, person_world, silhouettes, folder })
    }

    /// The same film for another number of nodes.
    pub fn spread_over(&mut self, nodes: usize) -> Outcome {
        self.plan.nodes = nodes;
        self.file = ClusterFile::open(&write_cluster(self.folder.path(), &self.file.rig, &self.plan)?)?;
        Ok(())
    }

    /// The probe settings of its nodes.
    pub fn settings(&self) -> ProbeSettings {
        self.file.probes
    }

    /// Each camera's silhouette in a frame, in rig order.
    pub fn silhouettes(&self, frame: u64) -> &[Silhouette] {
        &self.silhouettes[frame as usize]
    }

    /// The fixed side of every camera, in rig order.
    pub fn observers(&self) -> Vec<Arc<Observer>> {
        let observer = |(index, camera): (usize, &Camera)| {
            Arc::new(Observer::new(camera.clone(), index as u16, self.settings(), None))
        };
        self.file.rig.cameras().iter().enumerate().map(observer).collect()
    }

    /// All cameras at frame 0, in this process.
    pub fn views(&self) -> ViewSet {
        let views = self.observers().into_iter().zip(self.silhouettes(0));
        ViewSet::new(views.map(|(observer, silhouette)| View::new(observer, silhouette)).collect())
    }
}

/// A camera's silhouettes, written to files too.
fn filmed_by(
    plan: &FilmPlan,
    rig: &Rig,
    settings: &StageSettings,
    folder: &Path,
    index: usize,
) -> Outcome<Vec<Silhouette>> {
    let camera = &rig.cameras()[index];
    let mut stage = CameraStage::new(settings, camera, index);
    let of_camera = folder.join(camera.name());
    fs::create_dir(&of_camera).map_err(|error| Failure::unwritable(&of_camera, error))?;
    let frame = |frame| {
        let mut mask = stage.mask(START_S + frame as f64 / FPS);
        add_noise(&mut mask, plan.noise, &mut Random::new(index as u64 * plan.frames + frame));
        write_mask(&of_camera.join(format!("{frame}.png")), camera, &mask)?;
        Silhouette::from_mask(plan.size.0, plan.size.1, &mask).map_err(Failure::run)
    };
    (0..plan.frames).map(frame).collect()
}

/// Turns a share of the pixels into their opposites, each with the same chance: the gaps between them are
/// drawn, not the pixels.
fn add_noise(mask: &mut [u8], share: f64, random: &mut Random) {
    if share <= 0.0 {
        return;
    }
    let log_kept = libm::log1p(-share);
    let mut at = 0usize;
    loop {
        // One less than the draw is never zero.
        at += (libm::log(1.0 - random.share()) / log_kept) as usize;
        let Some(pixel) = mask.get_mut(at) else { return };
        *pixel = 255 - *pixel;
        at += 1;
    }
}

fn write_mask(path: &Path, camera: &Camera, mask: &[u8]) -> Outcome {
    let written = File::create(path).map_err(image::ImageError::IoError).and_then(|file| {
        PngEncoder::new_with_quality(BufWriter::new(file), CompressionType::Fast, FilterType::NoFilter)
            .write_image(mask, camera.width(), camera.height(), ExtendedColorType::L8)
    });
    written.map_err(|error| Failure::unwritable(path, error))
}

fn write_cluster(folder: &Path, rig: &Rig, &FilmPlan { nodes, abstain, .. }: &FilmPlan) -> Outcome<PathBuf> {
    let mut text = format!("name = {ROOM:?}\nrig = \"rig.toml\"\nscene = \"topple\"\nfps = {FPS:?}\n");
    if abstain {
        text += "out_of_view = \"abstain\"\n";
    }
    for node in 0..nodes {
        // A local process finds a port of its own.
        text += &format!("[[node]]\nname = \"node{node}\"\naddress = \"node{node}.invalid:7001\"\n");
    }
    for (index, camera) in rig.cameras().iter().enumerate() {
        let (name, node) = (camera.name(), index * nodes / rig.cameras().len());
        text += &format!(
            "[[camera]]\nname = {name:?}\nnode = \"node{node}\"\n\
             source = {{ kind = \"masks\", path = \"{name}/%d.png\" }}\n"
        );
    }
    let path = folder.join("cluster.toml");
    let written = fs::write(folder.join("rig.toml"), rig.to_toml()).and_then(|()| fs::write(&path, text));
    written.map_err(|error| Failure::unwritable(folder, error))?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_inverts_the_given_share() {
        let mut mask = vec![0u8; 200_000];
        add_noise(&mut mask, 0.05, &mut Random::new(7));
        let turned = mask.iter().filter(|&&pixel| pixel == 255).count() as f64 / mask.len() as f64;
        assert!((turned - 0.05).abs() < 0.003, "{turned}");
        let before = mask.clone();
        add_noise(&mut mask, 0.0, &mut Random::new(7));
        assert_eq!(mask, before);
    }

    #[test]
    fn nodes_share_the_cameras_and_read_every_frame() {
        let plan = FilmPlan { cameras: 4, nodes: 2, size: (160, 120), frames: 2, noise: 0.0, abstain: true };
        let film = Film::make(plan).expect("a film");
        assert_eq!(film.settings().rule().out_of_view, hull::OutOfView::Abstain);
        let groups: Vec<Vec<usize>> = film.file.nodes.iter().map(|node| node.cameras.clone()).collect();
        assert_eq!(groups, [vec![0, 1], vec![2, 3]]);
        assert!(film.silhouettes(1).iter().all(|silhouette| silhouette.area() > 100));
    }
}
