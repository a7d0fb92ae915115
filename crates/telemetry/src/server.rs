//! HTTP/1.1 for untrusted peers: one request a connection, and few connections.

use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use hyper::body::Incoming;
use hyper::header::{CONTENT_TYPE, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use net::admission::{Policy, Registry, accept_next};
use tokio::net::TcpStream;
use tokio::task::JoinSet;

/// Connections at once: a scraper has one, and probes have theirs. Each is closed once it was answered.
const POLICY: Policy = Policy { beginning: 32, passing: None };
/// The head of a request comes within this.
const HEAD_TIMEOUT: Duration = Duration::from_secs(5);
/// And its answer is read within this, from the beginning.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(15);
/// The longest head.
const MAX_HEAD_BYTES: usize = 8 * 1024;

/// What a request is answered with.
pub(crate) struct Answer {
    pub status: StatusCode,
    pub content_type: &'static str,
    pub text: String,
}

/// Answers until it is dropped.
pub(crate) async fn serve<A>(listener: TcpListener, answer: Arc<A>)
where
    A: Fn(&Method, &str) -> Answer + Send + Sync + 'static,
{
    let listener = match tokio::net::TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => return tracing::error!("metrics cannot be served: {error}"),
    };
    let (mut connections, registry) = (JoinSet::new(), Registry::new(POLICY));
    let log = |error: &std::io::Error| tracing::debug!("the metrics port: {error}");
    loop {
        let (socket, from) = tokio::select! {
            accepted = accept_next(|| listener.accept(), log) => accepted,
            Some(_) = connections.join_next() => continue,
        };
        let slot = registry.begin(Some(from.ip().to_canonical()), Arc::new(()));
        let answer = Arc::clone(&answer);
        connections.spawn(async move {
            tokio::select! {
                () = serve_connection(socket, answer) => {}
                () = slot.evicted() => {}
                () = tokio::time::sleep(CONNECTION_TIMEOUT) => {}
            }
        });
        // A new connection reads what was sent already before the next one may evict it.
        tokio::task::yield_now().await;
    }
}

async fn serve_connection<A>(socket: TcpStream, answer: Arc<A>)
where
    A: Fn(&Method, &str) -> Answer,
{
    let service = service_fn(|request: Request<Incoming>| {
        let response = response(answer(request.method(), request.uri().path()));
        async move { Ok::<_, Infallible>(response) }
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIMEOUT)
        .max_buf_size(MAX_HEAD_BYTES)
        .keep_alive(false)
        .serve_connection(TokioIo::new(socket), service);
    if let Err(error) = served.await {
        tracing::debug!("the metrics port: {error}");
    }
}

fn response(answer: Answer) -> Response<String> {
    let mut response = Response::new(answer.text);
    *response.status_mut() = answer.status;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(answer.content_type));
    response
}
