//! What cameras do while they film: in the run of their lease holder, or in one of our own of some seconds.

use std::io::{IsTerminal as _, Write as _};
use std::sync::Arc;
use std::time::Duration;

use film_time::{Pace, unix_now_s};
use node_client::{Agreement, Dial, ExpectedNode, NodeClient, NodeEvent, StatusClient};
use proto::{CameraStatus, CameraTrouble, TroubleKind};
use setup::ClusterFile;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout};

use super::super::facts::{CameraFacts, NoFilm, NodeFacts};
use super::trust::Trust;

/// Between two looks.
const EVERY: Duration = Duration::from_millis(500);
/// Live cameras are looked at for so long, so that their rates and phases are known; film for half of it.
const LIVE: Duration = Duration::from_millis(4500);
const FILM: Duration = Duration::from_secs(2);
/// Nodes connect within this, and programs that film begin.
const CONNECTS_WITHIN: Duration = Duration::from_secs(10);
const BEGINS_WITHIN: Duration = Duration::from_secs(12);
/// Programs need a moment to open cameras; frame 0 is not late for it.
const LEAD_S: f64 = 0.3;

/// Looks at cameras that film; says why there is nothing to see.
pub async fn look(
    file: &ClusterFile,
    expected: &[ExpectedNode],
    nodes: &mut [NodeFacts],
    trust: &Trust,
    may_film: bool,
) -> Result<Vec<CameraFacts>, NoFilm> {
    let (dial, owner) = preparation(nodes, trust, may_film).map_err(NoFilm::NotTried)?;
    let is_live = file.cameras.iter().any(|camera| camera.source.is_live());
    let lasts = if is_live { LIVE } else { FILM };
    let clients = expected.iter().map(|node| StatusClient::new(node.clone(), Arc::clone(dial)));
    let looks = Looks { clients: clients.collect(), cameras: Vec::new() };
    let looked = match owner {
        RunOwner::LeaseHolder => looks.watch(nodes, lasts).await,
        RunOwner::Doctor => {
            say_that_it_films(lasts);
            let agreement = Agreement::new(file.probes, file.fps, Vec::new()).dialling(Arc::clone(dial));
            looks.film(expected, nodes, agreement, lasts).await
        }
    };
    looked.map_err(NoFilm::Failed)
}

/// The program whose run the cameras film.
enum RunOwner {
    /// The coordinator that holds the leader lease of the nodes.
    LeaseHolder,
    /// This command: it starts a run of some seconds.
    Doctor,
}

/// Over which sockets nodes are asked, and the owner of the run; or why cameras cannot be looked at.
fn preparation<'a>(
    nodes: &[NodeFacts],
    trust: &'a Trust,
    may_film: bool,
) -> Result<(&'a Arc<dyn Dial>, RunOwner), String> {
    if nodes.is_empty() {
        return Err("no node to ask".to_owned());
    }
    if let Some(node) = nodes.iter().find(|node| node.report().is_none()) {
        return Err(format!("cameras are looked at when all nodes answer, and {} does not", node.name));
    }
    if let Some(node) = nodes.iter().find(|node| matches!(node.agrees, Some(Err(_)))) {
        return Err(format!(
            "cameras are looked at when all nodes fit the cluster file, and {} does not",
            node.name
        ));
    }
    let Some(dial) = &trust.dial else { return Err("nodes cannot be asked".to_owned()) };
    let mut holders = nodes.iter().filter_map(|node| node.report()?.status.holder.as_ref());
    if holders.any(|holder| holder.is_there) {
        return Ok((dial, RunOwner::LeaseHolder));
    }
    if !may_film || !trust.may_lead {
        let why = if may_film { "this certificate may not lead them" } else { "--no-film is given" };
        return Err(format!("no coordinator leads the nodes, so that no camera films, and {why}"));
    }
    Ok((dial, RunOwner::Doctor))
}

fn say_that_it_films(lasts: Duration) {
    if std::io::stderr().is_terminal() {
        // A closed standard error is no reason to fail.
        let _ = writeln!(
            std::io::stderr(),
            "no coordinator leads the nodes: filming for {:.0} s",
            lasts.as_secs_f64()
        );
    }
}

/// A run of ours. It ends with this: nodes stop their cameras some seconds later.
struct Run {
    _clients: Vec<Arc<NodeClient>>,
    /// Cameras of nodes that do not film, and why.
    refused: Vec<(Vec<String>, String)>,
}

