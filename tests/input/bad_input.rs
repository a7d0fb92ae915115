//! Bad input gets one clear line, and the right exit status: 2 for what was given, 1 for a run that
//! failed.

use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn hulltouch() -> Command {
    testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
}

/// Runs it; it must end with `status` and one line that holds all of `words`.
#[track_caller]
fn check(arguments: &[&str], status: i32, words: &[&str]) {
    let output = hulltouch().args(arguments).env_remove("RUST_LOG").output().expect("runs");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{arguments:?} said {said}");
    let lines: Vec<&str> = said.lines().filter(|line| line.starts_with("hulltouch: ")).collect();
    assert_eq!(lines.len(), 1, "one line says why: {said}");
    for word in words {
        assert!(lines[0].contains(word), "expected {word:?} in {:?}", lines[0]);
    }
}

/// A rig and a cluster file of two small cameras; `source` is the text of every camera's source.
fn write_cluster(folder: &Path, source: &str) -> String {
    let rig = stage::studio_rig(2, (160, 120)).expect("a rig");
    std::fs::write(folder.join("rig.toml"), rig.to_toml()).expect("written");
    let mut text = "rig = \"rig.toml\"\nscene = \"topple\"\nfps = 30\n".to_owned();
    for camera in rig.cameras() {
        // Every camera runs a command of its own.
        let (name, source) = (camera.name(), source.replace("NAME", camera.name()));
        text += &format!("[[camera]]\nname = {name:?}\nnode = \"127.0.0.1:1\"\n{source}\n");
    }
    let path = folder.join("cluster.toml");
    std::fs::write(&path, text).expect("written");
    path.to_string_lossy().into_owned()
}

#[test]
fn wrong_words_of_demo() {
    check(&["demo", "--scene", "nosuch"], 2, &["--scene", "nosuch", "topple, lift, crowd"]);
    check(&["demo", "--cameras", "0"], 2, &["--cameras is 0", "1 to 1024"]);
    check(&["demo", "--size", "0x480"], 2, &["--size", "0 x 480"]);
    check(
        &["demo", "--response", "paper", "--hull-time", "between"],
        2,
        &["--hull-time between", "--response contacts"],
    );
    check(&["demo", "--fps", "nan"], 2, &["--fps is NaN"]);
    check(&["demo", "--seconds=-1"], 2, &["--seconds is -1"]);
    check(&["demo", "--recording", "/no/such.toml"], 2, &["/no/such.toml"]);
    check(&["demo", "--json", "/no/such/folder/out.json"], 2, &["--json /no/such/folder/out.json"]);
    let own_file = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    check(&["demo", "--json", own_file], 2, &["Cargo.toml", "holds no figures"]);
}

#[test]
fn wrong_words_of_sample_leave_no_file() {
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (new, held, nowhere) = (path("new"), path("held"), path("none/new"));
    check(&["sample", &new, "--cameras", "1"], 2, &["--cameras is 1, expected 2 to 64"]);
    check(&["sample", &new, "--size", "640x48"], 2, &["--size is 640x48", "64x64 to 4096x4096 pixels"]);
    check(&["sample", &new, "--seconds", "1e9"], 2, &["--seconds is 1000000000, expected 0.1 to 600"]);
    check(&["sample", &new, "--fps", "0"], 2, &["--fps is 0, expected 1 to 1000"]);
    check(&["sample", &nowhere], 2, &["cannot write", "none/new", "No such file"]);
    std::fs::create_dir(&held).expect("made");
    std::fs::write(path("held/mine.txt"), "").expect("written");
    let found = "held: found a folder that holds \"mine.txt\", expected ";
    check(&["sample", &held], 2, &[found, "a new or an empty folder"]);
    check(&["sample", &held, "--force"], 2, &[found, "a sample that --force replaces"]);
    let file = path("held/mine.txt");
    check(&["sample", &file], 2, &["mine.txt: found a file, expected a new or an empty folder"]);
    let left = std::fs::read_dir(folder.path()).expect("listed").flatten().map(|entry| entry.file_name());
    assert_eq!(left.collect::<Vec<_>>(), ["held"]);
}

