//! Tests of the documentation: links lead somewhere, and the program accepts the commands shown.

#![cfg(unix)]

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use sqlparser::dialect::DuckDbDialect;

/// Returns the README and the pages in `docs/`, indexed by their paths.
fn documents() -> BTreeMap<PathBuf, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let inside = std::fs::read_dir(root.join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let pages = inside.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    let read = |path: PathBuf| (path.clone(), std::fs::read_to_string(&path).unwrap());
    pages.chain([root.join("README.md")]).map(read).collect()
}

/// Returns the anchor of a heading.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || *c == '-' || *c == '_' || *c == ' ';
    let text: String = heading.to_lowercase().chars().filter(kept).collect();
    text.trim().replace(' ', "-")
}

#[test]
fn links_between_documents_lead_somewhere() {
    let mut documents = documents();
    let of_trials = Path::new(env!("CARGO_MANIFEST_DIR")).join("raw/README.md");
    let text = std::fs::read_to_string(&of_trials).unwrap();
    documents.insert(of_trials, text);
    // A packaged crate does not contain the other crates.
    let is_packed = !Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz").exists();
    let mut checked = 0;
    for (path, text) in &documents {
        for target in text.split("](").skip(1).filter_map(|rest| rest.split_once(')')) {
            let (file, section) = target.0.split_once('#').unwrap_or((target.0, ""));
            let elsewhere = ["../fuzz/", "../crates/", "crates/", "fuzz/"];
            let is_elsewhere = is_packed && elsewhere.iter().any(|folder| file.starts_with(folder));
            if file.starts_with("http") || is_elsewhere {
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

/// Each claim names the test that verifies it, which is in one of the files to which the section links.
#[test]
fn tests_that_verify_claims_of_the_paper_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    if !root.join("fuzz").exists() {
        // A packaged crate does not contain the other crates.
        return;
    }
    let page = std::fs::read_to_string(root.join("docs/paper-claims.md")).unwrap();
    let (_, section) = page.split_once("## Verified by tests").unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    let files = section.split("](../").skip(1).filter_map(|rest| rest.split_once(')'));
    let code: String =
        files.map(|(file, _)| std::fs::read_to_string(root.join(file)).unwrap()).collect();
    let tests: Vec<&str> = section
        .lines()
        .filter_map(|line| line.strip_suffix("` |")?.rsplit_once('`').map(|(_, test)| test))
        .collect();
    assert!(tests.len() > 10, "{tests:?}");
    for test in tests {
        assert!(code.contains(&format!("fn {test}(")), "{test} is not there");
    }
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

/// Returns the code blocks in a document that are written in a language.
fn blocks<'t>(text: &'t str, language: &str) -> Vec<&'t str> {
    let fence = format!("```{language}\n");
    let starts = text.match_indices(&fence).map(|(start, _)| start + fence.len());
    starts.filter_map(|start| text[start..].split_once("```")).map(|(block, _)| block).collect()
}

/// Returns the shell lines that begin with the program's name, with continued lines joined.
fn commands(text: &str) -> Vec<String> {
    let joined: String =
        blocks(text, "sh").iter().map(|block| block.replace("\\\n", " ")).collect();
    let lines = joined.lines().map(str::trim).filter(|line| line.starts_with("trilink "));
    lines.map(str::to_owned).collect()
}

/// Returns the output of a program for this input, and whether the program succeeded.
fn answer(command: &mut Command, input: &str) -> (bool, String) {
    let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = piped.spawn().unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn blocks_of_shell_python_and_sql_are_of_their_language() {
    let python = std::env::var("TRILINK_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_python = Command::new(&python).arg("--version").output().is_ok();
    let mut counts = [0; 3];
    for (path, text) in documents() {
        let page = path.display();
        for block in blocks(&text, "sh") {
            let (is_shell, error) = answer(Command::new("sh").arg("-n"), block);
            assert!(is_shell, "{page}: {error}\n{block}");
            counts[0] += 1;
        }
        for block in blocks(&text, "python") {
            let parse = "import ast, sys; ast.parse(sys.stdin.read())";
            if has_python {
                let (is_python, error) = answer(Command::new(&python).args(["-c", parse]), block);
                assert!(is_python, "{page}: {error}\n{block}");
            }
            counts[1] += 1;
        }
        for block in blocks(&text, "sql") {
            let parsed = sqlparser::parser::Parser::parse_sql(&DuckDbDialect {}, block);
            assert!(parsed.is_ok_and(|of| !of.is_empty()), "{page}: {block}");
            counts[2] += 1;
        }
    }
    assert!(counts[0] > 20 && counts[1..].iter().all(|count| *count > 0), "{counts:?}");
}

/// Merges the table `with` into the table `into`.
fn merge(into: &mut toml::Table, with: toml::Table) {
    for (key, value) in with {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(into)), toml::Value::Table(with)) => merge(into, with),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

#[test]
fn blocks_of_settings_are_valid_alone_or_in_the_file_of_this_repository() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let whole: toml::Table =
        std::fs::read_to_string(root.join("pipeline.toml")).unwrap().parse().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let is_valid = |text: &str| {
        std::fs::write(folder.path().join("pipeline.toml"), text).unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_trilink"))
            .args(["config", "check"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout).contains("pipeline.toml: valid");
        (said, String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let mut count = 0;
    for (path, text) in documents() {
        for block in blocks(&text, "toml") {
            let settings: toml::Table = block.parse().unwrap();
            if settings.contains_key("trial") {
                continue;
            }
            let (alone, error) = is_valid(block);
            let mut merged = whole.clone();
            merge(&mut merged, settings);
            let is_whole = block.contains("[robot.") && block.contains("[markers.");
            let (inside, inside_error) = is_valid(&merged.to_string());
            assert!(
                alone || inside && !is_whole,
                "{}: {error}{inside_error}\n{block}",
                path.display()
            );
            count += 1;
        }
    }
    assert!(count >= 5, "{count}");
}

#[test]
fn the_program_knows_every_command_and_option_that_the_documents_show() {
    let home = tempfile::tempdir().unwrap();
    let completions = home.path().join(".local/share/bash-completion/completions");
    std::fs::create_dir_all(completions).unwrap();
    let mut count = 0;
    for (path, text) in documents() {
        for line in commands(&text) {
            // Options before --help are checked: they must exist, with valid values.
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

#[test]
fn the_repository_is_the_same_everywhere() {
    let (root, repository) = (Path::new(env!("CARGO_MANIFEST_DIR")), env!("CARGO_PKG_REPOSITORY"));
    for name in ["README.md", "CITATION.cff"] {
        let text = std::fs::read_to_string(root.join(name)).unwrap();
        assert!(text.contains(repository), "{name}");
    }
    let help = crate::common::succeed(root, &["--help"]);
    assert!(help.contains(&format!("Report problems: {repository}")), "{help}");
}
