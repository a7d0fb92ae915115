//! The connections that are in, and the memory that each of them holds: half-received messages, lists, questions that
//! wait, answers that are not sent yet. All of them share one budget.
//!
//! The machine that holds most gives way when it is spent, and whoever has said nothing for longest when the seats are: so
//! nobody keeps a coordinator out, and none of them has to be known for that.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use thiserror::Error;
use tokio::sync::Notify;
use tokio::time::Instant;

/// What all connections hold together, bytes: the largest message and its question with room for others, and with the largest
/// shapes less than 100 MiB.
pub(super) const MAX_HELD_BYTES: usize = 68 << 20;
/// Connections that have said who they are, all together.
const MAX_CONNECTIONS: usize = 32;
/// Of them, those of viewers: the others are left for coordinators.
const MAX_VIEWERS: usize = 16;
/// Connections of one machine that is not this one.
const MAX_OF_A_MACHINE: usize = 4;
/// A connection without a call ends after this.
const IDLE: Duration = Duration::from_secs(60);
/// One that has never called anything ends after this.
const SILENT: Duration = Duration::from_secs(5);
/// One that has said nothing for so long gives way to another. A coordinator is heard twice a second.
const GIVES_WAY_AFTER: Duration = Duration::from_secs(5);

/// Why somebody gets no seat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(super) enum NoSeat {
    #[error("it has {MAX_OF_A_MACHINE} connections already")]
    TooMany,
    #[error("there are as many connections as a node has")]
    Full,
}

/// The budget is spent, and nobody holds more than who asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "nobody holds more of the {} MiB that all connections share than this one, expected it to ask for less",
    MAX_HELD_BYTES >> 20
)]
pub(super) struct Spent;

/// All connections of a node.
#[derive(Debug, Default)]
pub(super) struct Seats {
    held_bytes: usize,
    next: u64,
    taken: HashMap<u64, Taken>,
}

#[derive(Debug)]
struct Taken {
    from: Option<IpAddr>,
    leads: bool,
    held_bytes: usize,
    calls: usize,
    has_called: bool,
    heard: Instant,
    ended: Arc<Notify>,
}

/// Why a connection was ended by the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ended {
    Silent,
    Idle,
    GaveWay,
    HeldMost,
}

impl Seats {
    /// A place for a connection of that machine (`None`: of this one); who had it before, if somebody gave way.
    fn sit(&mut self, from: Option<IpAddr>, leads: bool, now: Instant) -> Result<u64, NoSeat> {
        let of_machine = self.taken.values().filter(|seat| from.is_some() && seat.from == from).count();
        let viewers = self.taken.values().filter(|seat| !seat.leads).count();
        let no_seat = if of_machine >= MAX_OF_A_MACHINE {
            Some((NoSeat::TooMany, from, false))
        } else if self.taken.len() >= MAX_CONNECTIONS {
            Some((NoSeat::Full, None, false))
        } else if !leads && viewers >= MAX_VIEWERS {
            Some((NoSeat::Full, None, true))
        } else {
            None
        };
        if let Some((why, machine, viewers_alone)) = no_seat {
            let silent = |seat: &Taken| now.saturating_duration_since(seat.heard) >= GIVES_WAY_AFTER;
            let may_go = |seat: &Taken| {
                silent(seat) && (machine.is_none() || seat.from == machine) && !(viewers_alone && seat.leads)
            };
            let of_those = self.taken.iter().filter(|(_, seat)| may_go(seat));
            let (&oldest, _) = of_those.min_by_key(|(id, seat)| (seat.heard, **id)).ok_or(why)?;
            self.end(oldest, Ended::GaveWay);
        }
        self.next += 1;
        let seat = Taken {
            from,
            leads,
            held_bytes: 0,
            calls: 0,
            has_called: false,
            heard: now,
            ended: Arc::default(),
        };
        self.taken.insert(self.next, seat);
        Ok(self.next)
    }

