//! The units: they are valid, hardened, and start the program as it is.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::arguments::check_arguments;

const UNITS: [&str; 2] = ["hulltouch-node.service", "hulltouch-coordinator.service"];
const INSTALLED: &str = "/usr/local/bin/hulltouch";

fn units() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/systemd")
}

fn text(unit: &str) -> String {
    fs::read_to_string(units().join(unit)).expect("a unit")
}

/// What systemd-analyze makes of a unit of this text; none where it is not installed.
fn analyze(arguments: &[&str], unit: &str, text: &str) -> Option<Output> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(unit);
    fs::write(&path, text).expect("written");
    match testkit::command("systemd-analyze").args(arguments).arg(&path).output() {
        Ok(output) => Some(output),
        Err(error) => {
            testkit::skip(format_args!("systemd-analyze cannot be run: {error} (Debian package systemd)"));
            None
        }
    }
}

fn said(output: &Output) -> String {
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    format!("{out}{err}")
}

#[test]
fn the_units_are_valid_and_a_misspelt_key_is_not() {
    for unit in UNITS {
        let text = text(unit).replace(INSTALLED, env!("CARGO_BIN_EXE_hulltouch"));
        let Some(output) = analyze(&["verify"], unit, &text) else { return };
        assert!(output.status.success() && said(&output).is_empty(), "{unit}: {}", said(&output));
        let misspelt = text.replace("WatchdogSec=", "WatchDogSec=");
        let output = analyze(&["verify"], unit, &misspelt).expect("is there");
        assert!(said(&output).contains("WatchDogSec"), "{unit}: {}", said(&output));
    }
}

#[test]
fn the_units_are_exposed_by_two_of_ten_at_most() {
    let arguments = ["security", "--offline=yes", "--threshold=20", "--no-pager"];
    for unit in UNITS {
        let text = text(unit);
        let Some(output) = analyze(&arguments, unit, &text) else { return };
        assert!(output.status.success(), "{unit}: {}", said(&output));
        let open = text.replace("SystemCallFilter=", "# ").replace("CapabilityBoundingSet=", "# ");
        let output = analyze(&arguments, unit, &open).expect("is there");
        assert!(!output.status.success(), "without system calls and capabilities: {}", said(&output));
    }
}

#[test]
fn the_units_start_the_program_as_it_is_and_for_ever() {
    for unit in UNITS {
        let text = text(unit);
        let key = |key: &str| {
            let line = text.lines().find_map(|line| line.strip_prefix(key));
            line.unwrap_or_else(|| panic!("{unit} has no {key}"))
        };
        let words: Vec<&str> = key("ExecStart=").split_whitespace().collect();
        assert_eq!(words[0], INSTALLED);
        check_arguments(unit, &words[1..]);
        let kept = ["Type=", "Restart=", "StartLimitIntervalSec="].map(key);
        assert_eq!(kept, ["notify", "always", "0"], "{unit}");
        // What is loaded is a copy that is never renewed.
        assert!(!text.contains("LoadCredential"), "{unit}");
    }
    let node = text(UNITS[0]);
    for line in ["DeviceAllow=char-video4linux rw", "SupplementaryGroups=video"] {
        assert!(node.lines().any(|found| found == line), "{line}");
    }
    assert!(!node.lines().any(|line| line.starts_with("PrivateDevices=")), "it would hide the cameras");
}
