//! Traces: a collector of the test's own gets one tree of spans a pass, over all processes of a run.

use std::collections::{HashMap, HashSet};
use std::net::SocketAddr;
use std::process::Output;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{
    TraceService, TraceServiceServer,
};
use opentelemetry_proto::tonic::collector::trace::v1::{
    ExportTraceServiceRequest, ExportTraceServiceResponse,
};
use opentelemetry_proto::tonic::common::v1::KeyValue;
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::{Request, Response, Status};

const TIMEOUT: Duration = Duration::from_secs(120);
const CAMERAS: usize = 3;

/// Takes what is exported.
struct Collector(SyncSender<ExportTraceServiceRequest>);

#[tonic::async_trait]
impl TraceService for Collector {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        // The test may have seen enough.
        let _ = self.0.try_send(request.into_inner());
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

/// Listens on a thread of its own until the test ends.
fn collector() -> (SocketAddr, Receiver<ExportTraceServiceRequest>) {
    let (sender, received) = sync_channel(4096);
    let (tell, told) = sync_channel(1);
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        runtime.block_on(async {
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
            tell.send(listener.local_addr().expect("bound")).expect("the test waits");
            let server =
                tonic::transport::Server::builder().add_service(TraceServiceServer::new(Collector(sender)));
            server.serve_with_incoming(TcpListenerStream::new(listener)).await.expect("serves");
        });
    });
    (told.recv().expect("it listens"), received)
}

#[derive(Debug)]
struct SpanFound {
    name: String,
    parent: Vec<u8>,
    /// Whose it is: service and instance.
    process: (String, String),
    took_ns: u64,
}

/// Spans by trace and span.
type Traces = HashMap<Vec<u8>, HashMap<Vec<u8>, SpanFound>>;

fn text(attributes: &[KeyValue], key: &str) -> String {
    let value = attributes.iter().find(|found| found.key == key).and_then(|found| found.value.clone());
    match value.and_then(|value| value.value) {
        Some(Value::StringValue(text)) => text,
        _ => String::new(),
    }
}

fn add(traces: &mut Traces, request: ExportTraceServiceRequest) {
    for of_process in request.resource_spans {
        let resource = of_process.resource.expect("a process says who it is").attributes;
        let process = (text(&resource, "service.name"), text(&resource, "service.instance.id"));
        for span in of_process.scope_spans.into_iter().flat_map(|scope| scope.spans) {
            let found = SpanFound {
                name: span.name,
                parent: span.parent_span_id,
                process: process.clone(),
                took_ns: span.end_time_unix_nano - span.start_time_unix_nano,
            };
            traces.entry(span.trace_id).or_default().insert(span.span_id, found);
        }
    }
}

/// The names from a span up to its root; nothing while one is missing.
fn path<'a>(spans: &'a HashMap<Vec<u8>, SpanFound>, span: &'a SpanFound) -> Option<Vec<&'a str>> {
    let mut path = vec![&span.name[..]];
    let mut at = span;
    while !at.parent.is_empty() {
        at = spans.get(&at.parent)?;
        path.push(&at.name);
    }
    Some(path)
}

/// The nodes whose part of a round of classes is whole in a trace.
fn nodes_of(spans: &HashMap<Vec<u8>, SpanFound>) -> HashSet<&str> {
    let computed = |span: &&SpanFound| {
        path(spans, span).as_deref() == Some(&["compute", "answer", "ask a node", "classes", "pass"])
    };
    let computed = spans.values().filter(computed).inspect(|span| {
        assert_eq!(span.process.0, "hulltouch-node");
    });
    computed.map(|span| &span.process.1[..]).collect()
}

fn demo(otlp: &str) -> Output {
    testkit::command(env!("CARGO_BIN_EXE_hulltouch"))
        .args(["demo", "--cameras", "3", "--size", "160x120", "--seconds", "2", "--headless", "--unpaced"])
        .args(["--transport", "cluster", "--otlp", otlp])
        .env("OTEL_TRACES_SAMPLER", "always_on")
        .output()
        .expect("it runs")
}

#[test]
fn a_pass_is_one_tree_of_spans_over_all_processes() {
    let (address, received) = collector();
    let output = demo(&format!("http://{address}"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (mut traces, by) = (Traces::new(), Instant::now() + TIMEOUT);
    let whole = |spans: &HashMap<Vec<u8>, SpanFound>| nodes_of(spans).len() == CAMERAS;
    // All of it was sent before the run ended: what comes here was on its way.
    while !traces.values().any(whole) {
        let left = by.saturating_duration_since(Instant::now());
        let more = received.recv_timeout(left).unwrap_or_else(|_| panic!("no whole trace: {traces:#?}"));
        add(&mut traces, more);
    }
    let spans = traces.values().find(|spans| whole(spans)).expect("found");
    let roots: Vec<&SpanFound> = spans.values().filter(|span| span.parent.is_empty()).collect();
    assert_eq!(roots.len(), 1, "one tree: {spans:#?}");
    assert_eq!((&roots[0].name[..], &roots[0].process.0[..]), ("pass", "hulltouch-coordinator"));
    // Parts lie within the whole, as far as clocks of one machine tell.
    let slack_ns = 1_000_000;
    let parts = spans.values().filter(|span| span.name == "compute");
    assert!(parts.clone().all(|part| part.took_ns <= roots[0].took_ns + slack_ns), "{spans:#?}");
}

#[test]
fn a_collector_that_is_away_is_told_once_and_changes_nothing() {
    // A port that was free a moment ago.
    let away = std::net::TcpListener::bind("127.0.0.1:0").and_then(|port| port.local_addr()).expect("a port");
    let output = demo(&format!("http://{away}"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let coordinator = format!("WARN traces do not reach http://{away}");
    assert_eq!(said.lines().filter(|line| line.contains(&coordinator)).count(), CAMERAS + 1, "{said}");
}

#[test]
fn what_is_no_address_of_a_collector_is_refused_in_one_line() {
    let output = demo("https://collector:4317");
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("--otlp") && said.contains("expected http://HOST:PORT"), "{said}");
}
