//! Tests of the interaction with the environment: shells, pipes, signals, logs.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::common::{Small, files, small_settings, succeed, text, trilink, was_up_to_date};
use tempfile::TempDir;

/// Returns the names of all commands that the help text lists.
fn commands() -> Vec<String> {
    let help = succeed(here(), &["--help"]);
    let (_, list) = help.split_once("\nCommands:\n").unwrap();
    let (list, _) = list.split_once("\n\n").unwrap();
    let names = list.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = names.filter_map(|line| line.split_whitespace().next()).map(str::to_owned);
    let commands: Vec<String> = names.filter(|name| name != "help").collect();
    assert!(commands.len() >= 20 && commands.iter().any(|name| name == "demo"), "{commands:?}");
    commands
}

/// Creates a folder with synthetic trials that have not been run.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = toml::to_string(&small_settings()).unwrap();
    std::fs::write(folder.path().join("pipeline.toml"), text).unwrap();
    let omegas = "0.5,1,1.5,2,2.5,3,3.5,4,4.5,5";
    succeed(folder.path(), &["synth", "raw/demo", "--omega", omegas, "--quiet"]);
    folder
}

fn here() -> &'static Path {
    Path::new(".")
}

#[test]
fn shells_complete_commands_and_names_of_the_project() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = succeed(here(), &["completions", shell]);
        assert!(script.contains("TRILINK_COMPLETE"), "{shell}: {script}");
    }
    let script = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(script.path(), succeed(here(), &["completions", "bash"])).unwrap();
    if let Ok(checked) = Command::new("bash").arg("-n").arg(script.path()).output() {
        assert!(checked.status.success(), "{}", text(&checked.stderr));
    }
    let folder = Small::raw();
    succeed(folder.path(), &["-q", "ingest"]);
    let complete = |words: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trilink"));
        command.env("TRILINK_COMPLETE", "fish").args(["--", "trilink"]).args(words);
        let output = command.current_dir(folder.path()).output().unwrap();
        let lines = text(&output.stdout);
        lines.lines().map(|line| line.split('\t').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let offered = complete(&[""]);
    assert!(commands().iter().all(|command| offered.contains(command)), "{offered:?}");
    let [table] = complete(&["inspect", "tri"]).try_into().unwrap();
    assert_eq!(table, "trials");
    for (words, name) in [
        (&["simulate", ""][..], "kinematic-symmetric"),
        (&["simulate", "kinematic-symmetric", "--model", "skid"], "skid-roll"),
        (&["explain", "W01"], "W018"),
        (&["export", ""], "kinematic-symmetric-5.00-r1"),
    ] {
        assert!(complete(words).iter().any(|offered| offered == name), "{words:?}");
    }
}

#[test]
fn the_manual_has_a_page_for_every_command_with_examples() {
    let page = succeed(here(), &["man"]);
    assert!(page.contains(".TH trilink 1") && page.contains(".SH EXIT STATUS\n.nf\n"), "{page}");
    let folder = tempfile::tempdir().unwrap();
    succeed(here(), &["man", "--folder", folder.path().to_str().unwrap()]);
    let pages = files(folder.path());
    let commands = commands();
    assert_eq!(pages.len(), commands.len() + 1);
    for command in &commands {
        let page = text(&pages[Path::new(&format!("trilink-{command}.1"))]);
        assert!(page.contains(".SH EXAMPLES\n.nf\n\\&  trilink "), "{page}");
        assert!(succeed(here(), &[command.as_str(), "--help"]).contains("Examples:\n  trilink "));
    }
}

#[test]
fn help_has_no_colours_unless_wanted() {
    let help = |variables: &[(&str, &str)]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trilink"));
        command.arg("--help").envs(variables.iter().copied());
        text(&command.output().unwrap().stdout)
    };
    assert!(help(&[("CLICOLOR_FORCE", "1")]).contains('\u{1b}'));
    assert!(!help(&[]).contains('\u{1b}'));
    assert!(!help(&[("NO_COLOR", "1")]).contains('\u{1b}'));
}

