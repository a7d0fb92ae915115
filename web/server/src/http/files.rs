//! The page: the files of `web/page/dist`, inside the program.

use axum::Router;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use proto::text::clean;
use rust_embed::EmbeddedFile;

/// The built page.
#[derive(rust_embed::RustEmbed)]
#[folder = "../page/dist"]
struct Files;

/// Where the page begins.
const INDEX: &str = "index.html";
/// Files whose name changes with their contents.
const HASHED: &str = "assets/";
/// How files may be encoded, the shortest first, and how the names of such files end.
const ENCODINGS: [(&str, &str); 2] = [("br", "br"), ("gzip", "gz")];
/// What the page may load: its own files, its own sockets, and images and workers that it makes itself.
const POLICY: &str = "default-src 'self'; connect-src 'self' ws: wss:; img-src 'self' data: blob:; \
    style-src 'self' 'unsafe-inline'; worker-src 'self' blob:; base-uri 'none'; frame-ancestors 'none'";

/// Answers every path that has no other route.
pub(crate) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    Router::new().fallback_service(get(serve))
}

async fn serve(uri: Uri, headers: HeaderMap) -> Response {
    let path = uri.path().trim_start_matches('/');
    let path = if path.is_empty() { INDEX } else { path };
    let Some((file, encoding)) = file(path, &headers) else {
        return (StatusCode::NOT_FOUND, format!("no {:?} here\n", clean(path, 100))).into_response();
    };
    let hash = file.metadata.sha256_hash();
    let tag: String = hash[..16].iter().map(|byte| format!("{byte:02x}")).collect();
    let tag = format!("\"{tag}\"");
    let keep = if path.starts_with(HASHED) { "public, max-age=31536000, immutable" } else { "no-cache" };
    let known = headers.get(header::IF_NONE_MATCH).is_some_and(|known| known.as_bytes() == tag.as_bytes());
    let mut response = if known {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        ([(header::CONTENT_TYPE, kind(path))], file.data).into_response()
    };
    let more = response.headers_mut();
    more.insert(header::CACHE_CONTROL, HeaderValue::from_static(keep));
    more.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
    if let Some(encoding) = encoding {
        more.insert(header::CONTENT_ENCODING, HeaderValue::from_static(encoding));
    }
    more.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    more.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    more.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    if let Ok(tag) = HeaderValue::try_from(tag) {
        more.insert(header::ETAG, tag);
    }
    response
}

/// A file in the shortest form that the browser takes, and how that is encoded.
fn file(path: &str, headers: &HeaderMap) -> Option<(EmbeddedFile, Option<&'static str>)> {
    let encoded = ENCODINGS.iter().filter(|(encoding, _)| takes(headers, encoding));
    let mut encoded = encoded
        .filter_map(|(encoding, ending)| Some((Files::get(&format!("{path}.{ending}"))?, Some(*encoding))));
    encoded.next().or_else(|| Some((Files::get(path)?, None)))
}

/// Whether the browser takes an encoding: it names it, and not with weight 0.
fn takes(headers: &HeaderMap, encoding: &str) -> bool {
    let lists = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|list| list.to_str().ok());
    lists.flat_map(|list| list.split(',')).any(|entry| {
        let (name, weight) = entry.split_once(';').unwrap_or((entry, ""));
        let weight = weight.trim().strip_prefix("q=").and_then(|weight| weight.parse::<f32>().ok());
        name.trim().eq_ignore_ascii_case(encoding) && weight != Some(0.0)
    })
}

fn kind(path: &str) -> &'static str {
    match path.rsplit_once('.').map_or("", |(_, ending)| ending) {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" | "map" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "ico" => "image/x-icon",
        "wasm" => "application/wasm",
        "woff2" => "font/woff2",
        "txt" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}
