//! The leader lease of a node: one coordinator at a time. There is no election; a node refuses all others while the lease holder
//! is connected.
//!
//! Plain decisions, but for what calls see of them: time is an argument.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};
use proto::{Claim, HolderStatus};
use thiserror::Error;
use tokio::time::Instant;
use tonic::{Request, Status};

use super::seat;
use super::seats::Seat;

/// A holder whose stream broke may come back for so long before another takes its place.
const GRACE: Duration = Duration::from_secs(3);
/// A connected holder sends a message twice a second. One that does not may have lost power, with its stream left open: it
/// may claim the node again.
const HEARD_WITHIN: Duration = Duration::from_millis(1500);
/// A node without a lease holder for so long stops its cameras.
pub(super) const DESERTED_AFTER: Duration = Duration::from_secs(10);
/// A coordinator that takes over claims the next term. So many may have been claimed meanwhile; one far above is there to end the order of
/// terms.
const MOST_TERMS_AHEAD: u64 = 1 << 16;
/// Streams of more who say who they are than would ever lead a node are not counted.
const MAX_STREAMS: usize = 64;

/// Another holds the node.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("held by {name} for {for_s} s, expected it to end, --take-over or --observe")]
pub(super) struct HeldBy {
    name: String,
    for_s: u64,
}

/// Why a claim is refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub(super) enum ClaimRefused {
    #[error(transparent)]
    Held(HeldBy),
    #[error("HoldRequest.term: is {found}, expected at most {most}")]
    Term { found: u64, most: u64 },
}

/// The hold on a node.
#[derive(Debug, Default)]
pub(super) struct Hold {
    held: Option<Held>,
    /// Open streams by who opened them.
    streams: HashMap<u64, usize>,
}

#[derive(Debug)]
struct Held {
    claim: Claim,
    since: Instant,
    /// When it was last heard of, while it has no stream.
    heard: Instant,
}

impl Hold {
    /// Claims the node. A connected holder is displaced by a higher term alone; one whose stream has ended, or that is
    /// silent, by its own restarted process, and after a while by any coordinator.
    pub fn claim(&mut self, claim: Claim, now: Instant) -> Result<(), ClaimRefused> {
        let most = self.term().saturating_add(MOST_TERMS_AHEAD);
        if claim.term > most {
            return Err(ClaimRefused::Term { found: claim.term, most });
        }
        match &mut self.held {
            Some(held) if held.claim.id == claim.id => {
                held.heard = now;
                return Ok(());
            }
            Some(held) => {
                let (has_stream, silent) = (self.streams.contains_key(&held.claim.id), now - held.heard);
                let is_itself = claim.name == held.claim.name && (!has_stream || silent > HEARD_WITHIN);
                let may_follow = claim.term > held.claim.term || is_itself || !has_stream && silent > GRACE;
                if !may_follow {
                    return Err(ClaimRefused::Held(held.refusal(now)));
                }
            }
            None => {}
        }
        self.held = Some(Held { claim, since: now, heard: now });
        Ok(())
    }

    /// Whether a peer of that id may change anything; id 0 is anonymous.
    pub fn check(&mut self, id: u64, now: Instant) -> Result<(), HeldBy> {
        let Some(held) = &mut self.held else { return Ok(()) };
        if held.claim.id == id {
            held.heard = now;
            return Ok(());
        }
        let is_gone = !self.streams.contains_key(&held.claim.id) && now - held.heard > GRACE;
        if is_gone { Ok(()) } else { Err(held.refusal(now)) }
    }

    /// Whether the last claim is of that id.
    pub fn is_holder(&self, id: u64) -> bool {
        self.held.as_ref().is_some_and(|held| held.claim.id == id)
    }

    /// A peer of that id opened a stream; false if it is not counted.
    pub fn stream_began(&mut self, id: u64) -> bool {
        // Untrusted peers must not keep the holder's own from being counted.
        let holds = self.held.as_ref().is_some_and(|held| held.claim.id == id);
        let has_room = holds || self.streams.len() < MAX_STREAMS || self.streams.contains_key(&id);
        if id != 0 && has_room {
            *self.streams.entry(id).or_default() += 1;
        }
        id != 0 && has_room
    }

    /// A stream that was counted ended; whether it was of who holds the node.
    pub fn stream_ended(&mut self, id: u64, now: Instant) -> bool {
        if let Some(count) = self.streams.get_mut(&id) {
            *count -= 1;
            if *count == 0 {
                self.streams.remove(&id);
            }
        }
        let held = self.held.as_mut().filter(|held| held.claim.id == id);
        held.map(|held| held.heard = now).is_some()
    }

    /// Whether the node has been without a lease holder for so long that its cameras may stop.
    pub fn is_deserted(&self, now: Instant) -> bool {
        self.held.as_ref().is_none_or(|held| {
            !self.streams.contains_key(&held.claim.id) && now - held.heard >= DESERTED_AFTER
        })
    }

    /// Who holds it, for who looks.
    pub fn holder(&self, now: Instant) -> Option<HolderStatus> {
        let Held { claim, since, heard: _ } = self.held.as_ref()?;
        Some(HolderStatus {
            name: claim.name.clone(),
            term: claim.term,
            held_s: (now - *since).as_secs_f64(),
            is_there: self.streams.contains_key(&claim.id),
        })
    }

    /// The term of the lease; 0 without a lease holder.
    pub fn term(&self) -> u64 {
        self.held.as_ref().map_or(0, |held| held.claim.term)
    }
}

/// The hold, as all calls share it.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedHold(Arc<Mutex<Hold>>);

