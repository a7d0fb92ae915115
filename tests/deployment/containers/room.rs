//! The room of compose.yaml under an engine.

use std::cell::Cell;
use std::fs;
use std::net::SocketAddr;
use std::os::unix::fs::chown;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use super::engine::{Engine, said};
use super::film::filmed_room;

/// The nodes of the room.
pub const NODES: [&str; 4] = ["north", "west", "south", "east"];
const PROJECT: &str = "room";
const BASE: &str = "debian-minbase";
/// Whom the image runs as.
const USER: u32 = 65532;
const METRICS: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 9465);
/// Seconds on a busy machine; far less on an idle one.
const WITHIN: Duration = Duration::from_secs(60);

/// Four nodes and a coordinator, as compose.yaml has them.
pub struct Room<'a> {
    engine: &'a Engine,
    folder: tempfile::TempDir,
    compose: PathBuf,
}

impl Room<'_> {
    /// Builds two images of the program, makes certificates, and starts all.
    pub fn start<'a>(engine: &'a Engine, base: &Path, deployed: &Path) -> Room<'a> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        ["context", "room", "certs"].iter().for_each(|name| fs::create_dir(path(name)).expect("made"));
        filmed_room(&deployed.join("room"), &path("room")).expect("written");
        chown(path("certs"), Some(USER), Some(USER)).expect("root may");
        engine.says(&["import", &base.display().to_string(), BASE]);
        // What it knows for debuggers is most of it.
        let mut strip = testkit::command("strip");
        strip.args(["-g", "-o"]).arg(path("context/hulltouch")).arg(env!("CARGO_BIN_EXE_hulltouch"));
        said(&mut strip);
        let file = deployed.join("Dockerfile").display().to_string();
        for version in ["1", "2"] {
            let tag = format!("hulltouch:{version}");
            let mut build = engine.docker();
            build.args(["build", "--quiet", "--file", &file, "--tag", &tag, "--build-arg"]);
            build.args([&format!("BUILDER={BASE}"), "--build-arg", "BINARY=hulltouch", "--build-arg"]);
            said(build.arg(format!("VERSION={version}")).arg(path("context")));
        }
        let room = Room { engine, folder, compose: deployed.join("compose.yaml") };
        room.composed(1, &["run", "--rm", "certs"]);
        room.composed(1, &["up", "--detach", "--no-build"]);
        room
    }

    /// The room by an image.
    fn composed(&self, version: u32, arguments: &[&str]) {
        let mut command = self.engine.client("docker-compose");
        command.arg("--file").arg(&self.compose).args(["--project-name", PROJECT]).args(arguments);
        command.env("HULLTOUCH_IMAGE", format!("hulltouch:{version}"));
        command.env("HULLTOUCH_ROOM", self.folder.path().join("room"));
        command.env("HULLTOUCH_CERTS", self.folder.path().join("certs")).env_remove("HULLTOUCH_USER");
        said(command.env("HULLTOUCH_TOKEN", "a-token-for-tests"));
    }

    /// Runs a service by the newer image.
    pub fn renew(&self, service: &str) {
        self.composed(2, &["up", "--detach", "--no-build", "--no-deps", service]);
        let image = self.of(service, "{{.Config.Image}}");
        assert_eq!(image, "hulltouch:2");
    }

    /// The container of a service.
    pub fn container(&self, service: &str) -> String {
        let label = format!("label=com.docker.compose.service={service}");
        self.engine.says(&["ps", "--all", "--quiet", "--filter", &label])
    }

    /// The network of the nodes.
    pub fn network(&self) -> String {
        let network = format!("{PROJECT}_room");
        assert_eq!(self.engine.says(&["network", "inspect", "--format", "{{.Internal}}", &network]), "true");
        network
    }

    /// When a service's process was started.
    pub fn began(&self, service: &str) -> String {
        self.of(service, "{{.State.StartedAt}}")
    }

    fn of(&self, service: &str, what: &str) -> String {
        self.engine.says(&["inspect", "--format", what, &self.container(service)])
    }

    /// What the coordinator has said.
    pub fn log(&self) -> String {
        let output = self.engine.docker().args(["logs", &self.container("coordinator")]).output();
        output.map(|output| String::from_utf8_lossy(&output.stderr).into_owned()).unwrap_or_default()
    }

    /// Waits until this is so.
    #[track_caller]
    pub fn until(&self, what: &str, is_so: impl Fn() -> bool) {
        let begun = Instant::now();
        while !is_so() {
            assert!(begun.elapsed() < WITHIN, "not so after {WITHIN:?}: {what}: {}", self.log());
            thread::sleep(Duration::from_millis(200));
        }
        eprintln!("{what}: after {:.1} s", begun.elapsed().as_secs_f64());
    }

    /// A figure of the coordinator: the sum of its series whose labels hold this.
    fn figure(&self, name: &str, label: &str) -> Option<f64> {
        let answer = self.engine.get(METRICS, "/metrics").ok()?;
        let values = answer.body.lines().filter(|line| line.contains(label)).filter_map(|line| {
            let rest = line.strip_prefix(name)?.strip_prefix('{')?;
            rest.rsplit_once("} ")?.1.parse::<f64>().ok()
        });
        values.reduce(|sum, value| sum + value)
    }

    /// Waits until all cameras are in use, frames are stepped, and bodies are inside the hull.
    #[track_caller]
    pub fn is_ready(&self) {
        let ready = || self.engine.get(METRICS, "/ready").is_ok_and(|answer| answer.status == 200);
        self.until("ready", ready);
        self.grows("hulltouch_coordinator_frames_total", 10.0);
        self.grows("hulltouch_coordinator_inside_samples_total", 1.0);
    }

    /// Waits until a node is left out, and frames are stepped without it.
    #[track_caller]
    pub fn goes_on_without(&self, node: &str) {
        let label = format!("node=\"{node}\"");
        self.until(&format!("{node} is left out"), || {
            self.figure("hulltouch_coordinator_camera_left_out", &label) == Some(1.0)
        });
        self.grows("hulltouch_coordinator_frames_total", 10.0);
        let hull = self.figure("hulltouch_coordinator_hull_in_use", "");
        assert_eq!(hull, Some(1.0), "three cameras make a hull: {}", self.log());
    }

    #[track_caller]
    fn grows(&self, name: &str, by: f64) {
        let first = Cell::new(None);
        self.until(&format!("{name} has grown by {by}"), || {
            let Some(now) = self.figure(name, "") else { return false };
            let before = first.get().unwrap_or(now);
            first.set(Some(before));
            now >= before + by
        });
    }

    /// Containers may do nothing, have no shell, and call themselves healthy.
    pub fn is_closed(&self) {
        let healthy = |service: &str| self.of(service, "{{.State.Health.Status}}") == "healthy";
        for service in NODES.into_iter().chain(["coordinator"]) {
            self.until(&format!("{service} is healthy"), || healthy(service));
            let limits = "{{.Config.User}} {{.HostConfig.CapDrop}} {{.HostConfig.SecurityOpt}}";
            assert_eq!(self.of(service, limits), format!("{USER}:{USER} [ALL] [no-new-privileges:true]"));
            assert_ne!(self.of(service, "{{.HostConfig.Memory}}"), "0");
        }
        let inside = |program: &str, arguments: &[&str]| {
            let mut command = self.engine.docker();
            command.args(["exec", &self.container("north"), program]).args(arguments);
            let output = command.output().expect("it runs");
            assert!(!output.status.success(), "{command:?}");
            String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
        };
        let shell = inside("/bin/sh", &["-c", "true"]);
        assert!(shell.contains("no such file"), "{shell}");
        let written =
            inside("/usr/local/bin/hulltouch", &["certs", "room.cluster.toml", "--into", "/tmp/certs"]);
        assert!(written.contains("Read-only file system"), "{written}");
    }
}
