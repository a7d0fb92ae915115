//! What is wrong with certificates, in one line.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustls::pki_types::UnixTime;
use rustls::{AlertDescription, CertificateError as Reason, Error, InvalidMessage};
use thiserror::Error;
use time::OffsetDateTime;

/// A folder of certificates cannot be used.
#[derive(Debug, Error)]
pub enum CertificateError {
    /// A file cannot be read.
    #[error("{path}: {error}", path = .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        error: io::Error,
    },
    /// A pipe, a folder or a device.
    #[error("{path} is no regular file, expected certificates or a key as PEM", path = .path.display())]
    NoFile {
        /// What is there instead.
        path: PathBuf,
    },
    /// A file is longer than any of its kind.
    #[error("{path} is longer than 256 KiB, expected certificates or a key as PEM", path = .path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
    },
    /// A key that is no secret.
    #[error(
        "{path} has mode {mode:04o}: {}, expected 0600 or 0640",
        if mode & 0o007 == 0 { "its group may write it" } else { "others may read it" },
        path = .path.display()
    )]
    KeyOpen {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file holds something else.
    #[error("{path}: found {found}, expected {expected}", path = .path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// The key is of another certificate.
    #[error("{key} does not fit {certificate}", key = .key.display(), certificate = .certificate.display())]
    Mismatch {
        /// The key.
        key: PathBuf,
        /// The certificate.
        certificate: PathBuf,
    },
    /// The certificate is not valid for any peer.
    #[error("{path}: {reason}", path = .path.display())]
    Refused {
        /// The certificate.
        path: PathBuf,
        /// What the check says.
        reason: String,
    },
    /// The certificate is another owner's.
    #[error("{path} is of {found}, expected {expected}", path = .path.display())]
    Name {
        /// The certificate.
        path: PathBuf,
        /// The identity that it names.
        found: String,
        /// The identity of this process.
        expected: String,
    },
}

impl CertificateError {
    pub(crate) fn read(path: &Path, error: io::Error) -> CertificateError {
        CertificateError::Read { path: path.to_owned(), error }
    }
}

/// A connection with certificates was not made.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum HandshakeError {
    /// The peer, its certificate or its protocol is not what it should be.
    #[error("{0}")]
    Refused(String),
    /// The connection broke on the way.
    #[error("the connection broke: {0}")]
    Broken(String),
    /// It did not answer in time.
    #[error("no TLS handshake within {} s", .0.as_secs())]
    Timeout(Duration),
}

impl HandshakeError {
    pub(crate) fn of(error: &io::Error) -> HandshakeError {
        match error.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
            Some(error) => HandshakeError::Refused(of_tls(error)),
            None => HandshakeError::Broken(error.to_string()),
        }
    }

    /// The same of a server.
    pub(crate) fn before_a_certificate(self) -> HandshakeError {
        match self {
            HandshakeError::Broken(why) => HandshakeError::Refused(format!(
                "it showed no certificate before the connection broke ({why}), expected it to be started with --certs"
            )),
            other => other,
        }
    }
}

/// What a socket's error means.
pub(crate) fn in_words(error: &io::Error) -> String {
    let tls = error.get_ref().and_then(|inner| inner.downcast_ref::<Error>());
    tls.map_or_else(|| error.to_string(), of_tls)
}

fn of_tls(error: &Error) -> String {
    match error {
        Error::NoCertificatesPresented => "it shows no certificate".to_owned(),
        Error::InvalidCertificate(reason) => format!("its certificate {}", of_certificate(reason)),
        Error::InvalidMessage(InvalidMessage::InvalidContentType) => "it does not speak TLS".to_owned(),
        Error::PeerIncompatible(_) => "it does not speak TLS 1.3 with certificates as expected".to_owned(),
        Error::NoApplicationProtocol => "it speaks another protocol over TLS".to_owned(),
        Error::AlertReceived(alert) => {
            let reason = match alert {
                AlertDescription::CertificateExpired => "has ended there, or has not begun",
                AlertDescription::UnknownCA => "is of no authority that it knows",
                AlertDescription::CertificateRequired => "is missing",
                AlertDescription::BadCertificate | AlertDescription::CertificateUnknown => "is not accepted",
                _ => return format!("it broke the connection off: {alert:?}"),
            };
            format!("it says that our certificate {reason}")
        }
        other => other.to_string(),
    }
}

/// Why a certificate is not good; goes on after "its certificate".
pub(crate) fn of_certificate(reason: &Reason) -> String {
    match reason {
        Reason::Expired => "has ended".to_owned(),
        Reason::ExpiredContext { not_after, .. } => format!("has ended on {}", date(*not_after)),
        Reason::NotValidYet => "is not valid yet".to_owned(),
        Reason::NotValidYetContext { not_before, .. } => {
            format!("is not valid before {}", date(*not_before))
        }
        Reason::UnknownIssuer | Reason::BadSignature => "is of no authority in ca.crt".to_owned(),
        Reason::NotValidForName => "has another name".to_owned(),
        Reason::NotValidForNameContext { expected, presented } => {
            let names: Vec<&str> = presented.iter().map(|name| dns_name(name)).collect();
            format!("is of {}, expected {}", names.join(" and "), expected.to_str())
        }
        Reason::InvalidPurpose | Reason::InvalidPurposeContext { .. } => {
            "is not made for clients and servers both".to_owned()
        }
        other => format!("is not good: {other}"),
    }
}

/// The name within `DnsName("…")`.
fn dns_name(name: &str) -> &str {
    name.strip_prefix("DnsName(\"").and_then(|name| name.strip_suffix("\")")).unwrap_or(name)
}

/// A day, UTC.
pub(crate) fn date(time: UnixTime) -> String {
    let seconds = i64::try_from(time.as_secs()).unwrap_or(i64::MAX);
    OffsetDateTime::from_unix_timestamp(seconds)
        .map_or_else(|_| "never".to_owned(), |time| time.date().to_string())
}
