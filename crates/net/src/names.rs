//! By which names a certificate is known, its owner's among them.

use std::net::IpAddr;
use std::path::Path;

use rustls::pki_types::{CertificateDer, DnsName, ServerName};
use webpki::{EndEntityCert, Error};

use crate::error::CertificateError;
use crate::folder::{CERTIFICATE, read};
use crate::loaded::certificates;

/// A name that no certificate has: a refusal lists those that it has.
const NO_NAME: &str = "no-name.hulltouch";

/// Names of a certificate.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CertificateNames {
    /// DNS names and IP addresses, in its order.
    pub names: Vec<String>,
    /// Those that cannot be read, as far as they can.
    pub unreadable: Vec<String>,
}

impl CertificateNames {
    /// Of the certificate in a folder, of any authority and also if it has ended.
    pub fn read(folder: &Path) -> Result<CertificateNames, CertificateError> {
        let path = folder.join(CERTIFICATE);
        let chain = certificates(&path, &read(path.clone())?)?;
        of(&chain[0]).map_err(|error| CertificateError::Content {
            path,
            found: error.to_string(),
            expected: "a certificate with names",
        })
    }
}

fn of(certificate: &CertificateDer<'_>) -> Result<CertificateNames, Error> {
    let parsed = EndEntityCert::try_from(certificate)?;
    let is_there = |name: &ServerName<'_>| parsed.verify_is_valid_for_subject_name(name);
    let no_name = DnsName::try_from(NO_NAME).map_err(|_| Error::MalformedDnsIdentifier)?;
    let presented = match is_there(&ServerName::DnsName(no_name)) {
        Err(Error::CertNotValidForName(context)) => context.presented,
        Err(error) => return Err(error),
        Ok(()) => Vec::new(),
    };
    let mut found = CertificateNames::default();
    for name in presented {
        // An address is written shortened there, some as another one.
        let address = || within(&name, "IpAddress(", ")")?.parse::<IpAddr>().ok();
        let has = |address: &IpAddr| is_there(&ServerName::IpAddress((*address).into())).is_ok();
        match within(&name, "DnsName(\"", "\")") {
            Some(name) => found.names.push(name.to_owned()),
            None => match address().filter(has) {
                Some(address) => found.names.push(address.to_string()),
                None => found.unreadable.push(name),
            },
        }
    }
    Ok(found)
}

fn within<'a>(text: &'a str, begin: &str, end: &str) -> Option<&'a str> {
    text.strip_prefix(begin)?.strip_suffix(end)
}
