//! Decides which connections a node keeps and how much memory each of them holds. Plain: time is an argument, and what was
//! decided about a connection is written to the log.
//!
//! The lease holder comes first. Its connections are never ended for another one, slots are kept free for its machine, and
//! it may use the whole memory budget: other connections give back what it needs.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use net::admission::RateLimitedLog;
use thiserror::Error;
use tokio::sync::Notify;
use tokio::time::Instant;

/// What all connections hold together, bytes: the largest message and its question with room for others, and with the largest
/// shapes less than 100 MiB.
pub(in super::super) const MAX_HELD_BYTES: usize = 68 << 20;
/// Connections that were admitted, all together.
const MAX_CONNECTIONS: usize = 32;
/// Of them, those kept free for the machine of the lease holder: its connection, that of its pictures, and the next of each.
const LEASE_SLOTS: usize = 4;
/// Of all, those of viewers: the others are left for coordinators.
const MAX_VIEWERS: usize = 16;
/// Connections of one machine that is not this one.
const MAX_OF_A_MACHINE: usize = 4;
/// A connection without a call ends after this.
const IDLE: Duration = Duration::from_secs(60);
/// One that has never called anything ends after this.
const SILENT: Duration = Duration::from_secs(5);
/// A connection without a message for so long gives way to another. A coordinator sends two a second.
const GIVES_WAY_AFTER: Duration = Duration::from_secs(5);
/// A connection that was admitted so long ago gives way to a machine that has none: a coordinator has claimed the lease by
/// then.
const SETTLED_AFTER: Duration = Duration::from_secs(2);

/// Why a connection is not admitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(in super::super) enum NoSeat {
    #[error("its machine has {MAX_OF_A_MACHINE} connections already")]
    TooMany,
    #[error("all connection slots of this node are in use")]
    Full,
}

/// The budget is exhausted, and no connection holds more than the one that asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "memory budget of all connections ({} MiB) exhausted, and this one holds the most: expected a smaller request",
    MAX_HELD_BYTES >> 20
)]
pub(in super::super) struct BudgetExhausted;

/// Why the node ended a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ended {
    Silent,
    Idle,
    GaveWay,
    HeldMost,
}

/// The connection slots of a node.
#[derive(Debug, Default)]
pub(super) struct Table {
    pub(super) held_bytes: usize,
    next: u64,
    pub(super) slots: HashMap<u64, Slot>,
    lease: Option<Lease>,
    log: RateLimitedLog,
}

/// The last lease holder that the node knows.
#[derive(Debug)]
struct Lease {
    holder: u64,
    machine: Option<IpAddr>,
}

/// One connection that was admitted.
#[derive(Debug)]
pub(super) struct Slot {
    /// `None`: this one.
    machine: Option<IpAddr>,
    /// A coordinator; without certificates every peer may be one.
    leads: bool,
    /// The lease holder that it last proved to be; 0: none.
    holder: u64,
    pub(super) held_bytes: usize,
    pub(super) calls: usize,
    pub(super) has_called: bool,
    admitted: Instant,
    pub(super) heard: Instant,
    pub(super) ended: Arc<Notify>,
}

/// What is missing for another connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shortage {
    Machine,
    Viewers,
    All,
}

impl Table {
    /// Admits a connection of that machine (`None`: of this one). If there is no slot left, another connection gives way, or
    /// this one is refused.
    pub fn admit(&mut self, machine: Option<IpAddr>, leads: bool, now: Instant) -> Result<u64, NoSeat> {
        if let Some(shortage) = self.shortage(machine, leads) {
            let why = if shortage == Shortage::Machine { NoSeat::TooMany } else { NoSeat::Full };
            let gives_way = self.gives_way(shortage, machine, leads, now).ok_or(why)?;
            self.end(gives_way, Ended::GaveWay);
        }
        self.next += 1;
        let slot = Slot {
            machine,
            leads,
            holder: 0,
            held_bytes: 0,
            calls: 0,
            has_called: false,
            admitted: now,
            heard: now,
            ended: Arc::default(),
        };
        self.slots.insert(self.next, slot);
        Ok(self.next)
    }

