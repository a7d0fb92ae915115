//! Machines of the network that announce what is not so, or anything at all: what it costs a node and a coordinator, and
//! whether the node is found.

use std::fs;
use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use net::{Authority, Identity, Validity};
use serde_json::Value;

use crate::announcements::{Announcer, instance, new_hosts};
use crate::certified::issue;
use crate::namespace::Host;
use crate::room::{Node, Running, coordinator, named_room, program};
use testkit::{Watch, timely};

/// What a flood may add to a process.
const MAX_GROWTH_KIB: u64 = 20 << 10;
/// The clock of `/proc` ticks so often a second.
const TICKS_PER_S: f64 = 100.0;

/// A host, or a skipped test.
fn host() -> Option<Host> {
    match Host::new(1000) {
        Ok(host) => Some(host),
        Err(why) => {
            testkit::skip(format_args!("no network namespaces: {why}"));
            None
        }
    }
}

/// The memory that a process has, and the time that the threads of its DNS-SD computed.
fn cost(process: u32) -> (u64, f64) {
    let status = fs::read_to_string(format!("/proc/{process}/status")).expect("it runs");
    let memory = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("it has memory");
    let memory = memory.trim().trim_end_matches(" kB").parse().expect("a number");
    let threads = fs::read_dir(format!("/proc/{process}/task")).expect("it runs");
    let ticks = |thread: fs::DirEntry| {
        // A thread may end meanwhile.
        let stat = fs::read_to_string(thread.path().join("stat")).unwrap_or_default();
        let (before, after) = stat.rsplit_once(") ")?;
        let numbers: Vec<&str> = after.split(' ').collect();
        let ticks = numbers[11].parse::<u64>().ok()? + numbers[12].parse::<u64>().ok()?;
        before.ends_with("(dns-sd").then_some(ticks)
    };
    (memory, threads.flatten().filter_map(ticks).sum::<u64>() as f64 / TICKS_PER_S)
}

/// The process in a namespace whose command begins so.
fn process_in(host: &Host, word: &str) -> u32 {
    let until = Instant::now() + Duration::from_secs(30);
    loop {
        for process in host.processes() {
            let command = fs::read_to_string(format!("/proc/{process}/cmdline")).unwrap_or_default();
            let mut words = command.split('\0');
            if words.next().is_some_and(|program| program.ends_with("hulltouch"))
                && words.next() == Some(word)
            {
                return process;
            }
        }
        assert!(Instant::now() < until, "no {word} runs there");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn answers_to_no_question_cost_a_node_neither_memory_nor_time() {
    let Some(host) = host() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let mut command = host.command(&program());
    command.args(["node", "--insecure", "--host", "left", "--listen", "0.0.0.0:7001"]);
    let _left = Node::start_at(command, &cluster, &[]);
    let (announcer, node) = (Announcer::beside(&host), process_in(&host, "node"));
    let watch = Watch::start();
    let (before_kib, before_s) = cost(node);
    announcer.flood(400_000, 134_000, new_hosts);
    let (_, slow_s) = cost(node);
    announcer.flood(28_000_000, 14_000_000, new_hosts);
    let (after_kib, _) = cost(node);
    assert!(after_kib < before_kib + MAX_GROWTH_KIB, "it grew from {before_kib} to {after_kib} KiB");
    timely!(watch, slow_s - before_s < 0.3, "it computed {} s in 3 s", slow_s - before_s);
}

#[test]
fn a_coordinator_that_looks_for_nodes_stays_small_whatever_is_announced() {
    let Some(host) = host() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let json = folder.path().join("out.json");
    let mut command = coordinator(host.command(&program()), &cluster, "1", &json);
    command.args(["--insecure", "--headless", "--patience", "300"]).stderr(Stdio::null());
    let _run = Running::start(&mut command);
    let (announcer, process) = (Announcer::beside(&host), process_in(&host, "coordinator"));
    let invented = |number: u32| {
        let node = if number.is_multiple_of(2) { "left" } else { "right" };
        instance(node, number, Ipv4Addr::from_bits(0x0a00_0000 + number), number as u16)
    };
    // What it takes to try as many addresses as are tried.
    announcer.flood(400_000, 134_000, invented);
    let (before_kib, _) = cost(process);
    announcer.flood(28_000_000, 7_000_000, invented);
    announcer.flood(400_000, 134_000, new_hosts);
    let (after_kib, _) = cost(process);
    assert!(after_kib < before_kib + MAX_GROWTH_KIB, "it grew from {before_kib} to {after_kib} KiB");
}

/// Both nodes of the room on a host, without certificates.
fn insecure_nodes(host: &Host, cluster: &Path) -> [Node; 2] {
    [("left", "0.0.0.0:7001"), ("right", "0.0.0.0:7002")].map(|(name, listens)| {
        let mut command = host.command(&program());
        command.args(["node", "--insecure", "--host", name, "--listen", listens]);
        Node::start_at(command, cluster, &[])
    })
}

/// Runs a coordinator while one machine announces so many instances of each node, at addresses where it says nothing or does
/// not listen. What the coordinator said.
fn run_beside_invented(host: &Host, folder: &Path, cluster: &Path, access: &[&str], count: u32) -> String {
    let announcer = Announcer::beside(host);
    let silent: Vec<TcpListener> =
        (0..4).map(|_| TcpListener::bind((announcer.address, 0)).expect("a port")).collect();
    let ports: Vec<u16> = silent.iter().map(|port| port.local_addr().expect("bound").port()).collect();
    let (json, watch, is_over) = (folder.join("out.json"), Watch::start(), AtomicBool::new(false));
    let mut command = coordinator(host.command(&program()), cluster, "2", &json);
    command.args(["--headless", "--patience", "20"]).args(access).current_dir(folder);
    let output = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                for number in 0..count {
                    let port = ports.get(number as usize).copied().unwrap_or(20_000 + number as u16);
                    for node in ["left", "right"] {
                        announcer.send(&instance(node, number, announcer.address, port));
                    }
                }
                // Two thousand messages a second: no query is answered sooner by the nodes.
                std::thread::sleep(Duration::from_millis(count.into()));
            }
        });
        let output = Running::start(&mut command).wait_with_output().expect("ends");
        is_over.store(true, Ordering::Relaxed);
        output
    });
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    timely!(watch, output.status.success(), "{count} instances: {}: {said}", output.status);
    said
}

