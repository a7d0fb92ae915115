//! Which connections are kept, and what each may hold.

use super::super::{Seat, Share, SharedSeats};
use super::*;

const MIB: usize = 1 << 20;

fn machine(last: u8) -> Option<IpAddr> {
    Some(IpAddr::from([10, 0, 0, last]))
}

#[test]
fn the_connection_that_holds_most_gives_way_and_no_other() {
    let (seats, now) = (SharedSeats::default(), Instant::now());
    let seat = |last| {
        let id = seats.lock().admit(machine(last), true, now).expect("room");
        Arc::new(Seat { seats: seats.clone(), id, metered: true })
    };
    let [greedy, other, small] = [1, 2, 3].map(seat);
    let held = [(&greedy, 40), (&other, 27)]
        .map(|(seat, mib)| Share::take(&Some(Arc::clone(seat)), mib * MIB).expect("within the budget"));
    assert!(Share::take(&Some(Arc::clone(&greedy)), 2 * MIB).is_err(), "it holds most itself");
    assert_eq!(seats.lock().slots.len(), 3, "what is refused changes nothing");
    let two = Share::take(&Some(Arc::clone(&small)), 2 * MIB).expect("the greedy one gives way");
    assert_eq!(seats.lock().held_bytes, 29 * MIB);
    assert!(!seats.lock().slots.contains_key(&greedy.id()));
    assert!(Share::take(&Some(Arc::clone(&greedy)), 1).is_err(), "it has ended");
    drop((held, two, greedy, other, small));
    let seats = seats.lock();
    assert_eq!((seats.held_bytes, seats.slots.len()), (0, 0));
}

#[test]
fn what_a_machine_holds_over_several_connections_counts_together() {
    let seats = SharedSeats::default();
    let seat = |last| seats.take(machine(last), true, true).expect("room");
    let (leader, others) = (seat(1), [seat(2), seat(2), seat(2)]);
    let take = |seat: &Arc<Seat>, mib| Share::take(&Some(Arc::clone(seat)), mib * MIB);
    let led = take(&leader, 20).expect("room");
    let held = others.each_ref().map(|seat| take(seat, 16).expect("room"));
    assert!(take(&others[0], 2).is_err(), "the leader holds less than they do together");
    let more = take(&leader, 10).expect("one of them gives way");
    assert_eq!(seats.lock().held_bytes, 62 * MIB);
    assert!(seats.lock().slots.contains_key(&leader.id()));
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
    let (mut seats, began) = (Table::default(), Instant::now());
    let at = |seconds| began + Duration::from_secs(seconds);
    let first: Vec<u64> =
        (0..4).map(|second| seats.admit(machine(1), true, at(second)).expect("room")).collect();
    assert_eq!(seats.admit(machine(1), true, at(4)), Err(NoSeat::TooMany), "all have been heard");
    let fifth = seats.admit(machine(1), true, at(5)).expect("the first gives way");
    assert!(!seats.slots.contains_key(&first[0]) && seats.slots.contains_key(&fifth));
    for other in 0..28 {
        seats.admit(machine(10 + other), true, at(9)).expect("room");
    }
    assert!(seats.admit(machine(99), true, at(9)).is_ok(), "the second gives way");
    assert_eq!(seats.slots.len(), MAX_CONNECTIONS);
    assert!(!seats.slots.contains_key(&first[1]));
}

#[test]
fn viewers_leave_room_for_coordinators() {
    let (mut seats, now) = (Table::default(), Instant::now());
    for viewer in 0..16 {
        seats.admit(machine(viewer), false, now).expect("room");
    }
    assert_eq!(seats.admit(machine(90), false, now), Err(NoSeat::Full));
    assert!(seats.admit(machine(91), true, now).is_ok());
}

#[test]
fn a_connection_without_a_call_ends() {
    let (mut seats, began) = (Table::default(), Instant::now());
    let [busy, silent] = [began; 2].map(|began| seats.admit(machine(1), true, began).expect("room"));
    let never = seats.admit(machine(1), true, began + Duration::from_secs(50)).expect("room");
    seats.slots.get_mut(&busy).expect("there").calls = 1;
    for id in [busy, silent] {
        seats.slots.get_mut(&id).expect("there").has_called = true;
    }
    seats.end_idle(began + Duration::from_secs(54));
    assert_eq!(seats.slots.len(), 3);
    seats.end_idle(began + Duration::from_secs(59));
    assert!(seats.slots.len() == 2 && !seats.slots.contains_key(&never), "it never called anything");
    seats.end_idle(began + IDLE);
    assert!(seats.slots.contains_key(&busy) && !seats.slots.contains_key(&silent));
}

/// A lease holder of id 7 on machine 1, with its connection.
fn leased(seats: &SharedSeats) -> Arc<Seat> {
    let leader = seats.take(machine(1), true, true).expect("a slot");
    leader.prove_lease(7);
    leader
}