    fn shortage(&self, machine: Option<IpAddr>, leads: bool) -> Option<Shortage> {
        let viewers = self.slots.values().filter(|slot| !slot.leads).count();
        let kept = self.lease.as_ref().filter(|lease| lease.machine != machine);
        let kept = kept.map_or(0, |lease| LEASE_SLOTS.saturating_sub(self.count_of(lease.machine)));
        if machine.is_some() && self.count_of(machine) >= MAX_OF_A_MACHINE {
            Some(Shortage::Machine)
        } else if self.slots.len() + kept >= MAX_CONNECTIONS {
            Some(Shortage::All)
        } else if !leads && viewers >= MAX_VIEWERS {
            Some(Shortage::Viewers)
        } else {
            None
        }
    }

    /// The connection that gives way to a new one. Of those that may, the machines of the prefix that has most connections
    /// come first: one attacker may own many addresses, and they are neighbours.
    fn gives_way(
        &self,
        shortage: Shortage,
        machine: Option<IpAddr>,
        leads: bool,
        now: Instant,
    ) -> Option<u64> {
        let own = self.count_of(machine);
        let may_go = |slot: &Slot| {
            let is_silent = now.saturating_duration_since(slot.heard) >= GIVES_WAY_AFTER;
            let is_other = slot.machine != machine;
            let is_kept =
                is_other && self.is_of_lease(slot.machine) && self.count_of(slot.machine) <= LEASE_SLOTS;
            if self.holds_lease(slot) || is_kept && !is_silent {
                return false;
            }
            let has_more = self.count_of(slot.machine) > own + 1 || is_other && self.is_of_lease(machine);
            let is_newcomer = own == 0 || machine.is_none();
            let is_settled = is_newcomer && now.saturating_duration_since(slot.admitted) >= SETTLED_AFTER;
            match shortage {
                Shortage::Machine => slot.machine == machine && is_silent,
                Shortage::Viewers => !slot.leads && (is_silent || has_more || is_settled),
                Shortage::All => is_silent || (leads || !slot.leads) && (has_more || is_settled),
            }
        };
        let mut of_prefix: HashMap<Option<IpAddr>, usize> = HashMap::new();
        self.slots.values().for_each(|slot| *of_prefix.entry(prefix(slot.machine)).or_default() += 1);
        let rank = |(id, slot): &(&u64, &Slot)| {
            (
                of_prefix.get(&prefix(slot.machine)).copied(),
                self.count_of(slot.machine),
                Reverse((slot.heard, **id)),
            )
        };
        self.slots.iter().filter(|(_, slot)| may_go(slot)).max_by_key(rank).map(|(&id, _)| id)
    }

    fn count_of(&self, machine: Option<IpAddr>) -> usize {
        self.slots.values().filter(|slot| slot.machine == machine).count()
    }

    /// Whether the last lease holder is on that machine.
    pub fn is_of_lease(&self, machine: Option<IpAddr>) -> bool {
        self.lease.as_ref().is_some_and(|lease| lease.machine == machine)
    }

    fn holds_lease(&self, slot: &Slot) -> bool {
        self.lease.as_ref().is_some_and(|lease| lease.holder == slot.holder)
    }

    /// A call over this connection came from the lease holder of that id.
    pub fn prove_lease(&mut self, id: u64, holder: u64) {
        let Some(slot) = self.slots.get_mut(&id).filter(|_| holder != 0) else { return };
        slot.holder = holder;
        self.lease = Some(Lease { holder, machine: slot.machine });
    }

