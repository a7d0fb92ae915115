//! The clients of a run: the pages and programs that give commands.

use std::sync::{Arc, Weak};

/// What a client is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientKind {
    /// A page in a browser.
    Page,
    /// A program.
    Program,
}

/// A page or a program that gives commands. Copies are the same client, which is gone once the last of them is dropped:
/// then the run releases what it holds.
#[derive(Clone, Debug)]
pub struct Client(Arc<ClientKind>);

/// A client that may be gone.
#[derive(Clone, Debug)]
pub struct WeakClient(Weak<ClientKind>);

impl ClientKind {
    /// What a client of some kind calls one of this kind that is not itself.
    pub(crate) fn seen_by(self, other: ClientKind) -> &'static str {
        match (self, self == other) {
            (ClientKind::Page, true) => "another page",
            (ClientKind::Page, false) => "a page",
            (ClientKind::Program, true) => "another program",
            (ClientKind::Program, false) => "a program",
        }
    }
}

impl Client {
    /// A client that is no other.
    pub fn new(kind: ClientKind) -> Client {
        Client(Arc::new(kind))
    }

    pub(crate) fn kind(&self) -> ClientKind {
        *self.0
    }

    /// The same client, which this does not keep from being gone.
    pub fn downgrade(&self) -> WeakClient {
        WeakClient(Arc::downgrade(&self.0))
    }
}

impl WeakClient {
    /// The client, unless it is gone.
    pub fn upgrade(&self) -> Option<Client> {
        self.0.upgrade().map(Client)
    }
}

impl PartialEq for WeakClient {
    fn eq(&self, other: &WeakClient) -> bool {
        Weak::ptr_eq(&self.0, &other.0)
    }
}
