//! The benches of clusters run, and write the figures that the documents name.

use std::path::Path;

use serde_json::Value;

/// Runs a bench that must succeed; returns its JSON and what it printed.
#[track_caller]
fn bench(folder: &Path, arguments: &[&str]) -> (Value, String) {
    let json = folder.join("figures.json");
    let output = testkit::command(env!("CARGO_BIN_EXE_hulltouch-bench"))
        .args(arguments)
        .arg("--json")
        .arg(&json)
        .arg("--plot")
        .arg(folder.join("charts"))
        .output()
        .expect("runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    let text = std::fs::read_to_string(json).expect("written");
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    (serde_json::from_str(&text).expect("JSON"), printed)
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key} is a number in {row}"))
}

fn rows(figures: &Value) -> &Vec<Value> {
    figures["rows"].as_array().expect("rows")
}

#[test]
fn help_is_wrapped_once() {
    let commands = testkit::help_is_wrapped_once(env!("CARGO_BIN_EXE_hulltouch-bench"), &[]);
    assert!(
        ["query", "physics"].iter().all(|name| commands.iter().any(|command| command == name)),
        "{commands:?}"
    );
}

#[test]
fn cluster_times_passes_of_real_processes_and_models_larger_ones() {
    let folder = tempfile::tempdir().expect("folder");
    let arguments = ["cluster", "--nodes", "2,8", "--bodies", "2", "--size", "160x120", "--passes", "3"];
    let (figures, printed) = bench(folder.path(), &arguments);
    assert_eq!(figures["bench"], "cluster");
    assert!(figures["machine"]["cores"].is_number());
    let rows = rows(&figures);
    let key = |row: &Value| (number(row, "nodes"), row["response"].clone(), row["precision"].clone());
    let keys: Vec<_> = rows.iter().map(key).collect();
    let expected = [2.0, 8.0].into_iter().flat_map(|nodes| {
        ["paper", "contacts"]
            .map(|response| ["exact", "quantised"].map(|of| (nodes, response.into(), of.into())))
    });
    assert_eq!(keys, expected.flatten().collect::<Vec<_>>());
    let bytes = |row: usize| number(&rows[row], "bytes_per_node_pass");
    assert!(bytes(5) < bytes(4), "rounded numbers take fewer bytes");
    for row in rows {
        assert_eq!((number(row, "width"), number(row, "height"), number(row, "bodies")), (160.0, 120.0, 2.0));
        let (p50_ms, p99_ms, max_ms) = (number(row, "p50_ms"), number(row, "p99_ms"), number(row, "max_ms"));
        assert!(0.0 < p50_ms && p50_ms <= p99_ms && p99_ms <= max_ms, "{row}");
        assert!(number(row, "bytes_per_node_pass") > 100.0, "{row}");
        let inside = number(row, "inside_share");
        assert!((0.01..0.15).contains(&inside), "{row}");
        assert!(!row["stages"].as_array().expect("stages").is_empty(), "{row}");
        assert!(cfg!(not(target_os = "linux")) || number(row, "node_rss_mb") > 1.0, "{row}");
    }
    let scale = figures["scale"]["rows"].as_array().expect("the model's rows");
    assert!(scale.iter().any(|row| row["cameras"] == 256), "the model goes to 256 cameras");
    assert!(figures["scale"]["note"].as_str().expect("a note").starts_with("a model"));
    assert!(printed.contains("a model, not a measurement") && printed.contains("break first"), "{printed}");
    assert!(folder.path().join("charts/cluster_nodes_paper.svg").exists());
}

