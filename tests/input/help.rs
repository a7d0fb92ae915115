//! What `--help` prints is wrapped once, at the width of the terminal.

const WIDTH: usize = 60;

fn help(arguments: &[&str]) -> String {
    let mut program = testkit::command(env!("CARGO_BIN_EXE_hulltouch"));
    let output = program.args(arguments).arg("--help").env("COLUMNS", WIDTH.to_string()).output();
    String::from_utf8(output.expect("runs").stdout).expect("text")
}

/// The lines of a help text that end though the next one's first word would have fitted.
fn broken_early(text: &str) -> Vec<&str> {
    let lines: Vec<&str> = text.lines().collect();
    let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ') && !line.ends_with(':');
    let is_early = |pair: &&[&str]| {
        let next = pair[1].split(' ').next().unwrap_or_default();
        is_prose(pair[0]) && is_prose(pair[1]) && pair[0].chars().count() + 1 + next.chars().count() <= WIDTH
    };
    lines.windows(2).filter(is_early).map(|pair| pair[0]).collect()
}

#[test]
fn help_is_wrapped_once() {
    let all = help(&[]);
    let commands = all.lines().skip_while(|line| *line != "Commands:").skip(1);
    // Lines of one command are indented farther.
    let named = commands.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    let commands: Vec<&str> =
        named.filter(|name| !["", "help"].contains(name) && !name.starts_with('-')).collect();
    assert!(commands.contains(&"demo") && commands.contains(&"query"), "{all}");
    let nested = [["rig", "import"], ["rig", "check"], ["sync", "check"]];
    let each = commands.iter().map(std::slice::from_ref).chain(nested.iter().map(<[&str; 2]>::as_slice));
    for arguments in each {
        let text = help(arguments);
        assert!(text.contains("Usage: hulltouch"), "{arguments:?}: {text}");
        assert_eq!(broken_early(&text), [""; 0], "{arguments:?}");
    }
}
