//! Options that several subcommands share, and what they are once checked.

use std::fs::File;
use std::io::Read as _;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::path::{Path, PathBuf};

use clap::Args;
use recording::{Overwrites, WriteError};
use setup::cli::{Failure, Outcome};
use telemetry::Endpoint;

use super::page::{PageArguments, PagePlan};
use super::security::Security;

/// What is shown and written of a run, who may look, and who may steer.
#[derive(Clone, Debug, Default, Args)]
pub struct OutletArguments {
    /// Show nothing while it runs, and serve no page unless --listen says where.
    #[arg(long)]
    headless: bool,
    #[command(flatten)]
    page: PageArguments,
    /// Send the world as Open Sound Control to this address, over UDP.
    #[arg(long, value_name = "HOST:PORT")]
    osc: Option<String>,
    /// Serve metrics of the run at this address by plain HTTP: /metrics, /live and /ready.
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<SocketAddr>,
    /// Send traces of some passes, a span each round, question and answer, to this collector (OTLP over gRPC). One pass of a
    /// hundred; OTEL_TRACES_SAMPLER chooses others.
    #[arg(long, value_name = "http://HOST:PORT")]
    otlp: Option<Endpoint>,
    /// Write the run's figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write pictures from a viewpoint between the cameras, one a second of film.
    #[arg(long, value_name = "DIR")]
    snapshot: Option<PathBuf>,
}

/// Where a run can be seen and steered, and what is written of it; by default nothing.
#[derive(Clone, Debug, Default)]
pub struct Outlets {
    /// A live line of figures on a terminal.
    pub live_line: bool,
    /// The page, and what programs use.
    pub page: Option<PagePlan>,
    /// The address that OSC messages are sent to.
    pub osc: Option<SocketAddr>,
    /// Where metrics are served.
    pub metrics: Option<SocketAddr>,
    /// Where traces go.
    pub otlp: Option<Endpoint>,
    /// Where figures go.
    pub json: Option<PathBuf>,
    /// Where pictures go.
    pub snapshots: Option<PathBuf>,
    /// Prints no summary at its end: the run only serves another command.
    pub silent: bool,
}

impl OutletArguments {
    /// What is served where, and for whom. A headless run serves its page only with --listen.
    pub fn checked(&self, security: &Security) -> Outcome<Outlets> {
        let has_page = !self.headless || self.page.listens();
        if self.page.opens() && !has_page {
            return Err(Failure::input(
                "--open: this run serves no page: expected no --headless, or --listen",
            ));
        }
        Ok(Outlets {
            live_line: !self.headless,
            page: has_page.then(|| self.page.checked(security)).transpose()?,
            osc: self.osc.as_deref().map(osc_address).transpose()?,
            metrics: self.metrics,
            otlp: self.otlp.clone(),
            json: self.json.clone(),
            snapshots: self.snapshot.clone(),
            silent: false,
        })
    }
}

/// Recording beside whatever else a run does.
#[derive(Debug, Args)]
pub struct RecordOptions {
    /// Record the run in an MCAP file, for `hulltouch replay` and other tools.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Keep the colours around the foreground, too.
    #[arg(long = "record-colour", requires = "record")]
    colour: bool,
    /// Replace the file of --record if it is there.
    #[arg(long, requires = "record")]
    force: bool,
}

impl RecordOptions {
    /// Where the run is recorded, if it is to be.
    pub fn checked(&self) -> Outcome<Option<RecordTo>> {
        self.record.clone().map(|path| RecordTo::checked(path, self.force, self.colour)).transpose()
    }
}

/// Where a run is recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordTo {
    /// The file.
    pub path: PathBuf,
    /// Whether it may take the place of another.
    pub overwrites: Overwrites,
    /// With colours.
    pub colour: bool,
}

impl RecordTo {
    /// Refuses, before anything starts, a file that is there and one that cannot be written.
    pub fn checked(path: PathBuf, force: bool, colour: bool) -> Outcome<RecordTo> {
        if path.is_dir() {
            return Err(Failure::unreadable(&path, "found a folder, expected a file to write"));
        }
        if path.exists() && !force {
            return Err(Failure::input(WriteError::Exists(path)));
        }
        if path.exists() && !may_be_replaced(&path) {
            return Err(Failure::unreadable(&path, "found no recording, expected one that --force replaces"));
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // Without a name, so that nothing is left and nothing overwritten.
        tempfile::tempfile_in(folder)
            .map_err(|error| Failure::input(format_args!("cannot write {}: {error}", path.display())))?;
        let overwrites = if force { Overwrites::AtTheEnd } else { Overwrites::Never };
        Ok(RecordTo { path, overwrites, colour })
    }
}

/// Whether a file is a recording of this program, or empty: nothing else is lost by `--force`.
fn may_be_replaced(path: &Path) -> bool {
    // An MCAP begins with its magic and a header of some length, whose first text is the profile.
    const MAGIC: &[u8] = b"\x89MCAP0\r\n\x01";
    const PROFILE: &[u8] = b"\x09\0\0\0hulltouch";
    const LENGTH_BYTES: usize = 8;
    let mut head = Vec::new();
    let most = (MAGIC.len() + LENGTH_BYTES + PROFILE.len()) as u64;
    let read = |head: &mut Vec<u8>| File::open(path)?.take(most).read_to_end(head);
    let is_recording =
        |head: &[u8]| head.starts_with(MAGIC) && head.get(MAGIC.len() + LENGTH_BYTES..) == Some(PROFILE);
    path.is_file() && read(&mut head).is_ok() && (head.is_empty() || is_recording(&head))
}

/// The address that a host's name and a port mean.
fn osc_address(text: &str) -> Outcome<SocketAddr> {
    let wrong = |why: &str| Failure::input(format_args!("--osc {text}: {why}, expected HOST:PORT"));
    let found: Vec<SocketAddr> = text.to_socket_addrs().map_err(|error| wrong(&error.to_string()))?.collect();
    // A name may mean both; tools that take OSC listen on the older one.
    let old = found.iter().find(|address| address.is_ipv4());
    old.or(found.first()).copied().ok_or_else(|| wrong("no such host"))
}