#[test]
fn invented_instances_do_not_keep_a_coordinator_from_its_nodes() {
    let Some(host) = host() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (path, cluster) = (folder.path(), named_room(folder.path(), "", ""));
    let authority = Authority::make("room", Validity::days(30)).expect("an authority");
    let _nodes = [("left", "0.0.0.0:7001"), ("right", "0.0.0.0:7002")].map(|(name, listens)| {
        issue(&path.join(name), &authority, &Identity::node("room", name), Validity::days(30));
        let mut command = host.command(&program());
        command.current_dir(path).args(["node", "--certs", name, "--host", name, "--listen", listens]);
        Node::start_at(command, &cluster, &[])
    });
    issue(&path.join("coordinator"), &authority, &Identity::coordinator("room"), Validity::days(30));
    for count in [8, 200] {
        run_beside_invented(&host, path, &cluster, &["--certs", "coordinator"], count);
    }
}

#[test]
fn a_look_finds_nodes_that_another_machine_claims_to_be_before_they_answer() {
    let Some(host) = host() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let _nodes = insecure_nodes(&host, &cluster);
    let (announcer, watch, is_over) = (Announcer::beside(&host), Watch::start(), AtomicBool::new(false));
    let looks: Vec<_> = std::thread::scope(|scope| {
        scope.spawn(|| {
            for number in (0..1000).cycle().take_while(|_| !is_over.load(Ordering::Relaxed)) {
                for node in ["left", "right"] {
                    announcer.send(&instance(node, number.into(), announcer.address, 20_000 + number));
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        // One after the other: the nodes answer once a second, so they are late for most.
        let look = |_| {
            let mut command = host.command(&program());
            command.args(["status", "--insecure", "--json"]).arg(&cluster).output()
        };
        let looks = (0..8).map(look).collect();
        is_over.store(true, Ordering::Relaxed);
        looks
    });
    for look in looks {
        let look: Value = serde_json::from_slice(&look.expect("runs").stdout).expect("JSON");
        let nodes = look["nodes"].as_array().expect("nodes");
        assert_eq!(nodes.len(), 2, "{look}");
        timely!(watch, nodes.iter().all(|node| node.get("problem") == Some(&Value::Null)), "{look}");
    }
}

#[test]
fn without_certificates_several_that_claim_a_node_are_reported_in_one_line() {
    let Some(host) = host() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let _nodes = insecure_nodes(&host, &cluster);
    let said = run_beside_invented(&host, folder.path(), &cluster, &["--insecure"], 8);
    let lines =
        said.lines().filter(|line| line.contains("node left of room: ") && line.contains("by DNS-SD"));
    assert_eq!(lines.count(), 1, "{said}");
}
