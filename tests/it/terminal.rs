//! Tests of colours, of the width of lines, and of what the commands print first.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{Small, text, trilink};

/// Runs the program with environment variables.
fn with(folder: &Path, variables: &[(&str, &str)], arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trilink"));
    for variable in ["COLUMNS", "NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE"] {
        command.env_remove(variable);
    }
    let command = command.args(arguments).envs(variables.iter().copied());
    command.current_dir(folder).output().unwrap()
}

/// Returns what a command prints to standard output and then to standard error.
fn said(output: &Output) -> String {
    text(&output.stdout) + &text(&output.stderr)
}

/// Creates a project in which a marker file is missing and a trial has a warning.
fn faulty() -> Small {
    let folder = Small::raw();
    std::fs::remove_file(folder.place("raw/kinematic-symmetric-5.00-r1.csv")).unwrap();
    let settings = text(&folder.read("pipeline.toml"));
    folder.write("pipeline.toml", format!("{settings}\n[ingest]\nmax_residual_mm = 0.08\n"));
    folder
}

#[test]
fn colours_follow_the_switches_and_stay_out_of_pipes() {
    let folder = faulty();
    let (force, none) = (("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1"));
    let failed = "\u{1b}[1m\u{1b}[31m1 failed\u{1b}[0m";
    let error = "\u{1b}[1m\u{1b}[31merror:\u{1b}[0m ";
    for (variables, option, is_coloured) in [
        (&[][..], &[][..], false),
        (&[force], &[], true),
        (&[force, none], &[], false),
        (&[none], &["--color", "always"], true),
        (&[], &["--color=always"], true),
        (&[force], &["--color", "never"], false),
        (&[force], &["--color", "auto"], true),
    ] {
        // Results, an error of the program, and an error in the command line.
        for (command, coloured) in [
            (&["check"][..], failed),
            (&["run", "-c", "nowhere.toml"], error),
            (&["run", "--fast"], error),
        ] {
            let output = said(&with(folder.path(), variables, &[command, option].concat()));
            let case = format!("{variables:?} {option:?} {command:?}: {output}");
            assert_eq!(output.contains('\u{1b}'), is_coloured, "{case}");
            assert_eq!(output.contains(coloured), is_coloured, "{case}");
        }
    }
    let json = with(folder.path(), &[force], &["check", "--json"]);
    assert!(!text(&json.stdout).contains('\u{1b}'));
}

/// Command lines that print the most kinds of output, for a project that has been run.
const COMMANDS: [&[&str]; 19] = [
    &["run", "--force"],
    &["status"],
    &["check"],
    &["check", "raw/kinematic-symmetric-6.00-r1.csv", "raw/absent.csv"],
    &["compare", "--accept", "first"],
    &["compare", "--tolerance", "trials.d_m = { absolute = 0, relative = 0, sigmas = 0 }"],
    &["inspect"],
    &["inspect", "trials"],
    &["inspect", "fits"],
    &["inspect", "trials", "--schema"],
    &["inspect", "trials", "--columns", "omga"],
    &["simulate", "kinematic-symmetric", "--model", "skid-roll", "--omega", "1,3.9"],
    &["branches", "kinematic-symmetric", "--model", "skid", "--over", "omega_rad_s=3..4"],
    &["optimise", "kinematic-symmetric", "--model", "skid", "--maximise", "v", "--starts", "1"],
    &["config", "check"],
    &["explain", "W018"],
    &["clean", "--dry-run"],
    &["run", "-c", "wrong.toml"],
    &["synth", "--help"],
];

