//! The connections that were admitted, and the memory that each of them holds: half-received messages, lists, questions that
//! wait, answers that are not sent yet. All of them share one budget. What is decided is in [`table`]; here are the handles
//! that calls hold.

mod table;

use std::net::IpAddr;
use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::Notify;
use tokio::time::Instant;

use table::Table;
pub(super) use table::{BudgetExhausted, NoSeat};

/// The connection slots of a node, shared by all its tasks.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedSeats(Arc<Mutex<Table>>);

impl SharedSeats {
    fn lock(&self) -> MutexGuard<'_, Table> {
        // No statement of it panics between two changes.
        self.0.lock()
    }

    /// A seat for a connection from that machine; `None` is this one. What it holds counts if it is metered.
    pub fn take(&self, from: Option<IpAddr>, leads: bool, metered: bool) -> Result<Arc<Seat>, NoSeat> {
        let id = self.lock().admit(from, leads, Instant::now())?;
        Ok(Arc::new(Seat { seats: self.clone(), id, metered }))
    }

    /// Whether the last lease holder is on that machine.
    pub fn is_of_lease(&self, machine: Option<IpAddr>) -> bool {
        self.lock().is_of_lease(machine)
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
        self.seats.lock().slots.get(&self.id).map_or_else(ended_already, |seat| Arc::clone(&seat.ended))
    }

    /// A call came over it that only the lease holder of that id can make.
    pub fn prove_lease(&self, holder: u64) {
        self.seats.lock().prove_lease(self.id, holder);
    }

    /// A whole message has come.
    pub fn heard(&self) {
        if let Some(seat) = self.seats.lock().slots.get_mut(&self.id) {
            seat.heard = Instant::now();
        }
    }

    /// A call begins (`true`) or has ended.
    pub fn call(&self, begins: bool) {
        if let Some(seat) = self.seats.lock().slots.get_mut(&self.id) {
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
        if let Some(seat) = seats.slots.remove(&self.id) {
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
    pub fn take(seat: &Option<Arc<Seat>>, bytes: usize) -> Result<Share, BudgetExhausted> {
        let mut share = Share::of(seat.clone());
        share.set(bytes)?;
        Ok(share)
    }

    /// So many bytes from now on; what it had stays if there are not so many.
    pub fn set(&mut self, bytes: usize) -> Result<(), BudgetExhausted> {
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
