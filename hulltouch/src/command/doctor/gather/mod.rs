//! Looks at everything that checks are about, before any of them.

mod disk;
mod film;
mod local;
mod nodes;
mod trust;

use std::path::PathBuf;

use film_time::unix_now_s;
use node_client::Agreement;
use setup::ClusterFile;
use setup::cli::Outcome;

use self::trust::Trust;
use super::facts::{Facts, NoFilm};
use crate::run::security::SecurityArguments;

/// What is looked at, and how.
pub struct Scope<'a> {
    /// The cluster file.
    pub file: &'a ClusterFile,
    /// The only node that is looked at: this machine's own.
    pub host: Option<&'a str>,
    /// With whose certificates.
    pub security: &'a SecurityArguments,
    /// Whether nodes without a coordinator may be led for some seconds.
    pub may_film: bool,
    /// Where recordings go.
    pub recordings: PathBuf,
    /// Where `/dev` and `/sys` are.
    pub root: PathBuf,
}

/// Gathers everything; takes some seconds where cameras film.
pub async fn gather(scope: &Scope<'_>) -> Outcome<Facts> {
    let Scope { file, host, security, .. } = *scope;
    let trust = Trust::of(file, host, security);
    let agreement = Agreement::new(file.probes, file.fps, Vec::new());
    let expected = nodes::expected(file, host)?;
    let mut nodes = nodes::look(&expected, trust.dial.as_ref(), &agreement).await;
    if host.is_some() {
        nodes::forget_refusals(&mut nodes);
    }
    let film = match host {
        Some(_) => {
            let why = "cameras film when the room does: run it without --host, too";
            Err(NoFilm::NotTried(why.to_owned()))
        }
        None => film::look(file, &expected, &mut nodes, &trust, scope.may_film).await,
    };
    let local = local::cameras(file, host);
    Ok(Facts {
        fps: file.fps,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        now_unix_s: unix_now_s(),
        host: host.map(ToOwned::to_owned),
        nodes,
        certificates: trust.certificates,
        film,
        devices: local::devices(&local, &scope.root),
        missing_backgrounds: local::missing_backgrounds(&local),
        disks: disk::look(&local, &scope.recordings),
        open_files: rustix::process::getrlimit(rustix::process::Resource::Nofile).current,
    })
}
