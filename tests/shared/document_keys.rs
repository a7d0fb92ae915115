//! The keys of scenes and cluster files in docs/, held against what reads such files.

use std::collections::BTreeSet;

use setup::ClusterFile;
use sim::Scene;

use super::key_tables::{self, KeyRow, Refusal};
use super::rust_files::root;

#[test]
fn scene_keys_in_the_documents_are_those_that_are_read() {
    let text = std::fs::read_to_string(root().join("docs/scenes.md")).expect("a document");
    let body = "name = \"b\"\nshape.ball.radius = 0.1\nplace.stack.foot = [0, 0, 0]\n";
    let read = |heading: &str, entries: &[(String, String)]| {
        let keys: String = entries.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
        let text = match heading {
            "The file" => keys,
            "Shapes" | "Places" => format!("[[bodies]]\nname = \"b\"\n{keys}"),
            table => format!("{}\n{keys}", table.trim_matches('`')),
        };
        let scene = Scene::from_toml("scene", &text).map_err(Refusal::of)?;
        let (gravity, floor, bodies) = (scene.gravity_m_s2(), scene.floor(), scene.bodies(1));
        let stage = scene.stage().cloned().unwrap_or_default();
        Ok(format!("{gravity:?} {floor:?} {:?} {stage:?} {bodies:?}", scene.hull()))
    };
    let entry = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    for table in key_tables::tables(&text) {
        let variant = |key: &str| key.splitn(3, '.').take(2).collect::<Vec<_>>().join(".");
        // Beside a key of a shape or a place stand the others of it.
        let rest = |row: &KeyRow| {
            let other = if table.heading == "Shapes" {
                entry("place.at", "[0, 1, 0]")
            } else {
                entry("shape.ball.radius", "0.1")
            };
            let siblings = table.rows.iter().filter(|other| variant(&other.key) == variant(&row.key));
            let valued = siblings.map(|row| {
                let is_three = row.value.starts_with("three numbers");
                entry(&row.key, if is_three { "[0.1, 0.1, 0.1]" } else { "0.1" })
            });
            valued.chain([other]).collect()
        };
        let base = |row: &KeyRow| match &table.heading[..] {
            "Shapes" | "Places" if row.key == "shape.hull.points" => {
                vec![entry("place.at", "[0, 1, 0]")]
            }
            "Shapes" | "Places" => rest(row),
            // Mass and density exclude each other.
            "`[[bodies]]`" => vec![
                entry("name", "\"b\""),
                entry("shape", "{ ball = { radius = 0.1 } }"),
                entry("place", "{ stack = { foot = [0, 0, 0] } }"),
            ],
            _ => Vec::new(),
        };
        key_tables::hold(&table, &base, &read);
        let names: BTreeSet<&str> = table.rows.iter().map(|row| &row.key[..]).collect();
        match &table.heading[..] {
            "Shapes" | "Places" => {
                let of = if table.heading == "Shapes" { "shape" } else { "place" };
                let kinds: BTreeSet<&str> = names.iter().filter_map(|name| name.split('.').nth(1)).collect();
                let unknown = Scene::from_toml("scene", &format!("[[bodies]]\nname = \"b\"\n{of}.zz = 1"));
                let refusal = unknown.expect_err("unknown").to_string();
                assert_eq!(kinds, key_tables::expected_names(&refusal).into_iter().collect(), "{refusal}");
                for kind in kinds.iter().filter(|kind| **kind != "at") {
                    let keys = |key: &&str| key.starts_with(&format!("{of}.{kind}."));
                    let keys = names.iter().filter(|key| keys(key)).filter_map(|key| key.rsplit('.').next());
                    let unknown = format!("{body}{of}.{kind}.zz = 1");
                    let unknown = unknown.replace(
                        if of == "shape" {
                            "shape.ball.radius = 0.1\n"
                        } else {
                            "place.stack.foot = [0, 0, 0]\n"
                        },
                        "",
                    );
                    let refusal = Scene::from_toml("scene", &format!("[[bodies]]\n{unknown}"))
                        .expect_err("unknown")
                        .to_string();
                    assert_eq!(
                        keys.collect::<BTreeSet<_>>(),
                        key_tables::expected_names(&refusal).into_iter().collect(),
                        "{refusal}"
                    );
                }
            }
            heading => {
                let Refusal(refusal) = read(heading, &[entry("zz", "1")]).expect_err("unknown");
                assert_eq!(names, key_tables::expected_names(&refusal).into_iter().collect(), "{refusal}");
            }
        }
    }
}