#[test]
fn a_recording_that_cannot_be_written_is_refused_before_anything_starts() {
    let folder = tempfile::tempdir().expect("folder");
    let inside = folder.path().join("none/out.mcap");
    let (inside, itself) = (inside.to_string_lossy(), folder.path().to_string_lossy());
    let studio = ["--cameras", "2", "--size", "160x120", "--seconds", "0.2"];
    check(
        &[&["record", &inside], &studio[..]].concat(),
        2,
        &["cannot write", "none/out.mcap", "No such file"],
    );
    check(
        &[&["record", &itself, "--force"], &studio[..]].concat(),
        2,
        &["found a folder", "a file to write"],
    );
    check(&[&["demo", "--headless", "--record", &inside], &studio[..]].concat(), 2, &["cannot write"]);
    let mask = folder.path().join("cam_0.png");
    std::fs::write(&mask, b"\x89PNG\r\n\x1a\n").expect("written");
    let mask = mask.to_string_lossy();
    let over_mask = [&["record", &mask, "--force"], &studio[..]].concat();
    check(&over_mask, 2, &["cam_0.png", "found no recording", "that --force replaces"]);
    let new = folder.path().join("new.mcap");
    let new = new.to_string_lossy();
    let both = [&["record", &new, "--json", &new], &studio[..]].concat();
    check(&both, 2, &["--json", "new.mcap", "expected another file than that of the recording"]);
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    // No program listens at its nodes' address: waiting for them would end with status 1.
    check(&["record", &inside, "--cluster", &cluster], 2, &["cannot write"]);
}

#[test]
fn a_run_without_a_frame_fails() {
    let folder = tempfile::tempdir().expect("folder");
    let header_alone = "source = { kind = \"pipe\", command = [\"sh\", \"-c\", \"echo YUV4MPEG2 W160 H120 F30:1 C420 # NAME\"] }\n\
                        segmentation = { method = \"chroma\" }";
    let cluster = write_cluster(folder.path(), header_alone);
    for transport in ["inprocess", "cluster"] {
        let demo = ["demo", "--recording", &cluster, "--unpaced", "--headless", "--transport", transport];
        check(&demo, 1, &["frame"]);
    }
}

#[test]
fn wrong_words_of_node_and_coordinator() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    check(&["node", &cluster, "--camera", "cam_7"], 2, &["cam_7", "cam_0, cam_1"]);
    check(&["node", &cluster, "--camera", "cam_0", "--camera", "cam_0"], 2, &["given twice"]);
    let open = ["node", &cluster, "--camera", "cam_0", "--listen", "0.0.0.0:0"];
    check(&open, 2, &["0.0.0.0:0", "--insecure"]);
    check(&["coordinator", &cluster, "--patience=-3"], 2, &["--patience -3"]);
    check(&["coordinator", &cluster, "--patience", "0.2"], 1, &["127.0.0.1:1"]);
}

#[test]
fn a_host_that_the_cluster_file_lacks() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    check(&["node", &cluster], 2, &["has no [[node]] with a name", "--camera NAME"]);
    check(&["node", &cluster, "--host", "left"], 2, &["has no [[node]] with a name"]);
    let text = std::fs::read_to_string(&cluster).expect("written").replace("127.0.0.1:1", "left");
    let nodes = "[[node]]\nname = \"left\"\naddress = \"127.0.0.1:1\"\n[[camera]]";
    std::fs::write(&cluster, text.replacen("[[camera]]", nodes, 1)).expect("written");
    check(&["node", &cluster, "--host", "lfet"], 2, &["--host \"lfet\"", "cluster.toml has the nodes left"]);
    check(&["node", &cluster], 2, &["this host is ", "has the nodes left", "--host NAME"]);
    // Found by its name, it listens wherever machines reach it: not without consent.
    let text = std::fs::read_to_string(&cluster).expect("written");
    std::fs::write(&cluster, text.replace("address = \"127.0.0.1:1\"", "")).expect("written");
    check(&["node", &cluster, "--host", "left"], 2, &["0.0.0.0:7001", "--insecure"]);
    let output =
        hulltouch().args(["node", &cluster, "--host", "left", "--camera", "cam_0"]).output().expect("runs");
    assert_eq!(output.status.code(), Some(2), "one of the two: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_port_in_use_is_named() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("bound").to_string();
    check(&["node", &cluster, "--camera", "cam_0", "--listen", &address], 1, &[&address, "in use"]);
}

