//! What ARCHITECTURE.md promises of the code, held against the code, and what documents name, looked up.

#[path = "shared/document_keys.rs"]
mod document_keys;
#[path = "shared/document_names.rs"]
mod document_names;
#[path = "shared/import_circles.rs"]
mod import_circles;
#[path = "shared/key_tables.rs"]
mod key_tables;
#[path = "shared/links.rs"]
mod links;
#[path = "shared/rust_files.rs"]
mod rust_files;

use std::collections::BTreeSet;

use rust_files::{File, files, root};

/// The folders of our crates, and which of our crates each may depend on: dependencies point inward. Crates that only
/// cross-crate tests may need stand in no list: those tests belong to hulltouch, which sees everything.
const ALLOWED: [(&str, &[&str]); 20] = [
    ("crates/testkit", &[]),
    ("crates/hull", &[]),
    ("crates/calib", &["hull"]),
    ("crates/segment", &["hull"]),
    ("crates/stage", &["hull"]),
    ("sim", &["hull"]),
    ("crates/film-time", &["hull"]),
    ("proto", &["film-time", "hull"]),
    ("crates/net", &[]),
    ("crates/telemetry", &["net", "proto"]),
    ("crates/node-client", &["film-time", "hull", "net", "proto"]),
    ("crates/world-encodings", &["hull", "proto", "sim"]),
    ("camera-node", &["film-time", "hull", "net", "proto", "segment", "stage", "telemetry"]),
    ("coordinator", &["film-time", "hull", "node-client", "proto", "sim", "telemetry", "world-encodings"]),
    (
        "web/server",
        &["coordinator", "film-time", "hull", "net", "node-client", "proto", "sim", "world-encodings"],
    ),
    (
        "crates/recording",
        &["coordinator", "film-time", "hull", "node-client", "proto", "sim", "world-encodings"],
    ),
    (
        "crates/setup",
        &[
            "camera-node",
            "coordinator",
            "film-time",
            "hull",
            "node-client",
            "proto",
            "segment",
            "sim",
            "telemetry",
            "web-server",
        ],
    ),
    (
        "bench",
        &[
            "calib",
            "camera-node",
            "coordinator",
            "film-time",
            "hull",
            "hulltouch",
            "net",
            "node-client",
            "proto",
            "segment",
            "setup",
            "sim",
            "stage",
        ],
    ),
    ("bench/kernels", &["hull"]),
    (
        "hulltouch",
        &[
            "calib",
            "camera-node",
            "coordinator",
            "film-time",
            "hull",
            "net",
            "node-client",
            "proto",
            "recording",
            "segment",
            "setup",
            "sim",
            "stage",
            "telemetry",
            "web-server",
            "world-encodings",
        ],
    ),
];

/// The crate that tests of every crate may use, and nothing else.
const TESTKIT: &str = "testkit";

/// What a document may take at most, bytes: each has one reader with little time.
const SIZES: [(&str, usize); 2] = [("README.md", 8 << 10), ("ARCHITECTURE.md", 15 << 10)];

/// What looks like a path of the project and is none: files of users in examples, parts of a URL.
const EXAMPLES: [&str; 7] = [
    "foo/mod.rs",
    "assets/",
    "studio/rig.toml",
    "studio/empty/left.y4m",
    "masks/left/000000.png",
    "./my.scene.toml",
    "calibration/",
];

/// The files that may hold `unsafe`: vector instructions and the choice among them, each with its reason, and two
/// tests of such things.
const UNSAFE: [&str; 19] = [
    "crates/hull/src/probe/classify/avx512.rs",
    "crates/hull/src/probe/classify/mod.rs",
    "crates/hull/src/probe/edge_line/avx512.rs",
    "crates/hull/src/probe/edge_line/mod.rs",
    "crates/hull/src/probe/edge_normal/avx512.rs",
    "crates/hull/src/probe/edge_normal/mod.rs",
    "crates/hull/src/probe/nearest_edge/avx512.rs",
    "crates/hull/src/probe/nearest_edge/cells.rs",
    "crates/hull/src/probe/nearest_edge/mod.rs",
    "crates/hull/src/silhouette/bitmap/avx512.rs",
    "crates/hull/src/silhouette/bitmap/mod.rs",
    "crates/hull/src/silhouette/depth/avx512.rs",
    "crates/hull/src/silhouette/depth/mod.rs",
    "crates/hull/src/silhouette/surroundings/avx512.rs",
    "crates/hull/src/silhouette/surroundings/mod.rs",
    "crates/hull/src/vector.rs",
    "crates/hull/tests/allocation.rs",
    "crates/segment/src/kernel/path.rs",
    "crates/segment/tests/paths.rs",
];

