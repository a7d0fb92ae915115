//! The connections of a port, and which of them is evicted when there are too many.
//!
//! A peer that only begins, or only asks, keeps no other out: a connection is evicted. One that is not sending an answer comes
//! first, of those one of the machine that has most, of those the one that came or asked longest ago. Connections that stay (a
//! socket, a stream) are bounded where they are allowed to.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::fmt;
use std::net::IpAddr;
use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::Notify;

/// How many connections a port keeps, of all peers together.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// Those of which the port has not said that they have [asked](ConnectionSlot::asked).
    pub beginning: usize,
    /// Those that have asked something and do not stay; `None` where a port never says so.
    pub passing: Option<usize>,
}

/// What a connection is doing for its peer. It is asked while the registry is locked: it must neither wait nor own a
/// [`ConnectionSlot`].
pub trait Activity: Send + Sync {
    /// Whether an answer is being made, or not all of it was sent.
    fn is_answering(&self) -> bool;
}

/// A connection that is never known to be answering.
impl Activity for () {
    fn is_answering(&self) -> bool {
        false
    }
}

/// All connections of a port.
#[derive(Clone, Debug)]
pub struct Registry(Arc<Mutex<Connections>>);

struct Connections {
    policy: Policy,
    list: Vec<Entry>,
    /// Counts arrivals and requests: the lowest turn is the longest ago.
    turns: u64,
}

impl fmt::Debug for Connections {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} connections", self.list.len())
    }
}

struct Entry {
    id: u64,
    machine: Option<IpAddr>,
    stage: Stage,
    turn: u64,
    activity: Arc<dyn Activity>,
    evicted: Arc<Notify>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Beginning,
    Passing,
    /// With so many sockets or streams.
    Staying(usize),
}

/// One connection, until it is dropped.
#[derive(Debug)]
pub struct ConnectionSlot {
    registry: Registry,
    id: u64,
    evicted: Arc<Notify>,
}

/// Keeps its connection from being evicted.
#[derive(Debug)]
pub struct StayGuard(Arc<ConnectionSlot>);

impl Registry {
    /// No connection yet.
    pub fn new(policy: Policy) -> Registry {
        Registry(Arc::new(Mutex::new(Connections { policy, list: Vec::new(), turns: 0 })))
    }

    /// Another connection, from that machine; over a Unix socket there is none. If they are too many now, one of them
    /// is evicted.
    pub fn begin(&self, machine: Option<IpAddr>, activity: Arc<dyn Activity>) -> Arc<ConnectionSlot> {
        let mut connections = self.lock();
        let most = connections.policy.beginning;
        connections.evict_if_full(Stage::Beginning, most);
        let id = connections.next_turn();
        let evicted = Arc::new(Notify::new());
        let (stage, turn) = (Stage::Beginning, id);
        let entry = Entry { id, machine, stage, turn, activity, evicted: Arc::clone(&evicted) };
        connections.list.push(entry);
        Arc::new(ConnectionSlot { registry: self.clone(), id, evicted })
    }

    fn lock(&self) -> MutexGuard<'_, Connections> {
        self.0.lock()
    }
}

impl Connections {
    fn next_turn(&mut self) -> u64 {
        self.turns += 1;
        self.turns
    }

    /// Makes room in a stage for one more connection.
    fn evict_if_full(&mut self, stage: Stage, most: usize) {
        let among = || self.list.iter().enumerate().filter(|(_, entry)| entry.stage == stage);
        if among().count() < most {
            return;
        }
        let mut of_machine: HashMap<Option<IpAddr>, usize> = HashMap::new();
        among().for_each(|(_, entry)| *of_machine.entry(entry.machine).or_default() += 1);
        let rank = |(_, entry): &(usize, &Entry)| {
            (!entry.activity.is_answering(), of_machine.get(&entry.machine).copied(), Reverse(entry.turn))
        };
        if let Some((evicted, _)) = among().max_by_key(rank) {
            self.list.swap_remove(evicted).evicted.notify_one();
        }
    }

    /// Passing from now on, as the newest.
    fn pass(&mut self, id: u64) {
        let turn = self.next_turn();
        let Some(at) = self.list.iter().position(|entry| entry.id == id) else { return };
        let entry = self.list.swap_remove(at);
        if let Some(most) = self.policy.passing {
            self.evict_if_full(Stage::Passing, most);
        }
        self.list.push(Entry { stage: Stage::Passing, turn, ..entry });
    }

    fn entry(&mut self, id: u64) -> Option<&mut Entry> {
        self.list.iter_mut().find(|entry| entry.id == id)
    }
}

impl ConnectionSlot {
    /// Ends when it is evicted.
    pub async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// A request came.
    pub fn asked(&self) {
        if !self.stays() {
            self.registry.lock().pass(self.id);
        }
    }

    /// Whether it holds a socket or a stream.
    pub fn stays(&self) -> bool {
        let mut connections = self.registry.lock();
        connections.entry(self.id).is_some_and(|entry| matches!(entry.stage, Stage::Staying(_)))
    }

    /// Holds a socket or a stream from now on.
    pub fn stay(self: &Arc<Self>) -> StayGuard {
        if let Some(entry) = self.registry.lock().entry(self.id) {
            let before = if let Stage::Staying(count) = entry.stage { count } else { 0 };
            entry.stage = Stage::Staying(before + 1);
        }
        StayGuard(Arc::clone(self))
    }

    /// Gives its place back before it is dropped.
    pub fn end(&self) {
        self.registry.lock().list.retain(|entry| entry.id != self.id);
    }
}

