//! The manifests for Kubernetes: what is committed is what the overlays build, every key of it exists, and it does what
//! the operator's guide says.

mod manifests;

use std::fs;

use setup::ClusterFile;

use crate::arguments::check_arguments;
use manifests::{Resources, built, check, kubectl, kubernetes, read};
use serde_json::{Value, json};

const OVERLAYS: [&str; 2] = ["room-a", "room-a-host-cameras"];

/// The resources of every overlay as they are committed.
fn all_built() -> Option<Vec<(&'static str, Resources)>> {
    OVERLAYS.iter().map(|&overlay| Some((overlay, read(&built(overlay))?))).collect()
}

/// Lines in their order; but kubectl before 1.21 names a ConfigMap by another digest, and adds to lists at another end.
fn lines(text: &str, is_old: bool) -> Vec<String> {
    let mut lines: Vec<String> = text.lines().map(ToOwned::to_owned).collect();
    if is_old {
        let plain = |line: &String| match line.split_once("name: room-") {
            Some((before, hash)) if hash.len() == 10 => format!("{before}name: room-HASH"),
            _ => line.trim_start_matches([' ', '-']).to_owned(),
        };
        lines = lines.iter().map(plain).collect();
        lines.sort();
    }
    lines
}

#[test]
fn what_is_committed_is_what_the_overlays_build() {
    let Some(version) = kubectl(&["version", "--client"]) else { return };
    let is_old = version.contains("GitVersion:\"v1.20");
    for overlay in OVERLAYS {
        let folder = kubernetes().join("overlays").join(overlay);
        let made = kubectl(&["kustomize", &folder.display().to_string()]).expect("it is there");
        let committed = fs::read_to_string(built(overlay)).expect("committed");
        assert!(
            lines(&made, is_old) == lines(&committed, is_old),
            "kubectl kustomize deploy/kubernetes/overlays/{overlay} > deploy/kubernetes/built/{overlay}.yaml"
        );
    }
}

#[test]
fn every_key_exists_and_a_misspelt_one_does_not() {
    let mut texts: Vec<String> =
        OVERLAYS.iter().map(|overlay| fs::read_to_string(built(overlay)).expect("committed")).collect();
    texts.extend(kubectl(&["kustomize", &kubernetes().join("base").display().to_string()]));
    for text in &texts {
        match check(text) {
            None => return,
            Some(Ok(_)) => {}
            Some(Err(why)) => panic!("{why}"),
        }
    }
    for (right, wrong, named) in [
        ("readinessProbe:", "readynessProbe:", "'readynessProbe' was unexpected"),
        ("maxSurge:", "maxSurges:", "'maxSurges' was unexpected"),
        ("dnsNames:", "dnsName:", "'dnsName' was unexpected"),
        ("podMetricsEndpoints:", "podMetricsEndpoint:", "'podMetricsEndpoint' was unexpected"),
        ("selfSigned:", "selfsigned:", "'selfsigned' was unexpected"),
        ("cert-manager.io/v1", "cert-manager.io/v2", "'cert-manager.io/v1' was expected"),
        ("renewBefore: 720h", "renewBefore: 30d", "'30d' does not match"),
    ] {
        let misspelt = texts[0].replacen(right, wrong, 1);
        assert_ne!(misspelt, texts[0], "{right} is there");
        let why = check(&misspelt).expect("it is there").expect_err(wrong);
        assert!(why.contains(named), "{wrong}: {why}");
    }
}

#[test]
fn nodes_and_coordinator_behave_as_the_guide_says() {
    let Some(overlays) = all_built() else { return };
    for (overlay, resources) in overlays {
        let kinds: Vec<&str> = resources.kinds();
        for absent in ["PodDisruptionBudget", "Lease", "PersistentVolumeClaim", "Secret"] {
            assert!(!kinds.contains(&absent), "{overlay}: {absent}");
        }
        assert!(!resources.text().contains("subPath"), "{overlay}: what is mounted so never changes");

        let node = resources.one("DaemonSet", "node");
        let rolling = &node["spec"]["updateStrategy"]["rollingUpdate"];
        assert_eq!(rolling, &json!({ "maxSurge": 0, "maxUnavailable": 1 }), "{overlay}");
        let pod = &node["spec"]["template"]["spec"];
        assert_eq!(pod["hostNetwork"], true, "{overlay}");
        assert_eq!(pod["nodeSelector"], json!({ "hulltouch.dev/room": "room-a" }), "{overlay}");
        check_pod(overlay, pod, 9464);

        let coordinator = resources.one("Deployment", "coordinator");
        assert_eq!(coordinator["spec"]["replicas"], 1, "{overlay}");
        assert_eq!(coordinator["spec"]["strategy"], json!({ "type": "Recreate" }), "{overlay}");
        let pod = &coordinator["spec"]["template"]["spec"];
        let unreachable = json!({ "key": "node.kubernetes.io/unreachable", "operator": "Exists",
            "effect": "NoExecute", "tolerationSeconds": 10 });
        assert!(pod["tolerations"].as_array().is_some_and(|all| all.contains(&unreachable)), "{overlay}");
        assert_eq!(pod["hostNetwork"], Value::Null, "a policy binds it");
        check_pod(overlay, pod, 9465);

        let policy = &resources.one("NetworkPolicy", "coordinator")["spec"];
        let labels = &coordinator["spec"]["template"]["metadata"]["labels"];
        assert_eq!(&policy["podSelector"]["matchLabels"], labels, "{overlay}");
        for resource in resources.all() {
            let name = &resource["metadata"];
            assert_eq!(name["labels"]["room"], "room-a", "{overlay}: {name}");
            let namespace = if resource["kind"] == "Namespace" { &name["name"] } else { &name["namespace"] };
            assert_eq!(namespace, "room-a", "{overlay}: {name}");
        }
    }
}