#[test]
fn cluster_file_keys_in_the_documents_are_those_that_are_read() {
    let text = std::fs::read_to_string(root().join("docs/cluster-file.md")).expect("a document");
    let rig = root().join("deploy/kubernetes/overlays/room-a/rig.toml");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("room.cluster.toml");
    let entry = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    let lines = |entries: &[(String, String)]| -> String {
        entries.iter().map(|(key, value)| format!("{key} = {value}\n")).collect()
    };
    let file = [
        entry("rig", &format!("{:?}", rig.display().to_string())),
        entry("scene", "\"topple\""),
        entry("fps", "30"),
    ];
    let camera = |name: &str, more: &str| format!("[[camera]]\nname = \"{name}\"\n{more}\n");
    let stage = "source = { kind = \"stage\" }";
    let read = |heading: &str, entries: &[(String, String)]| {
        let others = camera("middle", stage) + &camera("right", stage);
        let source = |kind: &str| {
            let keys: Vec<String> = entries.iter().map(|(key, value)| format!("{key} = {value}")).collect();
            let source = format!("source = {{ kind = \"{kind}\", {} }}", keys.join(", "));
            camera("left", &format!("{source}\nbackground = {{ kind = \"video\", path = \"empty.y4m\" }}"))
        };
        let (top, rest) = match heading {
            "The file" => (lines(entries), camera("left", stage)),
            "`[[camera]]`" => (lines(&file), format!("[[camera]]\n{}", lines(entries))),
            "`[[node]]`" => {
                let nodes = format!("[[node]]\n{}", lines(entries));
                let of_it = format!("{stage}\nnode = \"n\"");
                let cameras = ["left", "middle", "right"].map(|name| camera(name, &of_it)).concat();
                (lines(&file), nodes + &cameras)
            }
            "`images`, `masks` and `video`" => (lines(&file), source("video")),
            "`pipe`" => (lines(&file), source("pipe")),
            "`stage`" => (lines(&file), source("stage")),
            table => (
                lines(&file),
                format!("{}\n{}{}", table.trim_matches('`'), lines(entries), camera("left", stage)),
            ),
        };
        let others = if heading == "`[[node]]`" { String::new() } else { others };
        std::fs::write(&path, top + &rest + &others).expect("written");
        let read = ClusterFile::read(&path, &|_| None);
        read.map(|file| format!("{file:?}")).map_err(Refusal::of)
    };
    for table in key_tables::tables(&text) {
        let base = |row: &KeyRow| match &table.heading[..] {
            "The file" => file.to_vec(),
            "`[[camera]]`" => vec![entry("name", "\"left\""), entry("source", "{ kind = \"stage\" }")],
            "`[[node]]`" => vec![entry("name", "\"n\"")],
            "`images`, `masks` and `video`" => vec![entry("path", "\"left.y4m\"")],
            "`pipe`" => vec![entry("command", "[\"camera\"]")],
            // Low thresholds are at most high ones.
            "`[segmentation]`" if row.key == "low" => vec![entry("high", "255")],
            _ => Vec::new(),
        };
        key_tables::hold(&table, &base, &read);
        let names: BTreeSet<&str> = table.rows.iter().map(|row| &row.key[..]).collect();
        let nothing = KeyRow::of("zz");
        let unknown: Vec<_> = base(&nothing).into_iter().chain([entry("zz", "1")]).collect();
        let Refusal(refusal) = read(&table.heading, &unknown).expect_err("unknown");
        assert_eq!(names, key_tables::expected_names(&refusal).into_iter().collect(), "{refusal}");
    }
}
