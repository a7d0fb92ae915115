//! What ARCHITECTURE.md promises of the code, held against the code.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Which of our crates a crate may depend on: dependencies point inward.
const ALLOWED: [(&str, &[&str]); 15] = [
    ("hull", &[]),
    ("calib", &["hull"]),
    ("segment", &["hull"]),
    ("stage", &["hull"]),
    ("sim", &["hull"]),
    ("proto", &["hull"]),
    ("camera-node", &["hull", "proto", "segment", "stage"]),
    ("coordinator", &["hull", "proto", "sim"]),
    ("feed", &["coordinator", "hull", "proto", "sim"]),
    ("recording", &["coordinator", "hull", "proto", "sim"]),
    ("cluster", &["camera-node", "coordinator", "feed", "hull", "proto", "segment", "sim"]),
    ("cli", &["camera-node", "cluster", "proto"]),
    (
        "bench",
        &["camera-node", "cli", "cluster", "coordinator", "feed", "hull", "proto", "segment", "sim", "stage"],
    ),
    ("bench/kernels", &["hull"]),
    (
        "hulltouch",
        &[
            "bench",
            "calib",
            "camera-node",
            "cli",
            "cluster",
            "coordinator",
            "feed",
            "hull",
            "proto",
            "recording",
            "segment",
            "sim",
            "stage",
        ],
    ),
];

fn manifest(folder: &Path) -> toml::Table {
    let text = std::fs::read_to_string(folder.join("Cargo.toml")).expect("a manifest");
    text.parse().expect("TOML")
}

#[test]
fn dependencies_point_inward() {
    let ours: BTreeSet<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    let members = manifest(&root())["workspace"]["members"].as_array().expect("a list").clone();
    let members: BTreeSet<&str> = members.iter().map(|member| member.as_str().expect("a name")).collect();
    assert_eq!(members, ours, "every crate of the workspace has its rule");
    for (name, allowed) in ALLOWED {
        let manifest = manifest(&root().join(name));
        let folder = name.rsplit('/').next();
        assert_eq!(manifest["package"]["name"].as_str(), folder, "folder name equals crate name");
        let dependencies = manifest["dependencies"].as_table().expect("a table");
        for dependency in dependencies.keys().filter(|dependency| ours.contains(&dependency[..])) {
            assert!(allowed.contains(&&dependency[..]), "{name} may not depend on {dependency}");
        }
    }
}

/// Every Rust file of a crate's `src` with its text.
fn sources(name: &str) -> Vec<(PathBuf, String)> {
    let mut folders = vec![root().join(name).join("src")];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = std::fs::read_to_string(&path).expect("text");
                found.push((path, text));
            }
        }
    }
    found
}

#[track_caller]
fn never_in(name: &str, words: &[&str], except: &[&str]) {
    for (path, text) in sources(name) {
        if except.iter().any(|allowed| path.ends_with(allowed)) {
            continue;
        }
        for (number, line) in text.lines().enumerate() {
            let code = line.split("//").next().unwrap_or_default();
            for word in words {
                assert!(!code.contains(word), "{}:{}: {word} has no place here", path.display(), number + 1);
            }
        }
    }
}

#[test]
fn the_hull_knows_no_files_clocks_threads_network_or_chance() {
    let words = [
        "std::fs",
        "std::io",
        "std::net",
        "std::time",
        "std::thread",
        "std::env",
        "std::process",
        "tokio",
        "tonic",
        "prost",
        "rapier",
        "async ",
        "Instant",
        "rand::",
    ];
    never_in("hull", &words, &[]);
}

#[test]
fn rapier_stays_in_sim_and_the_wire_in_its_two_files() {
    for (name, _) in ALLOWED.iter().filter(|(name, _)| *name != "sim") {
        never_in(name, &["rapier3d", "parry3d", "glam::"], &[]);
    }
    let wire = ["v1::", "proto::v1"];
    let service = [
        "service/mod.rs",
        "service/node.rs",
        "service/worker.rs",
        "service/probe_stream.rs",
        "service/film_events.rs",
    ];
    never_in("camera-node", &wire, &service);
    never_in("coordinator", &wire, &["camera_client.rs"]);
    never_in("feed", &wire, &["pictures.rs", "world_service.rs"]);
    for name in ["cluster", "cli", "bench", "hulltouch"] {
        never_in(name, &wire, &[]);
    }
    for name in ["hull", "calib", "segment", "stage", "sim"] {
        never_in(name, &["tonic::", "prost::", "tokio::"], &[]);
    }
}

#[test]
fn nothing_is_left_unfinished() {
    for (name, _) in ALLOWED {
        never_in(name, &["todo!(", "unimplemented!(", "#[ignore"], &[]);
    }
}
