//! Where a node may be: what machines of the network announce about it, bounded for each machine and for all.
//!
//! Any machine may announce any name, and which announcement is true is known only once the node's certificate was
//! checked. So a machine that announces many does not take the place of one that announces once, and addresses that were
//! given to be tried before come after those that were not.

use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

/// Machines that announce a node, by the senders of their messages.
const MAX_SENDERS: usize = 16;
/// Addresses that one of them announces.
const MAX_ADDRESSES: usize = 256;
/// Addresses that a look gives.
const MAX_TRIED: usize = 128;
/// What was not announced for so long is forgotten.
const EXPIRY: Duration = Duration::from_secs(10);

/// All candidates of one node.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    senders: Vec<Sender>,
    /// Numbers the tries.
    tries: u64,
}

#[derive(Debug)]
struct Sender {
    ip: IpAddr,
    candidates: Vec<Candidate>,
}

#[derive(Debug)]
struct Candidate {
    address: SocketAddr,
    instance: u64,
    announced: Instant,
    /// Number of the last try, 0 before the first.
    tried: u64,
}

impl Candidates {
    /// A machine announces addresses of an instance.
    pub(super) fn announce(&mut self, from: IpAddr, instance: u64, addresses: &[SocketAddr], now: Instant) {
        if addresses.is_empty() {
            return;
        }
        let Some(sender) = self.sender(from, now) else { return };
        for &address in addresses {
            let new = Candidate { address, instance, announced: now, tried: 0 };
            let known = sender.candidates.iter_mut().find(|candidate| candidate.address == address);
            if let Some(known) = known {
                *known = Candidate { tried: known.tried, ..new };
            } else if sender.candidates.len() < MAX_ADDRESSES {
                sender.candidates.push(new);
            } else if let Some(replaced) = sender.replaceable(now) {
                *replaced = new;
            }
        }
    }

    /// A machine takes the announcement of an instance back; it cannot take back those of others.
    pub(super) fn withdraw(&mut self, from: IpAddr, instance: u64) {
        for sender in self.senders.iter_mut().filter(|sender| sender.ip == from) {
            sender.candidates.retain(|candidate| candidate.instance != instance);
        }
        self.senders.retain(|sender| !sender.candidates.is_empty());
    }

    /// Whether the node was announced since then.
    pub(super) fn are_announced(&self, since: Instant) -> bool {
        self.senders
            .iter()
            .flat_map(|sender| &sender.candidates)
            .any(|candidate| candidate.announced >= since)
    }

    /// What to try next, [`MAX_TRIED`] addresses at most: machines take turns, and each begins with what was not tried, or
    /// not for longest.
    pub(super) fn next(&mut self, now: Instant) -> Vec<SocketAddr> {
        self.forget_expired(now);
        for sender in &mut self.senders {
            sender.candidates.sort_by_key(|candidate| candidate.tried);
        }
        self.tries += 1;
        let (tries, mut next) = (self.tries, Vec::new());
        for turn in 0..MAX_ADDRESSES {
            for sender in &mut self.senders {
                let Some(candidate) = sender.candidates.get_mut(turn) else { continue };
                if next.len() == MAX_TRIED {
                    return next;
                }
                candidate.tried = tries;
                if !next.contains(&candidate.address) {
                    next.push(candidate.address);
                }
            }
        }
        next
    }

    /// Machines that announced the node since then, and how many instances: one, unless another program claims the node's
    /// name.
    pub(super) fn announcers(&self, since: Instant) -> (Vec<IpAddr>, usize) {
        let (mut machines, mut instances) = (Vec::new(), Vec::new());
        for sender in &self.senders {
            let recent = sender.candidates.iter().filter(|candidate| candidate.announced >= since);
            let known = instances.len();
            instances.extend(recent.map(|candidate| candidate.instance));
            if instances.len() > known {
                machines.push(sender.ip);
            }
        }
        instances.sort_unstable();
        instances.dedup();
        (machines, instances.len())
    }

    /// The machine's place; `None` if all are taken by machines that announce the node at present and were not tried.
    fn sender(&mut self, ip: IpAddr, now: Instant) -> Option<&mut Sender> {
        if let Some(at) = self.senders.iter().position(|sender| sender.ip == ip) {
            return Some(&mut self.senders[at]);
        }
        if self.senders.len() == MAX_SENDERS {
            self.forget_expired(now);
        }
        if self.senders.len() == MAX_SENDERS {
            let tried = self
                .senders
                .iter()
                .position(|sender| sender.candidates.iter().all(|candidate| candidate.tried > 0));
            self.senders.remove(tried?);
        }
        self.senders.push(Sender { ip, candidates: Vec::new() });
        self.senders.last_mut()
    }

    fn forget_expired(&mut self, now: Instant) {
        for sender in &mut self.senders {
            sender.candidates.retain(|candidate| now < candidate.announced + EXPIRY);
        }
        self.senders.retain(|sender| !sender.candidates.is_empty());
    }
}