    /// Forgets a connection, which ends soon. What it holds is free with it, a moment before its memory is.
    fn end(&mut self, id: u64, why: Ended) {
        if let Some(seat) = self.taken.remove(&id) {
            self.held_bytes -= seat.held_bytes;
            seat.ended.notify_one();
            let from = seat.from.map_or_else(|| "this machine".to_owned(), |from| from.to_string());
            let mib = |bytes: usize| bytes >> 20;
            match why {
                Ended::Silent => {
                    let seconds = SILENT.as_secs();
                    tracing::info!("a connection from {from} ended: it called nothing within {seconds} s");
                }
                Ended::Idle => {
                    let seconds = IDLE.as_secs();
                    tracing::info!("a connection from {from} ended: nothing was asked for {seconds} s");
                }
                Ended::GaveWay => {
                    tracing::warn!("a connection from {from} ended: it was silent, and another came");
                }
                Ended::HeldMost => {
                    let (held, all) = (mib(seat.held_bytes), mib(MAX_HELD_BYTES));
                    tracing::warn!(
                        "a connection from {from} ended: it held {held} MiB, most of the {all} that all share"
                    );
                }
            }
        }
    }

    /// Ends connections without a call.
    fn end_idle(&mut self, now: Instant) {
        let idle = |(&id, seat): (&u64, &Taken)| {
            let (within, why) = if seat.has_called { (IDLE, Ended::Idle) } else { (SILENT, Ended::Silent) };
            let is_idle = seat.calls == 0 && now.saturating_duration_since(seat.heard) >= within;
            is_idle.then_some((id, why))
        };
        let idle: Vec<_> = self.taken.iter().filter_map(idle).collect();
        idle.into_iter().for_each(|(id, why)| self.end(id, why));
    }

    /// What all connections of a connection's machine hold; of this machine each stands for itself.
    fn held_with(&self, id: u64) -> usize {
        let Some(seat) = self.taken.get(&id) else { return 0 };
        let same = |other: &&Taken| seat.from.is_some() && other.from == seat.from;
        let together: usize = self.taken.values().filter(same).map(|seat| seat.held_bytes).sum();
        together.max(seat.held_bytes)
    }

    fn hold(&mut self, id: u64, bytes: usize) -> Result<(), Spent> {
        if !self.taken.contains_key(&id) {
            return Err(Spent);
        }
        while self.held_bytes + bytes > MAX_HELD_BYTES {
            let most = |(id, seat): &(&u64, &Taken)| (self.held_with(**id), seat.held_bytes, **id);
            let (&richest, seat) = self.taken.iter().max_by_key(most).ok_or(Spent)?;
            let is_own = seat.from.is_some() && self.taken.get(&id).is_some_and(|own| own.from == seat.from);
            if richest == id || is_own || self.held_with(richest) <= self.held_with(id) + bytes {
                return Err(Spent);
            }
            self.end(richest, Ended::HeldMost);
        }
        self.held_bytes += bytes;
        if let Some(seat) = self.taken.get_mut(&id) {
            seat.held_bytes += bytes;
        }
        Ok(())
    }

    fn free(&mut self, id: u64, bytes: usize) {
        // Of one that was ended all was freed at once.
        if let Some(seat) = self.taken.get_mut(&id) {
            seat.held_bytes -= bytes;
            self.held_bytes -= bytes;
        }
    }
}

/// All connections, as everybody shares them.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedSeats(Arc<Mutex<Seats>>);

impl SharedSeats {
    fn lock(&self) -> MutexGuard<'_, Seats> {
        // No statement of it panics between two changes.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A seat for a connection from that machine; `None` is this one. What it holds counts if it is metered.
    pub fn take(&self, from: Option<IpAddr>, leads: bool, metered: bool) -> Result<Arc<Seat>, NoSeat> {
        let id = self.lock().sit(from, leads, Instant::now())?;
        Ok(Arc::new(Seat { seats: self.clone(), id, metered }))
    }

    /// What all of them hold.
    #[cfg(test)]
    pub fn held_bytes(&self) -> usize {
        self.lock().held_bytes
    }

    /// Ends connections without a call.
    pub fn end_idle(&self) {
        self.lock().end_idle(Instant::now());
    }
}

