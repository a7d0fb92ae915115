//! Where a node is: at an address, or wherever it is found.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use futures::future::BoxFuture;
use proto::Address;

/// As many addresses of a node are tried at once; the others are left out.
const MAX_TRIED: usize = 8;

/// Where a node is. Clones share what was found.
#[derive(Clone)]
pub enum NodePlace {
    /// It listens there.
    At(Address),
    /// It is looked for, whenever a connection is made.
    Sought(Arc<Sought>),
}

/// A node that is looked for.
pub struct Sought {
    find: Box<FindNode>,
    /// Where the node was when it was last checked.
    checked: Mutex<Option<Address>>,
}

/// Addresses at which the node may be, within a bounded time; none: nobody says where it is. Any of them may be
/// somebody else's.
pub type FindNode = dyn Fn() -> BoxFuture<'static, Vec<Address>> + Send + Sync;

impl NodePlace {
    /// A place to be found.
    pub fn sought(find: impl Fn() -> BoxFuture<'static, Vec<Address>> + Send + Sync + 'static) -> NodePlace {
        NodePlace::Sought(Arc::new(Sought { find: Box::new(find), checked: Mutex::default() }))
    }

    /// Where to try; none if the node is not found.
    pub async fn addresses(&self) -> Vec<Address> {
        match self {
            NodePlace::At(address) => vec![address.clone()],
            NodePlace::Sought(sought) => {
                let mut found = (sought.find)().await;
                found.truncate(MAX_TRIED);
                found
            }
        }
    }

    /// Whether addresses are only what somebody said.
    pub fn is_sought(&self) -> bool {
        matches!(self, NodePlace::Sought(_))
    }

    /// Who answered at this address is the node that is meant.
    pub(crate) fn set_checked(&self, address: &Address) {
        if let NodePlace::Sought(sought) = self {
            *sought.checked.lock().unwrap_or_else(PoisonError::into_inner) = Some(address.clone());
        }
    }

    /// Where the node is, as far as that is certain.
    pub(crate) fn checked(&self) -> Option<Address> {
        match self {
            NodePlace::At(address) => Some(address.clone()),
            NodePlace::Sought(sought) => {
                sought.checked.lock().unwrap_or_else(PoisonError::into_inner).clone()
            }
        }
    }
}

impl From<Address> for NodePlace {
    fn from(address: Address) -> NodePlace {
        NodePlace::At(address)
    }
}

impl fmt::Display for NodePlace {
    /// The address, where it is certain.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.checked() {
            Some(address) => address.fmt(f),
            None => f.write_str("not found yet"),
        }
    }
}

impl fmt::Debug for NodePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "NodePlace({self})")
    }
}
