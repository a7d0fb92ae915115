//! Debian's Prometheus, for tests: it scrapes services and is asked for expressions.

use std::fmt::Write as _;
use std::fs;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;
use testkit::Running;

use crate::http::try_get;

/// A Prometheus of its own folder and port; it ends with its test.
pub struct Prometheus {
    _running: Running,
    address: SocketAddr,
}

impl Prometheus {
    /// Scrapes these addresses twice a second and evaluates a file of rules.
    pub fn start(folder: &Path, targets: &[String], rules: &Path) -> Prometheus {
        let config = folder.join("prometheus.yml");
        let targets = targets.iter().map(|target| format!("{target:?}")).collect::<Vec<_>>().join(", ");
        let text = format!(
            "global: {{scrape_interval: 500ms, evaluation_interval: 500ms}}\nrule_files: [{rules:?}]\n\
             scrape_configs:\n  - job_name: hulltouch\n    static_configs: [{{targets: [{targets}]}}]\n"
        );
        fs::write(&config, text).expect("written");
        // Another program that takes the port meanwhile makes the test fail, and not pass.
        let address = TcpListener::bind("127.0.0.1:0").and_then(|port| port.local_addr()).expect("a port");
        let mut command = testkit::command("prometheus");
        command
            .arg(format!("--config.file={}", config.display()))
            .arg(format!("--storage.tsdb.path={}", folder.join("prometheus").display()))
            .arg(format!("--web.listen-address={address}"))
            .arg("--log.level=error")
            .stdout(Stdio::null());
        Prometheus { _running: Running::start(&mut command), address }
    }

    fn ask(&self, path: &str) -> Option<Value> {
        let answer = try_get(self.address, path).ok()?;
        let answer: Value = serde_json::from_str(&answer.body).ok()?;
        assert_eq!(answer["status"], "success", "{path}: {answer}");
        Some(answer["data"].clone())
    }

    /// What stands before the comparison of each alert rule.
    pub fn rules(&self) -> Vec<String> {
        let by = Instant::now() + Duration::from_secs(60);
        loop {
            let data = self.ask("/api/v1/rules").unwrap_or_default();
            let groups = data["groups"].as_array().cloned().unwrap_or_default();
            let rules =
                groups.iter().flat_map(|group| group["rules"].as_array().cloned().unwrap_or_default());
            let queries: Vec<String> =
                rules.map(|rule| before_comparison(rule["query"].as_str().expect("a query"))).collect();
            if !queries.is_empty() {
                return queries;
            }
            assert!(Instant::now() < by, "no rules: {data}");
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    /// Waits until each expression gives a series.
    #[track_caller]
    pub fn await_series(&self, expressions: &[String], patience: Duration) {
        let by = Instant::now() + patience;
        let mut without: Vec<&String> = expressions.iter().collect();
        while !without.is_empty() {
            without.retain(|expression| {
                let data = self.ask(&format!("/api/v1/query?query={}", escaped(expression)));
                let series = data.map(|data| data["result"].as_array().map_or(0, Vec::len));
                series.is_none_or(|count| count == 0)
            });
            assert!(Instant::now() < by || without.is_empty(), "these give no series: {without:#?}");
            std::thread::sleep(Duration::from_millis(500));
        }
    }
}

/// A rule is a figure, one comparison, and a bound.
fn before_comparison(rule: &str) -> String {
    let comparisons = [" > ", " < ", " == "];
    let at = comparisons.into_iter().find_map(|comparison| rule.rfind(comparison));
    rule[..at.unwrap_or_else(|| panic!("{rule} compares nothing"))].to_owned()
}

/// Every expression of a dashboard, its variables filled in as Grafana does for "All".
pub fn expressions(dashboard: &Value) -> Vec<String> {
    let panels = dashboard["panels"].as_array().expect("panels").iter();
    let targets = panels.flat_map(|panel| panel["targets"].as_array().cloned().unwrap_or_default());
    let filled = |target: Value| {
        let expression = target["expr"].as_str().expect("an expression").to_owned();
        let expression = ["$room", "$node", "$camera"]
            .into_iter()
            .fold(expression, |expression, name| expression.replace(name, ".*"));
        let expression = expression.replace("$__rate_interval", "1m");
        assert!(!expression.contains('$'), "{expression}: a variable that the dashboard does not have");
        expression
    };
    targets.map(filled).collect()
}

fn escaped(text: &str) -> String {
    text.bytes().fold(String::new(), |mut escaped, byte| {
        let _ = match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'_' => write!(escaped, "{}", char::from(byte)),
            _ => write!(escaped, "%{byte:02X}"),
        };
        escaped
    })
}