#[test]
fn the_lease_holder_may_use_the_whole_budget() {
    let seats = SharedSeats::default();
    let others: Vec<_> =
        (0..28).map(|last| seats.take(machine(10 + last), true, true).expect("room")).collect();
    let take = |seat: &Arc<Seat>, bytes| Share::take(&Some(Arc::clone(seat)), bytes);
    let _held: Vec<_> = others.iter().map(|seat| take(seat, 2 * MIB + MIB / 4).expect("room")).collect();
    let _last = take(&others[0], MAX_HELD_BYTES - seats.held_bytes()).expect("the rest");
    let leader = leased(&seats);
    let question = take(&leader, 6 * MIB).expect("another connection ends");
    assert_eq!(seats.lock().slots.len(), 28, "the one that holds most, 7.25 MiB");
    let message = take(&leader, 62 * MIB).expect("all others that hold memory end");
    assert_eq!(seats.held_bytes(), MAX_HELD_BYTES);
    assert_eq!(seats.lock().slots.len(), 1);
    assert_eq!(take(&leader, 1).map(|_| ()), Err(BudgetExhausted), "it holds all of it");
    let late = seats.take(machine(99), true, true).expect("a slot");
    assert_eq!(
        take(&late, 1).map(|_| ()),
        Err(BudgetExhausted),
        "the lease holder's connection does not end for another"
    );
    drop((question, message));
}

#[test]
fn a_lease_that_another_takes_over_takes_its_rights_along() {
    let seats = SharedSeats::default();
    let old = leased(&seats);
    let held = Share::take(&Some(Arc::clone(&old)), 60 * MIB).expect("room");
    let new = seats.take(machine(2), true, true).expect("a slot");
    new.prove_lease(8);
    let _all = Share::take(&Some(Arc::clone(&new)), 60 * MIB).expect("the old one ends");
    assert!(!seats.lock().slots.contains_key(&old.id()));
    drop(held);
}

#[test]
fn many_addresses_of_one_attacker_keep_no_coordinator_out() {
    let (mut table, began) = (Table::default(), Instant::now());
    let at = |tenths: u64| began + Duration::from_millis(100 * tenths);
    let coordinator = Some(IpAddr::from([192, 168, 7, 1]));
    // Eight addresses, four connections each, all of which have sent a message just now.
    let attackers: Vec<u64> =
        (0..32).map(|count| table.admit(machine(10 + count / 4), true, began).expect("a slot")).collect();
    let first =
        table.admit(coordinator, true, at(1)).expect("a machine with four gives way to one with none");
    table.prove_lease(first, 7);
    assert!(table.admit(machine(77), true, at(2)).is_ok(), "a machine that has none");
    assert!(table.admit(coordinator, true, at(3)).is_ok(), "the machine of the lease holder");
    // For ever as many others, each from its own address, as can be: the lease holder stays.
    let mut admitted = 0;
    for (tenth, last) in (4..2000).zip((100..200).cycle()) {
        table.slots.values_mut().for_each(|slot| slot.heard = at(tenth));
        admitted += usize::from(table.admit(machine(last), true, at(tenth)).is_ok());
        assert!(table.slots.contains_key(&first) && table.slots.len() <= MAX_CONNECTIONS);
    }
    assert!(admitted > 100 && attackers.iter().all(|id| !table.slots.contains_key(id)));
    assert!(table.admit(coordinator, true, at(2000)).is_ok(), "slots are kept for its machine");
}

#[test]
fn a_coordinator_without_a_lease_gets_in_past_as_many_addresses_as_there_are_slots() {
    let (mut table, began) = (Table::default(), Instant::now());
    let at = |tenths: u64| began + Duration::from_millis(100 * tenths);
    for last in 0..32 {
        table.admit(machine(10 + last), true, began).expect("a slot");
    }
    table.slots.values_mut().for_each(|slot| slot.heard = at(19));
    assert_eq!(table.admit(machine(1), true, at(19)), Err(NoSeat::Full), "all of them are new");
    let coordinator = table.admit(machine(1), true, at(20)).expect("a connection of two seconds gives way");
    // Those that come back take the place of others like them first: it has time to claim the lease.
    for last in 0..31 {
        table.admit(machine(100 + last), true, at(21)).expect("a slot");
    }
    assert!(table.slots.contains_key(&coordinator));
}

#[test]
fn viewers_end_no_connection_of_a_coordinator_that_is_heard() {
    let (mut table, began) = (Table::default(), Instant::now());
    for last in 0..32 {
        table.admit(machine(last), true, began).expect("a slot");
    }
    let later = began + Duration::from_secs(4);
    assert_eq!(table.admit(machine(90), false, later), Err(NoSeat::Full));
}
