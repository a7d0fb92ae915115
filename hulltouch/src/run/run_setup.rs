//! What a run is made from, checked before anything starts.

use std::path::Path;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use coordinator::{AskEvery, MemoryUse};
use hull::surface::HullTime;
use node_client::{Dial, Role};
use setup::ClusterFile;
use setup::cli::{Failure, NamedValue, Outcome, RESPONSES, check_json_writable, named};
use sim::{ResponseMode, Scene, WorldSettings};

use super::options::{Outlets, RecordTo};

/// Where probes are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TransportName {
    /// At the nodes, or here where that is faster: measured as the run goes. With --unpaced and where numbers are rounded
    /// always at the nodes.
    Auto,
    /// At the nodes: questions travel, silhouettes stay.
    Cluster,
    /// Here: silhouettes travel (the paper's layout).
    Gather,
    /// Here, and cameras are filmed here too.
    Inprocess,
}

impl TransportName {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            TransportName::Auto => "auto",
            TransportName::Cluster => "cluster",
            TransportName::Gather => "gather",
            TransportName::Inprocess => "inprocess",
        }
    }
}

/// Of which moment the hull is that bodies collide with.
const HULL_TIMES: [NamedValue<HullTime>; 2] = [
    ("newest", HullTime::Newest, "The newest frame's, going on as fast as it came"),
    (
        "between",
        HullTime::Between,
        "Between the two newest frames: nothing is guessed, and all comes a frame later",
    ),
];

/// How bodies meet the hull.
#[derive(Debug, Args)]
pub struct ResponseArguments {
    /// How bodies answer the hull.
    #[arg(long, value_parser = named(RESPONSES), default_value = "contacts")]
    response: ResponseMode,
    /// Under contacts, of which moment the hull is that bodies collide with.
    #[arg(long, value_parser = named(HULL_TIMES), default_value = "newest")]
    hull_time: HullTime,
}

impl ResponseArguments {
    /// As the world has them.
    pub fn checked(&self) -> Outcome<(ResponseMode, HullTime)> {
        if self.hull_time == HullTime::Between && self.response != ResponseMode::Contacts {
            return Err(Failure::input(
                "--hull-time between is for contacts alone, expected --response contacts with it",
            ));
        }
        Ok((self.response, self.hull_time))
    }
}

/// Everything a run needs, checked.
pub struct Setup {
    /// Rig, cameras and rules.
    pub file: ClusterFile,
    /// What happens.
    pub scene: Scene,
    /// The world's settings.
    pub world: WorldSettings,
    /// Where probes are computed.
    pub transport: TransportName,
    /// How often the hull is asked.
    pub asks: AskEvery,
    /// Every frame, as fast as it can be made.
    pub lock_step: bool,
    /// What it is to nodes that another leads.
    pub role: Role,
    /// The sockets to nodes of other machines.
    pub dial: Arc<dyn Dial>,
    /// The scene without the person.
    pub empty: bool,
    /// The run ends after so much film.
    pub seconds: Option<f64>,
    /// Where it can be seen and steered, and what is written of it.
    pub outlets: Outlets,
    /// Where the run is recorded.
    pub record: Option<RecordTo>,
    /// What a live run does with the memory of its nodes.
    pub memory: MemoryUse,
}

impl Setup {
    /// Checks now what would fail at the end, and makes the folder of pictures.
    pub fn prepare_outputs(&self) -> Outcome {
        if let Some(json) = &self.outlets.json {
            check_json_writable(json)?;
            if self.record.as_ref().is_some_and(|record| is_same_file(&record.path, json)) {
                let problem = "expected another file than that of the recording";
                return Err(Failure::input(format_args!("--json {}: {problem}", json.display())));
            }
        }
        if let Some(folder) = &self.outlets.snapshots {
            std::fs::create_dir_all(folder)
                .map_err(|error| Failure::input(format_args!("--snapshot {}: {error}", folder.display())))?;
        }
        Ok(())
    }
}

/// Whether two paths of files that may not be there yet lead to one place.
fn is_same_file(one: &Path, other: &Path) -> bool {
    let place = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some((folder.canonicalize().ok()?, path.file_name()?.to_owned()))
    };
    place(one).is_some_and(|one| Some(one) == place(other))
}

/// The world's settings on a scene's own surface of the hull.
pub fn world_settings(
    scene: &Scene,
    seed: u64,
    (response, hull_time): (ResponseMode, HullTime),
) -> WorldSettings {
    WorldSettings { seed, response, hull_time, ..WorldSettings::default() }.on(scene.hull())
}

/// Seconds of film that are possible.
pub fn checked_seconds(seconds: Option<f64>) -> Outcome<Option<f64>> {
    match seconds {
        Some(seconds) if !(seconds > 0.0 && seconds <= 1e6) => Err(Failure::input(format_args!(
            "--seconds is {seconds}, expected more than 0 and at most 1000000"
        ))),
        seconds => Ok(seconds),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_out_of_bounds_are_refused_with_both_bounds() {
        assert_eq!(checked_seconds(None), Ok(None));
        assert_eq!(checked_seconds(Some(1e6)), Ok(Some(1e6)));
        for seconds in [0.0, 1e7, f64::NAN] {
            let refused = checked_seconds(Some(seconds)).expect_err("refused").to_string();
            assert!(refused.ends_with("expected more than 0 and at most 1000000"), "{refused}");
        }
    }
}
