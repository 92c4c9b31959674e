//! `trilink export`.

use std::io::Write as _;
use std::path::PathBuf;

use trilink_tables::write_bytes;

use super::output::{note, say};
use super::{Context, Failure, Outcome, candidates};
use crate::export::{ExportFormat, Motion};

/// Format of an exported trial.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Format {
    /// Marker table for OpenSim, in mm; includes the wheel axles and the joints as markers.
    Trc,
    /// MCAP with frame transforms and point clouds for Foxglove or Rerun, in m.
    Mcap,
    /// One row per frame.
    Csv,
}

/// Write a trial's markers and poses for OpenSim, for Foxglove or Rerun, or as a table.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/export.txt").trim_end())]
pub(super) struct Export {
    /// Name of the trial, or `FOLDER/ID`.
    #[arg(add = candidates::trials())]
    trial: String,
    /// File format.
    #[arg(long, value_enum)]
    format: Format,
    /// File to write, `-` for standard output [default: TRIAL.FORMAT in the current folder].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

impl Export {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        context.check_results()?;
        let motion = Motion::read(&context.config, &self.trial)?;
        let to_stdout = self.output.as_deref().is_some_and(|path| path.as_os_str() == "-");
        let (extension, format) = match self.format {
            Format::Trc => ("trc", ExportFormat::Trc),
            Format::Mcap => ("mcap", ExportFormat::Mcap),
            Format::Csv => ("csv", ExportFormat::Csv),
        };
        let path = self.output.unwrap_or_else(|| format!("{}.{extension}", motion.name).into());
        if !to_stdout && !self.force && path.symlink_metadata().is_ok() {
            return Err(
                format!("{}: file already exists; --force replaces it", path.display()).into()
            );
        }
        let bytes = motion.write(format);
        if to_stdout {
            let mut stdout = std::io::stdout().lock();
            match stdout.write_all(&bytes).and_then(|()| stdout.flush()) {
                // The reader has closed the pipe.
                Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {}
                written => written.map_err(|error| format!("standard output: {error}"))?,
            }
        } else {
            write_bytes(&path, &bytes)?;
            say!("{}", path.display());
        }
        Ok(match &motion.without_poses {
            None => Outcome::Well,
            Some(why) => {
                note!("trial {}: exported markers without poses, because {why}", motion.name);
                Outcome::NeedsAttention
            }
        })
    }
}
