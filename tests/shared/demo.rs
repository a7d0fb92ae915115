//! A demo of this program that serves programs, for tests that talk to it.

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::sync::mpsc::channel;
use std::time::Duration;

use testkit::Running;

/// What lets its holder steer.
pub const TOKEN: &str = "a-token-for-tests";

/// A live demo of three small cameras; it ends with its test, and its nodes with it.
pub struct Demo {
    _running: Running,
    /// Where its page is: host and port.
    pub address: String,
}

impl Demo {
    /// Starts one with more arguments, and waits until it serves.
    pub fn start(more: &[&str]) -> Demo {
        let mut command = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
        command
            .args(["demo", "--cameras", "3", "--size", "160x120", "--seconds", "600", "--headless"])
            .args(["--listen", "127.0.0.1:0"])
            .args(more)
            .env("HULLTOUCH_TOKEN", TOKEN)
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut running = Running::start(&mut command);
        let stderr = running.child().stderr.take().expect("piped");
        let (tell, told) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if let Some(address) = line.strip_prefix("page: http://") {
                    // The test may have given up.
                    let _ = tell.send(address.split('/').next().unwrap_or_default().to_owned());
                }
            }
        });
        let address = told.recv_timeout(Duration::from_secs(120)).expect("it tells where its page is");
        Demo { _running: running, address }
    }
}