/// Where generated types of the wire may stand: the two sides of a call, and tests that are clients themselves.
const WIRE: [&str; 13] = [
    "proto/",
    "camera-node/src/service/",
    "crates/node-client/src/",
    "crates/world-encodings/src/",
    "web/server/src/programs/world_service.rs",
    "tests/answers/contract.rs",
    "tests/rooms/one_coordinator.rs",
    "tests/clients/programs.rs",
    "tests/simulated/liar.rs",
    "tests/rooms/pinned_memory.rs",
    "tests/under_attack/",
    // Of a collector, which is none of ours.
    "tests/rooms/traces.rs",
    "tests/tidy.rs",
];

/// Where the messages of a recording may stand.
const RECORDING: [&str; 4] =
    ["proto/", "crates/recording/src/", "crates/world-encodings/src/", "tests/tidy.rs"];

fn rust() -> Vec<File> {
    files("", ".rs")
}

fn manifest(folder: &str) -> toml::Table {
    let text = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).expect("a manifest");
    text.parse().expect("TOML")
}

/// The name of the crate in a folder: the folder's own, but for those that a user sees, or that are half of the page.
fn crate_name(folder: &str) -> &str {
    match folder {
        "bench" => "hulltouch-bench",
        "web/server" => "web-server",
        _ => folder.rsplit('/').next().unwrap_or(folder),
    }
}

/// The folder of a crate.
fn folder_of(name: &str) -> &'static str {
    let mut folders = ALLOWED.iter().map(|(folder, _)| *folder);
    folders.find(|folder| crate_name(folder) == name).unwrap_or_else(|| panic!("{name} is no crate of ours"))
}

/// Fails with every offence, a line each.
#[track_caller]
fn none(offences: impl IntoIterator<Item = String>, rule: &str) {
    let offences: Vec<String> = offences.into_iter().collect();
    assert!(offences.is_empty(), "{rule}:\n{}", offences.join("\n"));
}

/// The lines of code that hold one of these.
fn lines_with(files: &[File], words: &[&str]) -> Vec<String> {
    let mut lines = Vec::new();
    for file in files.iter().filter(|file| file.path != "tests/tidy.rs") {
        for (number, line) in file.code() {
            if let Some(word) = words.iter().find(|word| line.contains(**word)) {
                lines.push(format!("{}:{number}: {word}", file.path));
            }
        }
    }
    lines
}

#[test]
fn dependencies_point_inward() {
    let folders: BTreeSet<&str> = ALLOWED.iter().map(|(folder, _)| *folder).collect();
    let ours: BTreeSet<&str> = ALLOWED.iter().map(|(folder, _)| crate_name(folder)).collect();
    let members = manifest("")["workspace"]["members"].as_array().expect("a list").clone();
    let members: BTreeSet<&str> = members.iter().map(|member| member.as_str().expect("a name")).collect();
    assert_eq!(members, folders, "every crate of the workspace has its rule");
    for (folder, allowed) in ALLOWED {
        let (manifest, name) = (manifest(folder), crate_name(folder));
        assert_eq!(manifest["package"]["name"].as_str(), Some(name), "folder name equals crate name");
        for kind in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let dependencies = manifest.get(kind).and_then(|table| table.as_table()).cloned();
            for dependency in dependencies.unwrap_or_default().keys() {
                let is_allowed = !ours.contains(&dependency[..]) || allowed.contains(&&dependency[..]);
                let is_allowed = is_allowed || (dependency == TESTKIT && kind == "dev-dependencies");
                assert!(is_allowed, "{name}: {kind}: it may not depend on {dependency}");
                let is_rapier = ["rapier3d", "parry3d", "glam"].contains(&&dependency[..]);
                assert!(!is_rapier || name == "sim", "{name} may not depend on {dependency}");
            }
        }
    }
}

