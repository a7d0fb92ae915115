//! What `--help` of a program prints.

use crate::command;

/// The width of the terminal, in characters.
const WIDTH: usize = 60;

/// Asserts that the help of a program and of each of its commands is wrapped once, at the width of the terminal. `nested` are
/// commands of commands. Returns the names of the commands.
#[track_caller]
pub fn help_is_wrapped_once(program: &str, nested: &[[&str; 2]]) -> Vec<String> {
    let all = help(program, &[]);
    let commands = commands(&all);
    assert!(!commands.is_empty(), "{all}");
    let each = commands.iter().map(std::slice::from_ref).chain(nested.iter().map(<[&str; 2]>::as_slice));
    for arguments in std::iter::once(&[][..]).chain(each) {
        let text = help(program, arguments);
        assert!(text.contains("Usage: hulltouch"), "{arguments:?}: {text}");
        assert_eq!(broken_early(&text), [""; 0], "{arguments:?}");
    }
    commands.into_iter().map(str::to_owned).collect()
}

fn help(program: &str, arguments: &[&str]) -> String {
    let output = command(program).args(arguments).arg("--help").env("COLUMNS", WIDTH.to_string()).output();
    String::from_utf8(output.expect("runs").stdout).expect("text")
}

/// The commands that a program's help lists. Further lines of one are indented farther.
fn commands(help: &str) -> Vec<&str> {
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    names.filter(|name| !["", "help"].contains(name) && !name.starts_with('-')).collect()
}

/// The lines of prose that end though the next one's first word would have fitted.
fn broken_early(text: &str) -> Vec<&str> {
    let lines: Vec<&str> = text.lines().collect();
    let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ') && !line.ends_with(':');
    let is_early = |pair: &&[&str]| {
        let next = pair[1].split(' ').next().unwrap_or_default();
        is_prose(pair[0]) && is_prose(pair[1]) && pair[0].chars().count() + 1 + next.chars().count() <= WIDTH
    };
    lines.windows(2).filter(is_early).map(|pair| pair[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_breaks_though_the_next_word_fits_is_found() {
        let text =
            "Usage: hulltouch\n\nA word\nor two that follow one line after the other, as far as they\ngo.\n";
        assert_eq!(broken_early(text), ["A word"]);
        assert_eq!(
            commands("Commands:\n  play  Plays\n          twice\n  help  Helps\n\nOptions:\n  -h"),
            ["play"]
        );
    }
}
