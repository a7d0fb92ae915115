//! `hulltouch certs`: an authority and a folder of certificates for every machine of a room, where there is no authority.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use clap::Args;
use net::{
    AUTHORITIES, Authority, CERTIFICATE, CertificateError, CertificateNames, Credentials, Identity, KEY,
    PageName, Role, Validity,
};
use setup::ClusterFile;
use setup::cli::{Failure, Outcome, out};

/// The folder and the key of the authority itself.
const AUTHORITY: &str = "authority";
const AUTHORITY_KEY: &str = "ca.key";
/// The folder of the coordinator.
const COORDINATOR: &str = "coordinator";
/// An authority outlives many certificates.
const AUTHORITY_DAYS: u32 = 3650;

/// Make certificates for a room that has no authority: one, and a folder for each node, the coordinator and viewers. Run
/// again, it renews certificates; it never replaces a key.
#[derive(Debug, Args)]
#[command(after_help = "\
    Example, and then each machine gets the folder of its name:\n  \
    hulltouch certs studio.cluster.toml --into certs\n  \
    scp certs/nodes/left/* root@left-pc:/etc/hulltouch/certs/\n\n\
    Keep certs/authority on a machine of its own: a holder of its key can act as the coordinator.")]
pub struct CertsArguments {
    /// The cluster file.
    cluster: PathBuf,
    /// Where the folders are made.
    #[arg(long, value_name = "FOLDER")]
    into: PathBuf,
    /// How long certificates are valid, days.
    #[arg(long, value_name = "N", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
    /// Another name or IP address in the coordinator's certificate, as browsers call its machine; give it once for each. Those
    /// of the certificate that is renewed stay.
    #[arg(long = "page-name", value_name = "NAME")]
    page_names: Vec<PageName>,
}

/// Makes what is missing, and renews the rest.
pub fn run(arguments: &CertsArguments) -> Outcome {
    let file = ClusterFile::open(&arguments.cluster)?;
    let named: Option<Vec<&str>> = file.nodes.iter().map(|node| node.name.as_deref()).collect();
    let named = named.ok_or_else(|| {
        let path = file.path.display();
        Failure::input(format_args!(
            "{path} has nodes without a name, expected [[node]] entries: certificates are of names"
        ))
    })?;
    let room = &file.name;
    let nodes = named.iter().map(|name| (format!("nodes/{name}"), Identity::node(room, name)));
    let others = [
        (COORDINATOR.to_owned(), Identity::coordinator(room)),
        ("viewer".to_owned(), Identity::viewer(room)),
    ];
    let owners: Vec<(PathBuf, Identity)> =
        nodes.chain(others).map(|(folder, owner)| (arguments.into.join(folder), owner)).collect();
    let authority = authority(&arguments.into.join(AUTHORITY), room, &owners)?;
    let page_names = page_names(&arguments.into.join(COORDINATOR), &Identity::coordinator(room), arguments)?;
    let mut lines = String::new();
    let made = owners.into_iter().try_for_each(|(folder, owner)| -> Outcome {
        let also = if owner.role == Role::Coordinator { &page_names[..] } else { &[] };
        let done = issue(&folder, &authority, &owner, also, Validity::days(arguments.days))?;
        lines += &format!("{}: {owner}, {done}\n", folder.display());
        Ok(())
    });
    // After all are made: a closed standard output leaves none out. What was made before a failure is named, too.
    let shown = out!("{lines}");
    made.and(shown)
}

/// The names of the coordinator's certificate besides its own: those of the one that is there, and those that are given.
fn page_names(folder: &Path, owner: &Identity, arguments: &CertsArguments) -> Outcome<Vec<String>> {
    let mut before = match CertificateNames::read(folder) {
        Ok(before) => before,
        Err(CertificateError::Read { error, .. }) if error.kind() == io::ErrorKind::NotFound => {
            CertificateNames::default()
        }
        Err(error) => return Err(Failure::input(error)),
    };
    before.names.retain(|name| *name != owner.to_string());
    let (names, wrong) = before.names.into_iter().partition(|name| name.parse::<PageName>().is_ok());
    before.names = names;
    before.unreadable.extend::<Vec<String>>(wrong);
    if !before.unreadable.is_empty() {
        tracing::warn!(
            "{}: these names go: {}; give them again with --page-name",
            folder.join(CERTIFICATE).display(),
            before.unreadable.join(", ")
        );
    }
    for name in arguments.page_names.iter().map(PageName::to_string) {
        if !before.names.contains(&name) {
            before.names.push(name);
        }
    }
    Ok(before.names)
}

/// The room's authority: the one that is there, or a new one where there was none.
fn authority(folder: &Path, room: &str, owners: &[(PathBuf, Identity)]) -> Outcome<Authority> {
    let (certificate, key) = (folder.join(AUTHORITIES), folder.join(AUTHORITY_KEY));
    let is_there = |path: &Path| path.try_exists().map_err(|error| wrong(path, &error));
    if is_there(&key)? {
        let read = |path: &Path| fs::read_to_string(path).map_err(|error| wrong(path, &error));
        return Authority::open(room, &read(&certificate)?, &read(&key)?)
            .map_err(|error| wrong(&key, &error));
    }
    // Nodes that have copies of their folders would refuse all certificates of a new authority.
    for path in owners.iter().map(|(folder, _)| folder.join(KEY)).chain([certificate.clone()]) {
        if is_there(&path)? {
            return Err(Failure::input(format_args!(
                "{} is not there: put it back, or choose another folder",
                key.display()
            )));
        }
    }
    let made = Authority::make(room, Validity::days(AUTHORITY_DAYS)).map_err(Failure::run)?;
    make_folder(folder)?;
    write(&certificate, made.certificate(), 0o644)?;
    write_key(&key, &made.key())?;
    Ok(made)
}

/// A certificate in a folder of its owner's, for the key that is there or a new one; says which.
fn issue(
    folder: &Path,
    authority: &Authority,
    owner: &Identity,
    also: &[String],
    validity: Validity,
) -> Outcome<&'static str> {
    make_folder(folder)?;
    let path = folder.join(KEY);
    let known = match fs::read_to_string(&path) {
        Ok(key) => Some(key),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(wrong(&path, &error)),
    };
    let issued =
        authority.issue(owner, also, validity, known.as_deref()).map_err(|error| wrong(&path, &error))?;
    if known.is_none() {
        write_key(&path, &issued.key)?;
    }
    write(&folder.join(AUTHORITIES), authority.certificate(), 0o644)?;
    write(&folder.join(CERTIFICATE), &issued.certificate, 0o644)?;
    Credentials::open(folder, owner.clone()).map_err(Failure::input)?;
    Ok(if known.is_some() { "renewed for its key" } else { "new" })
}

fn make_folder(folder: &Path) -> Outcome {
    let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(folder);
    made.map_err(|error| wrong(folder, &error))
}

/// Replaces the file at once: a reader finds the old one or the new one.
fn write(path: &Path, text: &str, mode: u32) -> Outcome {
    let beside = path.with_extension("new");
    let open = |path: &Path| OpenOptions::new().write(true).create(true).truncate(true).mode(mode).open(path);
    let written =
        open(&beside).and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_all()));
    written.and_then(|()| fs::rename(&beside, path)).map_err(|error| wrong(path, &error))
}

/// Writes a key that is not there yet.
fn write_key(path: &Path, text: &str) -> Outcome {
    let opened = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
    let written = opened.and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_all()));
    written.map_err(|error| wrong(path, &error))
}

fn wrong(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::input(format_args!("{}: {error}", path.display()))
}