#[test]
fn bandwidth_counts_the_bytes_of_six_layouts() {
    let folder = tempfile::tempdir().expect("folder");
    let arguments = ["bandwidth", "--size", "160x120", "--cameras", "4", "--noise", "0,0.05"];
    let more = ["--bodies", "1,3", "--passes", "2"];
    let (figures, printed) = bench(folder.path(), &[&arguments[..], &more].concat());
    assert_eq!(figures["bench"], "bandwidth");
    let of = |layout: &str, bodies: u64, noise: f64| {
        let fits = |row: &&Value| {
            row["layout"] == layout
                && row["bodies"] == bodies
                && number(row, "noise") == noise
                && row["precision"] == "exact"
        };
        let row = rows(&figures).iter().find(fits).unwrap_or_else(|| panic!("a row of {layout}"));
        assert_eq!(
            (number(row, "width"), number(row, "height"), number(row, "cameras")),
            (160.0, 120.0, 4.0)
        );
        let (a_pass, a_second) = (number(row, "bytes_per_pass"), number(row, "bytes_per_s"));
        assert!((a_second - 120.0 * a_pass).abs() < 1.0, "{row}");
        a_second
    };
    // What travels holds at least the images: a byte a pixel, or a bit.
    let pixels_per_s = 30.0 * 4.0 * 160.0 * 120.0;
    let image_ratio = of("raw_images", 1, 0.0) / pixels_per_s;
    assert!((1.0..1.2).contains(&image_ratio), "{image_ratio}");
    let mask_ratio = of("bit_masks", 1, 0.0) / pixels_per_s * 8.0;
    assert!((1.0..2.0).contains(&mask_ratio), "{mask_ratio}");
    assert!(of("runs_lz4", 1, 0.0) < of("bit_masks", 1, 0.0), "clean silhouettes compress");
    assert!(of("runs", 1, 0.05) > 1.5 * of("runs", 1, 0.0), "noise makes runs");
    assert_eq!(of("runs", 3, 0.0), of("runs", 1, 0.0), "silhouettes do not depend on bodies");
    assert!(of("registered_bodies", 3, 0.0) > of("registered_bodies", 1, 0.0));
    assert!(of("raw_points", 3, 0.0) > 2.0 * of("registered_bodies", 3, 0.0));
    let crossings = figures["crossings"].as_array().expect("crossings");
    let against_images = crossings.iter().find(|crossing| crossing["against"] == "raw_images");
    assert!(number(against_images.expect("a crossing"), "bodies") > 1.0, "questions are less than images");
    assert!(printed.contains("fewer bytes than gathering") && printed.contains("10 Gbit/s"), "{printed}");
    assert!(folder.path().join("charts/bandwidth_bodies.svg").exists());
}

#[test]
fn sync_tells_how_exactly_planted_offsets_are_found() {
    let folder = tempfile::tempdir().expect("folder");
    let json = folder.path().join("sync.json");
    let output = testkit::command(env!("CARGO_BIN_EXE_hulltouch-bench"))
        .args(["sync", "--motion", "walk,idle", "--cameras", "3", "--size", "256x192", "--seconds", "3"])
        .args(["--runs", "2", "--json"])
        .arg(&json)
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let figures: Value = serde_json::from_slice(&std::fs::read(json).expect("written")).expect("JSON");
    let [walk, idle] = &rows(&figures)[..] else { panic!("two rows: {figures}") };
    assert_eq!((number(walk, "refused"), number(walk, "named_wrongly")), (0.0, 0.0), "{walk}");
    assert!((0.0..15.0).contains(&number(walk, "worst_ms")), "{walk}");
    assert_eq!((number(idle, "refused"), &idle["rms_ms"]), (2.0, &Value::Null), "{idle}");
}

#[test]
fn settings_out_of_bounds_are_refused() {
    for (arguments, word) in [
        (["cluster", "--nodes", "0"], "expected 1 to"),
        (["cluster", "--size", "64"], "expected WxH"),
        (["bandwidth", "--noise", "0.9"], "expected 0 to 0.5"),
        (["bandwidth", "--bodies", "x"], "expected 1 to"),
    ] {
        let output =
            testkit::command(env!("CARGO_BIN_EXE_hulltouch-bench")).args(arguments).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(word), "{said}");
    }
}

#[test]
fn feed_counts_what_a_page_is_sent_and_what_a_thin_link_leaves_of_it() {
    let folder = tempfile::tempdir().expect("folder");
    let arguments = ["feed", "--size", "160x120", "--cameras", "2", "--link", "0,0.4", "--seconds", "2"];
    let (figures, printed) = bench(folder.path(), &arguments);
    assert_eq!(figures["bench"], "feed");
    let [whole, thin] = &rows(&figures)[..] else { panic!("two rows in {figures}") };
    for row in [whole, thin] {
        assert_eq!((number(row, "cameras"), number(row, "fps")), (2.0, 30.0));
        assert!(number(row, "sets_per_s") > 1.0 && number(row, "bytes_per_set") > 100.0, "{row}");
        assert!(number(row, "step_p50_ms") > 0.0 && number(row, "step_p50_alone_ms") > 0.0, "{row}");
        assert!(number(row, "delay_p50_ms") <= number(row, "delay_max_ms"), "{row}");
    }
    assert!(whole["link_mbit_per_s"].is_null() && number(thin, "link_mbit_per_s") == 0.4);
    // What the kernel took before the link did may come in a turn's first moments.
    assert!(
        number(thin, "mbit_per_s") < 0.6 && number(thin, "mbit_per_s") < number(whole, "mbit_per_s"),
        "{figures}"
    );
    assert!(printed.contains("studio 160x120"), "{printed}");
    assert!(folder.path().join("charts/feed.svg").exists());
}

#[test]
fn a_closed_standard_output_ends_a_bench_without_a_word() {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut bench = testkit::command(env!("CARGO_BIN_EXE_hulltouch-bench"));
    let output = bench.args(["sync", "--runs", "1"]).env_remove("RUST_LOG").stdout(writer).output();
    let output = output.expect("runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(141), "{said}");
    assert!(!said.contains("panicked") && !said.contains("hulltouch-bench:"), "{said}");
}
