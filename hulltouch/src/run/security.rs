//! Options that say with whom this program talks over a network.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use net::{Credentials, Identity};
use node_client::{Dial, Sockets};
use proto::Address;
use setup::ClusterFile;
use setup::cli::{Failure, Outcome};

/// Certificates, or none.
#[derive(Clone, Debug, Default, Args)]
pub struct SecurityArguments {
    /// The folder of this machine's certificates (ca.crt, tls.crt, tls.key): connections over TCP are encrypted, and both
    /// sides show one.
    #[arg(long, value_name = "FOLDER", env = "HULLTOUCH_CERTS", conflicts_with = "insecure")]
    certs: Option<PathBuf>,
    /// Allow addresses of other machines without certificates: nothing is encrypted, and peers are not authenticated.
    #[arg(long)]
    insecure: bool,
}

/// Consent where there are no certificates to choose.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct ConsentArguments {
    /// Allow a page that other machines reach without encryption.
    #[arg(long)]
    insecure: bool,
}

impl ConsentArguments {
    /// The same of a run on this machine.
    pub fn checked(self) -> Security {
        Security { insecure: self.insecure, ..Security::default() }
    }
}

/// How a run's connections over a network are made; by default those of this machine are.
#[derive(Clone)]
pub struct Security {
    /// Connects to nodes.
    pub dial: Arc<dyn Dial>,
    /// The coordinator's own certificates.
    pub credentials: Option<Arc<Credentials>>,
    /// Whether certificates could have been given.
    pub takes_certificates: bool,
    /// Whether connections without certificates are wanted.
    pub insecure: bool,
    /// Whether nodes on other machines are asked without.
    pub nodes_in_clear: bool,
}

impl Default for Security {
    fn default() -> Security {
        Security {
            dial: Arc::new(Sockets::default()),
            credentials: None,
            takes_certificates: false,
            insecure: false,
            nodes_in_clear: false,
        }
    }
}

impl SecurityArguments {
    /// Whether connections without certificates are wanted.
    pub fn insecure(&self) -> bool {
        self.insecure
    }

    /// The folder of this machine's certificates.
    pub fn folder(&self) -> Option<&Path> {
        self.certs.as_deref()
    }

    /// The certificates of this owner in the room of a cluster file, if there is a folder of them.
    pub fn credentials(&self, file: &ClusterFile, own: Identity) -> Outcome<Option<Arc<Credentials>>> {
        let Some(folder) = &self.certs else { return Ok(None) };
        let credentials = Credentials::open(folder, own)
            .map_err(|error| Failure::input(format_args!("--certs: {error}")))?;
        let age = Duration::from_secs_f64(file.max_connection_age_s);
        Ok(Some(Arc::new(credentials.with_max_connection_age(age))))
    }

    /// The sockets of a coordinator of this cluster file.
    pub fn sockets(&self, file: &ClusterFile) -> Outcome<Arc<dyn Dial>> {
        self.checked(file).map(|security| security.dial)
    }

    /// What a coordinator of this cluster file may do. Nodes of other machines need certificates, or consent.
    pub fn checked(&self, file: &ClusterFile) -> Outcome<Security> {
        self.among(file, self.credentials(file, Identity::coordinator(&file.name))?)
    }

    /// The sockets of a viewer: with the certificates of viewers, or the coordinator's.
    pub fn looking(&self, file: &ClusterFile) -> Outcome<Arc<dyn Dial>> {
        let viewer = self.credentials(file, Identity::viewer(&file.name));
        let credentials = viewer.or_else(|_| self.credentials(file, Identity::coordinator(&file.name)))?;
        self.among(file, credentials).map(|security| security.dial)
    }

    /// Connections to the nodes of a file with these certificates, or with consent.
    fn among(&self, file: &ClusterFile, credentials: Option<Arc<Credentials>>) -> Outcome<Security> {
        let security = Security { takes_certificates: true, insecure: self.insecure, ..Security::default() };
        let outside = file.nodes.iter().find(|node| node.address.as_ref().is_none_or(leaves_this_machine));
        match (credentials, outside) {
            (Some(credentials), _) => {
                if let Some(node) = file.nodes.iter().find(|node| node.name.is_none()) {
                    let (path, camera) = (file.path.display(), &file.cameras[node.cameras[0]].name);
                    return Err(Failure::input(format_args!(
                        "{path}: the node of camera {camera:?} has no name, and --certs is given: certificates are of \
                         names, expected [[node]] entries"
                    )));
                }
                let dial = Arc::new(Sockets::encrypted(Arc::clone(&credentials)));
                Ok(Security { dial, credentials: Some(credentials), ..security })
            }
            (None, Some(_)) if self.insecure => {
                tracing::warn!("nodes are asked without encryption: anyone on the way may read and answer");
                Ok(Security { nodes_in_clear: true, ..security })
            }
            (None, Some(node)) => {
                let found = match (&node.address, &node.name) {
                    (Some(address), _) => format!("{address} is on another machine"),
                    (None, name) => {
                        format!("node {} is found in the network", name.as_deref().unwrap_or_default())
                    }
                };
                Err(Failure::input(format_args!(
                    "{}: {found} and nothing is encrypted: expected --certs, or --insecure",
                    file.path.display()
                )))
            }
            (None, None) => Ok(security),
        }
    }
}

/// Whether what is sent there may be seen by others.
pub fn leaves_this_machine(address: &Address) -> bool {
    let Address::Tcp(address) = address else { return false };
    let host = address.rsplit_once(':').map_or(&address[..], |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host != "localhost" && !host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_machine_is_trusted() {
        for (address, expected) in [
            ("127.0.0.1:7001", false),
            ("[::1]:7001", false),
            ("localhost:7001", false),
            ("unix:left.sock", false),
            ("192.0.2.1:7001", true),
            ("left-pc.local:7001", true),
        ] {
            assert_eq!(leaves_this_machine(&address.parse().expect("an address")), expected, "{address}");
        }
    }
}
