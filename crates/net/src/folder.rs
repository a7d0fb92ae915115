//! The files of a folder of certificates, as cert-manager and step-ca leave them.

use std::fs::{self, File};
use std::io::Read as _;
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use crate::error::CertificateError;

/// The authorities whose certificates are accepted, PEM.
pub const AUTHORITIES: &str = "ca.crt";
/// The owner's certificate and those between it and its authority, PEM.
pub const CERTIFICATE: &str = "tls.crt";
/// The certificate's key, PEM.
pub const KEY: &str = "tls.key";

/// Far more than a chain and a bundle of authorities need.
const MAX_FILE_BYTES: u64 = 256 * 1024;
/// Permissions that a key must not have: of all users that are neither the file's owner nor of its group, and the group's to write.
const OTHERS: u32 = 0o027;

/// What the three files hold.
#[derive(PartialEq, Eq)]
pub(crate) struct Files {
    pub authorities: Vec<u8>,
    pub certificate: Vec<u8>,
    pub key: Vec<u8>,
}

impl Files {
    /// Reads them. A key that others may read is refused.
    pub fn read(folder: &Path) -> Result<Files, CertificateError> {
        let path = folder.join(KEY);
        let metadata = fs::metadata(&path).map_err(|error| CertificateError::read(&path, error))?;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & OTHERS != 0 {
            return Err(CertificateError::KeyOpen { path, mode });
        }
        Ok(Files {
            authorities: read(folder.join(AUTHORITIES))?,
            certificate: read(folder.join(CERTIFICATE))?,
            key: read(path)?,
        })
    }
}

/// A file of a folder; refuses what is longer than any.
pub(crate) fn read(path: PathBuf) -> Result<Vec<u8>, CertificateError> {
    let mut bytes = Vec::new();
    // Opening a pipe would block for ever.
    let nonblock = rustix::fs::OFlags::NONBLOCK.bits() as i32;
    let file = File::options().read(true).custom_flags(nonblock).open(&path);
    let file = file.map_err(|error| CertificateError::read(&path, error))?;
    if !file.metadata().is_ok_and(|metadata| metadata.is_file()) {
        return Err(CertificateError::NoFile { path });
    }
    let read = file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|error| CertificateError::read(&path, error))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(CertificateError::TooLong { path });
    }
    Ok(bytes)
}
