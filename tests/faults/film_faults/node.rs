//! Nodes that can be lost.

use std::net::SocketAddr;
use std::ops::Range;
use std::thread::JoinHandle;

use camera_node::service::{Access, Node};
use camera_node::source::{SourceConfig, StageConfig};
use camera_node::{NodeCamera, NodeConfig};
use hull::{ProbeSettings, Rig};
use proto::Address;
use segment::SegmentSettings;
use serde_json::json;
use sim::Scene;
use stage::StageSettings;
use tokio::sync::oneshot;

use super::film::{FPS, stage_of};

/// Cameras of a rig, as a node films them.
pub fn node_config(scene: &Scene, rig: &Rig, cameras: Range<usize>) -> NodeConfig {
    let StageSettings { motion, props, person, .. } = stage_of(scene);
    let source = SourceConfig::Stage(StageConfig { motion, props, person, ..StageConfig::default() });
    let camera = |index: usize| NodeCamera {
        camera: rig.cameras()[index].clone(),
        rig_index: index as u16,
        source: source.clone(),
        background: None,
        segmentation: SegmentSettings::default(),
        ignored: None,
    };
    NodeConfig { cameras: cameras.map(camera).collect(), settings: ProbeSettings::default(), fps: FPS }
}

/// The same cameras, whose programs run and write nothing.
pub fn silent_node_config(scene: &Scene, rig: &Rig, cameras: Range<usize>) -> NodeConfig {
    let mut config = node_config(scene, rig, cameras);
    let source = json!({ "kind": "pipe", "live": true, "timeout_s": 600, "command": ["sleep", "1000"] });
    for camera in &mut config.cameras {
        camera.source = serde_json::from_value(source.clone()).expect("a source");
        if let SourceConfig::Pipe(pipe) = &mut camera.source {
            pipe.folder = std::env::temp_dir();
        }
        camera.segmentation = serde_json::from_value(json!({ "method": "chroma" })).expect("settings");
    }
    config
}

/// A node on a thread of its own. It ends, and so do its connections and programs, when this is dropped.
pub struct Served {
    pub address: Address,
    /// What ends it before, if that is told or dropped.
    pub loses: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Served {
    pub async fn start(config: NodeConfig) -> Served {
        let ((opened, address), (loses, lost)) = (oneshot::channel(), oneshot::channel());
        let thread = std::thread::spawn(move || {
            let runtime =
                tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
            runtime.block_on(async {
                let listen = SocketAddr::from(([127, 0, 0, 1], 0));
                let node = Node::open(config, listen, Access::default()).await.expect("opens");
                opened.send(node.address().expect("bound").to_string()).expect("the test waits");
                tokio::select! {
                    served = node.serve(std::future::pending()) => served.expect("serves"),
                    _ = lost => {}
                }
            });
        });
        let address = address.await.expect("an address").parse().expect("an address");
        Served { address, loses: Some(loses), thread: Some(thread) }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.loses = None;
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || ended.is_none_or(|ended| ended.is_ok()), "the node panicked");
    }
}
