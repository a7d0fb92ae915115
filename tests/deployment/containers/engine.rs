//! Docker's engine for one test: in name spaces of its own, so that networks, firewall rules, mounts and containers end
//! with it, however the test ends.

use std::fs::{self, File};
use std::net::SocketAddr;
use std::os::fd::AsFd as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, geteuid, kill_process};
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

use crate::http::{Answer, try_get};

/// Debian's programs, whatever else is called `docker` on this machine.
const PATH: &str = "/usr/sbin:/usr/bin:/sbin:/bin";
/// The engine's own places: nothing of it is seen outside, nor survives it.
const INSIDE: &str = "mkdir -p /etc/docker && mount -t tmpfs none /etc/docker && mount -t tmpfs none /run \
    && ip link set lo up && exec dockerd \"$@\"";
const STARTS_WITHIN: Duration = Duration::from_secs(60);
/// A release of Debian under a folder of the target, for the next run.
const CACHE: &str = env!("CARGO_TARGET_TMPDIR");

/// An engine; it ends with all its containers when it is dropped, or when its test dies.
pub struct Engine {
    folder: tempfile::TempDir,
    keeper: Child,
    cgroup: String,
}

impl Engine {
    /// Starts one, or says why this machine has none.
    pub fn start() -> Result<Engine, String> {
        if !geteuid().is_root() {
            return Err("it needs root".into());
        }
        let needed = ["dockerd", "docker", "docker-compose", "debootstrap", "iptables", "unshare", "setpriv"];
        if let Some(missing) = needed.into_iter().find(|program| !is_there(program)) {
            return Err(format!("{missing} is not installed"));
        }
        let folder = tempfile::tempdir_in(CACHE).map_err(|error| format!("{CACHE}: {error}"))?;
        let cgroup = format!("hulltouch-test-{}", std::process::id());
        fs::write(folder.path().join("daemon.json"), "{}").map_err(|error| error.to_string())?;
        let log = File::create(folder.path().join("log")).map_err(|error| error.to_string())?;
        let at = |name: &str| folder.path().join(name).display().to_string();
        let keeper = contained()
            .args([
                "--net",
                "sh",
                "-c",
                INSIDE,
                "dockerd",
                "--host",
                &format!("unix://{}", at("docker.sock")),
            ])
            .args(["--data-root", &at("data"), "--exec-root", &at("exec"), "--pidfile", &at("pid")])
            .args(["--config-file", &at("daemon.json"), "--cgroup-parent", &format!("/{cgroup}")])
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .map_err(|error| format!("unshare: {error}"))?;
        let mut engine = Engine { folder, keeper, cgroup };
        engine.wait()?;
        Ok(engine)
    }

    fn wait(&mut self) -> Result<(), String> {
        let begun = Instant::now();
        loop {
            let asked = self.docker().arg("info").output().map_err(|error| format!("docker: {error}"))?;
            if asked.status.success() {
                return Ok(());
            }
            let ended = self.keeper.try_wait().map_err(|error| error.to_string())?;
            if ended.is_some() || begun.elapsed() > STARTS_WITHIN {
                let log = fs::read_to_string(self.folder.path().join("log")).unwrap_or_default();
                let last: Vec<&str> = log.lines().rev().take(3).collect();
                return Err(format!("Docker's engine does not start: {}", last.join("; ")));
            }
            thread::sleep(Duration::from_millis(100));
        }
    }

    /// The client of this engine.
    pub fn docker(&self) -> Command {
        self.client("docker")
    }

    /// One of its clients.
    pub fn client(&self, program: &str) -> Command {
        let mut command = testkit::command(program);
        let socket = self.folder.path().join("docker.sock");
        command.env("PATH", PATH).env("DOCKER_HOST", format!("unix://{}", socket.display()));
        command.env("DOCKER_CONFIG", self.folder.path()).stdin(Stdio::null());
        command
    }

    /// What the client says.
    #[track_caller]
    pub fn says(&self, arguments: &[&str]) -> String {
        said(self.docker().args(arguments))
    }

    /// Ends a process as the kernel does when memory runs out: the engine was not asked.
    pub fn kill(&self, process: &str) {
        let engine = self.process().expect("it runs").as_raw_pid().to_string();
        let mut command = testkit::command("nsenter");
        command.args(["--target", &engine, "--pid", "--mount", "sh", "-c", &format!("kill -KILL {process}")]);
        said(command.env("PATH", PATH));
    }

