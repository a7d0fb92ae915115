//! A queue, bounded in bytes, between a loop that must not wait for a disk and the thread that does.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

/// A queue of things that have a size.
#[derive(Debug)]
pub(crate) struct ByteQueue<T> {
    limit_bytes: usize,
    inner: Mutex<Inner<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct Inner<T> {
    waiting: VecDeque<(usize, T)>,
    bytes: usize,
    closed: bool,
}

/// The outcome of waiting for an item.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Received<T> {
    /// The oldest there was.
    Next(T),
    /// Nothing came in time.
    Timeout,
    /// Nothing will come any more.
    Closed,
}

impl<T> ByteQueue<T> {
    /// An empty queue that takes no more while it holds so many bytes.
    pub fn new(limit_bytes: usize) -> ByteQueue<T> {
        let inner = Inner { waiting: VecDeque::new(), bytes: 0, closed: false };
        ByteQueue { limit_bytes, inner: Mutex::new(inner), changed: Condvar::new() }
    }

    /// Puts something at the end; false if there is no room for it, or the queue is closed.
    pub fn offer(&self, bytes: usize, item: T) -> bool {
        let inner = self.lock();
        inner.bytes < self.limit_bytes && self.push(inner, bytes, item)
    }

    /// Puts something at the end once there is room; false if the queue is closed.
    pub fn put(&self, bytes: usize, item: T) -> bool {
        let mut inner = self.lock();
        while inner.bytes >= self.limit_bytes && !inner.closed {
            self.changed.wait(&mut inner);
        }
        self.push(inner, bytes, item)
    }

    fn push(&self, mut inner: MutexGuard<'_, Inner<T>>, bytes: usize, item: T) -> bool {
        if inner.closed {
            return false;
        }
        inner.bytes += bytes;
        inner.waiting.push_back((bytes, item));
        self.changed.notify_all();
        true
    }

    /// Whether less than half of the limit waits.
    pub fn has_room(&self) -> bool {
        self.lock().bytes < self.limit_bytes / 2
    }

    /// Takes the oldest, or waits for one until `deadline`.
    pub fn take(&self, deadline: Option<Instant>) -> Received<T> {
        let mut inner = self.lock();
        loop {
            if let Some((bytes, item)) = inner.waiting.pop_front() {
                inner.bytes -= bytes;
                self.changed.notify_all();
                return Received::Next(item);
            }
            if inner.closed {
                return Received::Closed;
            }
            let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
            match left {
                Some(Duration::ZERO) => return Received::Timeout,
                // What came meanwhile is looked for again.
                Some(left) => {
                    self.changed.wait_for(&mut inner, left);
                }
                None => self.changed.wait(&mut inner),
            }
        }
    }

    /// Whether nothing more is taken in.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// Takes nothing more in; what waits can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        // Nothing between two statements that can panic is half done.
        self.inner.lock()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_full_queue_refuses_an_offer_and_holds_up_a_put() {
        let queue = Arc::new(ByteQueue::new(10));
        assert!(queue.offer(9, 'a') && queue.offer(9, 'b'), "the limit may be passed by one");
        assert!(!queue.offer(1, 'c') && !queue.has_room());
        let waiting = {
            let queue = Arc::clone(&queue);
            std::thread::spawn(move || queue.put(1, 'd'))
        };
        assert_eq!(queue.take(None), Received::Next('a'));
        assert!(waiting.join().expect("no panic"), "there was room in the end");
        assert_eq!((queue.take(None), queue.take(None)), (Received::Next('b'), Received::Next('d')));
        assert_eq!(queue.take(Some(Instant::now())), Received::Timeout);
    }

    #[test]
    fn a_closed_queue_gives_what_it_has_and_takes_nothing() {
        let queue = ByteQueue::new(10);
        assert!(queue.offer(20, 'a'));
        queue.close();
        assert!(!queue.offer(1, 'b') && !queue.put(1, 'b'));
        assert_eq!((queue.take(None), queue.take(None)), (Received::Next('a'), Received::Closed));
    }
}
