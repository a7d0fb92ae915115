//! Hosts of a test's own: network namespaces, each with one cable to this one.

use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// A host at the end of a cable. Its namespace ends with the test.
pub struct Host {
    name: String,
    /// The end of the cable here.
    cable: String,
    /// Its address.
    #[allow(dead_code, reason = "not every test needs it")]
    pub address: Ipv4Addr,
}

impl Host {
    /// A host, or why this machine makes none.
    pub fn new(rate_mbit_s: u32) -> Result<Host, String> {
        static MADE: AtomicU32 = AtomicU32::new(0);
        let (process, number) = (std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
        let (name, cable) = (format!("hulltouch{process}-{number}"), format!("ht{process}{number}"));
        // Four addresses for a cable, chosen by the process: its tests have sixteen, tests of other processes others.
        let block = (process % 1024) * 64 + number % 16 * 4;
        let network = u32::from(Ipv4Addr::new(10, 213, 0, 0)) + block % (1 << 16);
        let (ours, address) = (Ipv4Addr::from(network + 1), Ipv4Addr::from(network + 2));
        ip(&format!("netns add {name}"))?;
        let host = Host { name, cable, address };
        let Host { name, cable, .. } = &host;
        ip(&format!("link add {cable} type veth peer name eth0 netns {name}"))?;
        ip(&format!("address add {ours}/30 dev {cable}"))?;
        ip(&format!("link set {cable} up"))?;
        host.inside(&format!("ip address add {address}/30 dev eth0"))?;
        host.inside("ip link set eth0 up")?;
        host.inside("ip link set lo up")?;
        let limit = format!("root tbf rate {rate_mbit_s}mbit burst 32kbit latency 100ms");
        run("tc", &format!("qdisc add dev {cable} {limit}"))?;
        host.inside(&format!("tc qdisc add dev eth0 {limit}"))?;
        Ok(host)
    }

    /// The same program there.
    pub fn command(&self, program: &Command) -> Command {
        let mut command = testkit::command("ip");
        command.args(["netns", "exec", &self.name]).arg(program.get_program());
        command
    }

    /// The processes there.
    #[allow(dead_code, reason = "not every test needs it")]
    pub fn processes(&self) -> Vec<u32> {
        let found = testkit::command("ip").args(["netns", "pids", &self.name]).output();
        let found = found.map(|output| output.stdout).unwrap_or_default();
        String::from_utf8_lossy(&found).lines().filter_map(|line| line.trim().parse().ok()).collect()
    }

    fn inside(&self, command: &str) -> Result<(), String> {
        ip(&format!("netns exec {} {command}", self.name))
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // The cable goes with either end; it may not have been laid.
        let _ = ip(&format!("link delete {}", self.cable));
        let _ = ip(&format!("netns delete {}", self.name));
    }
}

fn ip(arguments: &str) -> Result<(), String> {
    run("ip", arguments)
}

fn run(program: &str, arguments: &str) -> Result<(), String> {
    let output = testkit::command(program).args(arguments.split(' ')).output();
    let output = output.map_err(|error| format!("{program}: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    Err(format!("{program} {arguments}: {}", String::from_utf8_lossy(&output.stderr).trim()))
}
