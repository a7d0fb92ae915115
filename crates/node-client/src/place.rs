//! Where a node is: at an address, or wherever it is found.

use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use futures::FutureExt as _;
use futures::future::{Either, select};
use futures::stream::{BoxStream, FuturesUnordered, StreamExt as _};
use parking_lot::Mutex;
use proto::Address;
use tokio::time::Instant;

use crate::error::NodeError;

/// Addresses of a node that are tried at once: each takes a socket.
const MAX_TRIED_AT_ONCE: usize = 16;
/// Addresses that wait to be tried: those of some looks.
const MAX_WAITING: usize = 512;
/// The program that answers at an address that was only found must say which node it is within this.
const FOUND_TIMEOUT: Duration = Duration::from_secs(5);
/// An address at which the node was not reached may be found again at once: it is not tried again sooner.
const TRY_AGAIN_AFTER: Duration = Duration::from_millis(500);

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

/// Looks for the node for a bounded time: each look gives the addresses at which it may be, in the order in which to try
/// them, before what earlier looks gave. Any of them may belong to another program, which may have announced the node before
/// the node did.
pub type FindNode = dyn Fn() -> BoxStream<'static, Vec<Address>> + Send + Sync;

impl NodePlace {
    /// A place to be found.
    pub fn sought(find: impl Fn() -> BoxStream<'static, Vec<Address>> + Send + Sync + 'static) -> NodePlace {
        NodePlace::Sought(Arc::new(Sought { find: Box::new(find), checked: Mutex::default() }))
    }

    /// Where to try, as many addresses at most; none if the node is not found.
    pub async fn addresses(&self, max: usize) -> Vec<Address> {
        let find = match self {
            NodePlace::At(address) => return vec![address.clone()],
            NodePlace::Sought(sought) => &sought.find,
        };
        let (mut looks, mut addresses) = (find(), Vec::new());
        while addresses.len() < max
            && let Some(found) = looks.next().await
        {
            for address in found {
                if addresses.len() < max && !addresses.contains(&address) {
                    addresses.push(address);
                }
            }
        }
        addresses
    }

    /// Reaches the node: what the first attempt returns that finds the node that is meant. Of a node that is looked for, the
    /// address at which it last was is tried meanwhile, and a machine that only claims to be the node delays it no more
    /// than the other attempts do.
    pub(crate) async fn reach<T, F>(&self, attempt: impl Fn(Address) -> F) -> Result<T, NodeError>
    where
        F: Future<Output = Result<T, NodeError>>,
    {
        let find = match self {
            NodePlace::At(address) => return attempt(address.clone()).await,
            NodePlace::Sought(sought) => &sought.find,
        };
        let attempt = &attempt;
        let attempt_at = |address: Address| async move {
            let tried = tokio::time::timeout(FOUND_TIMEOUT, attempt(address.clone())).await;
            let tried = tried.unwrap_or(Err(NodeError::Timeout(FOUND_TIMEOUT)));
            tried
                .inspect(|_| self.set_checked(&address))
                .map_err(|error| NodeError::At { address, error: Box::new(error) })
        };
        let at_known = async {
            match self.checked() {
                Some(address) => attempt_at(address).await,
                None => Err(NodeError::NotFound),
            }
        };
        let at_found = async {
            let (mut looks, mut open, mut queue) = (find(), FuturesUnordered::new(), Queue::default());
            let (mut is_looking, mut failure) = (true, NodeError::NotFound);
            while is_looking || !open.is_empty() {
                tokio::select! {
                    look = looks.next(), if is_looking => match look {
                        Some(found) => queue.find(found),
                        None => is_looking = false,
                    },
                    Some((address, tried)) = open.next() => {
                        let error: NodeError = match tried {
                            Ok(reached) => return Ok(reached),
                            Err(error) => error,
                        };
                        queue.failed(address);
                        failure = failure.or_more_telling(error);
                    },
                }
                while open.len() < MAX_TRIED_AT_ONCE
                    && let Some(address) = queue.next()
                {
                    open.push(attempt_at(address.clone()).map(|tried| (address, tried)));
                }
            }
            Err(failure)
        };
        tokio::pin!(at_known, at_found);
        match select(at_known, at_found).await {
            Either::Left((Err(known), at_found)) => {
                at_found.await.map_err(|found| known.or_more_telling(found))
            }
            Either::Right((Err(found), at_known)) => {
                at_known.await.map_err(|known| known.or_more_telling(found))
            }
            Either::Left((reached, _)) | Either::Right((reached, _)) => reached,
        }
    }

    /// Whether addresses are only what was announced.
    pub fn is_sought(&self) -> bool {
        matches!(self, NodePlace::Sought(_))
    }

    /// The program that answered at this address is the node that is meant.
    fn set_checked(&self, address: &Address) {
        if let NodePlace::Sought(sought) = self {
            *sought.checked.lock() = Some(address.clone());
        }
    }

    /// Where the node is, as far as that is certain.
    pub(crate) fn checked(&self) -> Option<Address> {
        match self {
            NodePlace::At(address) => Some(address.clone()),
            NodePlace::Sought(sought) => sought.checked.lock().clone(),
        }
    }
}

/// The addresses that were found and are to be tried: those of the newest look first.
#[derive(Default)]
struct Queue {
    waiting: Vec<Address>,
    /// Addresses that were tried, and when each may be tried again: never while it is being tried.
    tried: HashMap<Address, Option<Instant>>,
}

impl Queue {
    /// A look found these, in the order in which to try them.
    fn find(&mut self, mut found: Vec<Address>) {
        self.waiting.retain(|address| !found.contains(address));
        found.append(&mut self.waiting);
        found.truncate(MAX_WAITING);
        self.waiting = found;
    }

