//! Tests of the examples in the help texts.

use clap::{CommandFactory, Parser};

use super::Arguments;

/// Splits a line into words as a shell does, omitting redirections and comments.
fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (None, '\'' | '"') => quote = Some(c),
            (Some(open), c) if open == c => quote = None,
            (None, ' ') => words.extend(Some(std::mem::take(&mut word))),
            (None, '>' | '|') => break,
            _ => word.push(c),
        }
        // Two spaces precede a comment.
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
        assert!(help.lines().all(|line| line.len() <= 80), "{help}");
        for line in help.replace("\\\n      ", "").lines() {
            let Some(line) = line.strip_prefix("  trilink ") else { continue };
            let words = words(&format!("trilink {line}"));
            Arguments::try_parse_from(&words).unwrap_or_else(|e| panic!("{words:?}: {e}"));
            count += 1;
        }
    }
    assert!(count > 25, "{count}");
}
