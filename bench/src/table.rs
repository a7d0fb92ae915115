//! What every bench prints and writes.

use std::fs;
use std::path::Path;

use serde::Serialize;

use setup::cli::{Failure, Outcome, outln, write_whole};

/// A bench's figures.
#[derive(Debug, Serialize)]
pub struct Table<Row> {
    /// Name of the bench.
    pub bench: &'static str,
    /// Where it ran.
    pub machine: Machine,
    /// What was measured.
    pub rows: Vec<Row>,
}

/// The machine and the build.
#[derive(Debug, Serialize)]
pub struct Machine {
    cpu: String,
    cores: usize,
    arch: &'static str,
    os: &'static str,
    version: &'static str,
    /// `release` or `debug`.
    build: &'static str,
}

impl Machine {
    /// This machine.
    pub fn here() -> Machine {
        let info = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = info.lines().find(|line| line.starts_with("model name"));
        let cpu = model.and_then(|line| line.split_once(": ")).map_or("unknown", |(_, name)| name);
        Machine {
            cpu: cpu.to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            arch: std::env::consts::ARCH,
            os: std::env::consts::OS,
            version: env!("CARGO_PKG_VERSION"),
            build: if cfg!(debug_assertions) { "debug" } else { "release" },
        }
    }

    /// One line for people.
    pub fn line(&self) -> String {
        format!("{}, {} cores, {} {}, {} build", self.cpu, self.cores, self.os, self.arch, self.build)
    }
}

/// Writes a bench's figures as JSON, if a file was named.
pub fn write_json(figures: &impl Serialize, path: Option<&Path>) -> Outcome {
    let Some(path) = path else { return Ok(()) };
    let mut text = serde_json::to_vec_pretty(figures).map_err(Failure::run)?;
    text.push(b'\n');
    write_whole(path, &text)
}

/// A table for people.
pub struct Columns<Row: 'static> {
    /// What stands between two columns.
    pub gap: &'static str,
    /// From left to right.
    pub columns: &'static [Column<Row>],
}

/// A column: its title, how wide it is, and what it says of a row.
pub struct Column<Row> {
    title: &'static str,
    width: usize,
    is_left: bool,
    cell: fn(&Row) -> String,
}

/// A column of numbers, against its right side.
pub const fn number<Row>(title: &'static str, width: usize, cell: fn(&Row) -> String) -> Column<Row> {
    Column { title, width, is_left: false, cell }
}

/// A column of words, against its left side.
pub const fn words<Row>(title: &'static str, width: usize, cell: fn(&Row) -> String) -> Column<Row> {
    Column { title, width, is_left: true, cell }
}

impl<Row> Columns<Row> {
    /// The head of the table.
    pub fn print_titles(&self) -> Outcome {
        self.print_line(|column| column.title.to_owned())
    }

    /// A row of the table.
    pub fn print(&self, row: &Row) -> Outcome {
        self.print_line(|column| (column.cell)(row))
    }

    fn print_line(&self, text: impl Fn(&Column<Row>) -> String) -> Outcome {
        let cell = |column: &Column<Row>| match (text(column), column.width) {
            (text, width) if column.is_left => format!("{text:<width$}"),
            (text, width) => format!("{text:>width$}"),
        };
        outln!("{}", self.columns.iter().map(cell).collect::<Vec<_>>().join(self.gap))
    }
}

/// A number with so many digits behind the point, or a dash.
pub fn or_dash(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

/// Every item once, in the order in which they came first.
pub fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    items.fold(Vec::new(), |mut known, item| {
        if !known.contains(&item) {
            known.push(item);
        }
        known
    })
}
