//! What docs/nightly.md says of running every night, tried.

#![allow(clippy::unwrap_used)]
#![cfg(unix)]

mod common;

use std::path::Path;
use std::process::Command;

use common::{small_run, small_settings, succeed, text};

/// The document's blocks of a kind.
fn blocks(kind: &str) -> Vec<String> {
    let document = std::fs::read_to_string("docs/nightly.md").unwrap();
    let begins = format!("```{kind}\n");
    let parts = document.split(&begins).skip(1);
    parts.map(|part| part.split("```").next().unwrap().to_owned()).collect()
}

/// A home with the program where cargo puts it and a laboratory's folder with a baseline.
fn home() -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let lab = small_run(&small_settings(), "1");
    succeed(lab.path(), &["compare", "--save", "baseline.json"]);
    std::fs::rename(lab.keep(), home.path().join("lab")).unwrap();
    let programs = home.path().join(".cargo/bin");
    std::fs::create_dir_all(&programs).unwrap();
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_trilink"), programs.join("trilink")).unwrap();
    home
}

#[test]
fn the_line_for_cron_works_in_an_empty_environment() {
    let [line] = &blocks("crontab")[..] else { panic!("one block for cron") };
    let (time, command) = line.trim().split_at(line.find("cd ").unwrap());
    assert_eq!(time.split_whitespace().count(), 5);
    assert!(!command.contains('%'), "cron takes a per cent sign for the end of the line");
    let home = home();
    let night = Command::new("/bin/sh")
        .args(["-c", command])
        .env_clear()
        .env("HOME", home.path())
        .current_dir("/")
        .output()
        .unwrap();
    assert_eq!(night.status.code(), Some(0), "{}", text(&night.stderr));
    assert_eq!(text(&night.stdout) + &text(&night.stderr), "", "cron would send a mail");
    let said = std::fs::read_to_string(home.path().join("lab/nightly.txt")).unwrap();
    assert!(said.contains("0 out of tolerance") && said.contains("page: reports/index.html"));
    let log = std::fs::read_to_string(home.path().join("lab/nightly.log")).unwrap();
    assert!(log.contains("INFO end status=0"));
}

#[test]
fn systemd_takes_the_timer_and_the_service() {
    let units = blocks("ini");
    assert_eq!(units.len(), 2);
    let home = home();
    let mut paths = Vec::new();
    for unit in &units {
        let name = unit.lines().next().unwrap().trim_start_matches("# ");
        let path = home.path().join(name);
        // Whoever verifies has another home than the one that is tried.
        std::fs::write(&path, unit.replace("%h", home.path().to_str().unwrap())).unwrap();
        paths.push(path);
    }
    let verified = Command::new("systemd-analyze")
        .args(["verify", "--user"])
        .args(&paths)
        .env("XDG_RUNTIME_DIR", home.path())
        .output();
    match verified {
        Ok(verified) => assert_eq!(text(&verified.stderr), ""),
        Err(_) => eprintln!("left out: systemd-analyze does not start"),
    }
    let calendar = units[1].lines().find_map(|line| line.strip_prefix("OnCalendar=")).unwrap();
    if let Ok(next) = Command::new("systemd-analyze").args(["calendar", calendar]).output() {
        assert!(next.status.success(), "{}", text(&next.stderr));
    }
    // The service's commands one after the other, as systemd would.
    for line in units[0].lines().filter_map(|line| line.strip_prefix("ExecStart=")) {
        let command = line.trim_start_matches('-').replace("%h", home.path().to_str().unwrap());
        let words: Vec<&str> = command.split_whitespace().collect();
        let ended = Command::new(words[0])
            .args(&words[1..])
            .env_clear()
            .current_dir(home.path().join("lab"))
            .output()
            .unwrap();
        assert_eq!(ended.status.code(), Some(0), "{}", text(&ended.stderr));
    }
}

#[test]
fn the_workflow_names_files_that_are_there() {
    let workflow = std::fs::read_to_string(".github/workflows/nightly.yml").unwrap();
    assert!(workflow.contains("compare docs/demo-baseline.json"));
    let baseline = trilink::compare::Snapshot::load(Path::new("docs/demo-baseline.json")).unwrap();
    assert_eq!(baseline.records("trials").len(), 42);
    assert_eq!(baseline.records("fits").len(), 12);
}