    /// Asks from the engine's machine.
    pub fn get(&self, address: SocketAddr, path: &str) -> std::io::Result<Answer> {
        let engine = self.process().ok_or(std::io::ErrorKind::NotFound)?.as_raw_pid();
        let network = File::open(format!("/proc/{engine}/ns/net"))?;
        let ask = || {
            move_into_link_name_space(network.as_fd(), Some(LinkNameSpaceType::Network))?;
            try_get(address, path)
        };
        // A thread of its own: other threads keep their network.
        thread::scope(|scope| scope.spawn(ask).join()).expect("no panic")
    }

    /// The engine itself: the first process of its name space.
    fn process(&self) -> Option<Pid> {
        let keeper = self.keeper.id();
        let children = fs::read_to_string(format!("/proc/{keeper}/task/{keeper}/children")).ok()?;
        Pid::from_raw(children.split_whitespace().next()?.parse().ok()?)
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        match self.process() {
            // The kernel ends all others of the name space first.
            Some(engine) => drop(kill_process(engine, Signal::KILL)),
            None => drop(self.keeper.kill()),
        }
        let _ = self.keeper.wait();
        let hierarchies = fs::read_dir("/sys/fs/cgroup").into_iter().flatten().flatten();
        let hierarchies = hierarchies.map(|entry| entry.path()).chain([PathBuf::from("/sys/fs/cgroup")]);
        hierarchies.for_each(|hierarchy| remove_groups(&hierarchy.join(&self.cgroup)));
    }
}

/// Removes a control group without processes, and those in it.
fn remove_groups(group: &Path) {
    for entry in fs::read_dir(group).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            remove_groups(&entry.path());
        }
    }
    let _ = fs::remove_dir(group);
}

/// Runs something in mounts and processes of its own, which end with the thread that started it.
fn contained() -> Command {
    let mut command = testkit::command("setpriv");
    command.args(["--pdeathsig", "KILL", "unshare", "--mount", "--pid", "--fork", "--kill-child"]);
    command.arg("--mount-proc").env("PATH", PATH).stdin(Stdio::null());
    command
}

/// A minimal Debian of this machine's release as an archive, made once, or why it cannot be made.
pub fn debian() -> Result<PathBuf, String> {
    let release = release()?;
    let archive = Path::new(CACHE).join(format!("debian-{release}-minbase.tar"));
    if archive.exists() {
        return Ok(archive);
    }
    let folder = tempfile::tempdir_in(CACHE).map_err(|error| format!("{CACHE}: {error}"))?;
    let (root, made) = (folder.path().join("root"), folder.path().join("tar"));
    let mut command = contained();
    command.args(["debootstrap", "--variant=minbase", &release]).arg(&root);
    done(command.arg("http://deb.debian.org/debian"))?;
    let mut command = testkit::command("tar");
    command.arg("--create").arg("--file").arg(&made).arg("--directory").arg(&root);
    done(command.args(["--exclude=./var/cache/apt/*", "--exclude=./usr/share/doc/*", "."]))?;
    fs::rename(&made, &archive).map_err(|error| error.to_string())?;
    Ok(archive)
}

/// This machine's release: the program was linked to its libraries.
fn release() -> Result<String, String> {
    let text = fs::read_to_string("/etc/os-release").unwrap_or_default();
    let value = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
    match (value("ID"), value("VERSION_CODENAME")) {
        (Some("debian"), Some(release)) => Ok(release.to_owned()),
        (id, _) => Err(format!("this is {}, and the base is made of Debian", id.unwrap_or("unknown"))),
    }
}

fn is_there(program: &str) -> bool {
    PATH.split(':').any(|folder| Path::new(folder).join(program).exists())
}

fn done(command: &mut Command) -> Result<Output, String> {
    let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
    if output.status.success() {
        return Ok(output);
    }
    let (said, failed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    Err(format!("{command:?}: {}: {} {}", output.status, said.trim(), failed.trim()))
}

/// What a command that must succeed writes.
#[track_caller]
pub fn said(command: &mut Command) -> String {
    match done(command) {
        Ok(output) => String::from_utf8_lossy(&output.stdout).trim().to_owned(),
        Err(why) => panic!("{why}"),
    }
}
