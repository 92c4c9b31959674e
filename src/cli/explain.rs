//! `trilink explain`.

use trilink_tables::Explanation;
use trilink_tables::config::did_you_mean;

use super::output::{say, write_json};
use super::{Failure, Outcome};

/// Lines are no longer, so that they can be read in any terminal.
const MOST_CHARACTERS: usize = 80;

/// Say what a check looks at, why that matters and what to do.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/explain.txt").trim_end())]
pub(super) struct Explain {
    /// Codes or names of checks, such as W018 or joint-places [default: a list of all].
    #[arg(value_name = "CHECK")]
    checks: Vec<String>,
    /// Print one JSON array: an object per check.
    #[arg(long)]
    json: bool,
}

impl Explain {
    pub(super) fn run(self, (): ()) -> Result<Outcome, Failure> {
        let mut found: Vec<_> = self.checks.iter().filter_map(|of| Explanation::of(of)).collect();
        let unknown = self.checks.iter().filter(|name| Explanation::of(name).is_none());
        let unknown: Vec<&String> = unknown.collect();
        if !unknown.is_empty() {
            let known: Vec<&str> = Explanation::all().map(|of| of.check).collect();
            let names = known.iter().flat_map(|check| check.split(' '));
            let hint = |name: &str| did_you_mean(&name.to_uppercase(), names.clone());
            let each: Vec<String> =
                unknown.iter().map(|name| format!("found `{name}`{}", hint(name))).collect();
            let needed = "needed codes or names of checks, as `trilink explain` lists them";
            return Err(format!("{}; {needed}", each.join(", ")).into());
        }
        if self.checks.is_empty() {
            found = Explanation::all().collect();
        }
        match (self.json, self.checks.is_empty()) {
            (true, _) => write_json(&found)?,
            (false, true) => found.iter().for_each(|of| say!("{}", of.check)),
            (false, false) => found.iter().for_each(say_one),
        }
        Ok(Outcome::Well)
    }
}

fn say_one(Explanation { check, parts }: &Explanation) {
    say!("{check}");
    for (heading, text) in parts {
        let mut line = format!("  {heading}:");
        for word in text.split(' ') {
            if line.chars().count() + 1 + word.chars().count() > MOST_CHARACTERS {
                say!("{line}");
                line = "   ".to_owned();
            }
            line = line + " " + word;
        }
        say!("{line}");
    }
}
