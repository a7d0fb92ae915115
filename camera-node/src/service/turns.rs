//! Questions that wait for the worker: connections have turns, so that none waits longer for another's many questions
//! than for one of them.

use std::collections::VecDeque;

use parking_lot::{Condvar, Mutex, MutexGuard};

/// Why a question may not wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoTurn {
    /// So many of its connection wait.
    Full,
    /// The worker has ended.
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
    queues: VecDeque<(u64, VecDeque<T>)>,
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
        self.waiting.lock()
    }

    /// Drops what is no longer wanted; returns how much that was.
    pub fn forget(&self, is_unwanted: impl Fn(&T) -> bool) -> usize {
        let mut waiting = self.lock();
        let before: usize = waiting.queues.iter().map(|(_, queue)| queue.len()).sum();
        waiting.queues.iter_mut().for_each(|(_, queue)| queue.retain(|item| !is_unwanted(item)));
        waiting.queues.retain(|(_, queue)| !queue.is_empty());
        before - waiting.queues.iter().map(|(_, queue)| queue.len()).sum::<usize>()
    }

    /// Has something of a connection wait.
    pub fn push(&self, connection: u64, item: T) -> Result<(), NoTurn> {
        let mut waiting = self.lock();
        if waiting.closed {
            return Err(NoTurn::Closed);
        }
        match waiting.queues.iter_mut().find(|(known, _)| *known == connection) {
            Some((_, queue)) if queue.len() >= self.most => return Err(NoTurn::Full),
            Some((_, queue)) => queue.push_back(item),
            None => waiting.queues.push_back((connection, VecDeque::from([item]))),
        }
        self.changed.notify_one();
        Ok(())
    }

    /// The next, once there is one; `None` when it is closed and nothing waits.
    pub fn next(&self) -> Option<T> {
        let mut waiting = self.lock();
        loop {
            if let Some((connection, mut queue)) = waiting.queues.pop_front() {
                let item = queue.pop_front();
                if !queue.is_empty() {
                    waiting.queues.push_back((connection, queue));
                }
                return item;
            }
            if waiting.closed {
                return None;
            }
            self.changed.wait(&mut waiting);
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

    #[test]
    fn connections_have_turns() {
        let turns = Turns::new(3);
        for item in ["a1", "a2", "a3"] {
            turns.push(1, item).expect("room");
        }
        assert_eq!(turns.push(1, "a4"), Err(NoTurn::Full));
        turns.push(2, "b1").expect("room");
        turns.close();
        assert_eq!(turns.push(3, "c1"), Err(NoTurn::Closed));
        let order: Vec<_> = std::iter::from_fn(|| turns.next()).collect();
        assert_eq!(order, ["a1", "b1", "a2", "a3"]);
    }

    #[test]
    fn what_is_no_longer_wanted_does_not_wait() {
        let turns = Turns::new(3);
        for (connection, item) in [(1, "a1"), (1, "a2"), (2, "b1"), (3, "c1")] {
            turns.push(connection, item).expect("room");
        }
        assert_eq!(turns.forget(|item| *item == "a1" || *item == "b1"), 2);
        turns.close();
        let order: Vec<_> = std::iter::from_fn(|| turns.next()).collect();
        assert_eq!(order, ["a2", "c1"]);
    }
}
