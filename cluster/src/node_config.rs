//! From a cluster file to what a node films.

use camera_node::source::{FileConfig, Image, OpenContext};
use camera_node::{NodeCamera, NodeConfig, SourceConfig};
use cli::{Failure, Outcome};
use hull::Silhouette;

use crate::cluster_file::{CameraEntry, ClusterFile};

/// Reads a cluster file with the environment's variables.
pub fn read_cluster_file(path: &std::path::Path) -> Outcome<ClusterFile> {
    ClusterFile::read(path, &|name| std::env::var(name).ok()).map_err(Failure::input)
}

/// A node's configuration from the cluster file's entries at `indices`, ascending.
pub fn node_config(file: &ClusterFile, indices: &[usize], empty: bool) -> Outcome<NodeConfig> {
    let camera = |&index: &usize| {
        let entry = &file.cameras[index];
        let camera = file.rig.cameras()[index].clone();
        Ok(NodeCamera {
            ignored: ignored(entry, &camera)?,
            camera,
            rig_index: index as u16,
            source: if empty { emptied(entry)? } else { entry.source.clone() },
            background: entry.background.clone(),
            segmentation: entry.segmentation.clone(),
        })
    };
    let cameras = indices.iter().map(camera).collect::<Outcome<_>>()?;
    Ok(NodeConfig { cameras, settings: file.probes, fps: file.fps })
}

/// What each camera ignores, in rig order, from the masks that the cluster file names.
pub fn ignored_pixels(file: &ClusterFile) -> Outcome<Vec<Option<Silhouette>>> {
    file.cameras.iter().zip(file.rig.cameras()).map(|(entry, camera)| ignored(entry, camera)).collect()
}

/// The scene without the person.
fn emptied(entry: &CameraEntry) -> Outcome<SourceConfig> {
    if let SourceConfig::Stage(stage) = &entry.source {
        let mut stage = stage.clone();
        stage.person = false;
        return Ok(SourceConfig::Stage(stage));
    }
    entry.background.clone().ok_or_else(|| {
        Failure::input(format_args!("--empty: camera {:?} has no background to film instead", entry.name))
    })
}

fn ignored(entry: &CameraEntry, camera: &hull::Camera) -> Outcome<Option<Silhouette>> {
    let Some(path) = &entry.ignore_mask else { return Ok(None) };
    let context = OpenContext { fps: 1.0, clock: std::sync::Arc::new(|| 0.0) };
    let mut image = Image::default();
    let mut source = SourceConfig::Masks(FileConfig::new(path))
        .open(camera, entry.rig_index, &context)
        .map_err(Failure::input)?;
    source.next(0, &mut image).map_err(Failure::input)?;
    let mask: Vec<u8> = image.data.iter().map(|&pixel| u8::from(pixel > 127)).collect();
    let silhouette = Silhouette::from_mask(image.width, image.height, &mask);
    silhouette.map(Some).map_err(|error| Failure::unreadable(path, error))
}
