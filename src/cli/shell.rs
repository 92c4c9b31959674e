//! `trilink completions` and `trilink man`.

use std::io::Write;
use std::path::PathBuf;

use clap::CommandFactory;
use clap::builder::Resettable;
use clap_complete::Shell;
use clap_complete::env::Shells;
use trilink_tables::write_bytes;

use super::output::write_data;
use super::{Arguments, Failure, Outcome, candidates};

/// Print a script that lets a shell complete commands, options, and names of campaigns, models, tables, trials and
/// checks.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/completions.txt").trim_end())]
pub(super) struct Completions {
    /// Target shell.
    shell: Shell,
}

/// Print the manual page.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/man.txt").trim_end())]
pub(super) struct Man {
    /// Write a manual page for every command to this folder instead.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
}

impl Completions {
    pub(super) fn run(self, (): ()) -> Result<Outcome, Failure> {
        let mut script = Vec::new();
        let shells = Shells::builtins();
        let shell = shells.completer(&self.shell.to_string()).expect("all shells are known");
        let name = env!("CARGO_PKG_NAME");
        shell.write_registration(candidates::VARIABLE, name, name, name, &mut script)?;
        write_data(String::from_utf8(script)?.trim_end());
        Ok(Outcome::Well)
    }
}

impl Man {
    pub(super) fn run(self, (): ()) -> Result<Outcome, Failure> {
        let mut command = Arguments::command().disable_help_subcommand(true);
        command.build();
        let Some(folder) = self.folder else {
            write_data(String::from_utf8(page(command)?)?.trim_end());
            return Ok(Outcome::Well);
        };
        for inner in command.get_subcommands() {
            let name = format!("trilink-{}", inner.get_name());
            let inner = inner.clone().display_name(name.clone());
            write_bytes(&folder.join(format!("{name}.1")), &page(inner)?)?;
        }
        write_bytes(&folder.join("trilink.1"), &page(command)?)?;
        Ok(Outcome::Well)
    }
}

/// Renders the manual page of a command; examples and tables at the end of the help keep their line breaks.
fn page(command: clap::Command) -> std::io::Result<Vec<u8>> {
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let mut page = Vec::new();
    clap_mangen::Man::new(command.after_help(Resettable::Reset)).render(&mut page)?;
    for section in help.split("\n\n").filter(|section| !section.is_empty()) {
        let (heading, lines) = match section.split_once(":\n") {
            Some((heading, lines)) => (heading, lines),
            None => ("Notes", section),
        };
        // Escape backslashes, and full stops and quotes at the start of a line, which roff would take for requests.
        let lines: String =
            lines.lines().map(|line| format!("\\&{}\n", line.replace('\\', "\\e"))).collect();
        write!(page, ".SH {}\n.nf\n{lines}.fi\n", heading.to_uppercase())?;
    }
    Ok(page)
}
