//! `hulltouch ready`: whether a node or a run does its work, for what looks after processes.

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use clap::Args;
use setup::cli::{Failure, Outcome, outln};

/// A service that does not answer within this is not ready.
const TIMEOUT: Duration = Duration::from_secs(3);
/// The longest answer.
const MAX_ANSWER_BYTES: u64 = 16 * 1024;

/// Ask a node or a coordinator that was started with --metrics whether it does its work: all its cameras film, and of a
/// coordinator, a hull is in use. Exit status 0: it does; 1: it does not, with one line that says what it lacks.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example, as a container's health check:\n  \
    hulltouch ready 127.0.0.1:9465")]
pub struct ReadyArguments {
    /// The address of its --metrics.
    #[arg(default_value = "127.0.0.1:9464")]
    address: SocketAddr,
}

/// Asks once.
pub fn run(arguments: &ReadyArguments) -> Outcome {
    let address = arguments.address;
    let answer = ask(address).map_err(|error| match error.kind() {
        // A socket whose time is over says that it would block.
        ErrorKind::TimedOut | ErrorKind::WouldBlock => {
            Failure::run(format_args!("{address}: no answer within {} s", TIMEOUT.as_secs()))
        }
        _ => Failure::run(format_args!("{address}: {error}")),
    })?;
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    let status = head.strip_prefix("HTTP/1.1 ").and_then(|rest| rest.get(..3));
    let line = proto::text::clean(body.lines().next().unwrap_or_default(), 300);
    match status {
        Some("200") => match outln!("{line}") {
            // A health check that reads no output still reads the status.
            Err(Failure::Closed) => Ok(()),
            shown => shown,
        },
        Some("503") => Err(Failure::run(format_args!("not ready: {line}"))),
        _ => Err(Failure::run(format_args!("{address}: its answer is not that of a port of --metrics"))),
    }
}

/// The whole answer, which must come in time.
fn ask(address: SocketAddr) -> io::Result<String> {
    let by = Instant::now() + TIMEOUT;
    let mut socket = TcpStream::connect_timeout(&address, TIMEOUT)?;
    socket.set_write_timeout(Some(TIMEOUT))?;
    write!(socket, "GET /ready HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")?;
    let (mut answer, mut part) = (Vec::new(), [0; 1024]);
    while answer.len() < MAX_ANSWER_BYTES as usize {
        let left = by.saturating_duration_since(Instant::now()).max(Duration::from_millis(1));
        socket.set_read_timeout(Some(left))?;
        match socket.read(&mut part) {
            Ok(0) => break,
            Ok(count) => answer.extend_from_slice(&part[..count]),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
        if Instant::now() >= by {
            return Err(ErrorKind::TimedOut.into());
        }
    }
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn who_says_nothing_is_named_with_the_time_it_had() {
        // It connects by itself, and gets no answer.
        let silent = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = silent.local_addr().expect("bound");
        let refused = run(&ReadyArguments { address }).expect_err("refused").to_string();
        assert_eq!(refused, format!("{address}: no answer within 3 s"));
    }
}