impl Sender {
    /// What was tried longest ago, or is no longer announced.
    fn replaceable(&mut self, now: Instant) -> Option<&mut Candidate> {
        let may_go = |candidate: &&mut Candidate| candidate.tried > 0 || now >= candidate.announced + EXPIRY;
        self.candidates.iter_mut().filter(may_go).min_by_key(|candidate| candidate.tried)
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    const TRUE_NODE: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 1));
    const LIAR: IpAddr = IpAddr::V4(Ipv4Addr::new(192, 0, 2, 66));

    fn at(ip: IpAddr, port: u16) -> SocketAddr {
        SocketAddr::new(ip, port)
    }

    /// One machine announces instances at ports of its own from 1 on.
    fn invent(candidates: &mut Candidates, from: IpAddr, count: u16, now: Instant) {
        for port in 1..=count {
            candidates.announce(from, port.into(), &[at(LIAR, port)], now);
        }
    }

    #[test]
    fn a_machine_that_invents_instances_does_not_hide_the_node() {
        for count in [8, 200, 5000] {
            let (mut candidates, now) = (Candidates::default(), Instant::now());
            invent(&mut candidates, LIAR, count, now);
            candidates.announce(TRUE_NODE, 9999, &[at(TRUE_NODE, 7001)], now);
            invent(&mut candidates, LIAR, count, now);
            let next = candidates.next(now);
            assert!(
                next[..2].contains(&at(TRUE_NODE, 7001)),
                "{count}: it is among the first that are tried"
            );
            assert!(next.len() <= MAX_TRIED);
        }
    }

    #[test]
    fn what_was_tried_without_success_comes_last() {
        let (mut candidates, now) = (Candidates::default(), Instant::now());
        // On the node's own machine.
        invent(&mut candidates, TRUE_NODE, 200, now);
        candidates.announce(TRUE_NODE, 9999, &[at(TRUE_NODE, 7001)], now);
        assert!(!candidates.next(now).contains(&at(TRUE_NODE, 7001)));
        assert!(candidates.next(now).contains(&at(TRUE_NODE, 7001)));
    }

    #[test]
    fn what_was_tried_gives_its_place_to_what_was_not() {
        let (mut candidates, now) = (Candidates::default(), Instant::now());
        invent(&mut candidates, TRUE_NODE, 256, now);
        candidates.next(now);
        candidates.announce(TRUE_NODE, 9999, &[at(TRUE_NODE, 7001)], now);
        let (second, third) = (candidates.next(now), candidates.next(now));
        assert!(second.contains(&at(TRUE_NODE, 7001)) || third.contains(&at(TRUE_NODE, 7001)));
    }

    #[test]
    fn many_machines_are_bounded_and_one_that_was_tried_gives_its_place() {
        let (mut candidates, now) = (Candidates::default(), Instant::now());
        for last in 100..200 {
            invent(&mut candidates, IpAddr::V4(Ipv4Addr::new(192, 0, 2, last)), 300, now);
        }
        assert_eq!(candidates.senders.len(), MAX_SENDERS);
        assert!(candidates.senders.iter().all(|sender| sender.candidates.len() == MAX_ADDRESSES));
        candidates.announce(TRUE_NODE, 1, &[at(TRUE_NODE, 7001)], now);
        assert!(!candidates.senders.iter().any(|sender| sender.ip == TRUE_NODE));
        (0..2 * MAX_SENDERS).for_each(|_| drop(candidates.next(now)));
        candidates.announce(TRUE_NODE, 1, &[at(TRUE_NODE, 7001)], now);
        assert!(candidates.next(now).contains(&at(TRUE_NODE, 7001)));
    }

    #[test]
    fn a_machine_withdraws_what_it_announced_itself() {
        let (mut candidates, now) = (Candidates::default(), Instant::now());
        candidates.announce(TRUE_NODE, 1, &[at(TRUE_NODE, 7001)], now);
        candidates.withdraw(LIAR, 1);
        assert!(candidates.are_announced(now));
        candidates.withdraw(TRUE_NODE, 1);
        assert!(!candidates.are_announced(now));
        assert_eq!(candidates.next(now), []);
    }

    #[test]
    fn what_is_no_longer_announced_is_forgotten() {
        let (mut candidates, now) = (Candidates::default(), Instant::now());
        candidates.announce(TRUE_NODE, 1, &[at(TRUE_NODE, 7001)], now);
        assert_eq!(candidates.announcers(now), (vec![TRUE_NODE], 1));
        let later = now + Duration::from_millis(1);
        assert!(!candidates.are_announced(later));
        assert_eq!(candidates.announcers(later), (vec![], 0));
        assert_eq!(candidates.next(later), [at(TRUE_NODE, 7001)]);
        assert_eq!(candidates.next(now + EXPIRY), []);
    }

    #[test]
    fn two_that_claim_a_name_are_counted_and_one_with_two_addresses_is_not() {
        let (mut candidates, now) = (Candidates::default(), Instant::now());
        let both = [at(TRUE_NODE, 7001), at(IpAddr::V6(std::net::Ipv6Addr::LOCALHOST), 7001)];
        candidates.announce(TRUE_NODE, 1, &both, now);
        assert_eq!(candidates.announcers(now).1, 1);
        candidates.announce(LIAR, 2, &[at(LIAR, 7001)], now);
        assert_eq!(candidates.announcers(now), (vec![TRUE_NODE, LIAR], 2));
    }
}
