//! Certificates in use: what TLS needs of them.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rustls::client::Resumption;
use rustls::crypto::ring;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, UnixTime};
use rustls::server::{NoServerSessionStorage, WebPkiClientVerifier};
use rustls::sign::CertifiedKey;
use rustls::version::TLS13;
use rustls::{
    CertificateError as Reason, ClientConfig, Error, InconsistentKeys, RootCertStore, ServerConfig,
};

use crate::error::{CertificateError, of_certificate};
use crate::folder::{AUTHORITIES, CERTIFICATE, Files, KEY};
use crate::name::{Identity, Peer};

/// What gRPC speaks over TLS.
const HTTP2: &[u8] = b"h2";
const HTTP1: &[u8] = b"http/1.1";

/// Certificates that fit each other, their owner, and the time.
pub(crate) struct Loaded {
    /// For those who show a certificate themselves.
    pub server: Arc<ServerConfig>,
    pub client: Arc<ClientConfig>,
    /// For browsers, which show none.
    pub page: Arc<ServerConfig>,
    /// When the certificate ends, by Unix time.
    pub not_after: Duration,
}

impl Loaded {
    /// Checks them as any peer will, now.
    pub fn new(
        folder: &Path,
        files: &Files,
        own: &Identity,
        now: UnixTime,
    ) -> Result<Loaded, CertificateError> {
        let path = folder.join(CERTIFICATE);
        let chain = certificates(&path, &files.certificate)?;
        let authorities = Arc::new(authorities(&folder.join(AUTHORITIES), &files.authorities)?);
        let key = key(folder, files)?;
        let refused = |error: Error| CertificateError::Refused {
            path: path.clone(),
            reason: match error {
                Error::InvalidCertificate(reason) => format!("the certificate {}", of_certificate(&reason)),
                other => other.to_string(),
            },
        };
        let found = peer_of(&chain[0]).map_err(|reason| refused(Error::InvalidCertificate(reason)))?;
        if !found.is(own) {
            let (found, expected) = (found.to_string(), own.to_string());
            return Err(CertificateError::Name { path, found, expected });
        }

        let provider = Arc::new(ring::default_provider());
        let verifier =
            WebPkiClientVerifier::builder_with_provider(Arc::clone(&authorities), Arc::clone(&provider));
        let verifier = verifier.build().map_err(|error| refused(Error::General(error.to_string())))?;
        verifier.verify_client_cert(&chain[0], &chain[1..], now).map_err(refused)?;
        let far = UnixTime::since_unix_epoch(Duration::from_secs(u64::from(u32::MAX) * 64));
        let not_after = match verifier.verify_client_cert(&chain[0], &chain[1..], far) {
            Err(Error::InvalidCertificate(Reason::ExpiredContext { not_after, .. })) => not_after,
            _ => far,
        };

        let versions = &[&TLS13];
        let server =
            || ServerConfig::builder_with_provider(Arc::clone(&provider)).with_protocol_versions(versions);
        let pair = || (chain.clone(), key.clone_key());
        let (certificates, private) = pair();
        let with_clients = server().map_err(refused)?.with_client_cert_verifier(verifier);
        let mut of_service = with_clients.with_single_cert(certificates, private).map_err(refused)?;
        // A client that comes back shows its certificate again: it may have ended since, or its authority.
        of_service.session_storage = Arc::new(NoServerSessionStorage {});
        of_service.send_tls13_tickets = 0;
        of_service.alpn_protocols = vec![HTTP2.to_vec()];

        let (certificates, private) = pair();
        let mut page = server()
            .map_err(refused)?
            .with_no_client_auth()
            .with_single_cert(certificates, private)
            .map_err(refused)?;
        page.alpn_protocols = vec![HTTP2.to_vec(), HTTP1.to_vec()];

        let (certificates, private) = pair();
        let client = ClientConfig::builder_with_provider(provider)
            .with_protocol_versions(versions)
            .map_err(refused)?;
        let client = client.with_root_certificates(authorities);
        let mut client = client.with_client_auth_cert(certificates, private).map_err(refused)?;
        client.resumption = Resumption::disabled();
        client.alpn_protocols = vec![HTTP2.to_vec()];

        Ok(Loaded {
            server: Arc::new(of_service),
            client: Arc::new(client),
            page: Arc::new(page),
            not_after: Duration::from_secs(not_after.as_secs()),
        })
    }
}

/// Whose certificate it is. Says nothing of who issued it.
pub(crate) fn peer_of(certificate: &CertificateDer<'_>) -> Result<Peer, Reason> {
    let parsed = webpki::EndEntityCert::try_from(certificate).map_err(|_| Reason::BadEncoding)?;
    Ok(Peer::of(parsed.valid_dns_names()))
}

/// What a file holds: one at least.
pub(crate) fn certificates(
    path: &Path,
    pem: &[u8],
) -> Result<Vec<CertificateDer<'static>>, CertificateError> {
    let content = |found: String| CertificateError::Content {
        path: path.to_owned(),
        found,
        expected: "certificates as PEM",
    };
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    let found = found.map_err(|error| content(error.to_string()))?;
    if found.is_empty() { Err(content("none".to_owned())) } else { Ok(found) }
}

fn authorities(path: &Path, pem: &[u8]) -> Result<RootCertStore, CertificateError> {
    let mut store = RootCertStore::empty();
    for certificate in certificates(path, pem)? {
        store.add(certificate).map_err(|error| CertificateError::Content {
            path: path.to_owned(),
            found: error.to_string(),
            expected: "certificates of authorities as PEM",
        })?;
    }
    Ok(store)
}

fn key(folder: &Path, files: &Files) -> Result<PrivateKeyDer<'static>, CertificateError> {
    let path = folder.join(KEY);
    let content = |found: String| CertificateError::Content {
        path: path.clone(),
        found,
        expected: "a private key as PEM",
    };
    let key = PrivateKeyDer::from_pem_slice(&files.key).map_err(|error| content(error.to_string()))?;
    let signing = ring::default_provider().key_provider.load_private_key(key.clone_key());
    let signing = signing.map_err(|error| content(error.to_string()))?;
    let certificate = folder.join(CERTIFICATE);
    match CertifiedKey::new(certificates(&certificate, &files.certificate)?, signing).keys_match() {
        Err(Error::InconsistentKeys(InconsistentKeys::KeyMismatch)) => {
            Err(CertificateError::Mismatch { key: path, certificate })
        }
        _ => Ok(key),
    }
}
