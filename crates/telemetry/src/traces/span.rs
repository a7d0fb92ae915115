//! One span, which ends when it is dropped.

use std::sync::OnceLock;

use opentelemetry::trace::{
    SpanBuilder, SpanContext, SpanId, SpanKind, Status, TraceContextExt as _, TraceFlags, TraceId,
    TraceState, Tracer as _,
};
use opentelemetry::{Context, KeyValue, Value};
use opentelemetry_sdk::trace::SdkTracer;
use proto::TraceParent;

/// What makes this process's spans, if an exporter sends them.
pub(crate) static TRACER: OnceLock<SdkTracer> = OnceLock::new();

/// A stretch of work in a sampled trace; most often nothing, and then whatever belongs to it is nothing too. It ends when
/// it is dropped.
#[derive(Debug, Default)]
pub struct Span(Option<Context>);

impl Span {
    /// No span.
    pub const NONE: Span = Span(None);

    /// The first span of a trace; nothing where traces are off, and for those that are not sampled.
    pub fn root(name: &'static str) -> Span {
        Span::begin(name, SpanKind::Internal, &Context::new())
    }

    /// Whether it is nothing.
    pub fn is_none(&self) -> bool {
        self.0.is_none()
    }

    /// A part of this span's work.
    pub fn part(&self, name: &'static str) -> Span {
        self.begin_below(name, SpanKind::Internal)
    }

    /// A question to another process: that goes on with [`Span::parent`].
    pub fn question(&self, name: &'static str) -> Span {
        self.begin_below(name, SpanKind::Client)
    }

    /// The answer to another process's question.
    pub fn answer(name: &'static str, parent: Option<TraceParent>) -> Span {
        let Some(TraceParent { trace_id, span_id }) = parent else { return Span::NONE };
        let (trace_id, span_id) = (TraceId::from(trace_id), SpanId::from(span_id));
        let remote = SpanContext::new(trace_id, span_id, TraceFlags::SAMPLED, true, TraceState::NONE);
        Span::begin(name, SpanKind::Server, &Context::new().with_remote_span_context(remote))
    }

    fn begin_below(&self, name: &'static str, kind: SpanKind) -> Span {
        self.0.as_ref().map_or(Span::NONE, |parent| Span::begin(name, kind, parent))
    }

    fn begin(name: &'static str, kind: SpanKind, parent: &Context) -> Span {
        let Some(tracer) = TRACER.get() else { return Span::NONE };
        let span = tracer.build_with_context(SpanBuilder::from_name(name).with_kind(kind), parent);
        let context = Context::new().with_span(span);
        let is_sampled = context.span().span_context().is_sampled();
        Span(is_sampled.then_some(context))
    }

    /// How another process names it as its parent.
    pub fn parent(&self) -> Option<TraceParent> {
        let context = self.0.as_ref()?.span().span_context().clone();
        let trace_id = u128::from_be_bytes(context.trace_id().to_bytes());
        let span_id = u64::from_be_bytes(context.span_id().to_bytes());
        Some(TraceParent { trace_id, span_id })
    }

    /// Adds what is known of it; a count as `i64`, a name as text.
    pub fn note(&self, key: &'static str, value: impl Into<Value>) {
        if let Some(context) = &self.0 {
            context.span().set_attribute(KeyValue::new(key, value));
        }
    }

    /// The same of a count.
    pub fn count(&self, key: &'static str, count: usize) {
        self.note(key, i64::try_from(count).unwrap_or(i64::MAX));
    }

    /// It failed, and why.
    pub fn fail(&self, why: &dyn std::fmt::Display) {
        if let Some(context) = &self.0 {
            context.span().set_status(Status::error(why.to_string()));
        }
    }
}