impl SharedHold {
    pub fn lock(&self) -> MutexGuard<'_, Hold> {
        // No statement here panics between two changes.
        self.0.lock()
    }

    /// Whether a call with that id may change something, or cost time. The connection of the lease holder is known by it.
    pub fn check(&self, id: u64, seat: Option<&Seat>) -> Result<(), HeldBy> {
        let mut hold = self.lock();
        hold.check(id, Instant::now())?;
        if hold.is_holder(id) {
            drop(hold);
            seat.into_iter().for_each(|seat| seat.prove_lease(id));
        }
        Ok(())
    }

    /// The same of a call that is no stream.
    pub fn check_call<T>(&self, id: u64, request: &Request<T>) -> Result<(), Status> {
        self.check(id, seat(request).as_deref()).map_err(|by| held(&by))
    }
}

/// What a call of another hears.
pub(super) fn held(by: &HeldBy) -> Status {
    Status::aborted(by.to_string())
}

impl Held {
    fn refusal(&self, now: Instant) -> HeldBy {
        HeldBy { name: self.claim.name.clone(), for_s: (now - self.since).as_secs() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(id: u64, name: &str, term: u64) -> Claim {
        Claim { id, name: name.into(), term }
    }

    fn after(seconds: u64, began: Instant) -> Instant {
        began + Duration::from_secs(seconds)
    }

    #[test]
    fn no_claim_displaces_a_connected_holder() {
        let (mut hold, began) = (Hold::default(), Instant::now());
        assert_eq!(hold.check(0, began), Ok(()), "no lease holder");
        assert_eq!(hold.claim(claim(7, "first", 1), began), Ok(()));
        assert!(hold.stream_began(7));
        let late = after(100, began);
        let refused = hold.claim(claim(8, "second", 1), late).expect_err("held");
        assert_eq!(
            refused.to_string(),
            "held by first for 100 s, expected it to end, --take-over or --observe"
        );
        assert_eq!(hold.check(7, late), Ok(()));
        assert!(
            hold.claim(claim(9, "first", 1), late).is_err(),
            "its own name is not enough while it is there"
        );
        for id in [0, 8] {
            assert!(hold.check(id, late).is_err());
        }
        assert_eq!(hold.check(7, late), Ok(()));
        assert!(!hold.is_deserted(late));
    }

    #[test]
    fn one_that_lost_power_starts_over_though_its_stream_is_open() {
        let (mut hold, began) = (Hold::default(), Instant::now());
        hold.claim(claim(7, "first", 1), began).expect("free");
        hold.stream_began(7);
        assert_eq!(hold.check(7, after(10, began)), Ok(()));
        assert!(hold.claim(claim(8, "first", 1), after(11, began)).is_err(), "it may still be there");
        assert!(hold.claim(claim(9, "second", 1), after(12, began)).is_err(), "another");
        assert_eq!(hold.claim(claim(8, "first", 1), after(12, began)), Ok(()));
        assert!(hold.check(7, after(12, began)).is_err());
    }

    #[test]
    fn a_higher_term_takes_over_and_fences_the_old_one() {
        let (mut hold, began) = (Hold::default(), Instant::now());
        hold.claim(claim(7, "first", 1), began).expect("free");
        hold.stream_began(7);
        assert_eq!(hold.term(), 1);
        assert_eq!(hold.claim(claim(8, "second", 2), began), Ok(()));
        hold.stream_began(8);
        assert!(hold.check(7, began).is_err() && hold.claim(claim(7, "first", 1), began).is_err());
        hold.stream_ended(7, after(1, began));
        assert_eq!(hold.check(8, after(50, began)), Ok(()));
    }

    #[test]
    fn no_term_ends_the_order_of_terms() {
        let (mut hold, began) = (Hold::default(), Instant::now());
        for far in [u64::MAX - 1, MOST_TERMS_AHEAD + 1] {
            let refused = hold.claim(claim(7, "first", far), began).expect_err("refused").to_string();
            assert_eq!(refused, format!("HoldRequest.term: is {far}, expected at most {MOST_TERMS_AHEAD}"));
        }
        assert_eq!(hold.claim(claim(7, "first", MOST_TERMS_AHEAD), began), Ok(()));
        hold.stream_began(7);
        assert_eq!(hold.claim(claim(8, "second", MOST_TERMS_AHEAD + 1), began), Ok(()), "the next one");
    }

    #[test]
    fn one_that_is_gone_is_followed_at_once_by_itself_and_after_a_while_by_others() {
        let began = Instant::now();
        let gone = || {
            let mut hold = Hold::default();
            hold.claim(claim(7, "first", 1), began).expect("free");
            hold.stream_began(7);
            hold.stream_ended(7, after(20, began));
            hold
        };
        assert_eq!(gone().claim(claim(8, "first", 1), after(20, began)), Ok(()));
        assert!(gone().claim(claim(8, "second", 1), after(22, began)).is_err());
        assert!(gone().check(0, after(22, began)).is_err());
        assert_eq!(gone().claim(claim(8, "second", 1), after(24, began)), Ok(()));
        assert!(!gone().is_deserted(after(29, began)) && gone().is_deserted(after(30, began)));
    }

    #[test]
    fn streams_of_untrusted_peers_are_bounded() {
        let mut hold = Hold::default();
        assert!(!hold.stream_began(0));
        let counted = (1..1000).filter(|&id| hold.stream_began(id)).count();
        assert_eq!(counted, MAX_STREAMS);
        hold.stream_ended(500, Instant::now());
        assert!(hold.stream_began(1));
    }
}