#[test]
fn a_program_that_fails_ends_a_lock_step_run_with_its_last_words() {
    let folder = tempfile::tempdir().expect("folder");
    let failing = "source = { kind = \"pipe\", command = [\"sh\", \"-c\", \"echo lens cap on >&2; exit 3 # NAME\"] }\n\
                   segmentation = { method = \"chroma\" }";
    let cluster = write_cluster(folder.path(), failing);
    for transport in ["inprocess", "cluster"] {
        let demo = ["demo", "--recording", &cluster, "--unpaced", "--headless", "--transport", transport];
        check(&demo, 1, &["cam_", "lens cap on", "3"]);
    }
}

#[test]
fn a_live_camera_whose_program_is_not_there_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let missing = "source = { kind = \"pipe\", live = true, command = [\"no-such-program-7\", \"NAME\"] }\n\
                   segmentation = { method = \"chroma\" }";
    let cluster = write_cluster(folder.path(), missing);
    for transport in ["inprocess", "cluster"] {
        let demo =
            ["demo", "--recording", &cluster, "--seconds", "9", "--headless", "--transport", transport];
        check(&demo, 1, &["cam_", "cannot start \"no-such-program-7 cam_", "\": No such file"]);
    }
}

#[test]
fn a_live_camera_that_fails_again_and_again_is_told_once_for_each_reason() {
    let folder = tempfile::tempdir().expect("folder");
    let failing = "source = { kind = \"pipe\", live = true, command = [\"sh\", \"-c\", \"echo lens cap $$ >&2; exit 3 # NAME\"] }\n\
                   segmentation = { method = \"chroma\" }";
    let cluster = write_cluster(folder.path(), failing);
    let demo = ["demo", "--recording", &cluster, "--seconds", "1", "--headless", "--transport", "inprocess"];
    let output = hulltouch().args(demo).env_remove("RUST_LOG").output().expect("runs");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "there never was a frame: {said}");
    for camera in ["cam_0", "cam_1"] {
        let is_its = |line: &&str| line.contains(camera) && line.contains("lens cap");
        let lines: Vec<&str> = said.lines().filter(is_its).collect();
        assert_eq!(lines.len(), 1, "{said}");
        assert!(lines[0].ends_with("; it is opened again until it films"), "{said}");
    }
}

#[test]
fn a_full_disk_is_told_and_leaves_nothing_half_written() {
    let demo = ["demo", "--cameras", "2", "--size", "160x120", "--seconds", "0.2", "--unpaced", "--headless"];
    let full = [&demo[..], &["--transport", "inprocess", "--json", "/dev/full"]].concat();
    check(&full, 1, &["/dev/full", "No space left"]);
}

/// The system's limit for paths of sockets is 107 bytes.
#[test]
fn node_processes_start_under_a_long_tmpdir_and_a_missing_one_is_named() {
    let folder = tempfile::tempdir().expect("folder");
    let long = folder.path().join("a folder ".repeat(12)).join("b".repeat(60));
    std::fs::create_dir_all(&long).expect("made");
    let demo = [
        "demo",
        "--cameras",
        "2",
        "--size",
        "160x120",
        "--seconds",
        "0.2",
        "--unpaced",
        "--headless",
        "--transport",
        "cluster",
    ];
    let run = |tmpdir: &Path| {
        let output = hulltouch().args(demo).env("TMPDIR", tmpdir).env_remove("RUST_LOG").output();
        let output = output.expect("runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (status, said) = run(&long);
    assert_eq!(status, Some(0), "{said}");
    let missing = folder.path().join("missing");
    let (status, said) = run(&missing);
    let expected = format!("cannot make a folder in {} (TMPDIR): ", missing.display());
    assert!(status == Some(1) && said.contains(&expected), "{status:?} {said}");
}

/// A standard output whose reader has gone, as under `| head -0`.
fn closed_pipe() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

/// Status 141 is what shells show of a program that SIGPIPE has ended.
#[test]
fn a_command_whose_output_is_closed_ends_quietly_after_its_work() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (rig, imported, figures) = (path("rig.toml"), path("imported.toml"), path("run.json"));
    let demo = [
        "demo",
        "--cameras",
        "2",
        "--size",
        "160x120",
        "--seconds",
        "0.2",
        "--unpaced",
        "--headless",
        "--transport",
        "inprocess",
        "--json",
        &figures,
    ];
    for arguments in [
        &["rig", "import", &rig, "--out", &imported][..],
        &["status", &cluster],
        &["doctor", &cluster],
        &demo,
    ] {
        let output = hulltouch().args(arguments).env_remove("RUST_LOG").stdout(closed_pipe()).output();
        let output = output.expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(141), "{arguments:?} said {said}");
        assert!(!said.contains("panicked") && !said.contains("hulltouch:"), "{arguments:?} said {said}");
    }
    for made in [imported, figures] {
        assert!(Path::new(&made).is_file(), "{made} was written before the end");
    }
}

