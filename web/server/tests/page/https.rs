//! The page with a certificate.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::common::*;
use net::{AUTHORITIES, Authority, CERTIFICATE, Credentials, Identity, KEY, Validity};
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;

const ROOM: &str = "room";

fn authority() -> Authority {
    Authority::make(ROOM, Validity::days(30)).expect("an authority")
}

/// Writes a coordinator's certificate, with the name by which browsers call this machine.
fn issue(folder: &Path, authority: &Authority) {
    let owner = Identity::coordinator(ROOM);
    let issued = authority.issue(&owner, &["localhost".into()], Validity::days(30), None).expect("issued");
    fs::write(folder.join(AUTHORITIES), authority.certificate()).expect("written");
    fs::write(folder.join(CERTIFICATE), &issued.certificate).expect("written");
    fs::write(folder.join(KEY), &issued.key).expect("written");
    fs::set_permissions(folder.join(KEY), fs::Permissions::from_mode(0o600)).expect("set");
}

fn start(folder: &Path, authority: &Authority) -> Run {
    issue(folder, authority);
    let credentials = Credentials::open(folder, Identity::coordinator(ROOM)).expect("valid");
    Run::start_with(Some(Arc::new(credentials)), false)
}

/// A browser's side, which trusts an authority and has no certificate.
async fn browse(run: &Run, authority: &Authority, protocol: &[u8]) -> std::io::Result<TlsStream<TcpStream>> {
    let mut trusted = RootCertStore::empty();
    let certificate = CertificateDer::from_pem_slice(authority.certificate().as_bytes()).expect("PEM");
    trusted.add(certificate).expect("an authority");
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()));
    let config = config.with_safe_default_protocol_versions().expect("versions");
    let mut config = config.with_root_certificates(trusted).with_no_client_auth();
    config.alpn_protocols = vec![protocol.to_vec()];
    let stream = TcpStream::connect(run.feed.address()).await?;
    let name = ServerName::try_from("localhost").expect("a name");
    TlsConnector::from(Arc::new(config)).connect(name, stream).await
}

async fn index(run: &Run, authority: &Authority) -> std::io::Result<String> {
    let mut stream = browse(run, authority, b"http/1.1").await?;
    let request = format!(
        "GET / HTTP/1.1\r\nHost: localhost:{}\r\nConnection: close\r\n\r\n",
        run.feed.address().port()
    );
    stream.write_all(request.as_bytes()).await?;
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer).await;
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

#[tokio::test]
async fn a_page_with_a_certificate_speaks_https_and_wss() {
    let (folder, authority) = (tempfile::tempdir().expect("a folder"), authority());
    let run = start(folder.path(), &authority);
    let page = index(&run, &authority).await.expect("encrypted");
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("<title>Hulltouch</title>"), "{page}");

    let mut request = format!("wss://localhost:{}/feed", run.feed.address().port())
        .into_client_request()
        .expect("an address");
    let protocols = format!("hulltouch.feed.v1, hulltouch.token.{TOKEN}").parse().expect("a value");
    request.headers_mut().insert("Sec-WebSocket-Protocol", protocols);
    let origin = format!("https://localhost:{}", run.feed.address().port()).parse().expect("a value");
    request.headers_mut().insert("Origin", origin);
    let stream = browse(&run, &authority, b"http/1.1").await.expect("encrypted");
    let (mut socket, _) = tokio_tungstenite::client_async(request, stream).await.expect("a socket");
    use futures::StreamExt as _;
    let hello = tokio::time::timeout(TIMEOUT, socket.next()).await.expect("in time").expect("open");
    let hello: serde_json::Value =
        serde_json::from_str(hello.expect("a message").to_text().expect("text")).expect("JSON");
    assert_eq!((&hello["op"], &hello["controller"]), (&"hello".into(), &true.into()));

    let h2 = browse(&run, &authority, b"h2").await.expect("gRPC's protocol is spoken too");
    assert_eq!(h2.get_ref().1.alpn_protocol(), Some(&b"h2"[..]));
}

#[tokio::test]
async fn plain_http_is_told_that_the_port_speaks_https() {
    let (folder, authority) = (tempfile::tempdir().expect("a folder"), authority());
    let run = start(folder.path(), &authority);
    let mut stream = TcpStream::connect(run.feed.address()).await.expect("connects");
    stream.write_all(b"GET /?token=secret HTTP/1.1\r\nHost: localhost\r\n\r\n").await.expect("sent");
    let mut answer = String::new();
    tokio::time::timeout(TIMEOUT, stream.read_to_string(&mut answer)).await.expect("in time").expect("text");
    assert!(answer.starts_with("HTTP/1.1 400"), "{answer}");
    assert!(answer.ends_with("\r\n\r\nthis port speaks HTTPS, expected https://\n"), "{answer}");
}

#[tokio::test]
async fn a_certificate_that_was_replaced_is_shown_to_the_next_who_comes() {
    let (folder, old, new) = (tempfile::tempdir().expect("a folder"), authority(), authority());
    let run = start(folder.path(), &old);
    assert!(index(&run, &old).await.is_ok());
    let refused = index(&run, &new).await.expect_err("of another authority").to_string();
    assert!(refused.contains("invalid peer certificate"), "{refused}");
    issue(folder.path(), &new);
    // The folder is read once a second at most.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert!(index(&run, &new).await.expect("encrypted").starts_with("HTTP/1.1 200"));
}

#[tokio::test]
async fn a_handshake_that_is_not_finished_is_dropped() {
    let (folder, authority) = (tempfile::tempdir().expect("a folder"), authority());
    let run = start(folder.path(), &authority);
    let mut stream = TcpStream::connect(run.feed.address()).await.expect("connects");
    // The beginning of a record that is never whole.
    stream.write_all(&[0x16, 0x03, 0x01, 0x02, 0x00, 0x01, 0x00]).await.expect("sent");
    let began = std::time::Instant::now();
    let mut answer = Vec::new();
    let _ = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut answer)).await.expect("in time");
    let took = began.elapsed().as_secs_f64();
    assert!(took > 4.0, "dropped after {took} s");
}
