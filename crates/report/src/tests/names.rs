//! Names of all figures of the paper's campaigns.

use super::*;

/// Names of the figures that show the paper's campaigns but do not correspond to a figure in the paper.
const OTHERS: [&str; 21] = [
    "kinematic-skewed-simulated",
    "kinematic-skewed-wheels",
    "kinematic-skewed-sigma",
    "kinematic-skewed-residuals",
    "kinematic-skewed-starts",
    "kinematic-skewed-profiles",
    "kinematic-skewed-replicates",
    "kinematic-symmetric-sigma",
    "kinematic-symmetric-residuals",
    "kinematic-symmetric-starts",
    "kinematic-symmetric-profiles",
    "kinematic-symmetric-replicates",
    "semi-passive-symmetric-wheels",
    "semi-passive-symmetric-sigma",
    "semi-passive-symmetric-alpha",
    "semi-passive-symmetric-residuals",
    "semi-passive-symmetric-starts",
    "semi-passive-symmetric-profiles",
    "semi-passive-symmetric-replicates",
    "truth",
    "work",
];

/// Returns the file stems of all figures that show the paper's campaigns.
pub(crate) fn all_stems() -> BTreeSet<String> {
    let printed = (3..=20).filter(|nth| *nth != 7).map(|nth| format!("fig{nth:02}"));
    printed.chain(OTHERS.map(str::to_owned)).collect()
}
