//! Resampling of measurements from one campaign, or from several that are fitted together.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_tables::CycleRow;

use super::measurement::Measurement;
use super::objective::Objective;
use super::resample::{CampaignResampler, DrawnTrial};
use super::trial_noise::TrialNoise;

/// Resampler that draws the measurements of each campaign independently ([`super::resample`]).
pub(super) struct Resampler {
    seed: u64,
    pub measurements: Vec<Measurement>,
    campaigns: Vec<CampaignResampler>,
}

impl Resampler {
    /// Prepares measurements, which must be sorted by [`Measurement::order`], for resampling; `cycles` are the tables
    /// of cycles by trial name.
    pub(crate) fn new(
        seed: u64,
        measurements: Vec<Measurement>,
        cycles: &BTreeMap<String, Vec<CycleRow>>,
    ) -> Self {
        let campaigns = measurements.chunk_by(|a, b| a.campaign == b.campaign);
        let campaigns = campaigns.map(|own| CampaignResampler::new(own.to_vec(), cycles)).collect();
        Self { seed, measurements, campaigns }
    }

    /// Creates the random generator for a purpose and an index. Its seed depends neither on the model nor on the name
    /// of the campaign.
    pub(crate) fn random(&self, purpose: &str, number: usize) -> ChaCha8Rng {
        self.random_of(0, purpose, number)
    }

    /// Creates the random generator for a purpose and an index; the generators of different campaigns are independent.
    fn random_of(&self, campaign: usize, purpose: &str, number: usize) -> ChaCha8Rng {
        let mut hash = blake3::Hasher::new();
        hash.update(&self.seed.to_le_bytes());
        hash.update(&(number as u64).to_le_bytes());
        hash.update(purpose.as_bytes());
        if campaign > 0 {
            hash.update(&(campaign as u64).to_le_bytes());
        }
        ChaCha8Rng::from_seed(*hash.finalize().as_bytes())
    }

    /// Whether the measurements have no noise, so that all resamples are equal.
    pub(crate) fn is_noise_free(&self) -> bool {
        self.noises().iter().flat_map(ByFitted::values).all(|noise| *noise == 0.0 || noise.is_nan())
            && !self.measurements.iter().any(|measurement| {
                measurement.gait_errors_rad.as_flattened().iter().any(|error| *error > 0.0)
            })
    }

    /// Returns the names of the metrics that are in the objective but whose noise is not known.
    pub(crate) fn metrics_without_noise(&self, objective: &Objective) -> Vec<&'static str> {
        let noises = self.noises();
        let unknown = Metric::FITTED.into_iter().filter(|i| {
            let mut with_term = self
                .measurements
                .iter()
                .zip(&noises)
                .filter(|(of, _)| objective.terms(of).any(|(metric, ..)| metric == *i))
                .peekable();
            with_term.peek().is_some() && with_term.all(|(_, noises)| noises[*i] == 0.0)
        });
        unknown.map(Metric::name).collect()
    }

    /// Returns the pooled degrees of freedom of all standard errors; infinite if no trial has a known number of cycles.
    pub(crate) fn degrees_of_freedom(&self) -> f64 {
        match self.measurements.iter().map(Measurement::degrees_of_freedom).sum() {
            0.0 => f64::INFINITY,
            degrees_of_freedom => degrees_of_freedom,
        }
    }

    /// Returns the noise of every trial due to its cycles.
    fn all_noises(&self) -> impl Iterator<Item = &TrialNoise> {
        self.campaigns.iter().flat_map(|campaign| &campaign.noises)
    }

    /// Returns the noise of the trial with the given index due to its cycles.
    pub(crate) fn noise(&self, mut index: usize) -> &TrialNoise {
        for campaign in &self.campaigns {
            if let Some(noise) = campaign.noises.get(index) {
                return noise;
            }
            index -= campaign.noises.len();
        }
        unreachable!("the index is that of a measurement")
    }

    /// Draws, for each trial, the ratio of the estimated to the true standard deviation of the noise due to its cycles,
    /// given their number.
    pub(crate) fn noise_ratios(&self, number: usize) -> Vec<f64> {
        let campaigns = self.campaigns.iter().enumerate();
        campaigns
            .flat_map(|(nth, campaign)| {
                campaign.noise_ratios(self.random_of(nth, "told noise", number))
            })
            .collect()
    }

    /// Returns the unbiased standard deviations of the metrics of every trial due to its cycles.
    pub(crate) fn noises(&self) -> Vec<ByFitted<f64>> {
        self.all_noises().map(|noise| ByFitted::from_fn(|i| noise.deviation(i))).collect()
    }

    /// Draws the noise of all trials due to their cycles; the noise with a given index is the same for every model of a
    /// campaign.
    pub(crate) fn draw_noise(&self, number: usize) -> Vec<DrawnTrial> {
        self.draw_campaigns(number, ["", "gait"], CampaignResampler::draw_noise)
    }

    /// Draws the resample with the given index, in which frequencies are resampled, too.
    pub(crate) fn draw_frequencies(&self, number: usize) -> Vec<DrawnTrial> {
        let purposes = ["frequencies", "trials of frequencies", "gait of frequencies"];
        self.draw_campaigns(number, purposes, CampaignResampler::draw_frequencies)
    }

    /// Draws a resample of each campaign independently with `draw`, and concatenates these resamples; `draw` gets one
    /// random generator for each of the given purposes.
    fn draw_campaigns<const N: usize>(
        &self,
        number: usize,
        purposes: [&str; N],
        draw: fn(&CampaignResampler, [ChaCha8Rng; N]) -> Vec<DrawnTrial>,
    ) -> Vec<DrawnTrial> {
        let mut drawn = Vec::with_capacity(self.measurements.len());
        let mut first = 0;
        for (nth, campaign) in self.campaigns.iter().enumerate() {
            let random = purposes.map(|purpose| self.random_of(nth, purpose, number));
            let own = draw(campaign, random).into_iter();
            drawn.extend(own.map(|of| DrawnTrial { index: first + of.index, ..of }));
            first += campaign.measurements.len();
        }
        drawn
    }
}
