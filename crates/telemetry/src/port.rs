//! What is asked on the port, and the thread that answers.

use std::borrow::Cow;
use std::fmt;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

use hyper::{Method, StatusCode};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, text};
use prometheus_client::registry::Registry;
use thiserror::Error;
use tokio::sync::oneshot;

use crate::server::{Answer, serve};
use crate::sheet::Sheet;

/// What Prometheus insists on for this text.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const PLAIN: &str = "text/plain; charset=utf-8";

/// What a service tells of itself. Asked on another thread than the service's own: it must not wait for it.
pub trait Telemetry: Send + Sync + 'static {
    /// Writes all metrics.
    fn metrics(&self, sheet: &mut Sheet<'_>) -> fmt::Result;

    /// Why the service must be restarted, if so: its loop no longer turns.
    fn stuck(&self) -> Option<String>;

    /// What it lacks to do its work now, if anything.
    fn lacks(&self) -> Option<String>;
}

/// There is no such port.
#[derive(Debug, Error)]
pub enum PortError {
    /// The address cannot be had.
    #[error("cannot listen on {address}: {error}")]
    Listen {
        /// The address to listen on.
        address: SocketAddr,
        /// The system's reason.
        error: std::io::Error,
    },
    /// The system gives no thread, or no runtime.
    #[error("cannot serve metrics: {0}")]
    System(#[from] std::io::Error),
}

/// The port, until it is dropped.
#[derive(Debug)]
pub struct TelemetryPort {
    address: SocketAddr,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl TelemetryPort {
    /// Binds an address (port 0 is any free one) and begins to answer. Every metric carries these labels.
    pub fn start(
        listen: SocketAddr,
        labels: &[(&'static str, String)],
        telemetry: Arc<dyn Telemetry>,
    ) -> Result<TelemetryPort, PortError> {
        let listener = TcpListener::bind(listen);
        let listener = listener.map_err(|error| PortError::Listen { address: listen, error })?;
        let address = listener.local_addr()?;
        listener.set_nonblocking(true)?;
        let labels = labels.iter().map(|(name, value)| (Cow::Borrowed(*name), Cow::Owned(value.clone())));
        let mut registry = Registry::with_prefix_and_labels("hulltouch", labels);
        registry.register_collector(Box::new(ServiceCollector::of(Arc::clone(&telemetry))));
        let (end, ended) = oneshot::channel();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = std::thread::Builder::new().name("metrics".into()).spawn(move || {
            let answer = move |method: &Method, path: &str| answer(method, path, &registry, &*telemetry);
            // An end whose sender is gone is an end.
            runtime.block_on(async {
                tokio::select! {
                    () = serve(listener, Arc::new(answer)) => {}
                    _ = ended => {}
                }
            });
            runtime.shutdown_background();
        })?;
        Ok(TelemetryPort { address, end: Some(end), thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for TelemetryPort {
    fn drop(&mut self) {
        self.end = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread is on standard error already.
            let _ = thread.join();
        }
    }
}

/// What a service tells of itself, with what all of them tell.
struct ServiceCollector {
    telemetry: Arc<dyn Telemetry>,
    began_unix_s: f64,
}

impl ServiceCollector {
    fn of(telemetry: Arc<dyn Telemetry>) -> ServiceCollector {
        let began = SystemTime::now().duration_since(UNIX_EPOCH);
        ServiceCollector { telemetry, began_unix_s: began.map_or(0.0, |began| began.as_secs_f64()) }
    }
}

impl Collector for ServiceCollector {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let mut sheet = Sheet::new(encoder);
        let version = vec![("version", env!("CARGO_PKG_VERSION").to_owned())];
        sheet.gauge("build_info", "Which program this is.", [(version, 1.0)])?;
        let began = "When the process began, Unix seconds.";
        sheet.gauge("start_time_seconds", began, [(vec![], self.began_unix_s)])?;
        let ready = f64::from(u8::from(self.telemetry.lacks().is_none()));
        sheet.gauge("ready", "Whether /ready says so.", [(vec![], ready)])?;
        self.telemetry.metrics(&mut sheet)
    }
}

impl fmt::Debug for ServiceCollector {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("ServiceCollector")
    }
}

fn answer(method: &Method, path: &str, registry: &Registry, telemetry: &dyn Telemetry) -> Answer {
    let plain = |status, text: String| Answer { status, content_type: PLAIN, text };
    if method != Method::GET && method != Method::HEAD {
        return plain(StatusCode::METHOD_NOT_ALLOWED, "expected GET\n".into());
    }
    let checked = |problem: Option<String>, well: &str| match problem {
        Some(problem) => plain(StatusCode::SERVICE_UNAVAILABLE, format!("{problem}\n")),
        None => plain(StatusCode::OK, format!("{well}\n")),
    };
    match path {
        "/live" => checked(telemetry.stuck(), "live"),
        "/ready" => checked(telemetry.lacks(), "ready"),
        "/metrics" => {
            let mut text = String::new();
            match text::encode(&mut text, registry) {
                Ok(()) => Answer { status: StatusCode::OK, content_type: OPEN_METRICS, text },
                Err(_) => plain(StatusCode::INTERNAL_SERVER_ERROR, "metrics cannot be written\n".into()),
            }
        }
        _ => plain(StatusCode::NOT_FOUND, "expected /metrics, /live or /ready\n".into()),
    }
}
