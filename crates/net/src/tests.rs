//! Certificates on sockets in memory.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

use super::*;

const ROOM: &str = "room-a";

fn authority() -> Authority {
    Authority::make(ROOM, Validity::days(30)).expect("an authority")
}

fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    fs::write(&path, text).expect("written");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("its own");
}

/// Writes a folder of certificates.
fn issue(folder: &Path, authority: &Authority, owner: &Identity, validity: Validity) {
    let issued = authority.issue(owner, &[], validity, None).expect("issued");
    write(folder, AUTHORITIES, authority.certificate());
    write(folder, CERTIFICATE, &issued.certificate);
    write(folder, KEY, &issued.key);
}

struct Owner {
    folder: tempfile::TempDir,
    identity: Identity,
}

impl Owner {
    fn new(authority: &Authority, identity: Identity) -> Owner {
        let folder = tempfile::tempdir().expect("a folder");
        issue(folder.path(), authority, &identity, Validity::days(30));
        Owner { folder, identity }
    }

    fn open(&self) -> Result<Arc<Credentials>, CertificateError> {
        Credentials::open(self.folder.path(), self.identity.clone()).map(Arc::new)
    }

    fn problem(&self) -> String {
        let problem = self.open().expect_err("refused").to_string();
        problem.replace(&format!("{}/", self.folder.path().display()), "")
    }
}

fn left() -> Identity {
    Identity::node(ROOM, "left")
}

/// What the server makes of the client, and what the client makes of the server's first byte.
async fn meet(
    server: &Arc<Credentials>,
    client: &Arc<Credentials>,
    meant: &Identity,
) -> (Result<Peer, HandshakeError>, Result<u8, HandshakeError>) {
    let broken = |error: std::io::Error| HandshakeError::Broken(error.to_string());
    let (there, here) = tokio::io::duplex(64 * 1024);
    let serving = async {
        let (mut socket, peer) = server.accept(there).await?;
        socket.write_all(b"x").await.map_err(broken)?;
        Ok(peer)
    };
    let asking = async {
        let mut socket = client.connect(here, meant).await?;
        socket.read_u8().await.map_err(broken)
    };
    tokio::join!(serving, asking)
}

fn refused<T>(why: &str) -> Result<T, HandshakeError> {
    Err(HandshakeError::Refused(why.to_owned()))
}

#[test]
fn names_say_who_a_peer_is() {
    for identity in [left(), Identity::coordinator(ROOM), Identity::viewer(ROOM)] {
        assert_eq!(Identity::from_dns_name(&identity.to_string()), Some(identity));
    }
    for other in
        ["*.node.room-a.hulltouch", "left.node.room-a", "coordinator.room-a.hulltouch.org", "a.b", ""]
    {
        assert_eq!(Identity::from_dns_name(other), None, "{other}");
    }
}

#[tokio::test]
async fn those_of_one_authority_know_each_other() {
    let authority = authority();
    let node = Owner::new(&authority, left()).open().expect("valid");
    let coordinator = Owner::new(&authority, Identity::coordinator(ROOM)).open().expect("valid");
    let (peer, byte) = meet(&node, &coordinator, &left()).await;
    let peer = peer.expect("accepted");
    assert!(peer.is(&Identity::coordinator(ROOM)) && !peer.is(&Identity::viewer(ROOM)), "{peer}");
    assert_eq!(byte, Ok(b'x'));
    let (_, byte) = meet(&node, &coordinator, &Identity::node(ROOM, "right")).await;
    let expected = "its certificate is of left.node.room-a.hulltouch, expected right.node.room-a.hulltouch";
    assert_eq!(byte, refused(expected));
}

