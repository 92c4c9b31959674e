//! Tests of the instructions for nightly runs in docs/nightly.md.

#![cfg(unix)]

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{small_run, small_settings, succeed, text};

/// Returns the code blocks in docs/nightly.md that are written in a language.
fn blocks(kind: &str) -> Vec<String> {
    let document = std::fs::read_to_string("docs/nightly.md").unwrap();
    let begins = format!("```{kind}\n");
    let parts = document.split(&begins).skip(1);
    parts.map(|part| part.split("```").next().unwrap().to_owned()).collect()
}

/// Creates a home directory that contains the program, at the path where cargo installs it, and a project folder `lab`,
/// whose results have been saved as the baseline of later comparisons.
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

/// Returns the schedule and the command of the documented crontab line.
fn cron_line() -> (String, String) {
    let [line] = &blocks("crontab")[..] else { panic!("one block for cron") };
    let (times, command) = line.trim().split_at(line.find("cd ").unwrap());
    (times.to_owned(), command.to_owned())
}

/// Runs the documented crontab command in an empty environment, after the shell commands `before`.
fn cron_night(home: &Path, before: &str) -> Output {
    let command = cron_line().1;
    Command::new("/bin/sh")
        .args(["-c", &format!("{before}\n{command}")])
        .env_clear()
        .env("HOME", home)
        .env("PATH", "/usr/bin:/bin")
        .current_dir("/")
        .output()
        .unwrap()
}

/// Runs the commands of the documented systemd service one after the other until one fails, each after the shell
/// commands `before`; returns the output of the last command that was run.
fn systemd_night(home: &Path, before: &str) -> Output {
    let unit = &blocks("ini")[0];
    let mut last = None;
    for line in unit.lines().filter_map(|line| line.strip_prefix("ExecStart=")) {
        assert!(!line.starts_with('-'), "{line} swallows a status");
        let line = line.replace("%h", home.to_str().unwrap()).replace("$$", "$");
        let ended = Command::new("/bin/sh")
            .args(["-c", &format!("{before}\n{line}")])
            .env_clear()
            .env("HOME", home)
            .env("PATH", "/usr/bin:/bin")
            .current_dir(home.join("lab"))
            .output()
            .unwrap();
        let failed = !ended.status.success();
        last = Some(ended);
        if failed {
            break;
        }
    }
    last.unwrap()
}

#[test]
fn the_line_for_cron_works_in_an_empty_environment() {
    let (times, command) = cron_line();
    assert_eq!(times.split_whitespace().count(), 5);
    assert!(!command.contains('%'), "cron takes a per cent sign for the end of the line");
    let home = home();
    let night = cron_night(home.path(), "");
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
        // The home folder of the user who verifies differs from that of the test.
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
    let night = systemd_night(home.path(), "");
    assert_eq!(night.status.code(), Some(0), "{}", text(&night.stderr));
}

/// Shell script that kills a run once the run reports that it has started.
const KILLED: &str = r#"#!/bin/sh
real=$(dirname "$0")/real
[ "$1" = run ] || exec "$real" "$@"
"$real" "$@" & pid=$!
until grep -q '"running"' reports/run.json; do sleep 0.01; done
kill -9 $pid; wait $pid
"#;

#[test]
fn no_nightly_run_with_a_failure_reports_success() {
    type Night = fn(&Path, &str) -> Output;
    let nights: [(&str, Night); 2] = [("cron", cron_night), ("systemd", systemd_night)];
    let rerun = "rm -f \"$HOME/lab/derived/fits.parquet\"";
    let full_disk = format!("{rerun}; ulimit -f 8");
    let full_disk_told = format!("trap '' XFSZ; {full_disk}");
    let nights = nights.into_iter().flat_map(|(by, night)| {
        [
            ("the raw folder is gone", "mv \"$HOME/lab/raw\" \"$HOME/lab/away\"", None),
            ("the raw folder is empty", "rm -r \"$HOME/lab/raw/demo/\"*", None),
            (
                "a file is damaged",
                "for f in \"$HOME/lab/raw/demo/\"*.csv; do echo x > \"$f\"; break; done",
                None,
            ),
            ("the disk is full", full_disk.as_str(), None),
            ("the disk is full and says so", full_disk_told.as_str(), None),
            ("the run is killed", rerun, Some(KILLED)),
            ("no program", "rm \"$HOME/.cargo/bin/trilink\"", None),
        ]
        .map(|scenario| (by, night, scenario))
    });
    for (by, night, (what, before, program)) in nights {
        let home = home();
        let programs = home.path().join(".cargo/bin");
        if let Some(script) = program {
            std::fs::rename(programs.join("trilink"), programs.join("real")).unwrap();
            std::fs::write(programs.join("trilink"), script).unwrap();
            let executable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
            std::fs::set_permissions(programs.join("trilink"), executable).unwrap();
        }
        let ended = night(home.path(), before);
        let said = text(&ended.stdout) + &text(&ended.stderr);
        assert_ne!(ended.status.code(), Some(0), "{by}: {what}: {said}");
        assert!(!said.trim().is_empty(), "{by}: {what}: cron would send no mail");
    }
}

#[test]
fn the_workflow_names_files_that_are_there() {
    let workflow = std::fs::read_to_string(".github/workflows/nightly.yml").unwrap();
    assert!(workflow.contains("compare docs/demo-baseline.json"));
    // A failed step fails the workflow, and later steps do not run.
    for swallows in ["continue-on-error", "||", "set +e"] {
        assert!(!workflow.contains(swallows), "{swallows}");
    }
    let baseline = trilink::compare::Snapshot::load(Path::new("docs/demo-baseline.json")).unwrap();
    assert_eq!(baseline.records("trials").len(), 54);
    assert_eq!(baseline.records("fits").len(), 14);
}
