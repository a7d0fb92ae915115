//! What systemd hears of this process: that it serves, how it is, that it works, that it ends. Says nothing where there is
//! no NOTIFY_SOCKET. A manager that reads nothing does not block the process: what it has no room for is dropped.

use std::ffi::OsStr;
use std::io;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

use crate::Pulse;
use sd_notify::NotifyState;
use tokio::time::{MissedTickBehavior, interval};

/// Where systemd listens.
const SOCKET: &str = "NOTIFY_SOCKET";
/// That it serves is said once, and a unit that never says it is restarted: it is worth a wait, while nothing is served yet.
const READY_TIMEOUT: Duration = Duration::from_secs(2);

/// It serves from now on.
pub fn ready(status: &str) {
    tell(&[NotifyState::Ready, NotifyState::Status(&one_line(status))], Some(READY_TIMEOUT));
}

/// How it is, in a short line.
pub fn status(status: &str) {
    tell(&[NotifyState::Status(&one_line(status))], None);
}

/// It was asked to end, and does.
pub fn stopping() {
    tell(&[NotifyState::Stopping], None);
}

/// Does the work of this process, and feeds the watchdog at half its time while all of it gets on. Both on one thread: if
/// that is blocked, the watchdog hears nothing either.
pub async fn watched<T>(pulse: &Pulse, work: impl Future<Output = T>) -> T {
    match sd_notify::watchdog_enabled() {
        Some(period) => fed(pulse, period / 2, || tell(&[NotifyState::Watchdog], None), work).await,
        None => work.await,
    }
}

/// Calls `feed` this often until the work is done, but not while something has been stuck for as long.
async fn fed<T>(pulse: &Pulse, every: Duration, feed: impl Fn(), work: impl Future<Output = T>) -> T {
    tokio::pin!(work);
    // An interval of no time is none.
    let mut ticks = interval(every.max(Duration::from_millis(1)));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_stuck = false;
    loop {
        tokio::select! {
            done = &mut work => return done,
            _ = ticks.tick() => {}
        }
        let stuck = pulse.stuck(every);
        match &stuck {
            None => feed(),
            Some(stuck) if !is_stuck => tracing::error!("{stuck}: systemd's watchdog is not fed"),
            Some(_) => {}
        }
        is_stuck = stuck.is_some();
    }
}

fn tell(states: &[NotifyState<'_>], wait: Option<Duration>) {
    let Some(place) = std::env::var_os(SOCKET) else { return };
    let message: String = states.iter().map(|state| format!("{state}\n")).collect();
    if let Err(error) = send(&place, &message, wait) {
        tracing::debug!("systemd cannot be told: {error}");
    }
}

/// Sends a datagram to a path or an abstract name (`@…`). While the receiver's queue is full it waits so long, or not at all.
fn send(place: &OsStr, message: &str, wait: Option<Duration>) -> io::Result<()> {
    let address = address(place)?;
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(wait.is_none())?;
    socket.set_write_timeout(wait)?;
    socket.send_to_addr(message.as_bytes(), &address).map(drop)
}

fn address(place: &OsStr) -> io::Result<SocketAddr> {
    #[cfg(target_os = "linux")]
    {
        use std::os::linux::net::SocketAddrExt as _;
        use std::os::unix::ffi::OsStrExt as _;
        if let Some(name) = place.as_bytes().strip_prefix(b"@") {
            return SocketAddr::from_abstract_name(name);
        }
    }
    SocketAddr::from_pathname(place)
}

/// What is sent ends at a line's end.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// How often it is fed in four of its times, when work was begun two of them ago or not at all. Tokio's
    /// clock is driven; that of the pulse is the system's, and can only be later.
    async fn feeds(begun: bool) -> usize {
        let (pulse, every) = (Pulse::default(), Duration::from_millis(40));
        let beat = pulse.beat("the work");
        if begun {
            beat.works();
            std::thread::sleep(every * 2);
        }
        let count = Cell::new(0);
        fed(&pulse, every, || count.set(count.get() + 1), tokio::time::sleep(every * 4)).await;
        count.get()
    }

    #[tokio::test(start_paused = true)]
    async fn work_that_waits_feeds_the_watchdog_and_work_that_is_stuck_does_not() {
        assert!(feeds(false).await > 1);
        assert_eq!(feeds(true).await, 0);
    }

    #[test]
    fn a_manager_that_reads_nothing_blocks_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("notify");
        let _manager = UnixDatagram::bind(&path).expect("a socket");
        let full = (0..100_000).find_map(|_| send(path.as_os_str(), "WATCHDOG=1\n", None).err());
        assert_eq!(full.map(|error| error.kind()), Some(io::ErrorKind::WouldBlock));
        let late = send(path.as_os_str(), "READY=1\n", Some(Duration::from_millis(10)));
        assert_eq!(late.map_err(|error| error.kind()), Err(io::ErrorKind::WouldBlock));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_manager_may_have_an_abstract_name() {
        let name = format!("@hulltouch-test-{}", std::process::id());
        let manager = UnixDatagram::bind_addr(&address(name.as_ref()).expect("a name")).expect("a socket");
        send(name.as_ref(), "READY=1\n", None).expect("sent");
        let mut bytes = [0; 64];
        let count = manager.recv(&mut bytes).expect("received");
        assert_eq!(bytes[..count], *b"READY=1\n");
    }
}
