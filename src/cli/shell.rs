//! `trilink completions` and `trilink man`.

use std::path::PathBuf;

use clap::CommandFactory;
use clap_complete::Shell;

use super::output::say;
use super::{Arguments, Failure, Outcome};
use crate::store::write_bytes;

#[derive(clap::Args)]
pub(super) struct Completions {
    /// Whose.
    shell: Shell,
}

#[derive(clap::Args)]
pub(super) struct Man {
    /// Write a page for every command into this folder instead.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
}

impl Completions {
    pub fn run(self) -> Result<Outcome, Failure> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Arguments::command(), "trilink", &mut script);
        say!("{}", String::from_utf8(script)?.trim_end());
        Ok(Outcome::Well)
    }
}

impl Man {
    pub fn run(self) -> Result<Outcome, Failure> {
        let mut command = Arguments::command();
        command.build();
        let Some(folder) = self.folder else {
            say!("{}", String::from_utf8(page(command)?)?.trim_end());
            return Ok(Outcome::Well);
        };
        let commands: Vec<clap::Command> =
            command.get_subcommands().filter(|inner| !inner.is_hide_set()).cloned().collect();
        for inner in commands.into_iter().filter(|inner| inner.get_name() != "help") {
            let name = format!("trilink-{}", inner.get_name());
            let inner = inner.display_name(name.clone());
            write_bytes(&folder.join(format!("{name}.1")), &page(inner)?)?;
        }
        write_bytes(&folder.join("trilink.1"), &page(command)?)?;
        Ok(Outcome::Well)
    }
}

/// A page of the manual.
fn page(command: clap::Command) -> std::io::Result<Vec<u8>> {
    let mut page = Vec::new();
    clap_mangen::Man::new(command).render(&mut page)?;
    Ok(page)
}
