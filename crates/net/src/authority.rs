//! An authority of a room's own, for those who have none.

use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer,
    KeyPair, KeyUsagePurpose,
};
use thiserror::Error;
use time::{Duration, OffsetDateTime};

use crate::name::Identity;

/// An authority or a certificate cannot be made.
#[derive(Debug, Error)]
#[error("cannot make a certificate: {0}")]
pub struct AuthorityError(#[from] rcgen::Error);

/// Signs certificates of a room.
pub struct Authority {
    issuer: Issuer<'static, KeyPair>,
    certificate_pem: String,
}

/// A certificate, and the key that belongs to it.
pub struct Issued {
    /// The certificate and its chain, PEM.
    pub certificate: String,
    /// PEM, a secret.
    pub key: String,
}

/// From when a certificate is valid, and for how long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Validity {
    begins: OffsetDateTime,
    ends: OffsetDateTime,
}

impl Validity {
    /// From now, less an hour for clocks that differ, for so many days.
    pub fn days(days: u32) -> Validity {
        let now = OffsetDateTime::now_utc();
        Validity { begins: now - Duration::HOUR, ends: now + Duration::days(days.into()) }
    }

    /// Moved by so many days: what has ended, or has not begun.
    pub fn moved(self, days: i64) -> Validity {
        let by = Duration::days(days);
        Validity { begins: self.begins + by, ends: self.ends + by }
    }
}

impl Authority {
    /// A new one, of a room.
    pub fn make(room: &str, validity: Validity) -> Result<Authority, AuthorityError> {
        let key = KeyPair::generate()?;
        let params = params_of_authority(room, &key, validity);
        let certificate_pem = params.self_signed(&key)?.pem();
        Ok(Authority { issuer: Issuer::new(params, key), certificate_pem })
    }

    /// One that was made before of the same room: its certificate and its key, PEM.
    pub fn open(room: &str, certificate: &str, key: &str) -> Result<Authority, AuthorityError> {
        let key = KeyPair::from_pem(key)?;
        let params = params_of_authority(room, &key, Validity::days(0));
        Ok(Authority { issuer: Issuer::new(params, key), certificate_pem: certificate.to_owned() })
    }

    /// Its certificate, PEM.
    pub fn certificate(&self) -> &str {
        &self.certificate_pem
    }

    /// Its key, PEM: a secret.
    pub fn key(&self) -> String {
        self.issuer.key().serialize_pem()
    }

    /// A certificate of an owner, who may also be reached by other names (DNS names and IP addresses), for a key that is
    /// there (PEM) or a new one.
    pub fn issue(
        &self,
        owner: &Identity,
        also: &[String],
        validity: Validity,
        key: Option<&str>,
    ) -> Result<Issued, AuthorityError> {
        let key = key.map_or_else(KeyPair::generate, KeyPair::from_pem)?;
        let names = std::iter::once(owner.to_string()).chain(also.iter().cloned());
        let purposes = [ExtendedKeyUsagePurpose::ClientAuth, ExtendedKeyUsagePurpose::ServerAuth];
        let mut params = params_of(validity, purposes);
        params.subject_alt_names = CertificateParams::new(names.collect::<Vec<_>>())?.subject_alt_names;
        params.distinguished_name.push(DnType::CommonName, owner.to_string());
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.use_authority_key_identifier_extension = true;
        let certificate = params.signed_by(&key, &self.issuer)?.pem();
        Ok(Issued { certificate, key: key.serialize_pem() })
    }
}

/// Its name follows from room and key, so that it is known when the authority is opened again. Two authorities of one name
/// would be taken for each other, and their signatures for bad ones.
fn params_of_authority(room: &str, key: &KeyPair, validity: Validity) -> CertificateParams {
    let mut params = params_of(validity, []);
    let of_key: String =
        key.public_key_raw().iter().rev().take(8).map(|byte| format!("{byte:02x}")).collect();
    params.distinguished_name.push(DnType::CommonName, format!("hulltouch {room} {of_key}"));
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params
}

fn params_of(
    validity: Validity,
    purposes: impl IntoIterator<Item = ExtendedKeyUsagePurpose>,
) -> CertificateParams {
    let mut params = CertificateParams::default();
    params.not_before = validity.begins;
    params.not_after = validity.ends;
    params.distinguished_name = DistinguishedName::new();
    params.extended_key_usages = purposes.into_iter().collect();
    params
}
