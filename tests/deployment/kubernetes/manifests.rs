//! Manifests and the tools that read them: kubectl, and Python with the packages of the tests.

use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;

/// The manifests' folder.
pub fn kubernetes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/kubernetes")
}

/// What is committed of an overlay.
pub fn built(overlay: &str) -> PathBuf {
    kubernetes().join(format!("built/{overlay}.yaml"))
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// What kubectl writes; none where it is not installed.
pub fn kubectl(arguments: &[&str]) -> Option<String> {
    match testkit::command("kubectl").args(arguments).output() {
        Ok(output) => {
            assert!(output.status.success(), "kubectl {arguments:?}: {}", text(&output.stderr));
            Some(text(&output.stdout))
        }
        Err(error) => {
            testkit::skip(format_args!("kubectl cannot be run: {error} (Debian package kubernetes-client)"));
            None
        }
    }
}

/// What Python makes of it; none where it is not set up.
fn python(arguments: &[&Path]) -> Option<Output> {
    let Some(python) = std::env::var_os("HULLTOUCH_PYTHON") else {
        testkit::skip("HULLTOUCH_PYTHON names no Python with tests/python/requirements.txt");
        return None;
    };
    Some(testkit::command(python).args(arguments).output().expect("HULLTOUCH_PYTHON runs"))
}

/// Resources of Kubernetes, parsed.
#[derive(Debug)]
pub struct Resources(Vec<Value>);

impl Resources {
    pub fn all(&self) -> &[Value] {
        &self.0
    }

    pub fn kinds(&self) -> Vec<&str> {
        self.0.iter().filter_map(|resource| resource["kind"].as_str()).collect()
    }

    /// The one of this kind and name.
    #[track_caller]
    pub fn one(&self, kind: &str, name: &str) -> &Value {
        let is_it = |resource: &&Value| resource["kind"] == kind && resource["metadata"]["name"] == name;
        self.0.iter().find(is_it).unwrap_or_else(|| panic!("there is no {kind} {name}"))
    }

    /// All of them as JSON.
    pub fn text(&self) -> String {
        self.0.iter().map(Value::to_string).collect()
    }
}

/// The resources of a file whose custom resources are valid, or why one is not; none without Python.
fn read_checked(path: &Path) -> Option<Result<Resources, String>> {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests");
    let output =
        python(&[&tests.join("python/manifests.py"), &tests.join("deployment/kubernetes/schemas"), path])?;
    if !output.status.success() {
        return Some(Err(text(&output.stderr)));
    }
    Some(Ok(Resources(serde_json::from_slice(&output.stdout).expect("JSON"))))
}

/// The resources of a file; none without Python.
pub fn read(path: &Path) -> Option<Resources> {
    read_checked(path).map(|resources| resources.unwrap_or_else(|why| panic!("{}: {why}", path.display())))
}

/// Holds manifests against the schemas of Kubernetes and of the custom resources: what is wrong with them. None without
/// Python.
pub fn check(manifests: &str) -> Option<Result<Resources, String>> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("manifests.yaml");
    std::fs::write(&path, manifests).expect("written");
    let words = ["-m", "kubernetes_validate", "--strict", "--quiet", "--no-warn"].map(Path::new);
    let output = python(&[&words[..], &[&path]].concat())?;
    if !output.status.success() {
        return Some(Err(text(&output.stdout) + &text(&output.stderr)));
    }
    read_checked(&path)
}
