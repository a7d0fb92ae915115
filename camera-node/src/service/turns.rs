//! Questions that wait for the worker: those of coordinators first, and connections by turns, so that nobody waits longer
//! for another's many questions than for one of them.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Of whom a question is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Client {
    /// The connection; 0 where there is but one.
    pub id: u64,
    /// It has shown a coordinator's certificate.
    pub leads: bool,
}

/// Why a question may not wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoTurn {
    /// So many of its connection wait.
    Full,
    /// Nobody will take it.
    Closed,
}

/// What waits.
#[derive(Debug)]
pub(super) struct Turns<T> {
    waiting: Mutex<Waiting<T>>,
    changed: Condvar,
    /// Of one connection.
    most: usize,
}

#[derive(Debug)]
struct Waiting<T> {
    /// In the order in which connections have their turns; none is empty.
    queues: VecDeque<(Client, VecDeque<T>)>,
    closed: bool,
}

impl<T> Turns<T> {
    /// So many of a connection may wait.
    pub fn new(most: usize) -> Turns<T> {
        let waiting = Mutex::new(Waiting { queues: VecDeque::new(), closed: false });
        Turns { waiting, changed: Condvar::new(), most }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting<T>> {
        // No statement of it panics between two changes.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has something wait.
    pub fn push(&self, client: Client, item: T) -> Result<(), NoTurn> {
        let mut waiting = self.lock();
        if waiting.closed {
            return Err(NoTurn::Closed);
        }
        match waiting.queues.iter_mut().find(|(known, _)| *known == client) {
            Some((_, queue)) if queue.len() >= self.most => return Err(NoTurn::Full),
            Some((_, queue)) => queue.push_back(item),
            None => waiting.queues.push_back((client, VecDeque::from([item]))),
        }
        self.changed.notify_one();
        Ok(())
    }

    /// The next, once there is one; `None` when it is closed and nothing waits.
    pub fn next(&self) -> Option<T> {
        let mut waiting = self.lock();
        loop {
            let first = waiting.queues.iter().position(|(client, _)| client.leads).unwrap_or(0);
            if let Some((client, mut queue)) = waiting.queues.remove(first) {
                let item = queue.pop_front();
                if !queue.is_empty() {
                    waiting.queues.push_back((client, queue));
                }
                return item;
            }
            if waiting.closed {
                return None;
            }
            waiting = self.changed.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Nothing more is taken; what waits is.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEADER: Client = Client { id: 9, leads: true };

    fn client(id: u64) -> Client {
        Client { id, leads: false }
    }

    #[test]
    fn connections_have_turns_and_coordinators_go_first() {
        let turns = Turns::new(3);
        for item in ["a1", "a2", "a3"] {
            turns.push(client(1), item).expect("room");
        }
        assert_eq!(turns.push(client(1), "a4"), Err(NoTurn::Full));
        turns.push(client(2), "b1").expect("room");
        turns.push(LEADER, "l1").expect("room");
        turns.push(LEADER, "l2").expect("room");
        turns.close();
        assert_eq!(turns.push(client(3), "c1"), Err(NoTurn::Closed));
        let order: Vec<_> = std::iter::from_fn(|| turns.next()).collect();
        assert_eq!(order, ["l1", "l2", "a1", "b1", "a2", "a3"]);
    }
}
