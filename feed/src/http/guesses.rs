//! Wrong tokens: each is answered late, one after the other, so that a token cannot be guessed. A peer with the right one does
//! not wait.

use std::time::Duration;

use tokio::sync::Mutex;
use tokio::time::Instant;

/// A wrong token is answered after so long, and the next one after it: ten a second, from all peers together.
const TAKES: Duration = Duration::from_millis(100);
/// A line so often at most.
const LOG_EVERY: Duration = Duration::from_secs(1);

/// The wrong tokens of all peers.
#[derive(Debug, Default)]
pub(crate) struct Guesses(Mutex<Counted>);

#[derive(Debug, Default)]
struct Counted {
    logged: Option<Instant>,
    /// Those since the last line.
    count: u64,
}

impl Guesses {
    /// Completes when a wrong token may be answered.
    pub async fn wrong(&self) {
        let mut counted = self.0.lock().await;
        counted.count += 1;
        if counted.logged.is_none_or(|logged| logged.elapsed() >= LOG_EVERY) {
            tracing::warn!("{} wrong tokens at the page's port", counted.count);
            (counted.logged, counted.count) = (Some(Instant::now()), 0);
        }
        tokio::time::sleep(TAKES).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn ten_wrong_tokens_a_second_are_answered_whoever_sends_them() {
        let (guesses, began) = (Guesses::default(), Instant::now());
        futures::future::join_all((0..50).map(|_| guesses.wrong())).await;
        assert_eq!(began.elapsed().as_secs(), 5);
    }
}
