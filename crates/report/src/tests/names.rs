//! Names of figures.

use super::*;

/// Figures that the paper did not print, as its campaigns have them.
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

/// Names of all figures of the paper's campaigns.
pub(crate) fn all_stems() -> BTreeSet<String> {
    let printed = (3..=20).filter(|nth| *nth != 7).map(|nth| format!("fig{nth:02}"));
    printed.chain(OTHERS.map(str::to_owned)).collect()
}
