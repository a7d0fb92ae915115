//! Small rooms of real nodes, each with something of its own.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Output;

use net::{AUTHORITIES, Authority, CERTIFICATE, Identity, KEY, Validity};
use serde_json::Value;
use testkit::Watch;

use crate::room::{Node, program};

/// The nodes, each of two cameras.
pub const NODES: [&str; 2] = ["left", "right"];

/// Lines of numbers that a camera says: longer than any test.
const NUMBERS: u32 = 20_000;

/// Writes the film of a grey bar before green, and the numbers that cameras of a rate may say of their frames.
fn write_film(folder: &Path, fps: u32) {
    let planes = [149, 43, 21].map(|plane| [vec![128; 691], vec![plane; 96 * 72 - 691]].concat());
    fs::write(folder.join("bar.film"), planes.concat()).expect("written");
    let time_ms = |frame: u32| 1000.0 * f64::from(frame) / f64::from(fps);
    let kinds: [(&str, &dyn Fn(u32) -> String); 3] = [
        ("counts", &|frame| frame.to_string()),
        ("times", &|frame| format!("{:.3}", 5000.0 + time_ms(frame))),
        // Set back by five seconds.
        ("back", &|frame| format!("{:.3}", time_ms(frame) + if frame > 30 { 0.0 } else { 5000.0 })),
    ];
    for (kind, line) in kinds {
        let text: String = (0..NUMBERS).map(|frame| line(frame) + "\n").collect();
        fs::write(folder.join(format!("{kind}-{fps}")), text).expect("written");
    }
}

/// A room and its nodes; what the doctor is told of it besides.
pub struct Room {
    pub folder: tempfile::TempDir,
    /// With the addresses at which the nodes listen.
    pub cluster: PathBuf,
    pub nodes: Vec<Node>,
    pub more: Vec<String>,
    text: String,
    is_certified: bool,
}

/// A room before its nodes run.
pub struct Plan {
    pub folder: tempfile::TempDir,
    /// The cluster file without nodes.
    pub text: String,
    pub is_certified: bool,
}

impl Plan {
    /// Cameras of the studio, ten frames a second.
    pub fn of_stage() -> Plan {
        Plan::of(10, |_, _| "source = { kind = \"stage\", motion = \"sweep\" }".to_owned())
    }

    /// Live cameras, twenty frames a second: phase, rate, and what each says; and a device's name that it ignores.
    pub fn of_live(cameras: [(f64, u32, &str); 4], devices: [&str; 4]) -> Plan {
        Plan::of(20, |folder, at| {
            let (phase, fps, says) = cameras[at];
            let side = match says {
                "counts" => "{counts}",
                "times" | "back" => "{times}",
                _ => "",
            };
            write_film(folder, fps);
            let path = |name: &str| folder.join(name).display().to_string();
            let mut words = vec![testkit::CAMERA.to_owned(), format!("film={}", path("bar.film"))];
            words.extend(["header=YUV4MPEG2 W96 H72 C444".to_owned(), format!("fps={fps}")]);
            words.push(format!("phase_s={}", phase / 20.0));
            if !side.is_empty() {
                words.extend([format!("side={side}"), format!("numbers={}", path(&format!("{says}-{fps}")))]);
            }
            let (device, other) = (devices[at], format!("camera-{at}"));
            words.push(if device.is_empty() { other } else { device.to_owned() });
            format!(
                "source = {{ kind = \"pipe\", live = true, command = {words:?} }}\nsegmentation = {{ method = \"chroma\" }}"
            )
        })
    }

    fn of(fps: u32, camera: impl Fn(&Path, usize) -> String) -> Plan {
        let folder = tempfile::tempdir().expect("a folder");
        let rig = stage::studio_rig(4, (96, 72)).expect("a rig");
        fs::write(folder.path().join("rig.toml"), rig.to_toml()).expect("written");
        let mut text = format!("rig = \"rig.toml\"\nscene = \"topple\"\nfps = {fps}\nlatency_s = 0.4\n");
        for (at, rigged) in rig.cameras().iter().enumerate() {
            let (name, node) = (rigged.name(), NODES[at / 2]);
            text += &format!("[[camera]]\nname = {name:?}\nnode = {node:?}\n{}\n", camera(folder.path(), at));
        }
        Plan { folder, text, is_certified: true }
    }

    /// Starts the nodes.
    pub fn run(self) -> Room {
        let Plan { folder, text, is_certified } = self;
        let path = folder.path();
        if is_certified {
            let authority = Authority::make("room", Validity::days(30)).expect("an authority");
            let owners = NODES.map(|name| (name, Identity::node("room", name)));
            for (name, owner) in owners.into_iter().chain([("coordinator", Identity::coordinator("room"))]) {
                issue(&path.join(name), &authority, &owner, Validity::days(30));
            }
        }
        let cluster = path.join("room.cluster.toml");
        let mut room = Room { folder, cluster, nodes: Vec::new(), more: Vec::new(), text, is_certified };
        room.write(["", ""]);
        room.nodes = NODES.map(|name| room.start(name)).into();
        room.set_addresses();
        room
    }
}

