//! Synthetic rows for the table of trials.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_tables::{Columns as _, TrialRow};

/// Returns a trial whose metrics are those of `motion` plus normal noise. The relative standard errors are `of_d` for d
/// and v, and `of_sigma` for the skid ratios.
pub fn noisy_trial(
    campaign: &str,
    (omega_rad_s, motion): &(f64, GaitMetrics),
    [of_d, of_sigma]: [f64; 2],
    random: &mut ChaCha8Rng,
) -> TrialRow {
    let mut normal = || -> f64 { StandardNormal.sample(random) };
    let by = 1.0 + of_d * normal();
    let metrics = GaitMetrics {
        d_m: motion.d_m * by,
        v_m_s: motion.v_m_s * by,
        sigma: padded(&[0, 1, 2].map(|wheel| motion.sigma[wheel] * (1.0 + of_sigma * normal()))),
        ..*motion
    };
    let metrics_se = GaitMetrics {
        d_m: motion.d_m * of_d,
        v_m_s: motion.v_m_s * of_d,
        sigma: motion.sigma.map(|sigma| sigma * of_sigma),
        ..GaitMetrics::MISSING
    };
    TrialRow {
        trial: format!("at-{omega_rad_s}"),
        campaign: campaign.to_owned(),
        omega_commanded_rad_s: *omega_rad_s,
        omega_rad_s: *omega_rad_s,
        metrics,
        metrics_se,
        ..TrialRow::blank()
    }
}