    fn next(&mut self) -> Option<Address> {
        let now = Instant::now();
        self.tried.retain(|_, again| again.is_none_or(|again| now < again));
        let next = self.waiting.iter().position(|address| !self.tried.contains_key(address));
        self.waiting.drain(..next.unwrap_or(self.waiting.len()));
        let address = (!self.waiting.is_empty()).then(|| self.waiting.remove(0))?;
        self.tried.insert(address.clone(), None);
        Some(address)
    }

    fn failed(&mut self, address: Address) {
        self.tried.insert(address, Some(Instant::now() + TRY_AGAIN_AFTER));
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

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use futures::stream;

    use super::*;

    fn at(port: usize) -> Address {
        Address::Tcp(format!("192.0.2.1:{port}"))
    }

    /// The place of a node that is announced at ports from 1 on.
    fn announced(count: usize) -> NodePlace {
        NodePlace::sought(move || stream::iter([(1..=count).map(at).collect()]).boxed())
    }

    async fn silent<T>() -> T {
        std::future::pending().await
    }

    #[tokio::test(start_paused = true)]
    async fn silent_addresses_do_not_keep_the_node_from_being_found() {
        let (place, tried) = (announced(100), AtomicUsize::new(0));
        let tried = &tried;
        let attempt = |address: Address| async move {
            tried.fetch_add(1, Ordering::Relaxed);
            if address == at(40) { Ok(40) } else { silent().await }
        };
        let began = Instant::now();
        assert_eq!(place.reach(attempt).await, Ok(40));
        assert_eq!(began.elapsed(), 2 * FOUND_TIMEOUT, "it is among the third sixteen");
        assert!(tried.load(Ordering::Relaxed) <= 3 * MAX_TRIED_AT_ONCE);
    }

    #[tokio::test(start_paused = true)]
    async fn a_node_that_announces_itself_after_others_claimed_to_be_it_is_found() {
        for others_are_silent in [false, true] {
            let began = Instant::now();
            let look = async |looks| {
                tokio::time::sleep(Duration::from_millis(100)).await;
                let first = if looks < 10 { 2 } else { 1 };
                Some(((first..=10).map(at).collect(), looks + 1))
            };
            let place = NodePlace::sought(move || stream::unfold(1, look).boxed());
            let attempt = |address: Address| async move {
                match address == at(1) {
                    true => Ok(()),
                    false if others_are_silent => silent().await,
                    false => Err(NodeError::NotConnected),
                }
            };
            assert_eq!(place.reach(attempt).await, Ok(()));
            assert_eq!(began.elapsed(), Duration::from_secs(1));
        }
    }

    #[tokio::test(start_paused = true)]
    async fn the_node_of_a_later_look_is_next_whatever_was_found_before() {
        let looks = [(1..=16).collect(), (17..=128).collect(), vec![1, 2, 200, 17]];
        let looks = looks.map(|ports: Vec<_>| ports.into_iter().map(at).collect::<Vec<_>>());
        let place = NodePlace::sought(move || stream::iter(looks.clone()).boxed());
        let attempt =
            |address: Address| async move { if address == at(200) { Ok(()) } else { silent().await } };
        let began = Instant::now();
        assert_eq!(place.reach(attempt).await, Ok(()));
        assert_eq!(began.elapsed(), FOUND_TIMEOUT, "the first sixteen are silent");
    }

    #[tokio::test(start_paused = true)]
    async fn what_earlier_looks_found_is_tried_after_what_later_ones_found() {
        let place = NodePlace::sought(|| stream::iter([(1..=100).map(at).collect(), vec![at(200)]]).boxed());
        let attempt =
            |address: Address| async move { if address == at(100) { Ok(()) } else { silent().await } };
        assert_eq!(place.reach(attempt).await, Ok(()));
    }

    #[tokio::test(start_paused = true)]
    async fn a_node_that_refuses_is_asked_twice_a_second_while_it_is_looked_for() {
        let look = async |looks| {
            tokio::time::sleep(Duration::from_millis(150)).await;
            (looks < 13).then_some((vec![at(1)], looks + 1))
        };
        let (place, tried) =
            (NodePlace::sought(move || stream::unfold(0, look).boxed()), AtomicUsize::new(0));
        let attempt = |_| async {
            tried.fetch_add(1, Ordering::Relaxed);
            Err::<(), _>(NodeError::Refused("no".into()))
        };
        place.reach(attempt).await.expect_err("it refuses");
        assert_eq!(tried.load(Ordering::Relaxed), 4, "within two seconds");
    }

    #[tokio::test(start_paused = true)]
    async fn the_last_address_is_tried_whatever_is_announced() {
        let place = announced(100);
        let attempt =
            |address: Address| async move { if address == at(7) { Ok(()) } else { silent().await } };
        assert_eq!(place.reach(attempt).await, Ok(()));
        let found = NodePlace::sought(|| stream::pending().boxed());
        let (NodePlace::Sought(known), NodePlace::Sought(next)) = (&place, &found) else { panic!("sought") };
        *next.checked.lock() = known.checked.lock().clone();
        assert_eq!(found.reach(attempt).await, Ok(()));
    }

    #[tokio::test(start_paused = true)]
    async fn a_refusal_is_reported_rather_than_silence() {
        let attempt = |address: Address| async move {
            if address == at(2) { Err::<(), _>(NodeError::Refused("no".into())) } else { silent().await }
        };
        let error = announced(3).reach(attempt).await.expect_err("refused");
        assert_eq!(error.to_string(), "at 192.0.2.1:2: no");
        let error = announced(0).reach(attempt).await.expect_err("not announced");
        assert_eq!(error, NodeError::NotFound);
    }
}
