//! Wrong tokens: after a few of them every token that the same machine offers is judged late, so that none can be guessed.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::time::Duration;

use parking_lot::Mutex;
use tokio::time::Instant;

/// So many wrong tokens of a machine are judged at once: pages of the run before, and mistakes.
const FREE: u32 = 5;
/// Then a token is judged so long after the one before: ten a second.
const TAKES: Duration = Duration::from_millis(100);
/// A token that would wait for longer is refused without being judged.
const LONGEST_WAIT: Duration = Duration::from_secs(2);
/// A machine is forgotten so long after its last wrong token.
const REMEMBERED: Duration = Duration::from_secs(60);
/// Machines that are remembered at most; then the one that has been quiet for longest is forgotten.
const MAX_MACHINES: usize = 256;
/// A line of the log so often at most.
const LOG_EVERY: Duration = Duration::from_secs(1);

/// The wrong tokens of all machines.
#[derive(Debug, Default)]
pub(crate) struct Guesses(Mutex<Counted>);

#[derive(Debug, Default)]
struct Counted {
    machines: HashMap<IpAddr, Machine>,
    logged: Option<Instant>,
    /// Wrong tokens of all machines since the last line.
    count: u64,
}

#[derive(Clone, Copy, Debug)]
struct Machine {
    wrong: u32,
    last: Instant,
    /// When its next token is judged at the earliest.
    next: Instant,
}

impl Guesses {
    /// Completes when a token of this machine may be judged; `false` if it must be refused instead. What is abandoned
    /// meanwhile has used its turn.
    pub async fn turn(&self, from: IpAddr) -> bool {
        let now = Instant::now();
        let at = {
            let mut counted = self.0.lock();
            match counted.machines.get_mut(&machine_of(from)) {
                Some(machine) if machine.wrong >= FREE && now - machine.last < REMEMBERED => {
                    let at = machine.next.max(now);
                    if at - now > LONGEST_WAIT {
                        return false;
                    }
                    machine.next = at + TAKES;
                    at
                }
                _ => return true,
            }
        };
        tokio::time::sleep_until(at).await;
        true
    }

    /// Counts a wrong token.
    pub fn wrong(&self, from: IpAddr) {
        let now = Instant::now();
        let mut counted = self.0.lock();
        counted.machines.retain(|_, machine| now - machine.last < REMEMBERED);
        if counted.machines.len() >= MAX_MACHINES
            && !counted.machines.contains_key(&machine_of(from))
            && let Some(quiet) =
                counted.machines.iter().min_by_key(|(_, machine)| machine.last).map(|(from, _)| *from)
        {
            counted.machines.remove(&quiet);
        }
        let new = Machine { wrong: 0, last: now, next: now };
        let machine = counted.machines.entry(machine_of(from)).or_insert(new);
        machine.wrong = machine.wrong.saturating_add(1);
        machine.last = now;
        counted.count += 1;
        if counted.logged.is_none_or(|logged| now - logged >= LOG_EVERY) {
            tracing::warn!("{} wrong tokens at the page's port, the last one from {from}", counted.count);
            (counted.logged, counted.count) = (Some(now), 0);
        }
    }
}

/// The address by which a machine is counted: of IPv6 a machine has a whole /64.
fn machine_of(from: IpAddr) -> IpAddr {
    match from.to_canonical() {
        IpAddr::V6(address) => IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() >> 64 << 64)),
        v4 => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> IpAddr {
        text.parse().expect("an address")
    }

    /// How many tokens of these addresses were judged within so many seconds, each address offering one every 10 ms and
    /// abandoning those that are not judged at once.
    async fn judged(guesses: &Guesses, from: &[&str], seconds: u64) -> usize {
        let (began, mut judged) = (Instant::now(), 0);
        while began.elapsed().as_secs() < seconds {
            for from in from {
                let turn = tokio::time::timeout(Duration::from_millis(1), guesses.turn(address(from)));
                if turn.await == Ok(true) {
                    guesses.wrong(address(from));
                    judged += 1;
                }
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        judged
    }

    #[tokio::test(start_paused = true)]
    async fn a_machine_guesses_ten_tokens_a_second_also_if_it_abandons_its_calls() {
        let guesses = Guesses::default();
        let judged = judged(&guesses, &["192.0.2.1"], 10).await;
        assert!(judged <= FREE as usize + 101, "{judged} tokens were judged");
    }

    #[tokio::test(start_paused = true)]
    async fn addresses_of_one_network_of_ipv6_are_one_machine() {
        let guesses = Guesses::default();
        let judged = judged(&guesses, &["2001:db8::1", "2001:db8::2", "2001:db8::3"], 10).await;
        assert!(judged <= FREE as usize + 101, "{judged} tokens were judged");
    }

    #[tokio::test(start_paused = true)]
    async fn other_machines_and_first_mistakes_do_not_wait() {
        let guesses = Guesses::default();
        for _ in 0..100 {
            guesses.wrong(address("192.0.2.1"));
        }
        let began = Instant::now();
        for _ in 0..FREE {
            assert!(guesses.turn(address("192.0.2.2")).await);
            guesses.wrong(address("192.0.2.2"));
        }
        assert_eq!(began.elapsed(), Duration::ZERO);
        tokio::time::sleep(REMEMBERED).await;
        let began = Instant::now();
        assert!(guesses.turn(address("192.0.2.1")).await);
        assert_eq!(began.elapsed(), Duration::ZERO, "it is forgotten");
    }

    #[tokio::test(start_paused = true)]
    async fn machines_are_bounded() {
        let guesses = Guesses::default();
        for machine in 0..1000_u32 {
            guesses.wrong(IpAddr::V4(machine.into()));
        }
        assert!(guesses.0.lock().machines.len() <= MAX_MACHINES);
    }
}
