//! Running the program and looking at what it leaves.

// Not every test file uses all of it.
#![allow(dead_code)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs the program in `folder`.
pub fn trilink(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trilink"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

/// Runs the program, which must end with status 0; gives what it wrote to standard output.
pub fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = trilink(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Bytes as text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("the text is UTF-8")
}

/// What is beside the results: who holds them, and the record of times and hashes.
const BESIDE: [&str; 2] = [".lock", "up-to-date.json"];

/// Every file of results below a folder, by its path from there.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        for entry in std::fs::read_dir(&inner).expect("the folder is there") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if !BESIDE.iter().any(|name| path.ends_with(name)) {
                let bytes = std::fs::read(&path).expect("the file is readable");
                let name = path.strip_prefix(folder).expect("the file is inside");
                found.insert(name.to_owned(), bytes);
            }
        }
    }
    found
}
