//! The page is part of the program: it is built again when the page's files change.

#![allow(clippy::disallowed_macros, reason = "Cargo reads what is printed")]

fn main() {
    println!("cargo:rerun-if-changed=../page/dist");
}
