//! Which files of a crate import each other. A path is followed to the file that defines the item: through
//! re-exports, and through the imports that a module shares with its children.

use std::collections::{BTreeMap, BTreeSet};

use super::rust_files::File;

/// A module's path within its crate; empty for the root.
type Module = Vec<String>;

#[derive(Default)]
struct Imports {
    /// The names that `use` brings in, and the paths behind them.
    names: BTreeMap<String, Vec<String>>,
    /// All paths that begin with `crate`, `super`, `self` or are imported.
    paths: Vec<Vec<String>>,
}

/// Groups of modules in which each imports, over others of the group, every other: of files below `src`, each
/// group a line. A parent and what is below it may import each other.
pub fn circles(files: &[File], src: &str) -> Vec<String> {
    let modules: BTreeMap<Module, Imports> = files
        .iter()
        .filter(|file| !is_test(&file.path))
        .filter_map(|file| Some((module(file.path.strip_prefix(src)?), imports(&file.text))))
        .collect();
    let mut edges: BTreeMap<&Module, BTreeSet<&Module>> = BTreeMap::new();
    for (from, imports) in &modules {
        let targets = imports.paths.iter().filter_map(|path| resolve(&modules, from, path, 8));
        let others = targets.filter(|to| !to.starts_with(from) && !from.starts_with(to));
        edges.insert(from, others.collect());
    }
    let reached: BTreeMap<&Module, BTreeSet<&Module>> =
        modules.keys().map(|from| (from, reach(&edges, from))).collect();
    let group = |from: &&Module| -> BTreeSet<String> {
        let both = reached[*from].iter().filter(|to| reached[**to].contains(*from));
        both.map(|to| to.join("::")).collect()
    };
    let groups: BTreeSet<BTreeSet<String>> = modules.keys().map(|from| group(&from)).collect();
    let line = |group: &BTreeSet<String>| group.iter().cloned().collect::<Vec<_>>().join(", ");
    groups.iter().filter(|group| group.len() > 1).map(line).collect()
}

fn is_test(path: &str) -> bool {
    path.ends_with("/tests.rs") || path.contains("/tests/")
}

fn module(path: &str) -> Module {
    let path = path.trim_start_matches('/').trim_end_matches(".rs");
    let mut module: Module = path.split('/').map(str::to_owned).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        module.pop();
    }
    module
}

/// The module that defines what a path names; `None` outside the crate.
fn resolve<'a>(
    modules: &'a BTreeMap<Module, Imports>,
    from: &Module,
    path: &[String],
    depth: usize,
) -> Option<&'a Module> {
    let mut at = from.clone();
    let mut rest = path;
    match rest.first()?.as_str() {
        "crate" => at.clear(),
        "self" => {}
        "super" => drop(at.pop()),
        first => {
            // A child, or a name that an import brings in; anything else is another crate.
            let child = [&at[..], &[first.to_owned()]].concat();
            let known = modules.contains_key(&child) || modules[&at].names.contains_key(first);
            known.then_some(())?;
            return follow(modules, at, rest, depth);
        }
    }
    rest = &rest[1..];
    while rest.first().is_some_and(|segment| segment == "super") {
        at.pop();
        rest = &rest[1..];
    }
    follow(modules, at, rest, depth)
}

fn follow<'a>(
    modules: &'a BTreeMap<Module, Imports>,
    mut at: Module,
    mut rest: &[String],
    depth: usize,
) -> Option<&'a Module> {
    while let [segment, others @ ..] = rest {
        at.push(segment.clone());
        if modules.contains_key(&at) {
            rest = others;
            continue;
        }
        at.pop();
        let Some(behind) = modules.get(&at)?.names.get(segment) else { break };
        if depth > 0 && behind.last().is_some_and(|last| last != "*") {
            let path = [&behind[..], others].concat();
            let found = resolve(modules, &at, &path, depth - 1);
            // An item of another crate: a file that imports it from here depends on this file.
            return found.or_else(|| modules.get_key_value(&at).map(|(module, _)| module));
        }
        break;
    }
    modules.get_key_value(&at).map(|(module, _)| module)
}

fn reach<'a>(edges: &BTreeMap<&'a Module, BTreeSet<&'a Module>>, from: &'a Module) -> BTreeSet<&'a Module> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(module) = open.pop() {
        if reached.insert(module) {
            open.extend(&edges[module]);
        }
    }
    reached
}

fn imports(text: &str) -> Imports {
    let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    // Tests stand last.
    let end = code.iter().position(|line| line.trim() == "#[cfg(test)]").unwrap_or(code.len());
    let code = code[..end].join("\n");
    let mut imports = Imports::default();
    for statement in code.split(';') {
        // `use` begins a line, perhaps after `pub` or `pub(crate)`.
        let line = statement.match_indices("use ").find(|(at, _)| {
            let before = statement[..*at].rsplit('\n').next().unwrap_or_default().trim();
            before.is_empty() || before.starts_with("pub")
        });
        if let Some((at, _)) = line {
            expand(&[], &statement[at + 4..], &mut imports);
        }
    }
    for word in code.split(|c: char| !c.is_alphanumeric() && c != '_' && c != ':') {
        let path: Vec<String> = word.split("::").map(str::to_owned).collect();
        if path.len() > 1 && ["crate", "super"].contains(&&path[0][..]) {
            imports.paths.push(path);
        }
    }
    imports
}

/// Takes the tree of a `use` apart.
fn expand(prefix: &[String], tree: &str, imports: &mut Imports) {
    let tree = tree.trim();
    if let Some((head, inner)) = tree.split_once('{') {
        let segments = head.trim().trim_end_matches("::").trim_start_matches("::");
        let segments = segments.split("::").map(|segment| segment.trim().to_owned());
        let prefix: Vec<String> =
            prefix.iter().cloned().chain(segments.filter(|segment| !segment.is_empty())).collect();
        let inner = inner.rsplit_once('}').map_or(inner, |(inner, _)| inner);
        let mut depth = 0;
        let is_end = |c: char| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            c == ',' && depth == 0
        };
        inner
            .split(is_end)
            .filter(|part| !part.trim().is_empty())
            .for_each(|part| expand(&prefix, part, imports));
        return;
    }
    let (path, alias) =
        tree.split_once(" as ").map_or((tree, None), |(path, alias)| (path, Some(alias.trim())));
    let segments = path.split("::").map(|segment| segment.trim().to_owned());
    let mut path: Vec<String> = prefix.iter().cloned().chain(segments).collect();
    if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
        path.pop();
    }
    let name = alias.map(str::to_owned).or_else(|| path.last().cloned()).unwrap_or_default();
    imports.names.insert(name, path.clone());
    imports.paths.push(path);
}