#[test]
fn a_full_disk_behind_standard_output_is_one_line() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    let rig = folder.path().join("rig.toml").to_string_lossy().into_owned();
    let imported = folder.path().join("imported.toml").to_string_lossy().into_owned();
    for arguments in [&["rig", "import", &rig, "--out", &imported][..], &["status", &cluster]] {
        let full = std::fs::File::create("/dev/full").expect("there");
        let output = hulltouch().args(arguments).env_remove("RUST_LOG").stdout(full).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        let expected = "hulltouch: cannot write to standard output: No space left on device (os error 28)\n";
        assert_eq!((output.status.code(), &said[..]), (Some(1), expected), "{arguments:?}");
    }
}

/// The program that started it may read its address and go, or not read it at all.
#[test]
fn a_node_serves_though_its_output_is_closed() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    let socket = folder.path().join("node");
    let text = std::fs::read_to_string(&cluster).expect("text");
    let text = text.replace("127.0.0.1:1", &format!("unix:{}", socket.display()));
    std::fs::write(&cluster, text).expect("written");
    let mut command = hulltouch();
    command.args(["node", &cluster, "--camera", "cam_0", "--camera", "cam_1", "--stop-with-stdin"]);
    command.stdin(Stdio::piped()).stdout(closed_pipe()).stderr(closed_pipe());
    // It warns, on a standard error that is closed too.
    let mut node = testkit::Running::start(command.env("RUST_LOG", "debug"));
    let begun = Instant::now();
    while std::os::unix::net::UnixStream::connect(&socket).is_err() {
        assert!(node.child().try_wait().expect("asked").is_none(), "the node has ended");
        assert!(begun.elapsed() < Duration::from_secs(60), "the node does not listen");
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(node.child().stdin.take());
    assert!(node.child().wait().expect("reaped").success(), "the node went on serving");
}

#[test]
fn a_node_with_another_calibration_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("folder");
    let cluster = write_cluster(folder.path(), "source = { kind = \"stage\" }");
    let address = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr()).expect("a free port");
    let text = std::fs::read_to_string(&cluster).expect("text").replace("127.0.0.1:1", &address.to_string());
    std::fs::write(&cluster, &text).expect("written");
    let mut command = hulltouch();
    command.args(["node", &cluster, "--camera", "cam_0", "--camera", "cam_1", "--stop-with-stdin"]);
    let piped = || Stdio::piped();
    let mut node = testkit::Running::start(command.stdin(piped()).stdout(piped()));
    let mut line = String::new();
    let stdout = node.child().stdout.take().expect("piped");
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut line).expect("announces");
    // The coordinator's rig has since been calibrated again.
    let rig = stage::studio_rig(3, (160, 120)).expect("a rig");
    let moved = hull::Rig::new(rig.cameras()[1..].iter().enumerate().map(renamed).collect()).expect("a rig");
    std::fs::write(folder.path().join("rig.toml"), moved.to_toml()).expect("written");
    let coordinator = ["coordinator", &cluster, "--patience", "1"];
    check(&coordinator, 1, &["calibration", "cam_0", "not the rig's", &address.to_string()]);
    drop(node.child().stdin.take());
    assert!(node.child().wait().expect("reaped").success(), "the node went on serving");
}

fn renamed((index, camera): (usize, &hull::Camera)) -> hull::Camera {
    camera.clone().renamed(format!("cam_{index}"))
}
