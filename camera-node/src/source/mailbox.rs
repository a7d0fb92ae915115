//! A bounded hand-over of frames from the thread that reads them to the thread that uses them.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What a full mailbox does with one more letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// The writer waits: a film loses nothing.
    Wait,
    /// The oldest letter goes: a live camera does not wait, and old frames are of no use.
    DropOldest,
}

/// What a reader got.
#[derive(Debug, PartialEq, Eq)]
pub enum Received<T> {
    /// The oldest letter.
    Letter(T),
    /// The writer closed, and every letter was taken.
    Closed,
    /// Nothing came in time.
    TimedOut,
}

/// A queue between two threads, closed from either side.
#[derive(Debug)]
pub struct Mailbox<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    capacity: usize,
    when_full: WhenFull,
}

#[derive(Debug)]
struct State<T> {
    letters: VecDeque<T>,
    dropped: u64,
    closed: bool,
}

impl<T> Mailbox<T> {
    /// An empty mailbox for up to `capacity` letters, at least one.
    pub fn new(capacity: usize, when_full: WhenFull) -> Mailbox<T> {
        let state = State { letters: VecDeque::new(), dropped: 0, closed: false };
        Mailbox { state: Mutex::new(state), changed: Condvar::new(), capacity: capacity.max(1), when_full }
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        // Nothing panics while it holds the lock, and the state is whole between any two lines.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a letter in, waiting if that is the rule; gives it back if the mailbox is closed.
    pub fn send(&self, letter: T) -> Result<(), T> {
        let mut state = self.lock();
        while self.when_full == WhenFull::Wait && state.letters.len() >= self.capacity && !state.closed {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        if state.closed {
            return Err(letter);
        }
        if state.letters.len() >= self.capacity {
            state.letters.pop_front();
            state.dropped += 1;
        }
        state.letters.push_back(letter);
        self.changed.notify_all();
        Ok(())
    }

    /// Takes the oldest letter, waiting up to `limit` for one.
    pub fn receive(&self, limit: Duration) -> Received<T> {
        let deadline = Instant::now() + limit;
        let mut state = self.lock();
        loop {
            if let Some(letter) = state.letters.pop_front() {
                self.changed.notify_all();
                return Received::Letter(letter);
            }
            if state.closed {
                return Received::Closed;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Received::TimedOut;
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// How many letters were dropped since this was last asked.
    pub fn take_dropped(&self) -> u64 {
        std::mem::take(&mut self.lock().dropped)
    }

    /// No more letters: the writer is done, or nobody reads. Letters inside can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_millis(10);
    const LONG: Duration = Duration::from_secs(20);

    #[test]
    fn a_waiting_writer_loses_nothing_and_keeps_order() {
        let mailbox = Mailbox::new(2, WhenFull::Wait);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                (0..100).for_each(|letter| mailbox.send(letter).expect("open"));
                mailbox.close();
            });
            for letter in 0..100 {
                assert_eq!(mailbox.receive(LONG), Received::Letter(letter));
            }
            assert_eq!(mailbox.receive(LONG), Received::Closed);
        });
        assert_eq!(mailbox.take_dropped(), 0);
    }

    #[test]
    fn a_live_mailbox_keeps_the_newest_and_counts_the_rest() {
        let mailbox = Mailbox::new(1, WhenFull::DropOldest);
        (0..5).for_each(|letter| mailbox.send(letter).expect("open"));
        assert_eq!(mailbox.receive(SOON), Received::Letter(4));
        assert_eq!(mailbox.take_dropped(), 4);
        assert_eq!(mailbox.receive(SOON), Received::TimedOut);
    }

    #[test]
    fn closing_frees_a_writer_that_waits() {
        let mailbox = Mailbox::new(1, WhenFull::Wait);
        mailbox.send(1).expect("open");
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| mailbox.send(2));
            mailbox.close();
            assert_eq!(writer.join().expect("no panic"), Err(2));
        });
    }
}
