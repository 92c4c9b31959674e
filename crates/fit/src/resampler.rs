//! Resampled measurements of one campaign, or of several that are fitted together.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_tables::CycleRow;

use super::measurement::Measurement;
use super::objective::Objective;
use super::resample::{CampaignResampler, DrawnTrial};
use super::trial_noise::TrialNoise;

/// Draws measurements, of each campaign by itself ([`super::resample`]).
pub(super) struct Resampler {
    seed: u64,
    pub measurements: Vec<Measurement>,
    campaigns: Vec<CampaignResampler>,
}

impl Resampler {
    /// Of sorted measurements; `cycles` are those that count, by trial.
    pub(crate) fn new(
        seed: u64,
        measurements: Vec<Measurement>,
        cycles: &BTreeMap<String, Vec<CycleRow>>,
    ) -> Self {
        let of_campaign = |own: &[Measurement]| CampaignResampler::new(own.to_vec(), cycles);
        let campaigns = measurements.chunk_by(|a, b| a.campaign == b.campaign);
        let campaigns = campaigns.map(of_campaign).collect();
        Self { seed, measurements, campaigns }
    }

    /// Random numbers of some purpose, the same for every model of the campaign, whatever its name.
    pub(crate) fn random(&self, purpose: &str, number: usize) -> ChaCha8Rng {
        self.random_of(0, purpose, number)
    }

    /// The same for one of several campaigns: what they draw is independent.
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

    /// Whether nothing differs between resamples.
    pub(crate) fn is_silent(&self) -> bool {
        let gait = |of: &Measurement| of.gait_errors_rad.as_flattened().iter().any(|e| *e > 0.0);
        self.noises().iter().flat_map(ByFitted::values).all(|noise| *noise == 0.0 || noise.is_nan())
            && !self.measurements.iter().any(gait)
    }

    /// Metrics with terms in an objective of which nothing tells the noise.
    pub(crate) fn without_noise(&self, objective: &Objective) -> Vec<&'static str> {
        let noises = self.noises();
        let is_silent = |i: &Metric| {
            let all = self.measurements.iter().zip(&noises);
            let mut with_term = all
                .filter(|(of, _)| objective.terms(of).any(|(metric, ..)| metric == *i))
                .peekable();
            with_term.peek().is_some() && with_term.all(|(_, noises)| noises[*i] == 0.0)
        };
        Metric::FITTED.into_iter().filter(is_silent).map(Metric::name).collect()
    }

    /// Degrees of freedom of all measurements' standard errors together; infinite where nothing tells how
    /// many cycles they are of.
    pub(crate) fn freedom(&self) -> f64 {
        match self.measurements.iter().map(Measurement::freedom).sum() {
            0.0 => f64::INFINITY,
            freedom => freedom,
        }
    }

    /// What every measurement is off by: its noise, and the standard deviations of the trials' own spread.
    pub(crate) fn noises_and_spreads(&self) -> impl Iterator<Item = (&TrialNoise, ByFitted<f64>)> {
        self.campaigns.iter().flat_map(CampaignResampler::noises)
    }

    /// How many times the standard deviation of each metric's noise so many cycles and repeats tell, at random.
    pub(crate) fn told(&self, number: usize) -> Vec<ByFitted<f64>> {
        let of_campaign = |(nth, campaign): (usize, &CampaignResampler)| {
            campaign.told(self.random_of(nth, "told noise", number))
        };
        self.campaigns.iter().enumerate().flat_map(of_campaign).collect()
    }

    /// Standard deviations of what the metrics of every measurement are off by, without bias.
    pub(crate) fn noises(&self) -> Vec<ByFitted<f64>> {
        let both = |(noise, spread): (&TrialNoise, ByFitted<f64>)| {
            ByFitted::from_fn(|i| noise.deviation(i).hypot(spread[i]))
        };
        self.noises_and_spreads().map(both).collect()
    }

    /// The resample with this number; the same for every model of the campaign.
    pub(crate) fn draw(&self, number: usize) -> Vec<DrawnTrial> {
        self.draw_by(number, ["", "gait"], CampaignResampler::draw)
    }

    /// The same with frequencies drawn, too, by random numbers of its own.
    pub(crate) fn draw_frequencies(&self, number: usize) -> Vec<DrawnTrial> {
        let purposes = ["frequencies", "trials of frequencies", "gait of frequencies"];
        self.draw_by(number, purposes, CampaignResampler::draw_frequencies)
    }

    /// Of each campaign by itself, by random numbers of these purposes.
    fn draw_by<const N: usize>(
        &self,
        number: usize,
        purposes: [&str; N],
        draw: fn(&CampaignResampler, [ChaCha8Rng; N]) -> Vec<DrawnTrial>,
    ) -> Vec<DrawnTrial> {
        let (mut drawn, mut first) = (Vec::with_capacity(self.measurements.len()), 0);
        for (nth, campaign) in self.campaigns.iter().enumerate() {
            let random = purposes.map(|purpose| self.random_of(nth, purpose, number));
            let of_campaign = draw(campaign, random).into_iter();
            drawn.extend(of_campaign.map(|of| DrawnTrial { index: first + of.index, ..of }));
            first += campaign.measurements.len();
        }
        drawn
    }
}
