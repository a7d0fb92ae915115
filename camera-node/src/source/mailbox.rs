//! A bounded queue of frames from the thread that reads them to the thread that uses them.

use std::collections::VecDeque;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use parking_lot::{Condvar, Mutex, MutexGuard};

/// What a full mailbox does with one more message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenFull {
    /// The writer waits: a film loses nothing.
    Wait,
    /// The oldest message goes: a live camera does not wait, and old frames are of no use.
    DropOldest,
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
    messages: VecDeque<T>,
    closed: bool,
}

impl<T> Mailbox<T> {
    /// An empty mailbox for up to `capacity` messages, at least one.
    pub fn new(capacity: usize, when_full: WhenFull) -> Mailbox<T> {
        let state = State { messages: VecDeque::new(), closed: false };
        Mailbox { state: Mutex::new(state), changed: Condvar::new(), capacity: capacity.max(1), when_full }
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        // Nothing panics while it holds the lock, and the state is whole between any two lines.
        self.state.lock()
    }

    /// Puts a message in, waiting if that is the rule; gives it back if the mailbox is closed.
    pub fn send(&self, message: T) -> Result<(), T> {
        let mut state = self.lock();
        while self.when_full == WhenFull::Wait && state.messages.len() >= self.capacity && !state.closed {
            self.changed.wait(&mut state);
        }
        if state.closed {
            return Err(message);
        }
        if state.messages.len() >= self.capacity {
            state.messages.pop_front();
        }
        state.messages.push_back(message);
        self.changed.notify_all();
        Ok(())
    }

    /// Takes the oldest message, waiting up to `limit` for one: none comes once the writer has closed and
    /// every message was received.
    pub fn receive(&self, limit: Duration) -> Result<T, RecvTimeoutError> {
        let must_wait = |state: &mut State<T>| state.messages.is_empty() && !state.closed;
        let mut state = self.lock();
        self.changed.wait_while_for(&mut state, must_wait, limit);
        let none = if state.closed { RecvTimeoutError::Disconnected } else { RecvTimeoutError::Timeout };
        let message = state.messages.pop_front().ok_or(none)?;
        self.changed.notify_all();
        Ok(message)
    }

    /// No more messages: the writer is done, or the reader is gone. Messages inside can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_millis(10);
    const LONG: Duration = Duration::from_secs(100);

    #[test]
    fn a_waiting_writer_loses_nothing_and_keeps_order() {
        let mailbox = Mailbox::new(2, WhenFull::Wait);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                (0..100).for_each(|message| mailbox.send(message).expect("open"));
                mailbox.close();
            });
            for message in 0..100 {
                assert_eq!(mailbox.receive(LONG), Ok(message));
            }
            assert_eq!(mailbox.receive(LONG), Err(RecvTimeoutError::Disconnected));
        });
    }

    #[test]
    fn a_live_mailbox_keeps_the_newest() {
        let mailbox = Mailbox::new(1, WhenFull::DropOldest);
        (0..5).for_each(|message| mailbox.send(message).expect("open"));
        assert_eq!(mailbox.receive(SOON), Ok(4));
        assert_eq!(mailbox.receive(SOON), Err(RecvTimeoutError::Timeout));
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