#[test]
fn lines_break_between_words_at_the_width_of_the_terminal_and_not_in_a_pipe() {
    let folder = Small::done();
    let settings = text(&folder.read("pipeline.toml"));
    folder.write("wrong.toml", settings.replacen("starts", "start", 1));
    for columns in ["80", "60"] {
        let width: usize = columns.parse().unwrap();
        for command in COMMANDS {
            let output = with(folder.path(), &[("COLUMNS", columns)], command);
            let printed = said(&output);
            assert!(!printed.is_empty(), "{command:?}");
            for line in printed.lines() {
                let is_word = !line.trim().contains(' ');
                assert!(line.chars().count() <= width || is_word, "{command:?}: {line}\n{printed}");
            }
        }
    }
    let run = text(&with(folder.path(), &[], &["run", "--force"]).stdout);
    assert!(run.lines().any(|line| line.starts_with("  ") && line.len() > 200), "{run}");
    let broken = text(&with(folder.path(), &[("COLUMNS", "60")], &["run", "--force"]).stdout);
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    assert!(words(&broken).len() > 100 && broken.lines().count() > run.lines().count());
    let json = with(folder.path(), &[("COLUMNS", "60")], &["inspect", "trials", "--json"]);
    assert!(text(&json.stdout).lines().any(|line| line.len() > 200));
}

#[test]
fn check_prints_errors_then_warnings_then_the_counts() {
    let folder = faulty();
    let said = text(&trilink(folder.path(), &["check"]).stdout);
    let lines: Vec<&str> = said.lines().collect();
    let trial = "kinematic-symmetric-5.00-r1";
    let place = |start: &str| lines.iter().position(|line| line.starts_with(start)).unwrap();
    let error = place(&format!("E001 failed: {trial}: raw/{trial}.csv: no such file"));
    let (warning, count) = (place("W004 residual: raw: "), place("E001 failed  "));
    assert!(error < warning && warning < count && lines[count].ends_with(" 1 error"), "{said}");
    assert!(lines[..warning].iter().all(|line| line.starts_with('E')), "{said}");
    assert_eq!(lines[lines.len() - 1], "5 trials: 0 ok, 4 flagged, 1 failed", "{said}");
}

#[test]
fn inspect_shows_the_metrics_of_trials_and_all_columns_on_request() {
    let folder = Small::done();
    let heading = |arguments: &[&str]| {
        let said =
            text(&trilink(folder.path(), &[&["inspect", "trials"], arguments].concat()).stdout);
        let first = said.lines().next().unwrap().to_owned();
        first
            .split([' ', ','])
            .filter(|word| !word.is_empty())
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let shown = ["trial", "status", "omega_rad_s", "d_m", "v_m_s", "sigma0", "sigma1", "sigma2"];
    assert_eq!(heading(&[]), shown);
    assert_eq!(heading(&["--columns", "d_m"]), ["d_m"]);
    for all in [&["--columns", "*"][..], &["--csv"]] {
        let heading = heading(all);
        assert!(heading.len() > 50 && heading.contains(&"alpha1_rad_se".to_owned()), "{heading:?}");
    }
    let narrow = with(folder.path(), &[("COLUMNS", "60")], &["inspect", "trials"]);
    let first = text(&narrow.stdout).lines().next().unwrap().to_owned();
    assert!(first.ends_with(" d_m") && text(&narrow.stderr).contains("sigma2"), "{first}");
}

#[test]
fn a_quiet_run_prints_fewer_than_25_lines_however_much_is_wrong() {
    let folder = Small::raw();
    let mut list = text(&folder.read("raw/trials.toml"));
    let sound = text(&folder.read("raw/kinematic-symmetric-5.00-r1.csv"));
    for n in 0..60 {
        folder.write(&format!("raw/wrong{n}.csv"), sound.replacen(":R1", &format!(":Q{n}"), 1));
        list += &format!(
            "\n[[trial]]\nid = \"wrong{n}\"\nfile = \"wrong{n}.csv\"\nkind = \"gait\"\n\
             campaign = \"kinematic-symmetric\"\nomega_rad_s = {}.5\n",
            n % 6
        );
    }
    folder.write("raw/trials.toml", list);
    for columns in [None, Some("80"), Some("60")] {
        let variables: Vec<_> = columns.iter().map(|columns| ("COLUMNS", *columns)).collect();
        for option in ["--force", "--verify"] {
            let output = with(folder.path(), &variables, &["-q", "run", option]);
            assert_eq!(output.status.code(), Some(1));
            let said = said(&output);
            assert!(
                said.contains("60 failed") && said.contains("more, in checks.parquet"),
                "{said}"
            );
            assert!(said.lines().count() < 25, "{said}");
        }
    }
}
