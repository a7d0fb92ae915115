//! The examples for programs do what they say, against a running demo.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::demo::{Demo, TOKEN};
use serde_json::Value;
use testkit::{Watch, timely};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The Python that has what the examples need; CI makes one.
fn python() -> Option<Command> {
    let python = std::env::var_os("HULLTOUCH_PYTHON");
    if python.is_none() {
        testkit::skip("HULLTOUCH_PYTHON names no Python with examples/python/requirements.txt");
    }
    python.map(testkit::command)
}

#[track_caller]
fn text(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// A fenced block of a document: its language, what stands behind that, and its lines.
fn blocks(text: &str) -> impl Iterator<Item = (&str, &str, &str)> {
    text.split("\n```").skip(1).step_by(2).filter_map(|block| {
        let (head, lines) = block.split_once('\n')?;
        let (language, more) = head.split_once(' ')?;
        Some((language, more, lines))
    })
}

/// README.md and every page of docs/.
fn pages() -> Vec<PathBuf> {
    let (mut pages, mut folders) = (vec![root().join("README.md")], vec![root().join("docs")]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("documents") {
            let path = entry.expect("a document").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "md") {
                pages.push(path);
            }
        }
    }
    pages
}

/// Files that a page shows (`toml NAME`, `txt NAME`) lie in the folder in which its commands (`sh runnable`) run, beside the
/// project's folder `deploy`.
#[test]
fn commands_that_the_documents_mark_as_runnable_run() {
    const WORDS: &str = "hulltouch() { \"$PROGRAM\" \"$@\"; }\ncargo() { hulltouch \"$@\"; }\nset -e\n";
    let mut run = 0;
    for page in pages() {
        let name = page.display();
        let folder = tempfile::tempdir().expect("a folder");
        std::os::unix::fs::symlink(root().join("deploy"), folder.path().join("deploy")).expect("linked");
        let text = std::fs::read_to_string(&page).expect("a document");
        for (language, more, lines) in blocks(&text) {
            match (language, more) {
                ("toml" | "txt", file) => {
                    let path = folder.path().join(file);
                    std::fs::create_dir_all(path.parent().expect("its folder")).expect("made");
                    std::fs::write(path, lines).expect("written");
                }
                ("sh", "runnable") => {
                    let mut shell = testkit::command("sh");
                    shell.arg("-c").arg(format!("{WORDS}{lines}")).current_dir(folder.path());
                    shell.env("PROGRAM", env!("CARGO_BIN_EXE_hulltouch"));
                    let output = shell.output().expect("a shell");
                    let said = String::from_utf8_lossy(&output.stderr);
                    assert!(output.status.success(), "{name}: {lines}{said}");
                    run += 1;
                }
                _ => panic!(
                    "{name}: a block of {language} {more:?}, expected toml NAME, txt NAME or sh runnable"
                ),
            }
        }
    }
    assert!(run >= 12, "{run} blocks");
}

#[test]
fn the_python_program_follows_and_kicks_its_ball() {
    let Some(mut python) = python() else { return };
    let watch = Watch::start();
    let demo = Demo::start(&[]);
    let output = python
        .arg(root().join("examples/python/follow_and_push.py"))
        .args(["--address", &demo.address, "--token", TOKEN, "--seconds", "12"])
        .output()
        .expect("runs");
    let said = text(&output);
    assert!(said.starts_with("scene topple: right_stand, right_0"), "{said}");
    let last = said.lines().last().unwrap_or_default();
    let numbers: Vec<u32> = last.split(' ').filter_map(|word| word.parse().ok()).collect();
    assert!(last.ends_with("kicks") && numbers.len() == 2, "{last}");
    // Of a run without time for its steps fewer states come, and the ball does not come to rest.
    timely!(watch, numbers[0] > 60 && numbers[1] >= 1, "{last}: {said}");
}

#[test]
fn the_python_program_says_why_it_cannot() {
    let Some(mut python) = python() else { return };
    let demo = Demo::start(&[]);
    let output = python
        .arg(root().join("examples/python/follow_and_push.py"))
        .args(["--address", &demo.address, "--token", "not-the-token"])
        .output()
        .expect("runs");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("a viewer cannot steer"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[test]
fn the_python_printer_prints_what_comes_over_osc() {
    let Some(mut python) = python() else { return };
    python.arg(root().join("examples/python/osc_print.py")).args(["--port", "0", "--messages", "60"]);
    let mut printer = testkit::Running::start(python.stdout(Stdio::piped()));
    let mut lines =
        BufReader::new(printer.child().stdout.take().expect("piped")).lines().map_while(Result::ok);
    let first = lines.next().expect("it tells its port");
    let port = first.strip_prefix("listening on port ").expect("a port");
    let _demo = Demo::start(&["--osc", &format!("127.0.0.1:{port}")]);
    let printed: Vec<String> = lines.collect();
    assert!(printer.child().wait().expect("ends").success());
    assert_eq!(printed.len(), 60);
    assert!(printed.iter().any(|line| line.starts_with("/hulltouch/world 0 ")), "{printed:?}");
    assert!(printed.iter().any(|line| line.starts_with("/hulltouch/body/right_0/pose ")), "{printed:?}");
}

#[test]
fn the_javascript_of_the_page_follows_draws_and_spawns() {
    if !testkit::has_program("node", "nodejs") {
        return;
    }
    let demo = Demo::start(&[]);
    let output = testkit::command("node")
        // Newer ones have it without being asked.
        .arg("--experimental-websocket")
        .arg(root().join("tests/example.mjs"))
        .args([&demo.address, TOKEN])
        .output()
        .expect("runs");
    let found: Value = serde_json::from_str(&text(&output)).expect("JSON");
    assert_eq!((&found["body"], &found["bodies"]), (&Value::from(12), &Value::from(13)));
    assert!(found["refused"].as_str().is_some_and(|why| why.starts_with("a viewer cannot steer")), "{found}");
    let drawn = found["drawn"].as_array().expect("names");
    assert!(drawn.contains(&Value::from("mine")) && drawn.contains(&Value::from("left_4")), "{found}");
}
