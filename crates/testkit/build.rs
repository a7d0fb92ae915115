//! Compiles the camera program of the tests. A binary target of this package would not be built for the tests of
//! another package, and in one of those packages it would be part of the product's build.

#![allow(clippy::disallowed_macros, reason = "Cargo reads what is printed")]

use std::env;
use std::path::PathBuf;
use std::process::Command;

fn main() {
    let source = "src/camera.rs";
    println!("cargo::rerun-if-changed={source}");
    let variable = |name: &str| env::var_os(name).unwrap_or_else(|| panic!("cargo sets {name}"));
    let mut rustc = Command::new(variable("RUSTC"));
    rustc.args(["--edition=2024", "--crate-name=camera", "-O", "--target"]).arg(variable("TARGET"));
    if let Some(linker) = env::var_os("RUSTC_LINKER") {
        rustc.arg("-C").arg(format!("linker={}", PathBuf::from(linker).display()));
    }
    let program = PathBuf::from(variable("OUT_DIR")).join("camera");
    let status = rustc.arg("-o").arg(&program).arg(source).status();
    assert!(status.is_ok_and(|status| status.success()), "rustc cannot compile {source}");
}
