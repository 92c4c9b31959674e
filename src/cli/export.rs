//! `trilink export`.

use std::io::Write as _;
use std::path::PathBuf;

use trilink_tables::write_bytes;

use super::output::{note, say};
use super::{Context, Failure, Outcome};
use crate::export::{ExportFormat, Motion};

/// How a trial is written.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Format {
    /// OpenSim's table of markers, mm; the links' axles and the joints are markers, too.
    Trc,
    /// MCAP with Foxglove's frame transforms and point clouds, m.
    Mcap,
    /// One row per frame.
    Csv,
}

/// Write a trial's markers and poses for OpenSim, for Foxglove or Rerun, or as a table.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/export.txt").trim_end())]
pub(super) struct Export {
    /// Its name, or `FOLDER/ID`.
    trial: String,
    /// For OpenSim, for Foxglove or Rerun, or a table.
    #[arg(long, value_enum)]
    format: Format,
    /// File to write, `-` for standard output [default: TRIAL.FORMAT here].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
}

impl Export {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let motion = Motion::read(&context.config, &self.trial)?;
        let to_stdout = self.output.as_deref().is_some_and(|path| path.as_os_str() == "-");
        let (extension, format) = match self.format {
            Format::Trc => ("trc", ExportFormat::Trc),
            Format::Mcap => ("mcap", ExportFormat::Mcap),
            Format::Csv => ("csv", ExportFormat::Csv),
        };
        let path = self.output.unwrap_or_else(|| format!("{}.{extension}", motion.name).into());
        if !to_stdout && !self.force && path.symlink_metadata().is_ok() {
            let needed = "needed a new file, or --force to replace it";
            return Err(format!("{}: found a file, {needed}", path.display()).into());
        }
        let bytes = motion.write(format);
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