#[test]
fn a_log_has_stages_trials_and_how_it_ended() {
    let folder = folder();
    let file = folder.path().join("nightly.log");
    std::fs::write(&file, "earlier\n").unwrap();
    succeed(folder.path(), &["run", "--quiet", "--log", "nightly.log"]);
    let log = std::fs::read_to_string(&file).unwrap();
    let lines: Vec<&str> = log.lines().collect();
    assert_eq!(lines[0], "earlier");
    assert!(lines[1].contains(" INFO begin version=\"") && lines[1].contains("--log nightly.log"));
    for part in [
        "INFO stage begins stage=\"ingest\"",
        "DEBUG trial trial=\"kinematic-symmetric-2.00-r1\" status=\"ok\" after_s=",
        "INFO stage done stage=\"fit\" seconds=",
        "DEBUG fit campaign=\"kinematic-symmetric\" model=\"skid-roll\" j=0.0",
        "INFO end status=0",
    ] {
        assert!(log.contains(part), "{part}\n{log}");
    }
    assert!(lines[1].starts_with("20") && lines[1][..20].contains('T'), "{}", lines[1]);

    let said = trilink(folder.path(), &["fit", "-v", "--quiet"]);
    let errors = text(&said.stderr);
    assert!(errors.contains("INFO begin") && errors.contains("INFO end status=0"), "{errors}");
    assert!(!errors.contains("DEBUG"));
    assert!(text(&trilink(folder.path(), &["fit", "-vv"]).stderr).contains("DEBUG fit campaign="));
    let refused = trilink(folder.path(), &["fit", "--log", "nowhere/nightly.log"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("--log: nowhere/nightly.log: "));
}

#[test]
fn the_record_of_a_run_tells_a_monitor_when_it_was_and_how_it_ended() {
    let folder = folder();
    let record = || -> serde_json::Value {
        let text = std::fs::read_to_string(folder.path().join("reports/run.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    };
    succeed(folder.path(), &["run", "--quiet"]);
    assert_eq!(record()["status"], "ok");
    let [started, ended] =
        ["started", "ended"].map(|key| record()[key].as_str().unwrap().to_owned());
    assert!(started <= ended && started.len() == 20 && started.ends_with('Z'), "{started} {ended}");
    assert!(record()["seconds"].as_f64().unwrap() > 0.0);
    std::fs::remove_file(folder.path().join("raw/demo/trials.toml")).unwrap();
    assert_eq!(trilink(folder.path(), &["run", "--quiet"]).status.code(), Some(2));
    assert_eq!(record()["status"], "failed");
    assert!(record()["error"].as_str().unwrap().contains("trials.toml"));
}

#[test]
fn a_full_disk_is_an_error() {
    let Ok(full) = std::fs::OpenOptions::new().write(true).open("/dev/full") else { return };
    let output = Command::new(env!("CARGO_BIN_EXE_trilink"))
        .args(["simulate", "kinematic-symmetric", "--model", "no-skid", "--omega", "4"])
        .stdout(full)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("error: standard output: "), "{}", text(&output.stderr));
}

/// Sends a signal to a command once it writes a line that starts with `begins` to stderr; returns the exit status and
/// the last line on stderr.
#[cfg(unix)]
fn stopped(folder: &Path, command: &[&str], begins: &str, signal: &str) -> (Option<i32>, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_trilink"))
        .args(["--threads", "1"])
        .args(command)
        .current_dir(folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.starts_with(begins)), "no line begins with {begins}");
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let last = lines.last().unwrap_or_default();
    (child.wait().unwrap().code(), last)
}

#[cfg(unix)]
#[test]
fn a_search_ends_at_the_first_signal() {
    let folder = tempfile::tempdir().unwrap();
    // The search would take hours; before it starts, it notes that the current amplitude is larger.
    let command = ["optimise", "semi-passive-symmetric", "--model", "coulomb", "--maximise", "v"];
    let command = [&command[..], &["--starts", "10000", "--amplitude-deg", "5..6"]].concat();
    for (signal, status) in [("-INT", 130), ("-TERM", 143)] {
        let stopped =
            stopped(folder.path(), &command, "the current gait is outside the bounds", signal);
        assert_eq!(stopped, (Some(status), "cancelled".to_owned()));
    }
}

#[cfg(unix)]
#[test]
fn the_first_interruption_leaves_whole_files_and_says_what_is_left() {
    let folder = folder();
    let record = || std::fs::read_to_string(folder.path().join("reports/run.json")).unwrap();
    let (status, said) = stopped(folder.path(), &["run"], "ingest 2/", "-INT");
    assert_eq!(status, Some(130), "{said}");
    assert!(said.starts_with("error: interrupted during ingest after "), "{said}");
    assert!(
        said.contains(" of 11 trials; still to do: ingest, fit, report. Every file is complete"),
        "{said}"
    );
    assert!(record().contains("\"status\": \"interrupted\""));
    let left = files(folder.path());
    let unfinished = |path: &Path| path.to_string_lossy().contains(".writing-");
    assert!(!left.keys().any(|path| unfinished(path)), "{:?}", left.keys());
    for (path, bytes) in &left {
        if path.extension().is_some_and(|extension| extension == "parquet") {
            assert_eq!(bytes[bytes.len() - 4..], *b"PAR1", "{}", path.display());
        }
    }
    let (status, said) = stopped(folder.path(), &["run"], "fit 1/", "-TERM");
    assert_eq!(status, Some(143), "{said}");
    assert!(
        said.contains("interrupted during fit") && said.contains("still to do: fit, report"),
        "{said}"
    );
    assert!(folder.path().join("derived/trials.parquet").exists());
    assert!(!folder.path().join("derived/fits.parquet").exists());
    succeed(folder.path(), &["run", "--quiet"]);
    assert!(record().contains("\"status\": \"ok\""));
}

#[cfg(unix)]
#[test]
fn arguments_that_are_no_utf_8_are_refused_by_name() {
    use std::os::unix::ffi::OsStrExt;
    let odd = std::ffi::OsStr::from_bytes(b"raw\xff");
    for before in [&["run"][..], &["run", "-c"], &["run", "--log"], &["compare"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trilink"));
        let output = command.args(before).arg(odd).current_dir(std::env::temp_dir()).output();
        let output = output.unwrap();
        assert_eq!(output.status.code(), Some(2), "{before:?}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains("found bytes that are not UTF-8"), "{before:?}");
    }
}

#[test]
fn a_stage_that_has_nothing_to_read_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["ingest", "fit", "report", "run", "compare"] {
        let arguments: &[&str] =
            if command == "compare" { &["compare", "--save", "x.json"] } else { &[command] };
        assert_eq!(trilink(folder.path(), arguments).status.code(), Some(2), "{command}");
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 0, "{command}");
    }
}

#[test]
fn the_demo_runs_nobody_elses_trials() {
    let folder = Small::raw();
    std::fs::remove_file(folder.place("raw/truth.json")).unwrap();
    let refused = trilink(folder.path(), &["demo"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = text(&refused.stderr);
    assert!(said.contains("raw/trials.toml: found trials that are not the demo's"), "{said}");
    assert!(!folder.place("derived").exists());
}

#[test]
fn a_run_reports_removed_trials_and_those_that_need_attention() {
    let folder = Small::done();
    let list = text(&folder.read("raw/trials.toml"));
    let (first, others) = list.split_once("[[trial]]").unwrap();
    let trials: Vec<&str> = others.split("[[trial]]").collect();
    let id = |trial: &str| trial.split('"').nth(1).unwrap().to_owned();
    let (removed, damaged) = (id(trials[0]), id(trials[1]));
    let kept = trials[1..].iter().map(|trial| format!("[[trial]]{trial}")).collect::<String>();
    folder.write("raw/trials.toml", format!("{first}{kept}"));
    folder.write(&format!("raw/{damaged}.csv"), "nothing");
    let output = trilink(folder.path(), &["run"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    let said = text(&output.stderr);
    assert!(said.contains(&format!(
        "these trials were removed, because they are no longer in the list of trials: {removed}"
    )));
    let block = said.split("needs attention:\n").nth(1).unwrap();
    assert!(block.starts_with(&format!("  failed: {damaged}: ")), "{said}");
    // A run that has nothing to do names the failed trials, too.
    let again = trilink(folder.path(), &["run"]);
    assert!(text(&again.stderr).contains("needs attention:\n") && was_up_to_date(&again));
}

#[test]
fn flagged_trials_are_named_with_their_reasons() {
    let folder = Small::raw();
    let settings = text(&folder.read("pipeline.toml"));
    folder.write("pipeline.toml", format!("{settings}\n[ingest]\nmax_residual_mm = 0.08\n"));
    let said = text(&trilink(folder.path(), &["run"]).stderr);
    let block = said.split("used, but flagged:\n").nth(1).unwrap();
    assert!(block.starts_with("  flagged: raw: all 5 trials: "), "{said}");
    assert!(block.contains("mm on average"), "{said}");
}

#[test]
fn messages_suggest_what_was_meant() {
    let folder = Small::raw();
    let list = text(&folder.read("raw/trials.toml"));
    folder.write("raw/trials.toml", list.replacen("[[trial]]", "[trial]", 2));
    let said = text(&trilink(folder.path(), &["check"]).stderr);
    assert!(said.contains("found `[trial]`, needed `[[trial]]` before each trial"), "{said}");
    assert!(said.contains("raw/trials.toml, line "), "{said}");
    folder.write("raw/trials.toml", list);
    std::fs::remove_file(folder.place("raw/kinematic-symmetric-5.00-r1.csv")).unwrap();
    let said = text(&trilink(folder.path(), &["check"]).stdout);
    assert!(
        said.contains(
            "E001 failed: kinematic-symmetric-5.00-r1: raw/kinematic-symmetric-5.00-r1.csv: "
        ),
        "{said}"
    );
}

#[test]
fn a_check_is_explained_by_its_code_or_its_name() {
    let all = succeed(here(), &["explain"]);
    assert!(all.lines().any(|line| line == "W018 joint-places"), "{all}");
    let page = std::fs::read_to_string(here().join("crates/tables/src/checks.md")).unwrap();
    let cells =
        page.lines().filter(|line| line.starts_with("| `")).filter_map(|l| l.split(" | ").next());
    let mut tabled: Vec<&str> = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    tabled.sort_unstable();
    let mut listed: Vec<&str> = all.lines().filter_map(|line| line.split(' ').next()).collect();
    listed.sort_unstable();
    assert!(listed.len() >= 33 && listed == tabled, "{listed:?} {tabled:?}");
    let one = succeed(here(), &["explain", "W018"]);
    for part in ["W018 joint-places\n  What: ", "\n  Why it matters: ", "\n  What to do: "] {
        assert!(one.contains(part), "{one}");
    }
    assert_eq!(succeed(here(), &["explain", "joint-places"]), one);
    let json: Vec<serde_json::Value> =
        serde_json::from_str(&succeed(here(), &["explain", "w018", "E001", "--json"])).unwrap();
    assert_eq!((json.len(), &json[1]["check"]), (2, &"E001 failed".into()));
    let unknown = trilink(here(), &["explain", "W18", "nothing", "W001"]);
    let error = text(&unknown.stderr);
    assert_eq!(unknown.status.code(), Some(2), "{error}");
    assert!(error.contains("`W18`; did you mean `W018`?, found `nothing`"), "{error}");
}

#[test]
fn config_show_prints_values_and_where_they_are_set() {
    let folder = folder();
    std::fs::write(folder.path().join("own.toml"), "[fit]\nstarts = 3\n").unwrap();
    let show = |arguments: &[&str]| {
        let command = ["--config", "own.toml", "config", "show"];
        succeed(folder.path(), &[&command, arguments].concat())
    };
    let all = show(&[]);
    assert!(
        all.lines()
            .any(|line| line.starts_with("ingest.skip_cycles = 2 ") && line.ends_with("# default"))
    );
    let own = show(&["fit", "--own"]);
    assert!(own.lines().all(|line| line.contains("  # line 2")), "{own}");
    assert!(own.contains("fit.starts = ") && !own.contains("ingest"), "{own}");
    // The output is a configuration with the same values.
    std::fs::write(folder.path().join("whole.toml"), &all).unwrap();
    let whole = succeed(folder.path(), &["--config", "whole.toml", "config", "show", "--json"]);
    let values = |json: &str| -> Vec<[serde_json::Value; 2]> {
        let rows: Vec<serde_json::Value> = serde_json::from_str(json).unwrap();
        rows.into_iter().map(|row| [row["key"].clone(), row["value"].clone()]).collect()
    };
    assert_eq!(values(&whole), values(&show(&["--json"])));
    let unknown = trilink(folder.path(), &["config", "show", "fit.start"]);
    assert!(text(&unknown.stderr).contains("did you mean `fit.starts`?"));

    let check = succeed(folder.path(), &["config", "check"]);
    assert!(check.contains(" trials in ") && check.ends_with(", all readable\n"), "{check}");
    let list = folder.path().join("raw/demo/trials.toml");
    let broken =
        std::fs::read_to_string(&list).unwrap().replacen("campaign = \"", "campaign = \"un", 1);
    std::fs::write(&list, broken).unwrap();
    let check = trilink(folder.path(), &["config", "check"]);
    assert_eq!(check.status.code(), Some(1));
    assert!(text(&check.stdout).contains("key `campaign`"), "{}", text(&check.stdout));
}

#[test]
fn without_a_project_every_command_says_what_to_do_and_writes_nothing() {
    const CAMPAIGN: &str = "semi-passive-symmetric";
    // The commands of `--help`, each with arguments, and what it says without a project.
    let needs_project = "`trilink init FOLDER` (`trilink demo` shows the paper's experiment)";
    let assumed = "no pipeline.toml in the current folder: the paper's robots";
    let lines: [(&[&str], &str); 17] = [
        (&["run"], needs_project),
        (&["ingest"], needs_project),
        (&["check"], needs_project),
        (&["status"], needs_project),
        (&["clean"], needs_project),
        (&["fit"], needs_project),
        (&["report"], needs_project),
        (&["compare"], needs_project),
        (&["inspect"], needs_project),
        (&["inspect", "trials"], needs_project),
        (&["export", "a", "--format", "trc"], needs_project),
        (&["design", CAMPAIGN], needs_project),
        (&["simulate", CAMPAIGN, "--model", "skid", "--omega", "3", "--fitted"], needs_project),
        (&["simulate", CAMPAIGN, "--model", "no-skid", "--omega", "3"], assumed),
        (&["branches", CAMPAIGN, "--over", "omega_rad_s=2..3"], assumed),
        (&["merge", "shards"], "shards: cannot be read"),
        (&["config", "check"], "no pipeline.toml in the current folder: every key has its default"),
    ];
    // These commands work in any folder.
    let anywhere = ["demo", "init", "explain", "optimise", "synth", "completions", "man"];
    for command in commands() {
        let is_tested = lines.iter().any(|(line, _)| line[0] == command);
        assert!(is_tested != anywhere.contains(&command.as_str()), "{command}");
    }
    let empty = tempfile::tempdir().unwrap();
    let markers = tempfile::tempdir().unwrap();
    std::fs::write(markers.path().join("Take 01.csv"), "Trajectories\n100\n").unwrap();
    let project = tempfile::tempdir().unwrap();
    std::fs::write(project.path().join("pipeline.toml"), "").unwrap();
    let inner = project.path().join("raw/day");
    std::fs::create_dir_all(&inner).unwrap();
    for (line, expected) in lines {
        for folder in [empty.path(), markers.path(), &inner] {
            let before = files(folder);
            let output = trilink(folder, line);
            let all = text(&output.stderr) + &text(&output.stdout);
            if folder == inner {
                assert!(all.contains("add -c ../../pipeline.toml") && all.lines().count() == 1);
                assert_eq!(output.status.code(), Some(2), "{line:?}: {all}");
            } else {
                let folder = if folder == empty.path() { "FOLDER" } else { "." };
                let expected = expected.replace("FOLDER", folder);
                assert!(all.contains(&expected), "{line:?}: {all}");
            }
            assert!(files(folder) == before, "{line:?}");
        }
    }
    for (folder, arguments, expected) in [
        (markers.path(), &["demo"][..], "run the demo in an empty folder"),
        (markers.path(), &["check", "."], "`trilink init .`"),
        (&inner, &["init", "."], "add -c ../../pipeline.toml"),
        (&inner, &["demo"], "add -c ../../pipeline.toml"),
        (
            &inner,
            &["-c", "../../pipeline.toml", "run", "."],
            "has no trials.toml; `trilink init .`",
        ),
    ] {
        let output = trilink(folder, arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(expected) && said.lines().count() == 1, "{arguments:?}: {said}");
    }
    assert_eq!(files(markers.path()).len() + files(project.path()).len(), 2);
}