#[tokio::test]
async fn an_untrusted_peer_is_refused_and_told_why() {
    let node = Owner::new(&authority(), left());
    let other = Owner::new(&authority(), Identity::coordinator(ROOM));
    // It believes the node, which does not believe it.
    fs::copy(node.folder.path().join(AUTHORITIES), other.folder.path().join("theirs")).expect("copied");
    let untrusted = other.open().expect("valid");
    let (_, byte) = meet(&node.open().expect("valid"), &untrusted, &left()).await;
    assert_eq!(byte, refused("its certificate is of no authority in ca.crt"));
    let both = format!(
        "{}{}",
        fs::read_to_string(other.folder.path().join(AUTHORITIES)).expect("there"),
        fs::read_to_string(other.folder.path().join("theirs")).expect("there")
    );
    write(other.folder.path(), AUTHORITIES, &both);
    let (peer, byte) = meet(&node.open().expect("valid"), &other.open().expect("valid"), &left()).await;
    assert_eq!(peer, refused("its certificate is of no authority in ca.crt"));
    let said = byte.expect_err("refused").to_string();
    assert_eq!(said, "the connection broke: it says that our certificate is of no authority that it knows");
}

#[tokio::test]
async fn what_is_no_tls_is_called_so() {
    let node = Owner::new(&authority(), left()).open().expect("valid");
    let (there, mut here) = tokio::io::duplex(1024);
    here.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").await.expect("sent");
    let refused = node.accept(there).await.map(|_| ()).expect_err("refused").to_string();
    assert_eq!(refused, "it does not speak TLS");
}

#[tokio::test(start_paused = true)]
async fn a_silent_peer_is_dropped() {
    let node = Owner::new(&authority(), left()).open().expect("valid");
    let (there, _here) = tokio::io::duplex(1024);
    let refused = node.accept(there).await.map(|_| ()).expect_err("dropped").to_string();
    assert_eq!(refused, "no TLS handshake within 5 s");
}

#[test]
fn a_folder_that_cannot_be_used_says_why() {
    let authority = authority();
    let owner = || Owner::new(&authority, left());

    let of_other = Owner { identity: Identity::node(ROOM, "right"), ..owner() };
    assert_eq!(
        of_other.problem(),
        "tls.crt is of left.node.room-a.hulltouch, expected right.node.room-a.hulltouch"
    );

    let open_key = owner();
    fs::set_permissions(open_key.folder.path().join(KEY), fs::Permissions::from_mode(0o644)).expect("set");
    assert_eq!(open_key.problem(), "tls.key has mode 0644: others may read it, expected 0600 or 0640");
    fs::set_permissions(open_key.folder.path().join(KEY), fs::Permissions::from_mode(0o660)).expect("set");
    assert_eq!(open_key.problem(), "tls.key has mode 0660: its group may write it, expected 0600 or 0640");

    let mixed = owner();
    fs::copy(owner().folder.path().join(KEY), mixed.folder.path().join(KEY)).expect("copied");
    assert!(mixed.problem().starts_with("tls.key does not fit "), "{}", mixed.problem());

    let empty = owner();
    write(empty.folder.path(), CERTIFICATE, "no certificate");
    assert_eq!(empty.problem(), "tls.crt: found none, expected certificates as PEM");

    let missing = owner();
    fs::remove_file(missing.folder.path().join(AUTHORITIES)).expect("removed");
    assert_eq!(missing.problem(), "ca.crt: No such file or directory (os error 2)");

    let ended = owner();
    issue(ended.folder.path(), &authority, &left(), Validity::days(1).moved(-9));
    assert!(ended.problem().starts_with("tls.crt: the certificate has ended on "), "{}", ended.problem());

    let early = owner();
    issue(early.folder.path(), &authority, &left(), Validity::days(1).moved(9));
    assert!(
        early.problem().starts_with("tls.crt: the certificate is not valid before "),
        "{}",
        early.problem()
    );

    let foreign = owner();
    write(foreign.folder.path(), AUTHORITIES, self::authority().certificate());
    assert_eq!(foreign.problem(), "tls.crt: the certificate is of no authority in ca.crt");
}