/// A pod's container runs the program as it is, asks its own port how it is, and runs without privileges.
#[track_caller]
fn check_pod(overlay: &str, pod: &Value, port: u16) {
    let containers = pod["containers"].as_array().expect("containers");
    let [container] = &containers[..] else { panic!("{overlay}: expected one container") };
    assert_eq!(container["image"], "hulltouch:latest", "{overlay}");
    assert_eq!(
        (&pod["securityContext"]["runAsNonRoot"], &pod["automountServiceAccountToken"]),
        (&json!(true), &json!(false))
    );
    assert_eq!(container["securityContext"]["readOnlyRootFilesystem"], true, "{overlay}");
    let ports = container["ports"].as_array().expect("ports");
    let metrics = ports.iter().find(|port| port["name"] == "metrics").expect("a port of metrics");
    assert_eq!(metrics["containerPort"], port, "{overlay}");
    for (probe, path) in [("livenessProbe", "/live"), ("readinessProbe", "/ready")] {
        let expected = json!({ "path": path, "port": "metrics" });
        assert_eq!(container[probe]["httpGet"], expected, "{overlay}: {probe}");
    }
    let arguments = container["args"].as_array().expect("arguments");
    let arguments: Vec<&str> = arguments.iter().filter_map(Value::as_str).collect();
    assert!(arguments.contains(&&format!("0.0.0.0:{port}")[..]), "{overlay}: {arguments:?}");
    check_arguments(overlay, &arguments);
}

#[test]
fn cameras_come_from_a_device_plugin_or_from_a_privileged_host_path() {
    let Some(overlays) = all_built() else { return };
    let pods = overlays
        .iter()
        .map(|(_, resources)| resources.one("DaemonSet", "node")["spec"]["template"]["spec"].clone());
    let pods: Vec<Value> = pods.collect();
    let container = |pod: usize| &pods[pod]["containers"][0];
    let host_path = |pod: &Value| {
        let volumes = pod["volumes"].as_array().expect("volumes").iter();
        volumes.filter_map(|volume| volume["hostPath"]["path"].as_str()).any(|path| path == "/dev")
    };
    assert_eq!(container(0)["resources"]["limits"]["squat.ai/video"], "1");
    assert_eq!(container(0)["securityContext"]["privileged"], Value::Null);
    assert_eq!(container(0)["securityContext"]["capabilities"], json!({ "drop": ["ALL"] }));
    assert!(!host_path(&pods[0]));
    assert_eq!(container(1)["resources"]["limits"]["squat.ai/video"], Value::Null);
    assert_eq!(container(1)["securityContext"]["privileged"], true);
    assert!(host_path(&pods[1]));
}

#[test]
fn every_host_of_the_cluster_file_has_its_certificate_where_its_node_looks() {
    let file = ClusterFile::open(&kubernetes().join("overlays/room-a/room.toml")).expect("valid");
    let Some(overlays) = all_built() else { return };
    for (overlay, resources) in overlays {
        let pod = &resources.one("DaemonSet", "node")["spec"]["template"]["spec"];
        let volumes = pod["volumes"].as_array().expect("volumes");
        let certs = volumes.iter().find(|volume| volume["name"] == "certs").expect("certificates");
        let sources = certs["projected"]["sources"].as_array().expect("sources");
        assert_eq!(sources.len(), file.nodes.len(), "{overlay}");
        let owner = |name: &str| resources.one("Certificate", name)["spec"]["dnsNames"].clone();
        for (node, source) in file.nodes.iter().zip(sources) {
            let name = node.name.as_deref().expect("a name");
            assert!(node.address.is_some(), "multicast does not reach {name}");
            let secret = format!("node-{name}");
            assert_eq!(source["secret"]["name"], secret[..], "{overlay}");
            assert_eq!(owner(&secret), json!([format!("{name}.node.{}.hulltouch", file.name)]));
            let files = ["ca.crt", "tls.crt", "tls.key"];
            let items = files.map(|key| json!({ "key": key, "path": format!("{name}/{key}") }));
            assert_eq!(source["secret"]["items"], json!(items), "{overlay}");
        }
        assert_eq!(owner("coordinator"), json!([format!("coordinator.{}.hulltouch", file.name)]));
        assert_eq!(owner("viewer"), json!([format!("viewer.{}.hulltouch", file.name)]));
    }
}
