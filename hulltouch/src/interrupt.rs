//! Requests to end the program. All of them end it the same way: nodes are stopped, temporary folders removed.

use futures::future::select_all;
use tokio::signal::unix::{SignalKind, signal};

/// Completes on Ctrl-C (SIGINT), SIGTERM, SIGQUIT, and when the terminal goes (SIGHUP). Must run within a tokio
/// runtime.
pub async fn interrupted() {
    let kinds = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::quit(), SignalKind::hangup()];
    let signals = kinds.into_iter().filter_map(|kind| signal(kind).ok());
    let waits: Vec<_> = signals.map(|mut signal| Box::pin(async move { signal.recv().await })).collect();
    if waits.is_empty() {
        return std::future::pending().await;
    }
    drop(select_all(waits).await);
}
