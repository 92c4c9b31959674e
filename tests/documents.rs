//! The documents say what is so: their links lead somewhere, and the program knows the commands that
//! they show.

#![allow(clippy::unwrap_used)]
#![cfg(unix)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The README and the pages of `docs/` with their texts, by their paths.
fn documents() -> BTreeMap<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let inside = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let pages = inside.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    let read = |path: PathBuf| (path.clone(), std::fs::read_to_string(&path).unwrap());
    pages.chain([root.join("README.md")]).map(read).collect()
}

/// The anchor that a heading has on a page.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || *c == '-' || *c == '_' || *c == ' ';
    let text: String = heading.to_lowercase().chars().filter(kept).collect();
    text.trim().replace(' ', "-")
}

#[test]
fn links_between_documents_lead_somewhere() {
    let documents = documents();
    let mut checked = 0;
    for (path, text) in &documents {
        for target in text.split("](").skip(1).filter_map(|rest| rest.split_once(')')) {
            let (file, section) = target.0.split_once('#').unwrap_or((target.0, ""));
            if file.starts_with("http") {
                continue;
            }
            let page = match file.is_empty() {
                true => path.clone(),
                false => path.parent().unwrap().join(file).canonicalize().unwrap_or_default(),
            };
            assert!(page.exists(), "{}: {} is not there", path.display(), target.0);
            checked += 1;
            if !section.is_empty() {
                let headings = documents[&page].lines().filter(|line| line.starts_with('#'));
                let mut headings = headings.map(|line| anchor(line.trim_start_matches('#').trim()));
                let is_there = headings.any(|of| of == section);
                assert!(is_there, "{}: {} has no such section", path.display(), target.0);
            }
        }
    }
    assert!(checked > 30, "{checked}");
}

#[test]
fn the_book_has_every_page() {
    let documents = documents();
    let is_summary = |path: &&PathBuf| path.ends_with("docs/SUMMARY.md");
    let summary = &documents[documents.keys().find(is_summary).unwrap()];
    for (path, text) in &documents {
        let name = path.file_name().unwrap().to_str().unwrap();
        if name != "SUMMARY.md" && name != "README.md" {
            let title = text.lines().next().unwrap().trim_start_matches("# ");
            assert!(summary.contains(&format!("- [{title}]({name})")), "{name}: {title}");
        }
    }
}

/// Lines of shell in the documents that begin with the program's name, continued ones in one.
fn commands(text: &str) -> Vec<String> {
    let blocks = text.split("```sh\n").skip(1).filter_map(|rest| rest.split_once("```"));
    let joined = blocks.map(|(block, _)| block.replace("\\\n", " ")).collect::<String>();
    let lines = joined.lines().map(str::trim).filter(|line| line.starts_with("trilink "));
    lines.map(str::to_owned).collect()
}

#[test]
fn the_program_knows_every_command_and_option_that_the_documents_show() {
    let home = tempfile::tempdir().unwrap();
    let completions = home.path().join(".local/share/bash-completion/completions");
    std::fs::create_dir_all(completions).unwrap();
    let mut count = 0;
    for (path, text) in documents() {
        for line in commands(&text) {
            // Options before --help have to be known and their values valid.
            let script = format!("trilink() {{ \"$TRILINK\" \"$@\" --help; }}\n{line}");
            let output = Command::new("sh")
                .args(["-c", &script])
                .current_dir(home.path())
                .env("HOME", home.path())
                .env("TRILINK", env!("CARGO_BIN_EXE_trilink"))
                .output()
                .unwrap();
            let error = String::from_utf8_lossy(&output.stderr);
            assert!(error.is_empty(), "{}: {line}\n{error}", path.display());
            count += 1;
        }
    }
    assert!(count > 30, "{count}");
}
