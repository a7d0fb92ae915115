//! Where a collector is.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// A collector that takes OTLP over gRPC: `http://HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint(String);

/// Why a text names no collector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{0}, expected http://HOST:PORT of a collector that takes OTLP over gRPC")]
pub struct EndpointError(&'static str);

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(text: &str) -> Result<Endpoint, EndpointError> {
        let uri: http::Uri = text.parse().map_err(|_| EndpointError("not a URL"))?;
        match (uri.scheme_str(), uri.port_u16(), uri.path(), uri.query()) {
            (Some("http"), Some(_), "/", None) => Ok(Endpoint(text.to_owned())),
            (Some("https"), ..) => {
                Err(EndpointError("no TLS is spoken to a collector: it is this network's own"))
            }
            (Some("http"), None, ..) => Err(EndpointError("no port")),
            (Some("http"), ..) => Err(EndpointError("nothing may follow the port")),
            _ => Err(EndpointError("no http://")),
        }
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_is_none_is_refused_in_one_line() {
        for good in ["http://127.0.0.1:4317", "http://collector.local:4317/", "http://[::1]:4317"] {
            assert_eq!(good.parse::<Endpoint>().expect(good).to_string(), good);
        }
        for (found, problem) in [
            ("https://collector:4317", "no TLS"),
            ("http://collector", "no port"),
            ("http://collector:4318/v1/traces", "nothing may follow"),
            ("http://collector:4318/?a", "nothing may follow"),
            ("collector:4317", "no http://"),
            ("", "not a URL"),
        ] {
            let error = found.parse::<Endpoint>().expect_err(found).to_string();
            assert!(error.starts_with(problem) && error.ends_with("OTLP over gRPC"), "{found}: {error}");
        }
    }
}