#[test]
fn a_crate_depends_on_no_crate_of_ours_that_it_does_not_use() {
    let mut unused = Vec::new();
    for (name, _) in ALLOWED {
        let manifest = manifest(name);
        // Tests that cross crates are hulltouch's.
        let folders = if name == "hulltouch" { vec![name, "tests"] } else { vec![name] };
        let code: Vec<File> = folders.iter().flat_map(|folder| files(folder, ".rs")).collect();
        for dependency in manifest["dependencies"].as_table().expect("a table").keys() {
            let is_ours = ALLOWED.iter().any(|(other, _)| crate_name(other) == dependency);
            let word = dependency.replace('-', "_");
            if is_ours && !code.iter().any(|file| file.has_word(&word)) {
                unused.push(format!("{name}: {dependency}"));
            }
        }
    }
    none(unused, "a dependency that is not used");
}

#[test]
fn the_hull_knows_no_files_clocks_threads_network_or_chance() {
    let words = [
        "std::fs",
        "std::io",
        "std::net",
        "std::time",
        "std::thread",
        "std::env",
        "std::process",
        "tokio",
        "tonic",
        "prost",
        "rapier",
        "async ",
        "Instant",
        "rand::",
    ];
    none(lines_with(&files("crates/hull/src", ".rs"), &words), "this has no place in hull");
}

#[test]
fn tests_start_no_process_that_outlives_them() {
    let is_test = |path: &str| path.starts_with("tests/") || path.contains("/tests/");
    let others =
        rust().into_iter().filter(|file| is_test(&file.path) && !file.path.starts_with("crates/testkit/"));
    let starts = ["Command::new(", "cargo_bin"];
    none(
        lines_with(&others.collect::<Vec<_>>(), &starts),
        "testkit::command ends what a test leaves running",
    );
}

#[test]
fn a_test_that_is_skipped_says_so_aloud() {
    let skips = ["\"skipped: ", "\"SKIPPED: "];
    let others: Vec<File> =
        rust().into_iter().filter(|file| !file.path.starts_with("crates/testkit/")).collect();
    none(lines_with(&others, &skips), "testkit::skip is seen without --nocapture");
}

#[test]
fn rapier_stays_in_sim() {
    let others: Vec<File> = rust().into_iter().filter(|file| !file.path.starts_with("sim/")).collect();
    none(lines_with(&others, &["rapier3d", "parry3d", "glam::"]), "rapier's types never leave sim");
}

#[test]
fn the_wire_stays_where_a_service_or_a_client_stands() {
    let others = rust().into_iter().filter(|file| !WIRE.iter().any(|place| file.path.starts_with(place)));
    none(lines_with(&others.collect::<Vec<_>>(), &["v1::"]), "generated types have no place here");
    let others =
        rust().into_iter().filter(|file| !RECORDING.iter().any(|place| file.path.starts_with(place)));
    none(
        lines_with(&others.collect::<Vec<_>>(), &["proto::recording"]),
        "a recording's messages have no place here",
    );
    let transports = ["tonic::", "prost::", "tokio::"];
    for name in ["hull", "calib", "segment", "stage", "sim"] {
        none(lines_with(&files(folder_of(name), ".rs"), &transports), "this crate knows no network");
    }
    none(lines_with(&files("coordinator", ".rs"), &["tonic::"]), "node-client holds the connections");
}

#[test]
fn decisions_do_not_wait() {
    let words = [
        "async ",
        ".await",
        "tokio",
        "Instant::now",
        "SystemTime::now",
        "monotonic_s()",
        "unix_now_s()",
        "film_now_s()",
        "std::thread",
        "std::net",
        "crate::live",
        "crate::memory",
        "crate::run",
        "crate::transport",
    ];
    let code = files("coordinator/src/core", ".rs").into_iter();
    let code = code.filter(|file| !file.path.ends_with("/tests.rs"));
    none(lines_with(&code.collect::<Vec<_>>(), &words), "waiting and clocks have no place here");
}

#[test]
fn unsafe_code_stays_in_its_files() {
    let unsafe_words = ["unsafe {", "unsafe fn", "unsafe impl", "unsafe extern", "allow(unsafe_code)"];
    let holds =
        |file: &&File| file.code().any(|(_, line)| unsafe_words.iter().any(|word| line.contains(word)));
    let others = rust();
    let found: BTreeSet<&str> = others
        .iter()
        .filter(|file| file.path != "tests/tidy.rs")
        .filter(holds)
        .map(|file| &file.path[..])
        .collect();
    assert_eq!(found, BTreeSet::from(UNSAFE));
}

