//! Certificates decide who is who: between processes, over TCP.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

use net::{AUTHORITIES, Authority, CERTIFICATE, CertificateNames, Identity, KEY, Validity};

use crate::certified::{ROOM, Room, issue, node};
use crate::room::{
    Running, ask_to_end, blind_steps, coordinator, ended, frames, missed, named_room, program,
};
use node_client::{NodeError, NodeEvent};
use testkit::{Watch, timely};

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The share of its frames that a run may miss while connections are renewed.
const MOST_MISSED: f64 = 0.1;

#[test]
fn a_room_with_certificates_runs_as_without() {
    let watch = Watch::start();
    let room = Room::new();
    let run = Running::start(&mut room.coordinator("2"));
    let Some(figures) = watch.judge(ended(run, &room.json())) else { return };
    timely!(watch, frames(&figures) > 10, "{}", missed(&figures));
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));
}

#[tokio::test]
async fn untrusted_peers_are_refused_in_one_line_and_the_run_goes_on() {
    let watch = Watch::start();
    let room = Room::new();
    let running = Running::start(&mut room.coordinator("600"));
    let (ours, other) = (&room.authority, Authority::make(ROOM, Validity::days(30)).expect("another"));

    let refused = room.refusal(ours, Identity::viewer(ROOM)).await;
    let expected = "this is for coordinator.room.hulltouch, and was asked by viewer.room.hulltouch";
    assert_eq!(refused, expected);
    let refused = room.refusal(ours, Identity::node(ROOM, "right")).await;
    assert_eq!(refused, expected.replace("viewer.room", "right.node.room"));
    let refused = room.refusal(ours, Identity::coordinator("other")).await;
    let of_other = "its certificate is of left.node.room.hulltouch, expected left.node.other.hulltouch";
    assert_eq!(refused, format!("cannot connect: {of_other}"));
    let refused = room.refusal(&other, Identity::coordinator(ROOM)).await;
    let expected = "it was shown the certificate of coordinator.room.hulltouch, and its log tells why";
    assert!(refused.ends_with(expected), "{refused}");

    let mut plain = coordinator(program(), &room.cluster, "1", &room.folder.path().join("plain.json"));
    let output = plain.args(["--patience", "5"]).output().expect("ends");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(
        said(&output).contains("node left (cam_0, cam_1): the connection broke at once ("),
        "{}",
        said(&output)
    );
    assert!(
        said(&output).contains(
            "this program was started without --certs; a node that was started with --certs expects one"
        ),
        "{}",
        said(&output)
    );

    ask_to_end(&running);
    let Some(figures) = watch.judge(ended(running, &room.json())) else { return };
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));
}

#[test]
fn certificates_are_replaced_under_a_run_that_misses_nothing() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let authority = || Authority::make(ROOM, Validity::days(30)).expect("an authority");
    let (old, new) = (authority(), authority());
    let owners = [
        ("left", Identity::node(ROOM, "left")),
        ("right", Identity::node(ROOM, "right")),
        ("coordinator", Identity::coordinator(ROOM)),
    ];
    // As Kubernetes does it: a link is changed to another folder.
    let path = folder.path().to_owned();
    let replace = |step: usize, signer: &Authority, believed: &[&Authority]| {
        for (name, owner) in &owners {
            let whole = path.join(format!("{name}-{step}"));
            issue(&whole, signer, owner, Validity::days(30));
            let bundle: String = believed.iter().map(|authority| authority.certificate()).collect();
            fs::write(whole.join(AUTHORITIES), bundle).expect("written");
            let link = path.join(format!("{name}-next"));
            std::os::unix::fs::symlink(&whole, &link).expect("linked");
            fs::rename(&link, path.join(name)).expect("replaced");
        }
    };
    replace(0, &old, &[&old]);
    let room = Room::of(folder, old, "[wire]\nmax_connection_age_s = 2\n");
    let running = Running::start(&mut room.coordinator("600"));
    let after = |seconds| std::thread::sleep(Duration::from_secs(seconds));
    after(3);
    replace(1, &room.authority, &[&room.authority, &new]);
    after(3);
    replace(2, &new, &[&room.authority, &new]);
    after(3);
    replace(3, &new, &[&new]);
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().expect("a runtime");
    // Another leads it: who gets in hears that, who does not hears of certificates.
    let of_new = runtime.block_on(room.first_event_of(&new));
    let is_held = matches!(of_new, NodeEvent::Down(NodeError::Held(_)));
    timely!(watch, is_held, "expected a node that is held: {of_new:?}");
    let of_old = runtime.block_on(room.first_event_of(&room.authority));
    assert!(matches!(of_old, NodeEvent::Down(NodeError::Unreachable(_))), "{of_old:?}");
    ask_to_end(&running);
    let Some(figures) = watch.judge(ended(running, &room.json())) else { return };
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));
    timely!(watch, figures["missed"]["reduced_steps"] == 0, "a node was left out: {}", figures["missed"]);
    let share = figures["missed"]["share"].as_f64().expect("a share");
    timely!(watch, share < MOST_MISSED, "frames were missed: {}", figures["missed"]);
}

