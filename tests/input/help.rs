//! What `--help` prints.

#[test]
fn help_is_wrapped_once() {
    let nested = [["rig", "import"], ["rig", "check"], ["sync", "check"]];
    let commands = testkit::help_is_wrapped_once(env!("CARGO_BIN_EXE_hulltouch"), &nested);
    assert!(
        ["demo", "query"].iter().all(|name| commands.iter().any(|command| command == name)),
        "{commands:?}"
    );
}