#[test]
fn errors_are_types_outside_the_program() {
    let mut strings = Vec::new();
    // The program shows its errors to people, and parsers of its arguments hand clap a text. Tests may do likewise.
    let may = ["hulltouch/", "tests/", "crates/testkit/"];
    for file in rust().iter().filter(|file| !may.iter().any(|folder| file.path.starts_with(folder))) {
        let code: String = file.code().map(|(_, line)| line.trim()).collect::<Vec<_>>().join(" ");
        for (at, _) in code.match_indices("Result<") {
            if error_type(&code[at + "Result<".len()..]) == Some("String") {
                strings.push(format!("{}: Result<{:.60}", file.path, &code[at + "Result<".len()..]));
            }
        }
    }
    none(strings, "an error is a type that names what was found and expected");
}

/// The second argument of a type's list of arguments, what follows its `<`.
fn error_type(arguments: &str) -> Option<&str> {
    let mut depth = 0;
    let mut comma = None;
    for (at, c) in arguments.char_indices() {
        match c {
            '<' | '(' | '[' => depth += 1,
            '>' if depth == 0 => {
                return comma.map(|comma: usize| arguments[comma + 1..at].trim().trim_end_matches(','));
            }
            '>' | ')' | ']' => depth -= 1,
            ',' if depth == 0 && comma.is_none() => comma = Some(at),
            _ => {}
        }
    }
    None
}

#[test]
fn a_module_with_children_is_mod_rs_in_their_folder() {
    let beside = |file: &File| {
        let folder = root().join(file.path.trim_end_matches(".rs"));
        let has_modules = !files(&file.path.replace(".rs", ""), ".rs").is_empty();
        (folder.is_dir() && has_modules).then(|| file.path.clone())
    };
    none(rust().iter().filter_map(beside), "foo/mod.rs, and not foo.rs beside foo/");
}

#[test]
fn files_of_a_crate_import_each_other_in_no_circle() {
    let circles = ALLOWED.iter().flat_map(|(name, _)| {
        let src = format!("{name}/src");
        let circles = import_circles::circles(&files(&src, ".rs"), &src).into_iter();
        circles.map(move |circle| format!("{name}: {circle}"))
    });
    none(circles, "these import each other");
}

#[test]
fn what_documents_name_is_there() {
    let code = rust();
    let mut missing = Vec::new();
    for document in files("", ".md") {
        let paths = document_names::missing_paths(&document, &EXAMPLES).into_iter();
        let names = document_names::missing_names(&document, &code);
        let items = document_names::missing_items(&document, &code).into_iter();
        let items = items.chain(document_names::misplaced(&document)).chain(links::dead(&document));
        let map = if document.path == "ARCHITECTURE.md" {
            document_names::missing_in_map(&document)
        } else {
            vec![]
        };
        let all = paths.chain(names).chain(items).chain(map);
        missing.extend(all.map(|missing| format!("{}: {missing}", document.path)));
    }
    none(missing, "a document names what is not there");
}

#[test]
fn each_page_of_the_book_has_its_line_in_the_table_of_contents() {
    let pages = files("docs", ".md").into_iter().map(|page| page.path);
    let pages: BTreeSet<String> = pages.filter(|path| path != "docs/SUMMARY.md").collect();
    let contents = std::fs::read_to_string(root().join("docs/SUMMARY.md")).expect("a table of contents");
    let named: Vec<String> = links::targets(&contents).map(|target| format!("docs/{target}")).collect();
    assert_eq!(named.iter().cloned().collect::<BTreeSet<_>>(), pages);
    assert_eq!(named.len(), pages.len(), "a page has one line");
}

#[test]
fn pages_for_readers_with_little_time_are_short() {
    let long = |(name, most): &(&str, usize)| {
        let bytes = std::fs::metadata(root().join(name)).expect("a document").len();
        (bytes > *most as u64).then(|| format!("{name}: {bytes} bytes, expected at most {most}"))
    };
    none(SIZES.iter().filter_map(long), "move what is longer to a page of docs/");
}

