//! The connections of a port, and which of them gives way when there are too many.
//!
//! A peer that only begins, or only asks, keeps no other out: a connection gives way. One that is not sending an answer comes
//! first, of those one of the machine that has most, of those the one that came or asked longest ago. Connections that stay (a
//! socket, a stream) are bounded where they are allowed to.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::Notify;

use super::progress::Progress;

/// Connections whose first request has not come, of all peers together.
pub(crate) const MAX_BEGINNING: usize = 64;
/// Connections that have asked something and do not stay.
pub(crate) const MAX_PASSING: usize = 64;

/// All connections of a port.
#[derive(Clone, Debug, Default)]
pub(super) struct Registry(Arc<Mutex<Connections>>);

#[derive(Debug, Default)]
struct Connections {
    list: Vec<Entry>,
    /// Counts arrivals and requests: the lowest turn is the longest ago.
    turns: u64,
}

#[derive(Debug)]
struct Entry {
    id: u64,
    machine: IpAddr,
    stage: Stage,
    turn: u64,
    progress: Arc<Progress>,
    gives_way: Arc<Notify>,
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
pub(super) struct Registered {
    registry: Registry,
    id: u64,
    gives_way: Arc<Notify>,
}

/// Keeps its connection from giving way.
#[derive(Debug)]
pub(crate) struct Staying(Arc<Registered>);

impl Registry {
    /// Another connection, from that machine.
    pub fn begin(&self, machine: IpAddr, progress: Arc<Progress>) -> Arc<Registered> {
        let mut connections = self.lock();
        connections.make_way(Stage::Beginning, MAX_BEGINNING);
        let id = connections.next_turn();
        let gives_way = Arc::new(Notify::new());
        let (stage, turn) = (Stage::Beginning, id);
        let entry = Entry { id, machine, stage, turn, progress, gives_way: Arc::clone(&gives_way) };
        connections.list.push(entry);
        Arc::new(Registered { registry: self.clone(), id, gives_way })
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
    fn make_way(&mut self, stage: Stage, most: usize) {
        let among = || self.list.iter().enumerate().filter(|(_, entry)| entry.stage == stage);
        if among().count() < most {
            return;
        }
        let mut of_machine: HashMap<IpAddr, usize> = HashMap::new();
        among().for_each(|(_, entry)| *of_machine.entry(entry.machine).or_default() += 1);
        let rank = |(_, entry): &(usize, &Entry)| {
            (!entry.progress.is_answering(), of_machine.get(&entry.machine).copied(), Reverse(entry.turn))
        };
        if let Some((gives_way, _)) = among().max_by_key(rank) {
            self.list.swap_remove(gives_way).gives_way.notify_one();
        }
    }

    /// Passing from now on, as the newest.
    fn pass(&mut self, id: u64) {
        let turn = self.next_turn();
        let Some(at) = self.list.iter().position(|entry| entry.id == id) else { return };
        let entry = self.list.swap_remove(at);
        self.make_way(Stage::Passing, MAX_PASSING);
        self.list.push(Entry { stage: Stage::Passing, turn, ..entry });
    }

    fn entry(&mut self, id: u64) -> Option<&mut Entry> {
        self.list.iter_mut().find(|entry| entry.id == id)
    }
}

impl Registered {
    /// Ends when it must give way.
    pub async fn gives_way(&self) {
        self.gives_way.notified().await;
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
    pub fn stay(self: &Arc<Self>) -> Staying {
        if let Some(entry) = self.registry.lock().entry(self.id) {
            let before = if let Stage::Staying(count) = entry.stage { count } else { 0 };
            entry.stage = Stage::Staying(before + 1);
        }
        Staying(Arc::clone(self))
    }

    /// It is over.
    pub fn end(&self) {
        self.registry.lock().list.retain(|entry| entry.id != self.id);
    }
}

impl Drop for Staying {
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
    use futures::FutureExt as _;

    fn machine(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    fn begin(registry: &Registry) -> Arc<Registered> {
        registry.begin(machine(1), Arc::default())
    }

    fn gave_way(connection: &Registered) -> bool {
        connection.gives_way().now_or_never().is_some()
    }

    #[test]
    fn the_connection_that_began_longest_ago_gives_way_to_a_new_one() {
        let registry = Registry::default();
        let asked = begin(&registry);
        asked.asked();
        let silent: Vec<_> = (0..2 * MAX_BEGINNING).map(|_| begin(&registry)).collect();
        let gone = silent.iter().filter(|connection| gave_way(connection)).count();
        assert_eq!(gone, MAX_BEGINNING);
        assert!(silent[MAX_BEGINNING..].iter().all(|connection| !gave_way(connection)));
        assert!(!gave_way(&asked), "silent ones cost those nothing that ask");
    }

    #[test]
    fn the_connection_that_asked_longest_ago_gives_way_and_never_one_that_stays() {
        let registry = Registry::default();
        let ask = || {
            let connection = begin(&registry);
            connection.asked();
            connection
        };
        let (page, first, second) = (ask(), ask(), ask());
        let staying = page.stay();
        first.asked();
        let _others: Vec<_> = (0..MAX_PASSING - 1).map(|_| ask()).collect();
        assert!(gave_way(&second) && !gave_way(&first) && !gave_way(&page));
        drop(staying);
        assert!(gave_way(&first), "who stays no more needs a place, as the newest");
        assert!(!gave_way(&page) && !page.stays());
    }

    #[test]
    fn a_flood_of_one_machine_ends_no_connection_of_another() {
        let registry = Registry::default();
        let page = registry.begin(machine(2), Arc::default());
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
        assert!(!gave_way(&page));
        let another = registry.begin(machine(3), Arc::default());
        another.asked();
        assert!(!gave_way(&another) && !gave_way(&page));
    }

    #[test]
    fn a_connection_that_sends_an_answer_gives_way_after_those_that_do_not() {
        let registry = Registry::default();
        let progress = Arc::<Progress>::default();
        let page = registry.begin(machine(1), Arc::clone(&progress));
        page.asked();
        let answer = progress.begin_request();
        let ask = || {
            let connection = begin(&registry);
            connection.asked();
            connection
        };
        let _others: Vec<_> = (0..3 * MAX_PASSING).map(|_| ask()).collect();
        assert!(!gave_way(&page));
        drop(answer);
        let _another = ask();
        assert!(gave_way(&page), "it asked longest ago");
    }

    #[test]
    fn a_connection_with_two_streams_stays_until_both_have_ended() {
        let registry = Registry::default();
        let connection = begin(&registry);
        let (one, other) = (connection.stay(), connection.stay());
        drop(one);
        assert!(connection.stays());
        drop(other);
        assert!(!connection.stays());
        connection.end();
        assert!(registry.lock().list.is_empty());
    }
}
