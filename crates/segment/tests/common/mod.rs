//! Where the recordings of real people are, and how their frames are decoded.

use std::path::{Path, PathBuf};

use segment::Format;

/// The folder of the recordings: `HULLTOUCH_DATASETS`, or else `../shared/datasets`, both from the
/// workspace's root. `None`, with the reason reported, if the variable is not set and the folder is not there, or
/// without ffmpeg, which decodes them.
pub fn datasets() -> Option<PathBuf> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = manifest.ancestors().find(|folder| folder.join("Cargo.lock").is_file()).unwrap_or(manifest);
    let set = std::env::var_os("HULLTOUCH_DATASETS");
    let folder = root.join(set.clone().unwrap_or_else(|| "../shared/datasets".into()));
    if !folder.is_dir() {
        assert!(set.is_none(), "HULLTOUCH_DATASETS leads to {}, which is no folder", folder.display());
        testkit::skip(format_args!("{} is no folder and HULLTOUCH_DATASETS is not set", folder.display()));
        return None;
    }
    testkit::has_program("ffmpeg", "ffmpeg").then_some(folder)
}

/// Decoded frames of the format asked for, by ffmpeg's name of its layout.
pub fn frames(video: &Path, format: Format, pixel_format: &str, filter: &str) -> Vec<Vec<u8>> {
    let output = testkit::command("ffmpeg")
        .args(["-v", "error", "-nostdin", "-i"])
        .arg(video)
        .args(["-vf", filter, "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", pixel_format, "-"])
        .output()
        .expect("ffmpeg runs");
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "ffmpeg on {}: {complaint}", video.display());
    let size = format.frame_bytes();
    assert_eq!(output.stdout.len() % size, 0, "{} is not of {format:?}", video.display());
    output.stdout.chunks_exact(size).map(<[u8]>::to_vec).collect()
}
