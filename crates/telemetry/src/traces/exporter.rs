//! Sends spans to a collector by OTLP over gRPC.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::{ExporterBuildError, SpanExporter, WithExportConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::error::{OTelSdkError, OTelSdkResult};
use opentelemetry_sdk::trace::{
    BatchConfigBuilder, BatchSpanProcessor, Sampler, SdkTracerProvider, SpanData,
};
use proto::text::{MAX_MESSAGE_CHARS, clean};
use thiserror::Error;
use tokio::runtime::Runtime;

use super::endpoint::Endpoint;
use super::span::TRACER;

/// Of so many passes one is traced: about one a second. `OTEL_TRACES_SAMPLER` chooses others.
const SAMPLED_SHARE: f64 = 0.01;
/// `OpenTelemetry`'s own name for that.
const SAMPLER_VARIABLE: &str = "OTEL_TRACES_SAMPLER";
/// Spans that wait, of 0.5 KB each; beyond, they are dropped: a collector that is away takes no memory.
const MAX_WAITING: usize = 4096;
/// How long they wait for others to be sent with.
const SEND_EVERY: Duration = Duration::from_secs(1);
/// A collector that takes longer has not got them.
const SEND_TIMEOUT: Duration = Duration::from_secs(3);
/// The end of a process is not held up for longer.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Whose spans they are.
#[derive(Clone, Copy, Debug)]
pub struct Process<'a> {
    /// `coordinator` or `node`: the service is called `hulltouch-` and that.
    pub role: &'static str,
    /// The room of its cluster file: the service's namespace. Empty: none.
    pub room: &'a str,
    /// Its name there: the service's instance. Empty: none.
    pub name: &'a str,
}

/// Why spans cannot be sent.
#[derive(Debug, Error)]
pub enum OtlpError {
    /// The exporter does not start.
    #[error("cannot send traces: {0}")]
    Exporter(#[from] ExporterBuildError),
    /// The system gives no thread.
    #[error("cannot send traces: {0}")]
    Thread(#[from] std::io::Error),
}

/// Sends this process's spans for as long as it lives; what waits then is sent first. One a process.
#[derive(Debug)]
pub struct Exporter {
    provider: SdkTracerProvider,
    /// Moves the bytes: the program's own runtimes are busy with passes.
    _runtime: Runtime,
}

impl Exporter {
    /// From now on, spans of this process go to a collector. The process does not wait for it; one that is not there is logged once, and
    /// spans are dropped until it is.
    pub fn begin(endpoint: &Endpoint, process: Process<'_>) -> Result<Exporter, OtlpError> {
        let threads = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = threads?;
        let inner = {
            let _within = runtime.enter();
            SpanExporter::builder()
                .with_tonic()
                .with_endpoint(endpoint.to_string())
                .with_timeout(SEND_TIMEOUT)
                .build()?
        };
        let exporter = Reported {
            inner: Arc::new(inner),
            endpoint: endpoint.clone(),
            fails: AtomicBool::new(false),
            runtime: runtime.handle().clone(),
        };
        let batches = BatchConfigBuilder::default()
            .with_max_queue_size(MAX_WAITING)
            .with_scheduled_delay(SEND_EVERY)
            .build();
        let batches = BatchSpanProcessor::builder(exporter).with_batch_config(batches).build();
        let mut provider =
            SdkTracerProvider::builder().with_resource(resource(process)).with_span_processor(batches);
        if std::env::var_os(SAMPLER_VARIABLE).is_none() {
            let share = Sampler::TraceIdRatioBased(SAMPLED_SHARE);
            provider = provider.with_sampler(Sampler::ParentBased(Box::new(share)));
        }
        let provider = provider.build();
        // Of a second exporter nothing would be sent; the program makes one.
        let _ = TRACER.set(provider.tracer("hulltouch"));
        Ok(Exporter { provider, _runtime: runtime })
    }
}

impl Drop for Exporter {
    fn drop(&mut self) {
        // A collector that is away is no reason to end differently, and was logged.
        let _ = self.provider.shutdown_with_timeout(LAST_WORDS);
    }
}

fn resource(process: Process<'_>) -> Resource {
    let Process { role, room, name } = process;
    let named = [("service.namespace", room), ("service.instance.id", name)];
    let named = named.into_iter().filter(|(_, value)| !value.is_empty());
    Resource::builder()
        .with_service_name(format!("hulltouch-{role}"))
        .with_attribute(KeyValue::new("service.version", env!("CARGO_PKG_VERSION")))
        .with_attributes(named.map(|(key, value)| KeyValue::new(key, value.to_owned())))
        .build()
}

/// Logs once that spans do not arrive, and once that they do again.
#[derive(Debug)]
struct Reported {
    inner: Arc<SpanExporter>,
    endpoint: Endpoint,
    fails: AtomicBool,
    runtime: tokio::runtime::Handle,
}

impl opentelemetry_sdk::trace::SpanExporter for Reported {
    async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
        let inner = Arc::clone(&self.inner);
        // Timeouts need the runtime; who asks has none.
        let sent = self.runtime.spawn(async move { inner.export(batch).await }).await;
        let sent = sent.unwrap_or_else(|error| Err(OTelSdkError::InternalFailure(error.to_string())));
        let failed = self.fails.swap(sent.is_err(), Ordering::Relaxed);
        match &sent {
            Err(error) if !failed => {
                let why = clean(&error.to_string(), MAX_MESSAGE_CHARS);
                tracing::warn!("traces do not reach {}, and are dropped: {why}", self.endpoint);
            }
            Ok(()) if failed => tracing::warn!("traces reach {} again", self.endpoint),
            _ => {}
        }
        sent
    }

    fn shutdown_with_timeout(&self, _: Duration) -> OTelSdkResult {
        Ok(())
    }

    fn set_resource(&mut self, resource: &Resource) {
        if let Some(inner) = Arc::get_mut(&mut self.inner) {
            inner.set_resource(resource);
        }
    }
}