impl Room {
    /// Starts a node by the cluster file as it is now.
    pub fn start(&self, name: &str) -> Node {
        let mut command = program();
        command.current_dir(self.folder.path()).args(["node", "--listen", "127.0.0.1:0", "--host", name]);
        if self.is_certified {
            command.args(["--certs", name]);
        }
        Node::start_at(command, &self.cluster, &[])
    }

    /// Writes the addresses of the nodes into the cluster file.
    pub fn set_addresses(&self) {
        let [left, right] = [&self.nodes[0], &self.nodes[1]].map(Node::address);
        self.write([left, right]);
    }

    /// The cluster file with these addresses.
    pub fn write(&self, addresses: [&str; 2]) {
        let mut nodes = String::new();
        for (name, address) in NODES.iter().zip(addresses) {
            let address = if address.is_empty() { String::new() } else { format!("address = {address:?}\n") };
            nodes += &format!("[[node]]\nname = {name:?}\n{address}");
        }
        let text = self.text.replacen("[[camera]]", &format!("{nodes}[[camera]]"), 1);
        fs::write(&self.cluster, text).expect("written");
    }

    /// What the doctor says.
    pub fn doctor(&self) -> Output {
        let mut command = program();
        command
            .current_dir(self.folder.path())
            .arg("doctor")
            .arg(&self.cluster)
            .arg("--json")
            .args(&self.more);
        if self.is_certified && !self.more.iter().any(|word| word == "--certs") {
            command.args(["--certs", "coordinator"]);
        }
        command.output().expect("ends")
    }

    /// A file of an empty root that the doctor looks at for devices.
    pub fn plant(&mut self, files: &[(&str, &str)]) -> PathBuf {
        let root = self.folder.path().join("root");
        fs::create_dir_all(&root).expect("made");
        for (path, text) in files {
            let path = root.join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, text).expect("written");
        }
        self.more.extend(["--root".to_owned(), root.display().to_string()]);
        root
    }
}

/// Writes the certificates of an owner into a folder.
pub fn issue(folder: &Path, authority: &Authority, owner: &Identity, validity: Validity) {
    let issued = authority.issue(owner, &[], validity, None).expect("issued");
    fs::create_dir_all(folder).expect("a folder");
    fs::write(folder.join(AUTHORITIES), authority.certificate()).expect("written");
    fs::write(folder.join(CERTIFICATE), &issued.certificate).expect("written");
    fs::write(folder.join(KEY), &issued.key).expect("written");
    fs::set_permissions(folder.join(KEY), fs::Permissions::from_mode(0o600)).expect("set");
}

/// What is wrong: check, level and text of each line that is neither ok nor skipped.
pub fn wrong(output: &Output) -> Vec<Line> {
    let all = lines(output).into_iter();
    all.filter(|(_, level, _)| level == "warn" || level == "fail").collect()
}

/// The checks that judge real time: on a busy machine cameras film slower, and clocks are known less well.
const TIMED: [&str; 4] = ["clocks", "rates", "stamps", "phases"];

/// Whether the doctor found what it must: some lines that are wrong, and these alone. Panics if not; `false` if only checks
/// that judge time differ, on a machine that was too busy.
#[track_caller]
#[must_use]
pub fn finds(watch: &Watch, output: &Output, expected: &str, is_planted: impl Fn(&Line) -> bool) -> bool {
    let said = || format!("expected {expected}: {}", String::from_utf8_lossy(&output.stdout));
    let is_of_time = |line: &&Line| TIMED.contains(&line.0.as_str());
    let found = wrong(output);
    let (timed, others): (Vec<&Line>, Vec<&Line>) = found.iter().partition(is_of_time);
    assert!(others.into_iter().all(&is_planted), "{}", said());
    watch.holds(timed.into_iter().all(&is_planted), said)
}

/// Whether nothing is wrong, and the cameras were looked at: what is skipped is not well. As [`finds`].
#[track_caller]
#[must_use]
pub fn is_well_and_films(watch: &Watch, output: &Output) -> bool {
    if !finds(watch, output, "nothing wrong", |_| false) {
        return false;
    }
    let said = String::from_utf8_lossy(&output.stdout);
    let lines = lines(output);
    for check in ["rates", "stamps", "phases", "backgrounds"] {
        let levels: Vec<&str> =
            lines.iter().filter(|(of, _, _)| of == check).map(|(_, level, _)| &level[..]).collect();
        assert_eq!(levels, ["ok"], "{check}: {said}");
    }
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    true
}

/// Check, level and text.
pub type Line = (String, String, String);

/// Check, level and text of each line.
fn lines(output: &Output) -> Vec<Line> {
    let report: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)));
    let line =
        |line: &Value| ["check", "level", "what"].map(|key| line[key].as_str().expect("text").to_owned());
    report["checks"].as_array().expect("checks").iter().map(line).map(Into::into).collect()
}
