//! What must hold of whatever bytes come from outside: one function a decoder, which panics where it does not.
//! Fuzz targets call them, and so do tests with the files that fuzzing has left (`tests/shared/corpora.rs`).

#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use crate::cluster_file::ClusterFile;

/// A cluster file in a folder with a rig and images: one that is accepted has an entry for every camera, each at one
/// node, and can be told other latencies.
pub fn cluster_file(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let path = room().join("fuzz.cluster.toml");
    let variables = |name: &str| (name == "ROOM").then(|| room().display().to_string());
    let file = match ClusterFile::from_text(&path, &path, text, &variables) {
        Ok(file) => file,
        Err(error) => return assert!(!error.to_string().contains('\n'), "an error of one line: {error}"),
    };
    let count = file.rig.cameras().len();
    assert_eq!(file.cameras.len(), count, "an entry a camera");
    assert!(file.cameras.iter().map(|camera| camera.rig_index).eq(0..count), "in their order");
    let mut served: Vec<usize> = file.nodes.iter().flat_map(|node| node.cameras.clone()).collect();
    served.sort_unstable();
    assert!(served.into_iter().eq(0..count), "every camera at one node");
    // Neither may panic; whether a place or a live source is there, the file decides.
    drop(file.expected_nodes());
    if let Ok((changed, _)) = file.with_latencies(text, |_| 0.25) {
        assert!(
            ClusterFile::from_text(&path, &path, &changed, &variables).is_ok(),
            "what was changed:\n{changed}"
        );
    }
}

/// A message of multicast DNS that any machine of the network sends: what it announces is bounded, and it asks a node for
/// nothing if it is not a query.
pub fn dns_message(bytes: &[u8]) {
    crate::dns_sd::check_message(bytes);
}

/// The files that cluster files of the corpus name.
fn room() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/room")
}