#[test]
fn a_node_without_certificates_is_no_node_of_a_room_that_has_them() {
    let room = Room::new();
    let folder = room.folder.path();
    let plain = named_room(folder, "", "");
    let plain = node(folder, &plain, "left", &[]);
    let right = format!("address = {:?}", room.nodes[1].address());
    let cluster = named_room(folder, &format!("address = {:?}", plain.address()), &right);
    let mut command = coordinator(program(), &cluster, "1", &room.json());
    command.current_dir(folder).args(["--certs", "coordinator", "--patience", "5"]);
    let output = command.output().expect("ends");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(
        said(&output).contains(
            "node left (cam_0, cam_1): cannot connect: it showed no certificate before the connection broke"
        ),
        "{}",
        said(&output)
    );
}

#[test]
fn the_very_node_that_is_meant_must_answer() {
    let room = Room::new();
    let [left, right] =
        [&room.nodes[1], &room.nodes[0]].map(|node| format!("address = {:?}", node.address()));
    named_room(room.folder.path(), &left, &right);
    let output = room.coordinator("1").args(["--patience", "5"]).output().expect("ends");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    let expected = "node left (cam_0, cam_1): cannot connect: its certificate is of right.node.room.hulltouch, expected \
                    left.node.room.hulltouch";
    assert!(said(&output).contains(expected), "{}", said(&output));
}

#[test]
fn certificates_that_cannot_be_used_are_refused_before_anything_runs() {
    let room = Room::new();
    let folder = room.folder.path();
    let refusal = |certs: &str| {
        let mut command = coordinator(program(), &room.cluster, "1", &room.json());
        let output = command.current_dir(folder).args(["--certs", certs]).output().expect("ends");
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        said(&output)
    };
    assert_eq!(
        refusal("nowhere"),
        "hulltouch: --certs: nowhere/tls.key: No such file or directory (os error 2)\n"
    );
    let expected = "hulltouch: --certs: left/tls.crt is of left.node.room.hulltouch, expected coordinator.room.hulltouch\n";
    assert_eq!(refusal("left"), expected);
    let ended = Validity::days(1).moved(-3);
    issue(&folder.join("ended"), &room.authority, &Identity::coordinator(ROOM), ended);
    assert!(refusal("ended").contains("ended/tls.crt: the certificate has ended on "));
    fs::set_permissions(folder.join("coordinator").join(KEY), fs::Permissions::from_mode(0o604))
        .expect("set");
    let expected = "coordinator/tls.key has mode 0604: others may read it, expected 0600 or 0640";
    assert!(refusal("coordinator").contains(expected));
}

#[test]
fn certs_makes_a_room_that_runs_and_keeps_its_keys() {
    let watch = Watch::start();
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let certs = folder.path().join("certs");
    let make = || {
        let mut command = program();
        let output = command.arg("certs").arg(&cluster).arg("--into").arg(&certs).output().expect("ends");
        assert!(output.status.success(), "{}", said(&output));
        String::from_utf8(output.stdout).expect("text")
    };
    assert!(make().contains("certs/nodes/left: left.node.room.hulltouch, new\n"));
    let read = |file: &str| fs::read(certs.join("nodes/left").join(file)).expect("there");
    let before = (read(KEY), read(CERTIFICATE));
    assert!(make().contains("certs/nodes/left: left.node.room.hulltouch, renewed for its key\n"));
    assert_eq!(read(KEY), before.0);
    assert_ne!(read(CERTIFICATE), before.1);
    let mode = fs::metadata(certs.join("authority/ca.key")).expect("there").permissions().mode() & 0o777;
    assert_eq!(mode, 0o600);

    let nodes = ["left", "right"].map(|name| {
        let own = certs.join("nodes").join(name);
        node(folder.path(), &cluster, name, &["--certs", own.to_str().expect("a path")])
    });
    let [left, right] = [&nodes[0], &nodes[1]].map(|node| format!("address = {:?}", node.address()));
    let (cluster, json) = (named_room(folder.path(), &left, &right), folder.path().join("out.json"));
    let mut command = coordinator(program(), &cluster, "1", &json);
    let run = Running::start(command.arg("--certs").arg(certs.join("coordinator")));
    let Some(figures) = watch.judge(ended(run, &json)) else { return };
    timely!(watch, blind_steps(&figures) == 0, "{}", missed(&figures));
}

