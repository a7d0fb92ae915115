//! The names that documents give to code: paths, `Type::function` and `module::function`.

use std::collections::BTreeSet;
use std::path::Path;

use super::rust_files::{File, root};

/// Endings of files that documents name.
const ENDINGS: [&str; 16] = [
    ".rs", ".md", ".toml", ".py", ".js", ".mjs", ".ts", ".proto", ".sh", ".txt", ".json", ".html", ".png",
    ".css", ".csv", ".y4m",
];

/// What a document says in code style, and where its links lead.
fn quoted(text: &str) -> BTreeSet<&str> {
    let mut quoted: BTreeSet<&str> =
        text.lines().flat_map(|line| line.split('`').skip(1).step_by(2)).collect();
    let links = text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
    quoted.extend(links.filter(|link| !link.contains("://")));
    quoted
}

/// The paths that a document names: those in code style or linked, and whatever begins with a folder of the
/// project. `examples` are those of users' own files.
pub fn missing_paths(document: &File, examples: &[&str]) -> Vec<String> {
    let root = root();
    let folder = root.join(&document.path).parent().map(Path::to_owned).unwrap_or_default();
    let is_path = |word: &&str| {
        let plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "_-./".contains(c));
        let begins = word.split('/').next().unwrap_or_default();
        let ends = word.ends_with('/') || ENDINGS.iter().any(|ending| word.ends_with(ending));
        let of_ours = !begins.starts_with('.') && !begins.is_empty() && root.join(begins).is_dir();
        plain && word.contains('/') && (ends || of_ours) && !word.starts_with('/') && begins != "target"
    };
    let separators = |c: char| c.is_whitespace() || "`()[]{},;:\"'|<>".contains(c);
    let words = document.text.split(separators).map(|word| word.trim_end_matches('.'));
    let in_folders = words.filter(|word| {
        let begins = word.split('/').next().unwrap_or_default();
        word.contains('/') && !begins.starts_with('.') && !begins.is_empty() && root.join(begins).is_dir()
    });
    let named: BTreeSet<&str> =
        quoted(&document.text).into_iter().chain(in_folders).filter(is_path).collect();
    let there = |name: &&str| root.join(name).exists() || folder.join(name).exists();
    named.into_iter().filter(|name| !there(name) && !examples.contains(name)).map(str::to_owned).collect()
}

/// The file names that a document gives without a folder, and that no file of the project has.
pub fn missing_names(document: &File, files: &[File]) -> Vec<String> {
    let names =
        quoted(&document.text).into_iter().filter(|name| name.ends_with(".rs") && !name.contains('/'));
    let there = |name: &&str| files.iter().any(|file| file.path.rsplit('/').next() == Some(*name));
    names.filter(|name| !there(name)).map(str::to_owned).collect()
}

/// The `Type::item` and `module::item` that a document names and no file of the project has.
pub fn missing_items(document: &File, files: &[File]) -> Vec<String> {
    let is_name = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic())
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    let mut missing = Vec::new();
    for name in quoted(&document.text) {
        let parts: Vec<&str> = name.trim_end_matches("()").split("::").collect();
        if let [.., container, item] = parts[..]
            && parts.iter().all(|part| is_name(part))
            && !files.iter().any(|file| holds(file, container, item))
        {
            missing.push(name.to_owned());
        }
    }
    missing
}

/// The names that a document gives with a file, as in `name` (`path.rs`) or `name` in `path.rs`, and that the file
/// does not hold.
pub fn misplaced(document: &File) -> Vec<String> {
    let parts: Vec<&str> = document.text.split('`').collect();
    let mut misplaced = Vec::new();
    for (at, between) in parts.iter().enumerate().skip(2).step_by(2) {
        let (name, Some(path)) = (parts[at - 1], parts.get(at + 1).filter(|path| path.ends_with(".rs")))
        else {
            continue;
        };
        let item = name.trim_end_matches("()").rsplit("::").next().unwrap_or_default();
        let is_name = item.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') && !item.is_empty();
        if !is_name || !["(", "in"].contains(&between.trim()) {
            continue;
        }
        let text = std::fs::read_to_string(root().join(path)).unwrap_or_default();
        if !(File { path: path.to_string(), text }).has_word(item) {
            misplaced.push(format!("{name} in {path}"));
        }
    }
    misplaced
}

fn holds(file: &File, container: &str, item: &str) -> bool {
    let of_type = container.starts_with(|c: char| c.is_ascii_uppercase());
    let is_container = if of_type {
        file.has_word(container)
    } else {
        file.path.ends_with(&format!("/{container}.rs")) || file.path.contains(&format!("/{container}/"))
    };
    let is_function = item.starts_with(|c: char| c.is_ascii_lowercase());
    is_container && if is_function { file.has_word(&format!("fn {item}")) } else { file.has_word(item) }
}

/// The entries of ARCHITECTURE's map that are not there. A line of a crate begins with its folder, those below it
/// with files and folders of its `src`, commas between.
pub fn missing_in_map(document: &File) -> Vec<String> {
    let map = document.text.split("```").nth(1).unwrap_or_default();
    let mut folder = String::new();
    let mut missing = Vec::new();
    let mut check = |name: String, paths: &[String]| {
        if !paths.iter().any(|path| root().join(path).exists()) {
            missing.push(name);
        }
    };
    for line in map.lines().filter(|line| !line.trim().is_empty()) {
        let indent = line.len() - line.trim_start().len();
        let names = line.trim_start().split("  ").next().unwrap_or_default();
        if indent == 0 {
            folder = names.trim_end_matches('/').to_owned();
            check(folder.clone(), &[folder.clone()]);
        } else if indent == 2 {
            for name in names.split(", ") {
                let name = name.trim_end_matches('/');
                let within = |suffix: &str| format!("{folder}/{name}{suffix}");
                check(
                    within(""),
                    &[format!("{folder}/src/{name}"), format!("{folder}/src/{name}.rs"), within("")],
                );
            }
        }
    }
    missing
}
