//! Requests to end the program. All of them end it the same way: nodes are stopped, temporary folders removed.

use futures::future::select_all;
use tokio::signal::unix::{SignalKind, signal};

/// From now on the program does not die of Ctrl-C (SIGINT), SIGTERM, SIGQUIT and of a terminal that closes
/// (SIGHUP); what is returned completes with the first of them. Must be called within a tokio runtime.
pub fn interrupted() -> impl Future<Output = ()> {
    let kinds = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::quit(), SignalKind::hangup()];
    let signals = kinds.into_iter().filter_map(|kind| signal(kind).ok());
    let waits: Vec<_> = signals.map(|mut signal| Box::pin(async move { signal.recv().await })).collect();
    async move {
        if waits.is_empty() {
            return std::future::pending().await;
        }
        drop(select_all(waits).await);
    }
}
