//! Wheels and joints whose metrics have columns in the tables of trials and cycles.

use std::collections::{BTreeMap, BTreeSet};

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_robot::metrics::GaitMetrics;
use trilink_tables::config::RobotConfig;
use trilink_tables::{CycleRow, TrialRow};

use crate::ReportInput;
use crate::figures::subscripted;
use crate::recording::Recording;

/// Wheels and joints for which a table has columns: the numbers of the links of the wheels, and the indices of the joints.
#[derive(Debug, Default)]
pub(super) struct Parts {
    pub wheels: BTreeSet<usize>,
    pub joints: BTreeSet<usize>,
}

impl Parts {
    /// Returns the wheels and joints of a robot of three links.
    fn of_three_links() -> Self {
        Self { wheels: [0, 1, 2].into(), joints: [0].into() }
    }

    /// Returns the wheels of a campaign's robot, and all wheels and joints for which `metrics` have values.
    fn new<'m>(
        campaign: &str,
        metrics: impl Iterator<Item = &'m GaitMetrics>,
        input: &ReportInput,
    ) -> Self {
        let mut parts = if input.is_chain(campaign) {
            let wheels =
                (0..input.links(campaign).len()).filter(|of| input.has_wheel(campaign, *of));
            Self { wheels: wheels.collect(), joints: BTreeSet::new() }
        } else {
            Self::of_three_links()
        };
        let known = |values: &[f64]| -> Vec<usize> {
            (0..values.len()).filter(|i| values[*i].is_finite()).collect()
        };
        for GaitMetrics { sigma, alpha_rad, .. } in metrics {
            parts.wheels.extend(known(sigma));
            parts.joints.extend(known(alpha_rad));
        }
        parts
    }

    /// Returns the wheels and joints of the cycles of a trial.
    pub(super) fn of_cycles(
        trial: &TrialRow,
        recording: Option<&Recording>,
        input: &ReportInput,
    ) -> Self {
        let cycles = recording.into_iter().flat_map(|recording| &recording.cycles);
        Self::new(&trial.campaign, cycles.map(|cycle| &cycle.metrics), input)
    }

    /// Returns the wheels and joints of all trials; those of a robot of three links if no trial has metrics.
    pub(super) fn of_trials(trials: &[TrialRow], input: &ReportInput) -> Self {
        let campaigns: BTreeSet<&str> = trials.iter().map(|trial| &*trial.campaign).collect();
        let mut all = Self::default();
        for campaign in campaigns.into_iter().filter(|campaign| !campaign.is_empty()) {
            let own = trials.iter().filter(|trial| trial.campaign == campaign);
            let Self { wheels, joints } =
                Self::new(campaign, own.map(|trial| &trial.metrics), input);
            all.wheels.extend(wheels);
            all.joints.extend(joints);
        }
        if all.wheels.is_empty() && all.joints.is_empty() { Self::of_three_links() } else { all }
    }

    /// Returns the template values of the column headings: symbols and names of the wheels, and symbols of the joints.
    /// `links` are the names of the links by number; a wheel whose link has no name is unnamed.
    pub(super) fn heads(&self, links: &[String]) -> Value {
        let wheels = self
            .wheels
            .iter()
            .map(|wheel| (subscripted('σ', *wheel), links.get(*wheel).map_or("", String::as_str)));
        let joints = self.joints.iter().map(|joint| subscripted('α', joint + 1));
        context! {
            wheels => Serde(wheels.collect::<Vec<_>>()),
            joints => joints.collect::<Vec<_>>(),
        }
    }

    /// Returns the cycles of a recording with the skid ratios and amplitudes (rad) in the columns.
    pub(super) fn cycles<'r>(
        &self,
        recording: &'r Recording,
    ) -> Vec<(&'r CycleRow, Vec<f64>, Vec<f64>)> {
        let cycles = recording.cycles.iter().map(|cycle| {
            let sigma = self.wheels.iter().map(|wheel| cycle.metrics.sigma[*wheel]);
            let alpha_rad = self.joints.iter().map(|joint| cycle.metrics.alpha_rad[*joint]);
            (cycle, sigma.collect(), alpha_rad.collect())
        });
        cycles.collect()
    }
}

/// Names of the wheels in a table of trials.
pub(super) struct WheelNames<'t> {
    /// Names by number, for the headings of the columns; empty if the links of the robots have different names.
    pub in_head: Vec<String>,
    /// In this case, the symbols of the skid ratios with the names of the wheels, by campaign; otherwise empty.
    pub of_campaigns: BTreeMap<&'t str, String>,
}

impl<'t> WheelNames<'t> {
    pub(super) fn new(trials: &'t [TrialRow], input: &ReportInput) -> Self {
        let campaigns: BTreeSet<&str> = trials.iter().map(|trial| &*trial.campaign).collect();
        let campaigns = campaigns.into_iter().filter(|campaign| !campaign.is_empty());
        let links: BTreeMap<&str, Vec<String>> =
            campaigns.map(|campaign| (campaign, input.links(campaign))).collect();
        let distinct: BTreeSet<&Vec<String>> = links.values().collect();
        let in_head = match distinct.len() {
            0 => Some(RobotConfig::THREE_LINKS.map(str::to_owned).into()),
            1 => distinct.into_iter().next().cloned(),
            _ => None,
        };
        let of_campaigns = links.iter().filter(|_| in_head.is_none()).map(|(campaign, links)| {
            let wheels = links.iter().enumerate();
            let wheels = wheels.filter(|(wheel, _)| input.has_wheel(campaign, *wheel));
            let wheels = wheels.map(|(wheel, link)| format!("{} {link}", subscripted('σ', wheel)));
            (*campaign, wheels.collect::<Vec<_>>().join(", "))
        });
        let of_campaigns = of_campaigns.collect();
        Self { in_head: in_head.unwrap_or_default(), of_campaigns }
    }
}