impl Drop for ConnectionSlot {
    fn drop(&mut self) {
        self.end();
    }
}

impl Drop for StayGuard {
    fn drop(&mut self) {
        let mut connections = self.0.registry.lock();
        let Some(entry) = connections.entry(self.0.id) else { return };
        match entry.stage {
            Stage::Staying(count) if count > 1 => entry.stage = Stage::Staying(count - 1),
            _ => connections.pass(self.0.id),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::pin::pin;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::task::{Context, Waker};

    const MAX_BEGINNING: usize = 64;
    const MAX_PASSING: usize = 48;

    fn registry() -> Registry {
        Registry::new(Policy { beginning: MAX_BEGINNING, passing: Some(MAX_PASSING) })
    }

    fn machine(last: u8) -> Option<IpAddr> {
        Some(IpAddr::from([10, 0, 0, last]))
    }

    fn begin(registry: &Registry) -> Arc<ConnectionSlot> {
        registry.begin(machine(1), Arc::new(()))
    }

    fn was_evicted(connection: &ConnectionSlot) -> bool {
        pin!(connection.evicted()).poll(&mut Context::from_waker(Waker::noop())).is_ready()
    }

    impl Activity for AtomicBool {
        fn is_answering(&self) -> bool {
            self.load(Ordering::Relaxed)
        }
    }

    #[test]
    fn the_connection_that_began_longest_ago_gives_way_to_a_new_one() {
        let registry = registry();
        let asked = begin(&registry);
        asked.asked();
        let silent: Vec<_> = (0..2 * MAX_BEGINNING).map(|_| begin(&registry)).collect();
        let gone = silent.iter().filter(|connection| was_evicted(connection)).count();
        assert_eq!(gone, MAX_BEGINNING);
        assert!(silent[MAX_BEGINNING..].iter().all(|connection| !was_evicted(connection)));
        assert!(!was_evicted(&asked), "silent ones cost those nothing that ask");
    }

    #[test]
    fn the_connection_that_asked_longest_ago_gives_way_and_never_one_that_stays() {
        let registry = registry();
        let ask = || {
            let connection = begin(&registry);
            connection.asked();
            connection
        };
        let (page, first, second) = (ask(), ask(), ask());
        let staying = page.stay();
        first.asked();
        let _others: Vec<_> = (0..MAX_PASSING - 1).map(|_| ask()).collect();
        assert!(was_evicted(&second) && !was_evicted(&first) && !was_evicted(&page));
        drop(staying);
        assert!(was_evicted(&first), "who stays no more needs a place, as the newest");
        assert!(!was_evicted(&page) && !page.stays());
    }

    #[test]
    fn a_flood_of_one_machine_ends_no_connection_of_another() {
        let registry = registry();
        let page = registry.begin(machine(2), Arc::new(()));
        page.asked();
        for _ in 0..1000 {
            begin(&registry).asked();
        }
        let _open: Vec<_> = (0..1000)
            .map(|_| {
                let connection = begin(&registry);
                connection.asked();
                connection
            })
            .collect();
        assert!(!was_evicted(&page));
        let another = registry.begin(machine(3), Arc::new(()));
        another.asked();
        assert!(!was_evicted(&another) && !was_evicted(&page));
    }

    #[test]
    fn a_connection_that_sends_an_answer_gives_way_after_those_that_do_not() {
        let registry = registry();
        let busy = Arc::new(AtomicBool::new(true));
        let page = registry.begin(machine(1), Arc::clone(&busy) as Arc<dyn Activity>);
        page.asked();
        let ask = || {
            let connection = begin(&registry);
            connection.asked();
            connection
        };
        let _others: Vec<_> = (0..3 * MAX_PASSING).map(|_| ask()).collect();
        assert!(!was_evicted(&page));
        busy.store(false, Ordering::Relaxed);
        let _another = ask();
        assert!(was_evicted(&page), "it asked longest ago");
    }

    #[test]
    fn a_connection_with_two_streams_stays_until_both_have_ended() {
        let registry = registry();
        let connection = begin(&registry);
        let (one, other) = (connection.stay(), connection.stay());
        drop(one);
        assert!(connection.stays());
        drop(other);
        assert!(!connection.stays());
        connection.end();
        assert!(registry.lock().list.is_empty());
    }

    #[test]
    fn the_first_of_the_machine_that_has_most_is_evicted_and_of_two_such_machines_the_older() {
        let evicted_of = |machines: &[Option<IpAddr>]| {
            let registry = Registry::new(Policy { beginning: machines.len(), passing: None });
            let all: Vec<_> = machines.iter().map(|&machine| registry.begin(machine, Arc::new(()))).collect();
            let _one_more = registry.begin(machine(9), Arc::new(()));
            all.iter().position(|connection| was_evicted(connection))
        };
        assert_eq!(evicted_of(&[1, 2, 3, 2, 1, 2].map(machine)), Some(1));
        assert_eq!(evicted_of(&[3, 2, 1, 2, 1].map(machine)), Some(1));
        assert_eq!(
            evicted_of(&[None, machine(1)]),
            Some(0),
            "connections of this machine count as one machine's"
        );
    }

    #[test]
    fn a_connection_that_is_dropped_leaves_its_place() {
        let registry = registry();
        let first = begin(&registry);
        for _ in 0..3 * MAX_BEGINNING {
            drop(begin(&registry));
        }
        assert!(!was_evicted(&first));
        assert_eq!(registry.lock().list.len(), 1);
    }
}
