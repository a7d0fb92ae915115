//! With which certificates, if any, nodes may be asked.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use net::{CertificateError, Credentials, Identity};
use node_client::{Dial, Sockets};
use setup::ClusterFile;

use super::super::facts::Certificates;
use crate::run::security::{SecurityArguments, leaves_this_machine};

/// What is known of this machine's certificates, and what follows for its connections.
pub struct Trust {
    /// For the checks.
    pub certificates: Certificates,
    /// Sockets to nodes; none if there can be none.
    pub dial: Option<Arc<dyn Dial>>,
    /// Whether nodes would obey.
    pub may_lead: bool,
}

impl Trust {
    /// Of a node's machine, or of a coordinator's or a viewer's.
    pub fn of(file: &ClusterFile, host: Option<&str>, security: &SecurityArguments) -> Trust {
        let Some(folder) = security.folder() else { return Trust::without(file, host, security.insecure()) };
        let opened = match host {
            Some(host) => Credentials::open(folder, Identity::node(&file.name, host)),
            None => open_of_asker(folder, &file.name),
        };
        let folder = folder.to_owned();
        match opened {
            Ok(credentials) => {
                let ends = credentials.not_after_in_use();
                let ends_s = ends.duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
                let own = credentials.own().clone();
                let may_lead = own == Identity::coordinator(&file.name);
                let age = Duration::from_secs_f64(file.max_connection_age_s);
                let sockets = Sockets::encrypted(Arc::new(credentials.with_max_connection_age(age)));
                let certificates = Certificates::Folder { folder, found: Ok((own, ends_s)) };
                Trust { certificates, dial: Some(Arc::new(sockets)), may_lead }
            }
            Err(error) => {
                let certificates = Certificates::Folder { folder, found: Err(error) };
                Trust { certificates, dial: None, may_lead: false }
            }
        }
    }

    fn without(file: &ClusterFile, host: Option<&str>, insecure: bool) -> Trust {
        let concerned = file.nodes.iter().filter(|node| host.is_none() || node.name.as_deref() == host);
        let mut concerned = concerned.filter(|node| node.has_place());
        let outside = concerned.find(|node| node.address.as_ref().is_none_or(leaves_this_machine));
        let Some(node) = outside else {
            let dial: Arc<dyn Dial> = Arc::new(Sockets::default());
            return Trust { certificates: Certificates::NotNeeded, dial: Some(dial), may_lead: true };
        };
        let place = node.address.as_ref().map(ToString::to_string).unwrap_or_default();
        let node = node.name.as_ref().map_or(place, |name| format!("node {name}"));
        let certificates = Certificates::Missing { node, is_wanted: insecure };
        let dial: Option<Arc<dyn Dial>> = if insecure { Some(Arc::new(Sockets::default())) } else { None };
        Trust { certificates, dial, may_lead: insecure }
    }
}

/// The coordinator's, or a viewer's.
fn open_of_asker(folder: &Path, room: &str) -> Result<Credentials, CertificateError> {
    match Credentials::open(folder, Identity::coordinator(room)) {
        Err(CertificateError::Name { path, found, expected }) => {
            let viewer = Identity::viewer(room);
            let expected = format!("{expected} or {viewer}");
            Credentials::open(folder, viewer).map_err(|_| CertificateError::Name { path, found, expected })
        }
        opened => opened,
    }
}
