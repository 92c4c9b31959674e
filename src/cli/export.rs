//! `trilink export`.

use std::io::Write as _;
use std::path::PathBuf;

use super::output::{note, say};
use super::{Context, Failure, Outcome};
use crate::export::{ExportFormat, Motion};
use crate::store::write_bytes;

#[derive(clap::Args)]
pub(super) struct Export {
    /// Its name, or `FOLDER/ID`.
    trial: String,
    /// For OpenSim, for Foxglove or Rerun, or a table.
    #[arg(long, value_enum)]
    format: ExportFormat,
    /// File to write, `-` for standard output [default: TRIAL.FORMAT here].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace a file that is there.
    #[arg(long)]
    force: bool,
}

impl Export {
    pub fn run(self, context: &Context) -> Result<Outcome, Failure> {
        let motion = Motion::read(&context.config, &self.trial)?;
        let to_stdout = self.output.as_deref().is_some_and(|path| path.as_os_str() == "-");
        let extension = match self.format {
            ExportFormat::Trc => "trc",
            ExportFormat::Mcap => "mcap",
            ExportFormat::Csv => "csv",
        };
        let path = self.output.unwrap_or_else(|| format!("{}.{extension}", motion.name).into());
        if !to_stdout && !self.force && path.symlink_metadata().is_ok() {
            let needed = "needed a new file, or --force to replace it";
            return Err(format!("{}: found a file, {needed}", path.display()).into());
        }
        let bytes = motion.write(self.format);
        match to_stdout {
            true => {
                let mut to = std::io::stdout().lock();
                match to.write_all(&bytes).and_then(|()| to.flush()) {
                    // Nobody reads any more.
                    Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {}
                    written => written.map_err(|error| format!("standard output: {error}"))?,
                }
            }
            false => {
                write_bytes(&path, &bytes)?;
                say!("{}", path.display());
            }
        }
        Ok(match &motion.without_poses {
            None => Outcome::Well,
            Some(why) => {
                note!("trial {}: markers without poses, because {why}", motion.name);
                Outcome::NeedsAttention
            }
        })
    }
}