impl Run {
    async fn begin(nodes: &[ExpectedNode], agreement: Arc<Agreement>) -> Result<Run, String> {
        let (sender, mut events) = mpsc::channel(64);
        let spawn = |(index, node): (usize, &ExpectedNode)| {
            NodeClient::spawn(node.clone(), index, Arc::clone(&agreement), sender.clone())
        };
        let clients: Vec<Arc<NodeClient>> = nodes.iter().enumerate().map(spawn).collect();
        drop(sender);
        let mut is_up = vec![false; nodes.len()];
        let connecting = async {
            let mut last = "nothing".to_owned();
            while is_up.contains(&false) {
                match events.recv().await {
                    Some((index, NodeEvent::Up)) => is_up[index] = true,
                    Some((index, NodeEvent::Down(error))) => {
                        (is_up[index], last) = (false, format!("node {}: {error}", nodes[index]));
                        tracing::debug!("{last}");
                    }
                    Some(_) => {}
                    None => return Err(last),
                }
            }
            Ok(())
        };
        let late = || Err("not all nodes let themselves be led".to_owned());
        timeout(CONNECTS_WITHIN, connecting).await.unwrap_or_else(|_| late())?;
        // Their reports must be read.
        tokio::spawn(async move { while events.recv().await.is_some() {} });
        // A number that no run before had.
        let pace = Pace::live(unix_now_s().to_bits(), LEAD_S);
        agreement.begin_run(pace);
        let mut refused = Vec::new();
        for client in &clients {
            if let Err(error) = client.start(pace).await {
                let cameras = client.node().cameras.iter().map(|camera| camera.name.clone()).collect();
                refused.push((cameras, error.to_string()));
            }
        }
        Ok(Run { _clients: clients, refused })
    }
}

/// Looks at all cameras, one after the other.
struct Looks {
    clients: Vec<StatusClient>,
    cameras: Vec<CameraFacts>,
}

impl Looks {
    /// Looks at what films already.
    async fn watch(mut self, nodes: &mut [NodeFacts], lasts: Duration) -> Result<Vec<CameraFacts>, String> {
        self.go_on(nodes, lasts).await?;
        Ok(self.cameras)
    }

    /// Looks while a run of our own films.
    async fn film(
        mut self,
        expected: &[ExpectedNode],
        nodes: &mut [NodeFacts],
        agreement: Agreement,
        lasts: Duration,
    ) -> Result<Vec<CameraFacts>, String> {
        let run = Run::begin(expected, Arc::new(agreement)).await?;
        self.begin(nodes).await?;
        self.go_on(nodes, lasts).await?;
        self.note_refused(&run.refused);
        Ok(self.cameras)
    }

    /// Waits until all cameras have given a frame, or told why they do not.
    async fn begin(&mut self, nodes: &mut [NodeFacts]) -> Result<(), String> {
        let until = Instant::now() + BEGINS_WITHIN;
        loop {
            self.look(nodes).await?;
            let films = |look: &CameraStatus| look.frames > 0 || look.trouble.is_some();
            let all_film = self.cameras.iter().all(|camera| camera.last().is_some_and(films));
            if all_film || Instant::now() >= until {
                return Ok(());
            }
            sleep(EVERY).await;
        }
    }

    async fn go_on(&mut self, nodes: &mut [NodeFacts], lasts: Duration) -> Result<(), String> {
        let until = Instant::now() + lasts;
        while Instant::now() < until {
            sleep(EVERY).await;
            self.look(nodes).await?;
        }
        Ok(())
    }

    /// Asks all nodes; the one that knows its clock best is kept of each.
    async fn look(&mut self, nodes: &mut [NodeFacts]) -> Result<(), String> {
        for (client, node) in self.clients.iter_mut().zip(nodes) {
            let mut report = client.ask().await.map_err(|error| format!("node {}: {error}", node.name))?;
            for (described, look) in report.status.node.cameras.iter().zip(&report.status.cameras) {
                match self.cameras.iter_mut().find(|camera| camera.name == described.name) {
                    Some(camera) => camera.looks.push(look.clone()),
                    None => self
                        .cameras
                        .push(CameraFacts { name: described.name.clone(), looks: vec![look.clone()] }),
                }
            }
            if let Some(Ok(before)) = &node.found
                && before.clock_bound_s < report.clock_bound_s
            {
                (report.clock_offset_s, report.clock_bound_s) = (before.clock_offset_s, before.clock_bound_s);
            }
            node.found = Some(Ok(report));
        }
        Ok(())
    }

    /// A node that did not begin to film said why.
    fn note_refused(&mut self, refused: &[(Vec<String>, String)]) {
        for camera in &mut self.cameras {
            let why = refused.iter().find(|(cameras, _)| cameras.contains(&camera.name));
            if let (Some((_, why)), Some(last)) = (why, camera.looks.last_mut()) {
                let (kind, message) = (TroubleKind::Source, why.clone());
                last.trouble.get_or_insert(CameraTrouble { kind, message, age_s: 0.0 });
            }
        }
    }
}
