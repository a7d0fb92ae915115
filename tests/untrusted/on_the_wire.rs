//! What others see of a run, and what other programs make of it: the packets of one with certificates and of one without, and a
//! client that knows nothing but the .proto.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use crate::certified::{Room, node};
use crate::room::{Running, coordinator, figures, named_room, program};
use rustix::process::{Pid, Signal, kill_process};

/// A corner of the scene's boxes, body frame: a sample of the shape that every node is told.
const CORNER_M: [f32; 3] = [0.125, 0.055, 0.125];

/// The packets of a port of this machine.
struct Capture {
    tcpdump: Running,
    file: PathBuf,
}

impl Capture {
    /// Begins; nothing if this user may not, or tcpdump is not there.
    fn begin(folder: &Path, address: &str) -> Option<Capture> {
        if !testkit::has_program("tcpdump", "tcpdump") {
            return None;
        }
        let file = folder.join("packets.pcap");
        let port = address.rsplit(':').next().expect("a port");
        let mut command = testkit::command("tcpdump");
        command.args(["-i", "lo", "-U", "-Z", "root", "-w"]).arg(&file).args(["tcp", "port", port]);
        let mut tcpdump = Running::start(command.stdout(Stdio::null()).stderr(Stdio::piped()));
        let said =
            BufReader::new(tcpdump.child().stderr.take().expect("piped")).lines().map_while(Result::ok);
        let mut lines = Vec::new();
        for line in said {
            if line.contains("listening on") {
                return Some(Capture { tcpdump, file });
            }
            lines.push(line);
        }
        testkit::skip(format_args!("tcpdump captures nothing: {}", lines.join("; ")));
        None
    }

    /// All that was seen.
    fn end(mut self) -> Vec<u8> {
        let id = Pid::from_child(self.tcpdump.child());
        kill_process(id, Signal::INT).expect("it runs");
        self.tcpdump.child().wait().expect("it ends");
        fs::read(&self.file).expect("packets")
    }
}

fn holds_known_body(packets: &[u8]) -> bool {
    let is_corner = |bytes: &[u8]| {
        let (numbers, _) = bytes.as_chunks::<4>();
        numbers.iter().zip(CORNER_M).all(|(&number, side)| f32::from_le_bytes(number).abs() == side)
    };
    packets.windows(12).any(is_corner)
}

#[test]
fn packets_hold_a_body_in_clear_text_and_none_with_certificates() {
    let room = Room::new();
    let Some(capture) = Capture::begin(room.folder.path(), room.nodes[0].address()) else { return };
    figures(Running::start(&mut room.coordinator("2")), &room.json());
    let encrypted = capture.end();

    let folder = tempfile::tempdir().expect("a folder");
    let unbound = named_room(folder.path(), "", "");
    let nodes = ["left", "right"].map(|name| node(folder.path(), &unbound, name, &[]));
    let [left, right] = [&nodes[0], &nodes[1]].map(|node| format!("address = {:?}", node.address()));
    let (cluster, json) = (named_room(folder.path(), &left, &right), folder.path().join("out.json"));
    let Some(capture) = Capture::begin(folder.path(), nodes[0].address()) else { return };
    figures(Running::start(&mut coordinator(program(), &cluster, "2", &json)), &json);
    let plain = capture.end();

    assert!(encrypted.len() > 10_000 && plain.len() > 10_000, "{}, {} bytes", encrypted.len(), plain.len());
    assert!(holds_known_body(&plain), "a run in clear text shows where bodies are");
    assert!(!holds_known_body(&encrypted), "a run with certificates does not");
}

#[test]
fn a_python_client_asks_a_pass_with_certificates() {
    let Some(python) = std::env::var_os("HULLTOUCH_PYTHON") else {
        testkit::skip("HULLTOUCH_PYTHON names no Python with examples/python/requirements.txt");
        return;
    };
    let room = Room::new();
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/python/ask_a_node.py");
    let ask = |certs: &str| {
        let mut command = testkit::command(&python);
        command.arg(&program).current_dir(room.folder.path());
        command.args(["--address", room.nodes[0].address(), "--certs", certs]);
        command.args(["--name", "left.node.room.hulltouch", "--at", "0", "1.2", "0"]);
        command.output().expect("runs")
    };
    let output = ask("coordinator");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "health: SERVING");
    assert!(lines[1].ends_with(": cam_0, cam_1"), "{said}");
    let (inside, of) =
        lines[2].split_once(": ").and_then(|(_, count)| count.split_once(" of ")).expect("counts");
    assert!(inside.parse::<u32>().is_ok_and(|inside| inside > 100) && of.starts_with("1331"), "{said}");
    assert!(lines[3].starts_with("deepest ") && lines[3].ends_with(" mm"), "{said}");

    let output = ask("right");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && said.contains("PERMISSION_DENIED: this is for coordinator"),
        "{said}"
    );
}
