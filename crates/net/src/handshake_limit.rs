//! How many TLS handshakes a server begins: each costs it a signature, whether the peer goes on or replays the first message
//! of another one.

use std::collections::HashMap;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Handshakes begun within a window.
const WINDOW: Duration = Duration::from_secs(1);
/// With one machine: a browser makes six connections for a page, a coordinator two.
const MAX_OF_A_MACHINE: u32 = 32;
/// With all machines: a twentieth of a processor.
const MAX_OF_ALL: u32 = 256;

/// Counts the handshakes that a server has begun within this second.
#[derive(Debug, Default)]
pub struct HandshakeLimit(Mutex<Window>);

#[derive(Debug, Default)]
struct Window {
    began: Option<Instant>,
    /// No more entries than handshakes of all machines.
    of_machine: HashMap<IpAddr, u32>,
    of_all: u32,
}

impl HandshakeLimit {
    /// Whether another handshake with this machine may begin. A trusted machine is not limited by what others have begun.
    pub fn admit(&self, machine: IpAddr, is_trusted: bool, now: Instant) -> bool {
        self.0.lock().admit(machine, is_trusted, now)
    }
}

impl Window {
    fn admit(&mut self, machine: IpAddr, is_trusted: bool, now: Instant) -> bool {
        if self.began.is_none_or(|began| now.saturating_duration_since(began) >= WINDOW) {
            *self = Window { began: Some(now), ..Window::default() };
        }
        if self.of_all >= MAX_OF_ALL && !is_trusted {
            return false;
        }
        let of_machine = self.of_machine.entry(machine).or_default();
        if *of_machine >= MAX_OF_A_MACHINE {
            return false;
        }
        *of_machine += 1;
        self.of_all += 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    #[test]
    fn a_flood_of_one_machine_leaves_handshakes_to_others() {
        let (mut window, began) = (Window::default(), Instant::now());
        let admitted = (0..5000).filter(|_| window.admit(machine(1), false, began)).count();
        assert_eq!(admitted, MAX_OF_A_MACHINE as usize);
        assert!(window.admit(machine(2), false, began));
        assert!(window.admit(machine(1), false, began + WINDOW), "in the next second again");
    }

    #[test]
    fn a_flood_of_many_machines_is_bounded_and_leaves_a_trusted_one_its_own() {
        let (mut window, now) = (Window::default(), Instant::now());
        let flood = (0..5000).map(|count| machine((count % 250) as u8));
        let admitted = flood.filter(|machine| window.admit(*machine, false, now)).count();
        assert_eq!(admitted, MAX_OF_ALL as usize);
        assert!(!window.admit(machine(251), false, now) && window.admit(machine(252), true, now));
        let trusted = (0..5000).filter(|_| window.admit(machine(252), true, now)).count();
        assert_eq!(trusted, MAX_OF_A_MACHINE as usize - 1);
        assert!(window.of_machine.len() <= MAX_OF_ALL as usize);
    }
}
