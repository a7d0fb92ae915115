//! Command lines of units and manifests, held against the program.

/// What the program says to arguments that it refuses.
#[track_caller]
fn refusal(arguments: &[&str]) -> String {
    let output = testkit::command(env!("CARGO_BIN_EXE_hulltouch")).args(arguments).output().expect("runs");
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Starts the program with these arguments, but with a cluster file that is not there: they are read, and then the file
/// is missing. One that is misspelt is not read.
#[track_caller]
pub fn check_arguments(whose: &str, arguments: &[&str]) {
    let missing = "/nowhere/room.toml";
    let file = arguments.iter().position(|word| word.ends_with("room.toml")).expect("a cluster file");
    let option = arguments.iter().position(|word| word.starts_with("--")).expect("an option");
    let mut arguments = arguments.to_vec();
    arguments[file] = missing;
    let said = refusal(&arguments);
    assert!(said.starts_with(&format!("hulltouch: {missing}")), "{whose}: {said}");
    arguments[option] = "--no-such-option";
    let said = refusal(&arguments);
    assert!(said.contains("unexpected argument '--no-such-option'"), "{whose}: {said}");
}
