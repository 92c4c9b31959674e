//! The figures of campaigns do not depend on what these, their robots and their gaits are called.

use super::*;
use crate::store::RobotParameterRow;
use made_up::SYMMETRIC;

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

/// What the paper's figures are called where the campaigns are not the paper's.
const PRINTED: [(&str, &str); 17] = [
    ("fig03", "semi-passive-symmetric-simulated"),
    ("fig04", "semi-passive-symmetric-from-rest"),
    ("fig05", "semi-passive-symmetric-sweep"),
    ("fig06", "kinematic-symmetric-simulated"),
    ("fig08", "iron-release"),
    ("fig09", "kinematic-skewed-gait"),
    ("fig10", "kinematic-skewed-d-v"),
    ("fig11", "kinematic-symmetric-gait"),
    ("fig12", "kinematic-symmetric-wheels"),
    ("fig13", "kinematic-symmetric-d-v"),
    ("fig14", "semi-passive-symmetric-gait"),
    ("fig15", "semi-passive-symmetric-d-v"),
    ("fig16", "kinematic-skewed-models"),
    ("fig17", "kinematic-symmetric-models"),
    ("fig18", "semi-passive-symmetric-models"),
    ("fig19", "wood-by-gait"),
    ("fig20", "v-by-robot"),
];

const CAMPAIGNS: [&str; 3] = [SKEWED, SYMMETRIC, SEMI_PASSIVE];

/// Names of all figures of the paper's campaigns.
pub fn all_stems() -> BTreeSet<String> {
    PRINTED.iter().map(|(stem, _)| *stem).chain(OTHERS).map(str::to_owned).collect()
}

fn replaced(text: &str, from: [&str; 3], to: [&str; 3]) -> String {
    from.iter().zip(to).fold(text.to_owned(), |text, (from, to)| text.replace(from, to))
}

/// The report of the paper's campaigns under these names, and with other ones of robots and gaits.
fn report_of(campaigns: [&str; 3], folder: &Path) -> Reported {
    let mut tables = MadeUp::of_the_paper();
    let new = |name: &mut String| *name = replaced(name, CAMPAIGNS, campaigns);
    tables.trials.iter_mut().for_each(|row| new(&mut row.campaign));
    tables.fits.iter_mut().for_each(|row| new(&mut row.campaign));
    tables.predictions.iter_mut().for_each(|row| new(&mut row.campaign));
    let derived = folder.join("derived");
    tables.write(&derived);
    let path = derived.join("robot_parameters.parquet");
    let rows = Reader::default().rows_if_there::<RobotParameterRow>(&path).expect("reads");
    let mut rows = rows.expect("is there");
    rows.iter_mut().for_each(|row| row.robot = "iron".to_owned());
    let provenance = crate::store::Provenance { input: "made up".to_owned() };
    RobotParameterRow::to_table(&rows).write(&path, &provenance).expect("writes");
    let raw = folder.join("raw");
    std::fs::create_dir_all(&raw).expect("a folder");
    let mut truth: serde_json::Value = serde_json::from_str(&made_up::truth()).expect("JSON");
    let planted = truth["campaigns"].to_string();
    truth["campaigns"] =
        serde_json::from_str(&replaced(&planted, CAMPAIGNS, campaigns)).expect("JSON");
    std::fs::write(raw.join("truth.json"), truth.to_string()).expect("writes");
    let mut config = config(folder);
    let robots = BTreeMap::from([("kinematic", "wood"), ("semi-passive", "iron")]);
    let gaits = BTreeMap::from([("skewed", "w"), ("symmetric", "v"), ("passive-symmetric", "u")]);
    config.robot =
        robots.iter().map(|(old, new)| ((*new).to_owned(), config.robot[*old].clone())).collect();
    config.gait =
        gaits.iter().map(|(old, new)| ((*new).to_owned(), config.gait[*old].clone())).collect();
    let campaign = |(old, new): (&str, &str)| {
        let mut campaign = config.campaign[old].clone();
        campaign.robot = robots[campaign.robot.as_str()].to_owned();
        campaign.gait = gaits[campaign.gait.as_str()].to_owned();
        (new.to_owned(), campaign)
    };
    config.campaign = CAMPAIGNS.into_iter().zip(campaigns).map(campaign).collect();
    report(&config).expect("reports")
}

#[test]
fn the_figures_are_the_same_panel_for_panel_under_other_names() {
    // In another order than the paper's.
    let campaigns = ["zig", "yam", "amble"];
    let (standard_folder, standard) = standard();
    let folder = temporary();
    let reported = report_of(campaigns, folder.path());
    assert!(reported.missing.is_empty(), "{:?}", reported.missing);
    let new_name = |stem: &str| {
        let printed = PRINTED.iter().find(|(printed, _)| *printed == stem);
        replaced(printed.map_or(stem, |(_, name)| name), CAMPAIGNS, campaigns)
    };
    let expected = standard.figures.iter().map(|stem| new_name(stem)).collect::<BTreeSet<_>>();
    assert_eq!(reported.figures.iter().cloned().collect::<BTreeSet<_>>(), expected);
    for stem in &standard.figures {
        let csv = |folder: &tempfile::TempDir, stem: &str| {
            read(&folder.path().join(format!("reports/figures/{stem}.csv")))
        };
        let (known, found) = (csv(standard_folder, stem), csv(&folder, &new_name(stem)));
        let found =
            replaced(&found, campaigns, CAMPAIGNS).replace("robot iron", "robot semi-passive");
        // Panels and layers of these follow each other by the campaigns' names.
        let lines = |csv: &str| -> Vec<String> {
            let lines = csv.lines().map(|line| line.split_once(',').map_or(line, |(_, rest)| rest));
            let mut lines: Vec<String> = lines.map(str::to_owned).collect();
            lines.sort();
            lines
        };
        let is_by_name = ["truth", "work"].contains(&stem.as_str());
        let are_same = if is_by_name { lines(&known) == lines(&found) } else { known == found };
        assert!(are_same, "{stem} differs from {}", new_name(stem));
    }
    let page = read(&reported.page);
    assert_eq!(page.matches(SHEET).count(), read(&standard.page).matches(SHEET).count());
    assert!(!page.contains("Fig. "), "figures of other campaigns are not the paper's");
}
