//! Examples at the end of every command's help.

pub(super) const TRILINK: &str = "\
Examples:
  trilink demo                       make the demo's trials, ingest, fit, draw
  trilink run raw/2024-05-12         the same for your own trials
  trilink run --log nightly.log -q   every night

Exit status:
  0    all well
  1    finished, but something needs a person: a trial failed, a comparison is out of tolerance
  2    nothing could be done: usage, configuration, a missing folder
  130  stopped by Ctrl-C (143 by SIGTERM); what was written is whole";

pub(super) const DEMO: &str = "\
Examples:
  trilink demo
  trilink -c other.toml demo         with other robots, gaits or folders";

pub(super) const RUN: &str = "\
Examples:
  trilink run                        the folder that pipeline.toml names
  trilink run raw/2024-05-12
  trilink run --threads 2 --log nightly.log --quiet";

pub(super) const INGEST: &str = "\
Examples:
  trilink ingest raw/2024-05-12
  trilink ingest --calibrate kinematic-symmetric-3.90-r1";

pub(super) const FIT: &str = "\
Examples:
  trilink fit
  trilink fit -vv                    every fit with its objective";

pub(super) const REPORT: &str = "\
Examples:
  trilink report
  trilink -c pipeline.toml report";

pub(super) const CHECK: &str = "\
Examples:
  trilink check                      the folder that pipeline.toml names
  trilink check raw/2024-05-12 --json
  trilink check ~/exports/*.csv ~/exports/*.c3d";

pub(super) const COMPARE: &str = "\
Examples:
  trilink compare --save baseline.json
  trilink compare baseline.json
  trilink compare ../last-week/derived
  trilink compare baseline.json --tolerance 'trials.d_m = { absolute = 0.001 }'
  trilink compare baseline.json --accept 'new tyres on the middle link'";

pub(super) const INSPECT: &str = "\
Examples:
  trilink inspect
  trilink inspect fits --schema
  trilink inspect trials --where \"campaign == 'kinematic-symmetric' and omega_rad_s > 3\" \\
      --columns trial,d_m,sigma0 --sort -d_m
  trilink inspect poses/kinematic-symmetric-3.90-r1 --head 5
  trilink inspect ~/elsewhere/any.parquet --csv > any.csv

A condition knows and, or, not, comparisons, + - * /, is null, in (..), between, like.";

pub(super) const SIMULATE: &str = "\
Examples:
  trilink simulate kinematic-symmetric --model skid-roll --omega 3.9,4
  trilink simulate semi-passive-symmetric --model skid-roll --omega 0.5..6/12 \\
      --set skid_kg_s=420,200,70 --json
  trilink simulate semi-passive-symmetric --model no-skid --omega 4 --trajectory cycle.parquet";

pub(super) const SYNTH: &str = "\
Examples:
  trilink synth raw/practice --seed 7
  trilink synth raw/another-night --noise-seed 2
  trilink synth raw/worn-wheel --noise-seed 2 --skid-factors 1.05,1,1
  trilink synth raw/practice --format c3d --misplaced 0.1";

pub(super) const COMPLETIONS: &str = "\
Examples:
  trilink completions bash > ~/.local/share/bash-completion/completions/trilink
  trilink completions zsh > ~/.zfunc/_trilink
  trilink completions fish > ~/.config/fish/completions/trilink.fish";

pub(super) const MAN: &str = "\
Examples:
  trilink man | man -l -
  trilink man --folder ~/.local/share/man/man1";

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use crate::cli::Arguments;

    /// The words of a line as a shell would have them, without redirection and remarks.
    fn words(line: &str) -> Vec<String> {
        let (mut words, mut word, mut quote) = (Vec::new(), String::new(), None);
        for c in line.chars() {
            match (quote, c) {
                (None, '\'' | '"') => quote = Some(c),
                (Some(open), c) if open == c => quote = None,
                (None, ' ') => words.extend(Some(std::mem::take(&mut word))),
                (None, '>' | '|') => break,
                _ => word.push(c),
            }
            // Two spaces come before a remark.
            if words.last().is_some_and(String::is_empty) {
                break;
            }
        }
        words.push(word);
        words.into_iter().filter(|word| !word.is_empty()).collect()
    }

    #[test]
    fn every_command_has_examples_that_are_command_lines() {
        let program = Arguments::command();
        let commands = program.get_subcommands().chain(std::iter::once(&program));
        let mut count = 0;
        for command in commands {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.starts_with("Examples:\n"), "{}", command.get_name());
            for line in help.replace("\\\n", "").lines() {
                let Some(line) = line.strip_prefix("  trilink ") else { continue };
                let line: Vec<String> =
                    line.splitn(2, "      --").map(str::trim).map(String::from).collect();
                let words = words(&format!("trilink {}", line.join(" --")));
                Arguments::try_parse_from(&words).unwrap_or_else(|e| panic!("{words:?}: {e}"));
                count += 1;
            }
        }
        assert!(count > 25, "{count}");
    }
}
