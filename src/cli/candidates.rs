//! Names that a shell completes; those of a project are of the one in the current folder, whatever `--config` says.

use clap_complete::{ArgValueCandidates, CompletionCandidate};
use trilink_tables::Explanation;
use trilink_tables::config::Config;

use crate::build::ingested;
use crate::inspect::{Listed, list};

/// Environment variable with which a shell's script asks this program for candidates.
pub(super) const VARIABLE: &str = "TRILINK_COMPLETE";

/// Creates the candidates from the configuration; none if it cannot be read.
fn from_config(
    names: impl Fn(&Config) -> Vec<String> + Send + Sync + 'static,
) -> ArgValueCandidates {
    ArgValueCandidates::new(move || {
        let names = Config::load_or_default(None).map(|config| names(&config));
        names.unwrap_or_default().into_iter().map(CompletionCandidate::new).collect()
    })
}

pub(super) fn campaigns() -> ArgValueCandidates {
    from_config(|config| config.campaign.keys().cloned().collect())
}

pub(super) fn models() -> ArgValueCandidates {
    from_config(|config| config.model.keys().map(|model| model.name().to_owned()).collect())
}

pub(super) fn trials() -> ArgValueCandidates {
    from_config(|config| {
        let trials = ingested(config).unwrap_or_default().trials;
        trials.into_iter().map(|row| row.trial).collect()
    })
}

pub(super) fn tables() -> ArgValueCandidates {
    // A folder of tables has the name `FOLDER/<trial>` in lists.
    let name = |table: Listed| table.name.split('/').next().unwrap_or_default().to_owned();
    from_config(move |config| list(&config.paths.derived).into_iter().map(name).collect())
}

pub(super) fn checks() -> ArgValueCandidates {
    ArgValueCandidates::new(|| {
        // A check is listed as `W030 missing-markers`.
        let codes =
            Explanation::all().filter_map(|explanation| explanation.check.split(' ').next());
        codes.map(CompletionCandidate::new).collect()
    })
}
