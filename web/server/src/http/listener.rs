//! A port that speaks HTTP, for as long as its program runs.

use std::io;
use std::sync::Arc;

use axum::Router;
use net::admission::{Registry, accept_next};
use net::{Credentials, HandshakeLimit};
use socket2::SockRef;
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::task::JoinSet;

use super::POLICY;
use super::connection::{Connection, PortShared};
use super::linger::Lingering;
use super::refusals::{Refusal, Refusals};

/// Connections that the system keeps until they are accepted. The standard library's own bound, 128, is filled by one burst,
/// and who comes then waits for a second.
const BACKLOG: i32 = 1024;

/// A port that listens.
#[derive(Debug)]
pub(crate) struct Port {
    listener: TcpListener,
    shared: Arc<PortShared>,
}

impl Port {
    /// Takes over a listener that does not block; `name` is what the log calls it. With credentials it speaks HTTPS, and requests
    /// no certificate of clients: browsers have none. Must run within a runtime.
    pub fn new(
        listener: std::net::TcpListener,
        name: &'static str,
        credentials: Option<Arc<Credentials>>,
    ) -> io::Result<Port> {
        SockRef::from(&listener).listen(BACKLOG)?;
        let shared = PortShared {
            credentials,
            handshakes: HandshakeLimit::default(),
            lingering: Lingering::default(),
            registry: Registry::new(POLICY),
            refusals: Refusals::new(name),
        };
        Ok(Port { listener: TcpListener::from_std(listener)?, shared: Arc::new(shared) })
    }

    /// Its sockets that were closed, until their peers have read what they were sent last.
    pub fn lingering(&self) -> Lingering {
        self.shared.lingering.clone()
    }

    /// Answers until the end, and then until what was asked is answered. Each request has its [`Connection`] as an
    /// extension.
    pub async fn serve(self, router: Router, mut ending: watch::Receiver<bool>) {
        let mut connections = JoinSet::new();
        let of_connections = ending.clone();
        loop {
            let log = |error: &io::Error| self.shared.refusals.log(None, &Refusal::System(error.to_string()));
            let (stream, from) = tokio::select! {
                accepted = accept_next(|| self.listener.accept(), log) => accepted,
                Some(_) = connections.join_next() => continue,
                // An end whose sender is gone is an end.
                _ = ending.wait_for(|ended| *ended) => break,
            };
            let connection = Connection::new(&self.shared, from.ip().to_canonical());
            connections.spawn(connection.serve(stream, router.clone(), of_connections.clone()));
            // A new connection reads what was sent already before the next one may evict it.
            tokio::task::yield_now().await;
        }
        drop(self.listener);
        while connections.join_next().await.is_some() {}
    }
}
