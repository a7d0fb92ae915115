//! The cameras of this machine: their devices, and the films of their empty rooms.

use std::path::{Path, PathBuf};

use camera_node::source::SourceConfig;
use rustix::fs::Access;
use setup::{CameraEntry, ClusterFile, NodeEntry};

use super::super::facts::{Device, DeviceFacts, Usb};
use crate::command::node::part::name_of_this_host;
use crate::run::security::leaves_this_machine;

/// What a camera's device is called.
const DEVICE: &str = "/dev/video";

/// The cameras that this machine films with: those of the node of that name, or of all that are here.
pub fn cameras<'a>(file: &'a ClusterFile, host: Option<&str>) -> Vec<&'a CameraEntry> {
    let own = name_of_this_host();
    let is_here = |node: &&NodeEntry| match (host, &node.address) {
        (Some(host), _) => node.name.as_deref() == Some(host),
        (None, Some(address)) => !leaves_this_machine(address) || node.name.as_ref() == Some(&own),
        (None, None) => node.name.is_none() || node.name.as_ref() == Some(&own),
    };
    let places = file.nodes.iter().filter(is_here).flat_map(|node| &node.cameras);
    places.filter_map(|place| file.cameras.get(*place)).collect()
}

/// Devices that their commands name. `root` is where `/dev` and `/sys` are.
pub fn devices(cameras: &[&CameraEntry], root: &Path) -> Vec<DeviceFacts> {
    let of_camera = |camera: &&CameraEntry| {
        let SourceConfig::Pipe(pipe) = &camera.source else { return Vec::new() };
        let paths = pipe.command.iter().filter_map(|word| device_of(word));
        let facts = |path: &str| DeviceFacts {
            camera: camera.name.clone(),
            path: path.to_owned(),
            found: look(root, path),
        };
        paths.map(facts).collect()
    };
    cameras.iter().flat_map(of_camera).collect()
}

/// The device that a word of a command names.
fn device_of(word: &str) -> Option<&str> {
    let path = &word[word.find(DEVICE)?..];
    let end = path[DEVICE.len()..].find(|c: char| !c.is_ascii_digit());
    Some(end.map_or(path, |end| &path[..DEVICE.len() + end]))
}

fn look(root: &Path, path: &str) -> Device {
    let there = root.join(path.trim_start_matches('/'));
    if !there.exists() {
        return Device::Missing;
    }
    if rustix::fs::access(&there, Access::READ_OK | Access::WRITE_OK).is_err() {
        return Device::Denied;
    }
    let name = path.rsplit('/').next().unwrap_or_default();
    Device::There(usb_of(&root.join("sys/class/video4linux").join(name).join("device")))
}

/// The USB device that a video device belongs to: the first folder above it with a bus's number.
fn usb_of(device: &Path) -> Option<Usb> {
    let device = device.canonicalize().ok()?;
    let usb = device.ancestors().find(|folder| folder.join("busnum").exists())?;
    let number = |file: &str| std::fs::read_to_string(usb.join(file)).ok()?.trim().parse().ok();
    Some(Usb { bus: number("busnum")?, speed_mbit_s: number("speed").unwrap_or_default() })
}

/// Films of empty rooms that are not there: of which camera, and where they should be.
pub fn missing_backgrounds(cameras: &[&CameraEntry]) -> Vec<(String, PathBuf)> {
    let missing = |camera: &&CameraEntry| {
        let path = background(camera).filter(|path| is_plain(path) && !path.exists())?;
        Some((camera.name.clone(), path.to_owned()))
    };
    cameras.iter().filter_map(missing).collect()
}

/// Where a camera's film of the empty room is.
pub fn background(camera: &CameraEntry) -> Option<&Path> {
    match camera.background.as_ref()? {
        SourceConfig::Images(files) | SourceConfig::Masks(files) | SourceConfig::Video(files) => {
            Some(&files.path)
        }
        SourceConfig::Stage(_) | SourceConfig::Pipe(_) => None,
    }
}

/// A file or folder, and no pattern of names.
fn is_plain(path: &Path) -> bool {
    !path.to_string_lossy().contains('%')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_found_in_the_words_that_programs_take() {
        for (word, expected) in [
            ("/dev/video0", Some("/dev/video0")),
            ("device=/dev/video12,fps=30", Some("/dev/video12")),
            ("v4l2:///dev/video3", Some("/dev/video3")),
            ("/dev/null", None),
            ("-i", None),
        ] {
            assert_eq!(device_of(word), expected, "{word}");
        }
    }
}
