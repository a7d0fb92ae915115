//! Which client holds which body: one client a body, until it releases the body or is gone.

use std::collections::BTreeMap;

use sim::BodyId;

use crate::client::{Client, ClientKind, WeakClient};
use crate::core::command::Command;

/// The bodies that are held, and by which client.
#[derive(Debug, Default)]
pub(crate) struct Holds(BTreeMap<BodyId, WeakClient>);

/// What a command does to holds, once it is carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HoldChange {
    /// The client that gives it holds this body.
    Held(BodyId),
    /// This body is no longer held.
    Released(BodyId),
}

impl HoldChange {
    /// What this command does to holds; `None`: nothing. That another world begins is noted by [`Holds::clear`].
    pub fn of(command: &Command) -> Option<HoldChange> {
        match *command {
            Command::Grab { body, .. } => Some(HoldChange::Held(body)),
            Command::Release { body, .. } | Command::Remove(body) => Some(HoldChange::Released(body)),
            _ => None,
        }
    }
}

impl Holds {
    /// The body that a command would take from another client's hand, and what that client is.
    pub fn conflict(&self, client: &Client, command: &Command) -> Option<(BodyId, ClientKind)> {
        let (Command::Grab { body, .. } | Command::Release { body, .. }) = *command else { return None };
        let holder = self.0.get(&body).filter(|holder| **holder != client.downgrade())?.upgrade()?;
        Some((body, holder.kind()))
    }

    /// A client's command was carried out.
    pub fn note(&mut self, client: &Client, change: HoldChange) {
        match change {
            HoldChange::Held(body) => drop(self.0.insert(body, client.downgrade())),
            HoldChange::Released(body) => self.forget(body),
        }
    }

    /// A body is no longer held.
    pub fn forget(&mut self, body: BodyId) {
        self.0.remove(&body);
    }

    /// Another world has begun: its bodies are others.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Bodies whose holders are gone.
    pub fn orphans(&self) -> Vec<BodyId> {
        let is_orphan = |(body, holder): (&BodyId, &WeakClient)| holder.upgrade().is_none().then_some(*body);
        self.0.iter().filter_map(is_orphan).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRAB: Command = Command::Grab { body: 3, grip_body_m: [0.0; 3], target_m: [0.0, 1.0, 0.0] };
    const RELEASE: Command = Command::Release { body: 3, velocity_m_s: None };

    fn carry_out(holds: &mut Holds, client: &Client, command: &Command) {
        assert_eq!(holds.conflict(client, command), None);
        holds.note(client, HoldChange::of(command).expect("it changes holds"));
    }

    #[test]
    fn a_body_is_held_by_one_client_until_that_one_releases_it() {
        let (page, program) = (Client::new(ClientKind::Page), Client::new(ClientKind::Program));
        let mut holds = Holds::default();
        carry_out(&mut holds, &page, &GRAB);
        carry_out(&mut holds, &page.clone(), &GRAB);
        for command in [GRAB, RELEASE] {
            assert_eq!(holds.conflict(&program, &command), Some((3, ClientKind::Page)), "{command:?}");
        }
        let other = Command::Grab { body: 4, grip_body_m: [0.0; 3], target_m: [0.0; 3] };
        carry_out(&mut holds, &program, &other);
        carry_out(&mut holds, &page, &RELEASE);
        carry_out(&mut holds, &program, &GRAB);
        assert_eq!(holds.conflict(&page, &GRAB), Some((3, ClientKind::Program)));
    }

    #[test]
    fn a_body_that_goes_and_a_world_that_ends_are_no_longer_held() {
        let (page, other) = (Client::new(ClientKind::Page), Client::new(ClientKind::Page));
        let mut holds = Holds::default();
        carry_out(&mut holds, &page, &GRAB);
        carry_out(&mut holds, &other, &Command::Remove(3));
        assert_eq!(holds.conflict(&other, &GRAB), None);
        carry_out(&mut holds, &page, &GRAB);
        holds.clear();
        assert_eq!(holds.conflict(&other, &GRAB), None);
    }

    #[test]
    fn what_a_client_held_is_an_orphan_once_its_last_copy_is_dropped() {
        let (page, other) = (Client::new(ClientKind::Page), Client::new(ClientKind::Page));
        let mut holds = Holds::default();
        carry_out(&mut holds, &page, &GRAB);
        let copy = page.clone();
        drop(page);
        assert_eq!(holds.orphans(), [0; 0]);
        drop(copy);
        assert_eq!((holds.orphans(), holds.conflict(&other, &GRAB)), (vec![3], None));
        holds.forget(3);
        assert_eq!(holds.orphans(), [0; 0]);
    }

    #[test]
    fn a_client_calls_its_like_another_one() {
        assert_eq!(ClientKind::Page.seen_by(ClientKind::Page), "another page");
        assert_eq!(ClientKind::Program.seen_by(ClientKind::Page), "a program");
    }
}
