//! Log: appended to a file with `--log`, printed to standard error with `-v`.

use std::fs::OpenOptions;
use std::path::Path;
use std::sync::Arc;

use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::fmt::layer;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry;
use tracing_subscriber::util::SubscriberInitExt;

use super::Failure;
use super::output::Lines;

/// Starts logging: appends to `file`, if one is given, and writes to standard error if `verbose`, the number of options
/// `-v`, is not 0. A process can start logging only once.
pub(super) fn begin(file: Option<&Path>, verbose: u8) -> Result<(), Failure> {
    if file.is_none() && verbose == 0 {
        return Ok(());
    }
    let shown = match verbose {
        0 => LevelFilter::OFF,
        1 => LevelFilter::INFO,
        _ => LevelFilter::DEBUG,
    };
    let to_file = file
        .map(|path| {
            let opened = OpenOptions::new().create(true).append(true).open(path);
            let opened = opened.map_err(|error| format!("--log: {}: {error}", path.display()))?;
            let file = Arc::new(opened);
            let lines = move || Lines(Arc::clone(&file));
            let lines = layer().with_ansi(false).with_target(false).with_writer(lines);
            Ok::<_, Failure>(lines.with_filter(LevelFilter::DEBUG))
        })
        .transpose()?;
    let lines = || Lines(std::io::stderr());
    let to_terminal = layer().with_ansi(false).with_target(false).with_writer(lines);
    let both = registry().with(to_terminal.with_filter(shown)).with(to_file);
    both.try_init().map_err(|_| {
        "--log, --verbose: an earlier command in this process has already started a log".into()
    })
}
