//! Who segments: ours in each layout, and OpenCV in a process of its own.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use hull::Silhouette;
use segment::{BackgroundBuilder, Format, Segmenter};
use serde_json::{Value, json};
use setup::cli::{Failure, Outcome};

use super::scene::{Frames, LAYOUTS, Scene};
use crate::peers::Peer;
use crate::usage::thread_cpu_s;

/// The program.
pub const SCRIPT: &str = include_str!("../../peers/segment.py");
/// Its engines.
const PEERS: [&str; 3] = ["mog2", MOG2_I420, "difference"];
/// The one that takes I420; only of even sides.
const MOG2_I420: &str = "mog2_i420";

/// Ours, with one layout of one scene.
pub struct Ours<'a> {
    segmenter: Segmenter,
    film: &'a [Vec<u8>],
}

impl<'a> Ours<'a> {
    /// Learns the empty room; `layout` counts in [`LAYOUTS`].
    pub fn new(scene: &'a Scene, layout: usize) -> Outcome<Ours<'a>> {
        let format = Format::new(LAYOUTS[layout].1, scene.size.0, scene.size.1).map_err(Failure::run)?;
        let Frames { background, film } = &scene.frames[layout];
        let mut builder = BackgroundBuilder::new(format);
        for frame in background {
            builder.push(frame).map_err(Failure::run)?;
        }
        let model = builder.finish().map_err(Failure::run)?;
        let segmenter = Segmenter::new(&scene.settings, format, Some(&model)).map_err(Failure::run)?;
        Ok(Ours { segmenter, film })
    }

    /// Processor seconds of this thread for each frame: from bytes to a silhouette.
    pub fn turn(&mut self) -> Outcome<Vec<f64>> {
        let mut seconds = Vec::new();
        for frame in self.film {
            let began_s = thread_cpu_s();
            let found = self.segmenter.segment(std::hint::black_box(frame)).map_err(Failure::run)?;
            seconds.push(thread_cpu_s() - began_s);
            std::hint::black_box(&found);
        }
        Ok(seconds)
    }

    /// Intersection over union of each frame's silhouette with the truth.
    pub fn overlaps(&mut self, truth: &[Silhouette]) -> Outcome<Vec<f64>> {
        let mut overlaps = Vec::new();
        for (frame, truth) in self.film.iter().zip(truth) {
            let found = self.segmenter.segment(frame).map_err(Failure::run)?;
            overlaps.push(intersection_over_union(&found.silhouette.to_mask(), truth));
        }
        Ok(overlaps)
    }
}

/// OpenCV, with one scene at a time.
pub struct Opponent {
    /// The process; its greeting names its versions.
    pub peer: Peer,
}

impl Opponent {
    /// Its engines that can do with frames of that size.
    pub fn engines((width, height): (u32, u32)) -> Vec<&'static str> {
        let even = width.is_multiple_of(2) && height.is_multiple_of(2);
        PEERS.into_iter().filter(|&engine| even || engine != MOG2_I420).collect()
    }

    /// Hands over a scene's frames in RGB and I420 and lets it learn.
    pub fn take(&mut self, scene: &Scene) -> Outcome {
        let (width, height) = scene.size;
        let takes_i420 = Opponent::engines(scene.size).contains(&MOG2_I420);
        let mut request = json!({"do": "scene", "width": width, "height": height, "i420": takes_i420});
        for (layout, suffix) in ["", "_i420"].into_iter().enumerate() {
            let Frames { background, film } = &scene.frames[layout];
            for (part, frames) in [("background", background), ("film", film)] {
                let name = format!("{part}{suffix}");
                let path = self.peer.folder().join(format!("{name}.raw"));
                write_frames(&path, frames)?;
                request[name] = json!(path);
            }
        }
        self.peer.ask(&request).map(drop)
    }

    /// Processor seconds of its thread for each frame: from bytes to a mask.
    pub fn turn(&mut self, engine: &str) -> Outcome<Vec<f64>> {
        let answer = self.peer.ask(&json!({"do": "turn", "engine": engine}))?;
        let seconds = answer["seconds"].as_array().map(|all| all.iter().filter_map(Value::as_f64).collect());
        seconds.ok_or_else(|| Failure::run(format_args!("the Python program answered {answer}")))
    }

    /// Intersection over union of each frame's mask with the truth: as it is, or cleaned, whichever is better in
    /// the mean.
    pub fn overlaps(&mut self, engine: &str, scene: &Scene) -> Outcome<Vec<f64>> {
        let folder = self.peer.folder();
        let files = [folder.join("raw.masks"), folder.join("cleaned.masks")];
        let long = scene.size.0.max(scene.size.1);
        let request = json!({
            "do": "masks", "engine": engine, "raw": files[0], "cleaned": files[1],
            "open": 1 + (long + 320) / 640, "close": (4 * long + 320) / 640,
            "largest": scene.settings.keep_largest.is_some(),
        });
        self.peer.ask(&request)?;
        let mut best = Vec::new();
        for file in &files {
            let masks = std::fs::read(file).map_err(|error| Failure::unreadable(file, error))?;
            let pixels = scene.size.0 as usize * scene.size.1 as usize;
            let pairs = masks.chunks_exact(pixels).zip(&scene.truth);
            let overlaps: Vec<f64> =
                pairs.map(|(mask, truth)| intersection_over_union(mask, truth)).collect();
            if overlaps.iter().sum::<f64>() > best.iter().sum::<f64>() {
                best = overlaps;
            }
        }
        Ok(best)
    }
}

fn write_frames(path: &Path, frames: &[Vec<u8>]) -> Outcome {
    let written = File::create(path).and_then(|file| {
        let mut file = BufWriter::new(file);
        frames.iter().try_for_each(|frame| file.write_all(frame)).and_then(|()| file.flush())
    });
    written.map_err(|error| Failure::unwritable(path, error))
}

fn intersection_over_union(mask: &[u8], truth: &Silhouette) -> f64 {
    let (mut both, mut either) = (0u64, 0u64);
    for (&found, truth) in mask.iter().zip(truth.to_mask()) {
        both += u64::from(found != 0 && truth != 0);
        either += u64::from(found != 0 || truth != 0);
    }
    both as f64 / either.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlap_is_what_both_share_of_what_either_has() {
        let truth = Silhouette::from_mask(4, 1, &[1, 1, 1, 0]).expect("size");
        assert_eq!(intersection_over_union(&[0, 255, 255, 255], &truth), 0.5);
        assert_eq!(intersection_over_union(&[255, 255, 255, 0], &truth), 1.0);
    }
}
