//! What one scrape is answered with: families of metrics, each with its series.

use std::fmt;

use prometheus_client::encoding::{DescriptorEncoder, MetricEncoder};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::exemplar::Exemplar;
use prometheus_client::registry::Unit;

/// The labels of one series, beside those of the port.
pub type Labels = Vec<(&'static str, String)>;

/// A histogram as it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Buckets {
    /// The sum of all values.
    pub sum: f64,
    /// Upper bound and count of each bucket, ascending, not cumulative; the last bound is infinite.
    pub buckets: Vec<(f64, u64)>,
}

/// Where metrics are written, by their names without the port's prefix and with their unit: `frame_age_seconds`. Counters
/// get the suffix `_total`.
pub struct Sheet<'a>(DescriptorEncoder<'a>);

impl<'a> Sheet<'a> {
    pub(crate) fn new(encoder: DescriptorEncoder<'a>) -> Sheet<'a> {
        Sheet(encoder)
    }

    /// What only grows while the process lives.
    pub fn counter(
        &mut self,
        name: &str,
        help: &str,
        series: impl IntoIterator<Item = (Labels, f64)>,
    ) -> fmt::Result {
        // No value of ours points at a trace.
        const NO_EXEMPLAR: Option<&Exemplar<[(&str, &str); 0], f64>> = None;
        self.family(name, help, MetricType::Counter, series, |metric, value| {
            metric.encode_counter(&value, NO_EXEMPLAR)
        })
    }

    /// What is so now.
    pub fn gauge(
        &mut self,
        name: &str,
        help: &str,
        series: impl IntoIterator<Item = (Labels, f64)>,
    ) -> fmt::Result {
        self.family(name, help, MetricType::Gauge, series, |metric, value| metric.encode_gauge(&value))
    }

    /// How often a figure was how large.
    pub fn histogram(
        &mut self,
        name: &str,
        help: &str,
        series: impl IntoIterator<Item = (Labels, Buckets)>,
    ) -> fmt::Result {
        self.family(name, help, MetricType::Histogram, series, |metric, Buckets { sum, buckets }| {
            let count = buckets.iter().map(|(_, count)| count).sum();
            metric.encode_histogram::<[(&str, &str); 0]>(sum, count, &buckets, None)
        })
    }

    /// One family and its series. One without series is not written.
    fn family<V>(
        &mut self,
        name: &str,
        help: &str,
        kind: MetricType,
        series: impl IntoIterator<Item = (Labels, V)>,
        mut write: impl FnMut(&mut MetricEncoder<'_>, V) -> fmt::Result,
    ) -> fmt::Result {
        let mut series = series.into_iter().peekable();
        if series.peek().is_none() {
            return Ok(());
        }
        let (name, unit) = name_and_unit(name);
        let mut family = self.0.encode_descriptor(name, help, unit.as_ref(), kind)?;
        for (labels, value) in series {
            if labels.is_empty() {
                write(&mut family, value)?;
            } else {
                write(&mut family.encode_family(&labels)?, value)?;
            }
        }
        Ok(())
    }
}

/// The unit that a name ends with is told apart from it.
fn name_and_unit(name: &str) -> (&str, Option<Unit>) {
    for (suffix, unit) in [("_seconds", Unit::Seconds), ("_bytes", Unit::Bytes)] {
        if let Some(name) = name.strip_suffix(suffix) {
            return (name, Some(unit));
        }
    }
    (name, None)
}