/// One connection's, until it is dropped.
#[derive(Debug)]
pub(super) struct Seat {
    seats: SharedSeats,
    id: u64,
    metered: bool,
}

impl Seat {
    /// Names the connection.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Completes when the node has ended it.
    pub fn ended(&self) -> Arc<Notify> {
        self.seats.lock().taken.get(&self.id).map_or_else(ended_already, |seat| Arc::clone(&seat.ended))
    }

    /// A whole message has come.
    pub fn heard(&self) {
        if let Some(seat) = self.seats.lock().taken.get_mut(&self.id) {
            seat.heard = Instant::now();
        }
    }

    /// A call begins (`true`) or has ended.
    pub fn call(&self, begins: bool) {
        if let Some(seat) = self.seats.lock().taken.get_mut(&self.id) {
            seat.calls = if begins { seat.calls + 1 } else { seat.calls - 1 };
            seat.has_called = true;
            seat.heard = Instant::now();
        }
    }
}

fn ended_already() -> Arc<Notify> {
    let ended = Arc::new(Notify::new());
    ended.notify_one();
    ended
}

impl Drop for Seat {
    fn drop(&mut self) {
        let mut seats = self.seats.lock();
        if let Some(seat) = seats.taken.remove(&self.id) {
            seats.held_bytes -= seat.held_bytes;
        }
    }
}

/// Memory that a connection holds, until it is dropped. Of a connection without a seat nothing is counted.
#[derive(Debug, Default)]
pub(super) struct Share {
    seat: Option<Arc<Seat>>,
    bytes: usize,
}

impl Share {
    /// Nothing yet.
    pub fn of(seat: Option<Arc<Seat>>) -> Share {
        Share { seat, bytes: 0 }
    }

    /// So many bytes from the start.
    pub fn take(seat: &Option<Arc<Seat>>, bytes: usize) -> Result<Share, Spent> {
        let mut share = Share::of(seat.clone());
        share.set(bytes)?;
        Ok(share)
    }