#[tokio::test]
async fn certificates_are_replaced_while_they_are_in_use() {
    let (old, new) = (authority(), authority());
    let node = Owner::new(&old, left());
    let serving = node.open().expect("valid");
    let old_end = serving.not_after();
    let coordinator = Owner::new(&old, Identity::coordinator(ROOM)).open().expect("valid");
    assert_eq!(meet(&serving, &coordinator, &left()).await.1, Ok(b'x'));

    // A key without its certificate: what was there stays.
    let issued = new.issue(&left(), &[], Validity::days(60), None).expect("issued");
    write(node.folder.path(), KEY, &issued.key);
    assert_eq!(meet(&serving, &coordinator, &left()).await.1, Ok(b'x'));
    assert_eq!(serving.not_after(), old_end);

    // Then the rest: the old authority is believed no longer.
    write(node.folder.path(), CERTIFICATE, &issued.certificate);
    write(node.folder.path(), AUTHORITIES, new.certificate());
    assert!(serving.not_after() > old_end);
    assert!(meet(&serving, &coordinator, &left()).await.1.is_err());
    let coordinator = Owner::new(&new, Identity::coordinator(ROOM)).open().expect("valid");
    assert_eq!(meet(&serving, &coordinator, &left()).await.1, Ok(b'x'));
}

#[tokio::test]
async fn a_pipe_in_the_place_of_a_certificate_is_refused_and_blocks_no_connection() {
    let authority = authority();
    let node = Owner::new(&authority, left());
    let serving = node.open().expect("valid");
    let coordinator = Owner::new(&authority, Identity::coordinator(ROOM)).open().expect("valid");
    let path = node.folder.path().join(CERTIFICATE);
    fs::remove_file(&path).expect("removed");
    let mode = rustix::fs::Mode::from_raw_mode(0o600);
    rustix::fs::mkfifoat(rustix::fs::CWD, &path, mode).expect("a pipe");
    assert_eq!(meet(&serving, &coordinator, &left()).await.1, Ok(b'x'), "with what was there before");
    assert_eq!(node.problem(), "tls.crt is no regular file, expected certificates or a key as PEM");
    fs::remove_file(&path).expect("removed");
    fs::create_dir(&path).expect("a folder");
    assert!(node.problem().starts_with("tls.crt is no regular file"), "{}", node.problem());
}

#[test]
fn an_authority_is_opened_again() {
    let made = authority();
    let opened = Authority::open(ROOM, made.certificate(), &made.key()).expect("its own files");
    let owner = Owner::new(&opened, left());
    assert!(owner.open().is_ok());
    let key = fs::read_to_string(owner.folder.path().join(KEY)).expect("there");
    let renewed =
        opened.issue(&left(), &["localhost".into()], Validity::days(90), Some(&key)).expect("issued");
    assert_eq!(renewed.key, key, "a key that is there is kept");
}

#[test]
fn a_certificate_says_by_which_names_its_owner_is_known_too() {
    let also = ["studio.example", "*.studio.example", "192.0.2.7", "fd00::7", "::1", "fe80:0:0:0:1::"];
    let also = also.map(str::to_owned);
    let issued = authority().issue(&left(), &also, Validity::days(1).moved(-3), None).expect("issued");
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), CERTIFICATE, &issued.certificate);
    let found = CertificateNames::read(folder.path()).expect("names");
    let expected =
        ["left.node.room-a.hulltouch", "studio.example", "*.studio.example", "192.0.2.7", "fd00::7", "::1"];
    assert_eq!(found.names, expected);
    // It is written as another address, fe80::1, and is not taken for that.
    assert_eq!(found.unreadable, ["IpAddress(fe80::1)"]);

    write(folder.path(), CERTIFICATE, "");
    let error = CertificateNames::read(folder.path()).expect_err("none").to_string();
    assert!(error.ends_with("tls.crt: found none, expected certificates as PEM"), "{error}");
}
