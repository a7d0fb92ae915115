//! The same pass through real local nodes: a process of this program for each camera.

use std::fs;
use std::path::Path;
use std::time::Duration;

use coordinator::{Placement, Transport, TransportError};
use film_time::Pace;
use hull::pass::{PaperResult, Pass};
use hull::rule::{NormalWindow, OutOfView};
use node_client::Agreement;
use setup::cli::{Failure, Outcome, temporary_folder};
use setup::{ClusterFile, LocalCluster, LocalNodes, Sockets};
use toml::Value;

use super::Query;

/// How long nodes may take to answer to their addresses, and to read a silhouette.
const START_TIMEOUT: Duration = Duration::from_secs(30);
/// How long a round may take: the most points that there may be, with distortion, on a slow machine.
const ROUND_TIMEOUT: Duration = Duration::from_secs(600);
/// A single image is frame 0 of its source.
const FRAME: u64 = 0;

/// Starts the nodes, asks them, and stops them.
pub fn results(query: &Query) -> Outcome<Vec<PaperResult>> {
    let folder = temporary_folder()?;
    let path = folder.path().join("query.cluster.toml");
    write_cluster(query, folder.path(), &path).map_err(|error| Failure::unwritable(folder.path(), error))?;
    let file = ClusterFile::open(&path)?;
    let cluster = LocalCluster::start(&file, Sockets::default(), LocalNodes::default())?;
    let mut pass = query.pass(&query.view_set(), cluster.nodes().len());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::run)?;
    runtime.block_on(async {
        let nodes = cluster.nodes().to_vec();
        let mut transport =
            Transport::connect(nodes, Placement::Nodes, Agreement::new(query.settings, file.fps, Vec::new()));
        answer(&mut transport, &mut pass).await.map_err(Failure::run)
    })?;
    Ok(super::paper_results(pass))
}

async fn answer(transport: &mut Transport, pass: &mut Pass) -> Result<(), TransportError> {
    transport.ready(START_TIMEOUT).await?;
    transport.start(Pace::lock_step(1), None).await?;
    transport.credit(FRAME);
    transport.frame(FRAME, START_TIMEOUT).await?;
    transport.run_pass(pass, FRAME, Some(ROUND_TIMEOUT), &mut |_, _| {}).await
}

/// Writes the rig, copies of the silhouettes under names that no pattern is in, and a cluster file.
fn write_cluster(query: &Query, folder: &Path, path: &Path) -> std::io::Result<()> {
    let rule = query.settings.rule();
    let out_of_view = match rule.out_of_view {
        OutOfView::Outside => "outside",
        OutOfView::Abstain => "abstain",
    };
    let normal_window = match query.settings.normal_window() {
        NormalWindow::Auto => "\"auto\"".to_owned(),
        NormalWindow::Pixels(k) => k.to_string(),
    };
    let mut text = format!(
        "rig = \"rig.toml\"\nscene = \"topple\"\nfps = 1\nout_of_view = \"{out_of_view}\"\nmin_views = {}\n\
         normal_window = {normal_window}\nmax_depth_m = {:?}\n",
        rule.min_views,
        query.settings.max_depth_m()
    );
    for (index, (camera, mask)) in query.rig.cameras().iter().zip(&query.mask_paths).enumerate() {
        let copy = format!("mask_{index}.png");
        fs::copy(mask, folder.join(&copy))?;
        // A cluster file fills variables in; a name that looks like one is only a name.
        let name = Value::String(camera.name().replace("${", "$${"));
        text += &format!("[[camera]]\nname = {name}\nsource = {{ kind = \"masks\", path = \"{copy}\" }}\n");
    }
    fs::write(folder.join("rig.toml"), query.rig.to_toml())?;
    fs::write(path, text)
}
