//! The links of documents: where they lead, and whether that is there.

use std::path::Path;

use super::rust_files::{File, root};

/// Where the links of a text lead, addresses of other sites left out.
pub fn targets(text: &str) -> impl Iterator<Item = &str> {
    let ends = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    ends.filter(|target| !target.contains("://"))
}

/// The links of a document that lead to no file, or to no heading of one.
pub fn dead(document: &File) -> Vec<String> {
    let folder = root().join(&document.path).parent().map(Path::to_owned).unwrap_or_default();
    let is_dead = |target: &&str| {
        let (path, heading) = target.split_once('#').unwrap_or((target, ""));
        if path.is_empty() {
            return !has_heading(&document.text, heading);
        }
        let path = folder.join(path);
        if heading.is_empty() {
            return !path.exists();
        }
        !std::fs::read_to_string(path).is_ok_and(|text| has_heading(&text, heading))
    };
    targets(&document.text).filter(is_dead).map(|target| format!("a link to {target}")).collect()
}

/// Whether a heading has this name in links: lower case, hyphens for blanks, punctuation left out.
fn has_heading(text: &str, name: &str) -> bool {
    let of = |heading: &str| -> String {
        let kept =
            heading.trim().chars().filter(|c| c.is_alphanumeric() || *c == ' ' || *c == '-' || *c == '_');
        kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    text.lines().filter(|line| line.starts_with('#')).any(|line| of(line.trim_start_matches('#')) == name)
}