    /// Forgets a connection, which ends soon. What it holds is free with it, a moment before its memory is.
    fn end(&mut self, id: u64, why: Ended) {
        if let Some(slot) = self.slots.remove(&id) {
            self.held_bytes -= slot.held_bytes;
            slot.ended.notify_one();
            let from = slot.machine.map_or_else(|| "this machine".to_owned(), |from| from.to_string());
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
                    let why = "all its slots were in use, and another connection came";
                    self.log.warn(&format_args!("a connection from {from} ended"), &why);
                }
                Ended::HeldMost => {
                    let (held, all) = (mib(slot.held_bytes), mib(MAX_HELD_BYTES));
                    let why = format!("it held {held} MiB, most of the {all} MiB that all share");
                    self.log.warn(&format_args!("a connection from {from} ended"), &why);
                }
            }
        }
    }

    /// Ends connections without a call.
    pub fn end_idle(&mut self, now: Instant) {
        let idle = |(&id, slot): (&u64, &Slot)| {
            let (within, why) = if slot.has_called { (IDLE, Ended::Idle) } else { (SILENT, Ended::Silent) };
            let is_idle = slot.calls == 0 && now.saturating_duration_since(slot.heard) >= within;
            is_idle.then_some((id, why))
        };
        let idle: Vec<_> = self.slots.iter().filter_map(idle).collect();
        idle.into_iter().for_each(|(id, why)| self.end(id, why));
    }

    /// What all connections of a slot's machine hold; of this machine each stands for itself.
    fn held_with(&self, slot: &Slot) -> usize {
        let same = |other: &&Slot| slot.machine.is_some() && other.machine == slot.machine;
        let together: usize = self.slots.values().filter(same).map(|slot| slot.held_bytes).sum();
        together.max(slot.held_bytes)
    }

    /// Counts more memory of a connection. If the budget is exhausted, the connection of the machine that holds most ends,
    /// unless that is the lease holder's or the asking one's own.
    pub fn hold(&mut self, id: u64, bytes: usize) -> Result<(), BudgetExhausted> {
        let is_leased = self.slots.get(&id).is_some_and(|own| self.holds_lease(own));
        while self.held_bytes + bytes > MAX_HELD_BYTES {
            let own = self.slots.get(&id).ok_or(BudgetExhausted)?;
            let others = self.slots.iter().filter(|(_, slot)| !self.holds_lease(slot));
            if is_leased && self.held_by_lease() + bytes > MAX_HELD_BYTES {
                return Err(BudgetExhausted);
            }
            let most = |(id, slot): &(&u64, &Slot)| (self.held_with(slot), slot.held_bytes, **id);
            let (&richest, slot) = others.max_by_key(most).ok_or(BudgetExhausted)?;
            let is_own = richest == id || slot.machine.is_some() && own.machine == slot.machine;
            if !is_leased && (is_own || self.held_with(slot) <= self.held_with(own) + bytes) {
                return Err(BudgetExhausted);
            }
            self.end(richest, Ended::HeldMost);
        }
        let own = self.slots.get_mut(&id).ok_or(BudgetExhausted)?;
        own.held_bytes += bytes;
        self.held_bytes += bytes;
        Ok(())
    }

    fn held_by_lease(&self) -> usize {
        self.slots.values().filter(|slot| self.holds_lease(slot)).map(|slot| slot.held_bytes).sum()
    }

    /// Counts less memory of a connection.
    pub fn free(&mut self, id: u64, bytes: usize) {
        // Of one that was ended all was freed at once.
        if let Some(slot) = self.slots.get_mut(&id) {
            slot.held_bytes -= bytes;
            self.held_bytes -= bytes;
        }
    }
}

/// The network that a machine's address is likely to be in.
fn prefix(machine: Option<IpAddr>) -> Option<IpAddr> {
    match machine? {
        IpAddr::V4(address) => Some(IpAddr::V4((address.to_bits() & !0xff).into())),
        IpAddr::V6(address) => Some(IpAddr::V6((address.to_bits() & !u128::from(u64::MAX)).into())),
    }
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