#[test]
fn every_fuzz_target_has_a_corpus_and_a_test() {
    let folders = |kind: &str| -> BTreeSet<String> {
        let entries = std::fs::read_dir(root().join("tests/fuzz").join(kind)).into_iter().flatten().flatten();
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
    };
    let manifest = manifest("tests/fuzz");
    let bins = manifest["bin"].as_array().expect("a list").iter();
    let bins: BTreeSet<&str> = bins.map(|bin| bin["name"].as_str().expect("a name")).collect();
    let mut targets = BTreeSet::new();
    let mut offences = Vec::new();
    for file in files("tests/fuzz/fuzz_targets", ".rs") {
        let name = file.path.rsplit('/').next().unwrap_or_default().trim_end_matches(".rs").to_owned();
        let library = file.text.split_once("&[u8]| ").and_then(|(_, call)| call.split_once("::fuzz::"));
        let (library, function) = library.unwrap_or_default();
        if function != format!("{name}(bytes));\n") {
            offences.push(format!("{}: it calls no function {name} of a module fuzz", file.path));
        }
        // Tests of a library's own module run the corpus through the same function.
        let tests = files(&format!("{}/src", folder_of(&library.replace('_', "-"))), "tests.rs");
        let run = format!("corpora::run(\"{name}\",");
        let mut tests = tests.iter().filter(|file| file.path.ends_with("/fuzz/tests.rs"));
        if !tests.any(|file| file.text.split_whitespace().collect::<String>().contains(&run)) {
            offences.push(format!("{library}: no test runs the corpus of {name}"));
        }
        targets.insert(name);
    }
    assert_eq!(targets.iter().map(|name| &name[..]).collect::<BTreeSet<_>>(), bins, "tests/fuzz/Cargo.toml");
    assert_eq!(folders("corpus"), targets, "a corpus a target, and no other");
    let stray = folders("regressions").into_iter().filter(|name| !targets.contains(name));
    none(offences.into_iter().chain(stray), "a fuzz target is not whole");
}

#[test]
fn prose_names_who_acts() {
    const ENDINGS: [&str; 7] = [".rs", ".ts", ".md", ".toml", ".yml", ".yaml", ".proto"];
    const WORDS: [&str; 8] =
        ["whoever", "nobody", "somebody", "anew", "stranger", "strangers", "everybody", "everyone"];
    // The digest of a scene covers its whole text, comments too: if the text of a shipped scene changes, runs do not go on
    // from the worlds that nodes keep of it, and recordings hold the old text.
    const EXCEPTIONS: [&str; 2] = ["tests/tidy.rs", "sim/scenes/rest.toml"];
    let prose = ENDINGS.into_iter().flat_map(|ending| files("", ending));
    let prose = prose.filter(|file| !EXCEPTIONS.contains(&file.path.as_str()));
    let offences = prose.flat_map(|file| {
        let named = |(number, line): (usize, &str)| {
            let found = line.split(|letter: char| !letter.is_alphabetic()).map(str::to_lowercase);
            found.filter(|word| WORDS.contains(&word.as_str())).map(|word| format!("{number}: {word}")).next()
        };
        let lines: Vec<String> = (1..).zip(file.text.lines()).filter_map(named).collect();
        lines.into_iter().map(|line| format!("{}:{line}", file.path)).collect::<Vec<_>>()
    });
    none(offences, "name the actor, or use the field's term");
}

#[test]
fn doc_comments_say_more_than_a_word_or_a_question() {
    let comment = |line: &str| line.trim_start().strip_prefix("///").map(str::to_owned);
    // "Which camera." says no more than the name of a field.
    let is_question = |text: &str| {
        let words: Vec<&str> = text.split_whitespace().collect();
        matches!(words[..], ["Which" | "Why" | "Who", last] if last.ends_with('.'))
    };
    let offences = rust().into_iter().flat_map(|file| {
        let lines: Vec<Option<String>> = file.text.lines().map(comment).collect();
        let alone = |&at: &usize| {
            let beside = [at.checked_sub(1), Some(at + 1)].into_iter().flatten();
            let is_alone = beside.filter_map(|at| lines.get(at)).all(Option::is_none);
            is_alone && lines[at].as_ref().is_some_and(|text| text.split_whitespace().count() == 1)
        };
        let asks = |&at: &usize| lines[at].as_ref().is_some_and(|text| is_question(text));
        let empty: Vec<usize> = (0..lines.len()).filter(|at| alone(at) || asks(at)).collect();
        empty.into_iter().map(|at| format!("{}:{}", file.path, at + 1)).collect::<Vec<_>>()
    });
    none(offences, "say what it is, its unit and its range, or let its name do");
}

#[test]
fn nothing_is_left_unfinished() {
    none(lines_with(&rust(), &["todo!(", "unimplemented!(", "#[ignore", "dbg!("]), "this is not finished");
    let marks = ["TODO", "FIXME", "XXX"];
    let marked = rust().into_iter().filter(|file| file.path != "tests/tidy.rs");
    let marked = marked.filter(|file| marks.iter().any(|mark| file.has_word(mark))).map(|file| file.path);
    none(marked, "this is not finished");
}
