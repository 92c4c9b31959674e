//! `trilink explain`.

use trilink_tables::Explanation;
use trilink_tables::config::did_you_mean;

use super::output::{print, say, write_json};
use super::terminal::Tone;
use super::{Failure, Outcome, candidates};

/// Explain a check: what it tests, why that matters and what to do.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/explain.txt").trim_end())]
pub(super) struct Explain {
    /// Codes or names of checks, such as W018 or joint-places [default: list all].
    #[arg(value_name = "CHECK", add = candidates::checks())]
    checks: Vec<String>,
    /// Print one JSON array: an object per check.
    #[arg(long)]
    json: bool,
}

impl Explain {
    pub(super) fn run(self, (): ()) -> Result<Outcome, Failure> {
        let mut found: Vec<_> =
            self.checks.iter().filter_map(|check| Explanation::find(check)).collect();
        let unknown = self.checks.iter().filter(|name| Explanation::find(name).is_none());
        let unknown: Vec<&String> = unknown.collect();
        if !unknown.is_empty() {
            let known: Vec<&str> =
                Explanation::all().flat_map(|explanation| explanation.check.split(' ')).collect();
            let each = unknown.iter().map(|name| {
                format!(
                    "found `{name}`{}",
                    did_you_mean(&name.to_uppercase(), known.iter().copied())
                )
            });
            let each = each.collect::<Vec<_>>().join(", ");
            let needed = "needed check codes or names, as listed by `trilink explain`";
            return Err(format!("{each}; {needed}").into());
        }
        if self.checks.is_empty() {
            found = Explanation::all().collect();
        }
        match (self.json, self.checks.is_empty()) {
            (true, _) => write_json(&found)?,
            (false, true) => found.iter().for_each(|explanation| say!("{}", explanation.check)),
            (false, false) => found.iter().for_each(say_one),
        }
        Ok(Outcome::Well)
    }
}

/// Prints the explanation of a check.
fn say_one(Explanation { check, parts }: &Explanation) {
    print(Tone::Heading.paint(check));
    parts.iter().for_each(|(heading, text)| say!("  {heading}: {text}"));
}