    /// So many bytes from now on; what it had stays if there are not so many.
    pub fn set(&mut self, bytes: usize) -> Result<(), Spent> {
        if let Some(seat) = self.seat.as_ref().filter(|seat| seat.metered) {
            let mut seats = seat.seats.lock();
            match bytes.checked_sub(self.bytes) {
                Some(0) => {}
                Some(more) => seats.hold(seat.id, more)?,
                None => seats.free(seat.id, self.bytes - bytes),
            }
        }
        self.bytes = bytes;
        Ok(())
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        if self.bytes > 0
            && let Some(seat) = self.seat.as_ref().filter(|seat| seat.metered)
        {
            seat.seats.lock().free(seat.id, self.bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: usize = 1 << 20;

    fn machine(last: u8) -> Option<IpAddr> {
        Some(IpAddr::from([10, 0, 0, last]))
    }

    #[test]
    fn who_holds_most_gives_way_and_nobody_else() {
        let (seats, now) = (SharedSeats::default(), Instant::now());
        let seat = |last| {
            let id = seats.lock().sit(machine(last), true, now).expect("room");
            Arc::new(Seat { seats: seats.clone(), id, metered: true })
        };
        let [greedy, other, small] = [1, 2, 3].map(seat);
        let held = [(&greedy, 40), (&other, 27)]
            .map(|(seat, mib)| Share::take(&Some(Arc::clone(seat)), mib * MIB).expect("within the budget"));
        assert!(Share::take(&Some(Arc::clone(&greedy)), 2 * MIB).is_err(), "it holds most itself");
        assert_eq!(seats.lock().taken.len(), 3, "what is refused changes nothing");
        let two = Share::take(&Some(Arc::clone(&small)), 2 * MIB).expect("the greedy one gives way");
        assert_eq!(seats.lock().held_bytes, 29 * MIB);
        assert!(!seats.lock().taken.contains_key(&greedy.id()));
        assert!(Share::take(&Some(Arc::clone(&greedy)), 1).is_err(), "it has ended");
        drop((held, two, greedy, other, small));
        let seats = seats.lock();
        assert_eq!((seats.held_bytes, seats.taken.len()), (0, 0));
    }

    #[test]
    fn what_a_machine_holds_over_several_connections_counts_together() {
        let seats = SharedSeats::default();
        let seat = |last| seats.take(machine(last), true, true).expect("room");
        let (leader, strangers) = (seat(1), [seat(2), seat(2), seat(2)]);
        let take = |seat: &Arc<Seat>, mib| Share::take(&Some(Arc::clone(seat)), mib * MIB);
        let led = take(&leader, 20).expect("room");
        let held = strangers.each_ref().map(|seat| take(seat, 16).expect("room"));
        assert!(take(&strangers[0], 2).is_err(), "the leader holds less than they do together");
        let more = take(&leader, 10).expect("one of them gives way");
        assert_eq!(seats.lock().held_bytes, 62 * MIB);
        assert!(seats.lock().taken.contains_key(&leader.id()));
        drop((led, held, more));
    }

    #[test]
    fn a_share_grows_and_shrinks() {
        let seats = SharedSeats::default();
        let seat = seats.take(machine(1), true, true).expect("room");
        let mut share = Share::of(Some(Arc::clone(&seat)));
        share.set(50 * MIB).expect("room");
        assert!(share.set(MAX_HELD_BYTES + 1).is_err());
        let held = seats.lock().held_bytes;
        assert_eq!((share.bytes, held), (50 * MIB, 50 * MIB));
        share.set(MIB).expect("less");
        assert_eq!(seats.lock().held_bytes, MIB);
        let free = seats.take(None, true, false).expect("room");
        assert!(Share::take(&Some(free), 2 * MAX_HELD_BYTES).is_ok(), "not metered");
    }

    #[test]
    fn who_is_silent_makes_room_for_another() {
        let (mut seats, began) = (Seats::default(), Instant::now());
        let at = |seconds| began + Duration::from_secs(seconds);
        let first: Vec<u64> =
            (0..4).map(|second| seats.sit(machine(1), true, at(second)).expect("room")).collect();
        assert_eq!(seats.sit(machine(1), true, at(4)), Err(NoSeat::TooMany), "all have been heard");
        let fifth = seats.sit(machine(1), true, at(5)).expect("the first gives way");
        assert!(!seats.taken.contains_key(&first[0]) && seats.taken.contains_key(&fifth));
        for other in 0..28 {
            seats.sit(machine(10 + other), true, at(9)).expect("room");
        }
        assert!(seats.sit(machine(99), true, at(9)).is_ok(), "the second gives way");
        assert_eq!(seats.taken.len(), MAX_CONNECTIONS);
        assert!(!seats.taken.contains_key(&first[1]));
    }

    #[test]
    fn viewers_leave_room_for_coordinators() {
        let (mut seats, now) = (Seats::default(), Instant::now());
        for viewer in 0..16 {
            seats.sit(machine(viewer), false, now).expect("room");
        }
        assert_eq!(seats.sit(machine(90), false, now), Err(NoSeat::Full));
        assert!(seats.sit(machine(91), true, now).is_ok());
    }

    #[test]
    fn a_connection_without_a_call_ends() {
        let (mut seats, began) = (Seats::default(), Instant::now());
        let [busy, silent] = [began; 2].map(|began| seats.sit(machine(1), true, began).expect("room"));
        let never = seats.sit(machine(1), true, began + Duration::from_secs(50)).expect("room");
        seats.taken.get_mut(&busy).expect("there").calls = 1;
        for id in [busy, silent] {
            seats.taken.get_mut(&id).expect("there").has_called = true;
        }
        seats.end_idle(began + Duration::from_secs(54));
        assert_eq!(seats.taken.len(), 3);
        seats.end_idle(began + Duration::from_secs(59));
        assert!(seats.taken.len() == 2 && !seats.taken.contains_key(&never), "it never called anything");
        seats.end_idle(began + IDLE);
        assert!(seats.taken.contains_key(&busy) && !seats.taken.contains_key(&silent));
    }
}