/// A folder with certificates of a room that `hulltouch certs` made there.
fn made_room() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let cluster = named_room(folder.path(), "", "");
    let output = certs(&cluster, &[]);
    assert!(output.status.success(), "{}", said(&output));
    (folder, cluster)
}

/// Runs `hulltouch certs` into the folder beside the cluster file.
fn certs(cluster: &Path, more: &[&str]) -> Output {
    let mut command = program();
    command.arg("certs").arg(cluster).arg("--into").arg(cluster.with_file_name("certs")).args(more);
    command.output().expect("ends")
}

#[test]
fn an_authority_whose_key_is_gone_is_not_replaced() {
    let (folder, cluster) = made_room();
    let authority = folder.path().join("certs/authority");
    let key = authority.join("ca.key");
    let before = fs::read(folder.path().join("certs/coordinator/tls.crt")).expect("there");
    let is_refused = || {
        let output = certs(&cluster, &[]);
        let expected =
            format!("hulltouch: {} is not there: put it back, or choose another folder\n", key.display());
        assert_eq!((output.status.code(), said(&output)), (Some(2), expected));
        assert!(!key.exists());
    };
    fs::remove_file(&key).expect("removed");
    is_refused();
    // Only the folders of the machines are left.
    fs::remove_dir_all(&authority).expect("removed");
    is_refused();
    let after = fs::read(folder.path().join("certs/coordinator/tls.crt")).expect("there");
    assert_eq!(before, after, "nothing was issued");
}

#[test]
fn a_page_name_that_no_browser_can_use_is_refused_before_anything_is_written() {
    let (folder, cluster) = made_room();
    let before = fs::read(folder.path().join("certs/coordinator/tls.crt")).expect("there");
    for (name, why) in [
        (
            "https://studio.example/",
            "found an address with a scheme or a path, expected the name in it alone",
        ),
        ("studio.example:8470", "found a name with a port, expected the name alone"),
        ("bühne.example", "found characters that are not ASCII, expected the name's ASCII form"),
        ("my studio", "found a part that is empty, longer than 63 or not of letters, digits, - and _"),
        ("left.node.room.hulltouch", "found a name of a machine of a room"),
    ] {
        let output = certs(&cluster, &["--page-name", "studio.example", "--page-name", name]);
        assert_eq!(output.status.code(), Some(2), "{name}: {}", said(&output));
        assert!(said(&output).contains(why), "{name}: {}", said(&output));
        let after = fs::read(folder.path().join("certs/coordinator/tls.crt")).expect("there");
        assert_eq!(before, after, "{name}: nothing was issued");
    }
    let output = certs(&cluster, &["--page-name", "[::1]"]);
    assert!(output.status.success(), "{}", said(&output));
    let names = CertificateNames::read(&folder.path().join("certs/coordinator")).expect("names").names;
    assert_eq!(names, ["coordinator.room.hulltouch", "::1"]);
}

#[test]
fn names_of_the_page_stay_when_a_certificate_is_renewed() {
    let (_folder, cluster) = made_room();
    let names = || {
        let own = cluster.with_file_name("certs").join("coordinator");
        CertificateNames::read(&own).expect("names").names
    };
    let issued = |more: &[&str]| {
        let output = certs(&cluster, more);
        assert!(output.status.success() && output.stderr.is_empty(), "{}", said(&output));
        names()
    };
    let own = "coordinator.room.hulltouch";
    assert_eq!(names(), [own]);
    let given = ["--page-name", "studio.example", "--page-name", "192.0.2.7"];
    assert_eq!(issued(&given), [own, "studio.example", "192.0.2.7"]);
    assert_eq!(issued(&[]), [own, "studio.example", "192.0.2.7"]);
    let more = ["--page-name", "studio.example", "--page-name", "fd00::7"];
    assert_eq!(issued(&more), [own, "studio.example", "192.0.2.7", "fd00::7"]);
    // One that cannot be read goes, and is named.
    assert!(certs(&cluster, &["--page-name", "fe80:0:0:0:1::"]).status.success());
    let output = certs(&cluster, &[]);
    assert!(output.status.success(), "{}", said(&output));
    assert!(
        said(&output).contains("coordinator/tls.crt: these names go: IpAddress(fe80::1); "),
        "{}",
        said(&output)
    );
    assert_eq!(names(), [own, "studio.example", "192.0.2.7", "fd00::7"]);
}
