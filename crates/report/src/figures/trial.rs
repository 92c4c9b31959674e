//! Figures on a trial page: path, joint angles, wheel velocities, cycles, residuals and gaps.

use minijinja::context;
use minijinja::value::Value;
use trilink_base::numbers::significant;
use trilink_plot::envelope;
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range, Scale};
use trilink_robot::metrics::Metric;
use trilink_statistics::mean;
use trilink_tables::trial::TrialKind;
use trilink_tables::{CycleRow, Fill, TrialRow};

use super::common::{
    DEG, angle, lines, link_noun, links, links_at_start, map, time_course, travel,
};
use super::texts::texts;
use super::tracking;
use crate::ReportInput;
use crate::looks;
use crate::recording::Recording;
use crate::series::{Quantity, fitted};
use crate::tables::Tables;

/// Number of time intervals into which a trial is divided to show the largest residual in each.
const PARTS: usize = 100;
/// Number of intervals into which a long curve is divided to show the minimum and maximum in each.
const DENSE_PARTS: usize = 400;

/// Returns the figures for a trial page, without those for which the recording has no data.
pub(crate) fn figures(
    trial: &TrialRow,
    recording: &Recording,
    (tables, config): (&Tables, &ReportInput),
) -> Vec<Figure> {
    let unused = unused_cycles(trial, recording);
    let panel = |title: &str, y_label: &str, layers: Vec<Layer>| {
        time_course(title, y_label, unused.iter().cloned().chain(layers).collect())
    };
    let over_time = |values: &[f64], factor: f64| -> Vec<(f64, f64)> {
        let values = values.iter().map(|value| factor * value);
        recording.time_s.iter().copied().zip(values).collect()
    };
    // Vertical axes show the cycles in use; what happens before and after may be larger.
    let in_use = times_in_use(trial, recording);
    let used = |values: &[f64], factor: f64| {
        let values =
            values.iter().zip(&recording.time_s).filter(|(_, time_s)| in_use.contains(time_s));
        Range::enclosing(values.map(|(value, _)| factor * value))
    };
    // Each component has its own panel, because overlapping lines would hide each other.
    let course = |title: String, y_label: &str, values: &[f64], factor: f64| {
        let points = envelope(&over_time(values, factor), DENSE_PARTS).concat();
        let panel = panel(&title, y_label, vec![Layer::new("measured", points, looks::RECORDED)]);
        Panel { shown: used(values, factor).map(with_margin), ..panel }
    };
    let angles = recording
        .phi_rad
        .iter()
        .zip((0..).map(angle))
        .map(|(phi_rad, joint)| {
            course(format!("Joint angle {joint}"), &format!("{joint} (deg)"), phi_rad, DEG)
        })
        .collect();
    let names = config.links(&trial.campaign);
    let is_chain = config.is_chain(&trial.campaign);
    let name_of = |link: usize| names.get(link).filter(|_| is_chain);
    let wheels = [("Roll", &recording.roll_m_s), ("Skid", &recording.skid_m_s)].into_iter();
    let wheels = wheels.flat_map(|(kind, all_m_s)| {
        let title = |wheel: usize| {
            let name = name_of(wheel).map_or(String::new(), |name| format!(" ({name})"));
            format!("{kind} velocity of wheel {wheel}{name}")
        };
        let y_label = format!("{kind} (mm/s)");
        // The wheels share one scale, so that they can be compared.
        let ranges = all_m_s.iter().filter_map(|m_s| used(m_s, 1e3));
        let covered = Range::enclosing(ranges.flat_map(|range| [range.low, range.high]));
        let shown = covered.map(with_margin);
        all_m_s
            .iter()
            .enumerate()
            .filter(|(wheel, _)| config.has_wheel(&trial.campaign, *wheel))
            .map(|(wheel, m_s)| Panel {
                covered,
                shown,
                ..course(title(wheel), &y_label, m_s, 1e3)
            })
            .collect::<Vec<_>>()
    });
    let name = |link: usize| {
        name_of(link).map_or_else(|| format!("link {link}"), |name| format!("{link}: {name}"))
    };
    let of_links: Vec<String> = (0..recording.residual_mm.len()).map(name).collect();
    let residuals = lines(&of_links, |link| {
        let ends = envelope(&over_time(&recording.residual_mm[link], 1.0), PARTS);
        ends.into_iter().map(|[a, b]| if b.1 >= a.1 { b } else { a }).collect()
    });
    let figure = |stem: &str, values: Value, layout: Layout, panels: Vec<Panel>| {
        Figure::new(stem, texts(stem, values), &[], layout, panels)
    };
    let smoothing_window = trial.smoothing_window;
    let errors_mm_s = velocity_errors_mm_s(recording, &in_use);
    let values = context! { smoothing_window, errors_mm_s, unused => !unused.is_empty() };
    let angles = figure("angles", values.clone(), Layout::Pairs, angles);
    let velocities = figure("velocities", values, Layout::Grid, wheels.collect());
    let residuals = panel("Residuals", "Residual (mm)", residuals);
    let gaps = time_course("Gaps", "Link", gaps(recording));
    let gaps = Panel { y_scale: Scale::Whole, ..gaps };
    let reconstruction =
        figure("reconstruction", context! { parts => PARTS }, Layout::Stack, vec![residuals, gaps]);
    // Models without a motion are simply absent from the legend, so sentences about them are discarded.
    let motion = tracking::figure("gait", trial, recording, (tables, config), &mut Vec::new());
    let own =
        [path(trial, recording, config), angles, velocities, cycles(trial, recording, config)];
    let all = motion.into_iter().chain(own).chain([reconstruction]);
    all.filter(|figure| !figure.is_empty()).collect()
}

/// Returns the RMS standard errors of the roll and skid velocities of all wheels in the used cycles, mm/s; `None` if they
/// are unknown.
fn velocity_errors_mm_s(
    recording: &Recording,
    in_use: &std::ops::RangeInclusive<f64>,
) -> Option<[String; 2]> {
    let errors = recording.velocity_errors.as_ref()?;
    let rms_mm_s = [&errors.roll_m_s, &errors.skid_m_s].map(|of_wheels| {
        let all = of_wheels.iter().flat_map(|errors| errors.iter().zip(&recording.time_s));
        let used = all.filter(|(error, time_s)| in_use.contains(time_s) && !error.is_nan());
        1e3 * mean(used.map(|(error_m_s, _)| error_m_s * error_m_s)).sqrt()
    });
    rms_mm_s.iter().all(|rms| rms.is_finite()).then(|| rms_mm_s.map(|rms| significant(rms, 2)))
}

fn path(trial: &TrialRow, recording: &Recording, config: &ReportInput) -> Figure {
    let all: Vec<(f64, f64)> =
        recording.x_m.iter().copied().zip(recording.y_m.iter().copied()).collect();
    let seen: Vec<(f64, f64)> = all.iter().copied().filter(|(x, y)| (x + y).is_finite()).collect();
    let mut layers = Vec::new();
    let start = (0..all.len()).find_map(|i| recording.pose(i));
    let links =
        start.zip(config.setup(&trial.campaign)).and_then(|((pose, phi_rad), (robot, _))| {
            links(&robot, pose, phi_rad.get(..recording.phi_rad.len())?)
        });
    if let Some(links) = links {
        layers.extend([links_at_start(links), travel(&seen, &[])]);
    }
    layers.push(Layer::new("measured", all, looks::RECORDED));
    let texts = texts("path", context! { gait => trial.kind == TrialKind::Gait });
    let panels = vec![map(path_title(trial, config), layers)];
    Figure::new("path", texts, &[], Layout::Stack, panels)
}

/// Returns the title of a map of the robot's path in a trial, which names link 0.
pub(super) fn path_title(trial: &TrialRow, config: &ReportInput) -> String {
    let links = config.links(&trial.campaign);
    format!("Path of {}", links.first().map_or("link 0".to_owned(), |name| link_noun(name)))
}

/// Returns the figure of the metrics of each cycle, with their means over the used cycles.
fn cycles(trial: &TrialRow, recording: &Recording, config: &ReportInput) -> Figure {
    let links = &config.links(&trial.campaign);
    let is_shown = |metric: &Metric| {
        let mut values = recording.cycles.iter().map(|cycle| cycle.metrics[*metric]);
        let is_always_shown = metric.is_of_three_links() && !config.is_chain(&trial.campaign);
        is_always_shown || values.any(f64::is_finite)
    };
    let quantities = fitted().filter(is_shown);
    let panels = quantities
        .map(|metric| Quantity::of_links(metric, links))
        .map(|quantity| {
            let kinds = [("not used", looks::UNUSED, false), ("used", looks::measured(0), true)];
            let mean = Layer::new("mean", [(f64::NAN, quantity.of(&trial.metrics))], Look::Guides);
            let values = recording.cycles.iter().map(|cycle| (cycle, quantity.of(&cycle.metrics)));
            let used = values.clone().filter(|(cycle, _)| cycle.used).map(|(_, value)| value);
            let shown = Range::enclosing(used).map(with_margin);
            let is_off =
                |value: f64| shown.is_some_and(|shown| !value.is_nan() && !shown.contains(value));
            let off = values.filter(|(_, value)| is_off(*value)).count();
            let beyond = if off > 0 { format!("{off} off the scale") } else { String::new() };
            let layers = [mean]
                .into_iter()
                .chain(kinds.map(|(name, look, used)| {
                    let cycles = recording.cycles.iter().filter(|cycle| cycle.used == used);
                    let points =
                        cycles.map(|cycle| (cycle.cycle as f64, quantity.of(&cycle.metrics)));
                    Layer::new(name, points, look)
                }))
                .collect();
            Panel {
                x_scale: Scale::Whole,
                shown,
                beyond,
                ..Panel::new(quantity.title, "Cycle", quantity.axis_label(), layers)
            }
        })
        .collect();
    Figure::new("cycles", texts("cycles", context! {}), &[], Layout::Grid, panels)
}

/// Returns a range extended on both sides by a quarter of its span.
fn with_margin(Range { low, high }: Range) -> Range {
    let margin = 0.25 * (high - low) + 1e-3 * low.abs().max(high.abs());
    Range { low: low - margin, high: high + margin }
}

/// Returns the times from the start of the first cycle in use to the end of the last, s; all times if none is in use.
fn times_in_use(trial: &TrialRow, recording: &Recording) -> std::ops::RangeInclusive<f64> {
    let mut starts_s =
        recording.cycles.iter().filter(|cycle| cycle.used).map(|cycle| cycle.start_s);
    let first_s = starts_s.next().unwrap_or(f64::NEG_INFINITY);
    let last_s = starts_s.next_back().unwrap_or(first_s);
    let is_used = first_s.is_finite();
    first_s..=if is_used {
        last_s + std::f64::consts::TAU / trial.omega_rad_s
    } else {
        f64::INFINITY
    }
}

/// Returns the layers that shade the times outside the cycles in use (cycles that enter the trial means); empty if no
/// cycle is in use.
fn unused_cycles(trial: &TrialRow, recording: &Recording) -> Vec<Layer> {
    let period_s = std::f64::consts::TAU / trial.omega_rad_s;
    let band = |from_s, to_s| {
        Layer::new("not used", [(from_s, f64::NAN), (to_s, f64::NAN)], Look::Band(looks::BAND))
    };
    let mut bands = Vec::new();
    let mut end_s = f64::NAN;
    for CycleRow { start_s, .. } in recording.cycles.iter().filter(|cycle| cycle.used) {
        // The end and start times of consecutive cycles agree within rounding errors.
        let follows = *start_s <= end_s + 1e-3 * period_s;
        bands.extend((!follows).then(|| band(end_s, *start_s)));
        end_s = start_s + period_s;
    }
    let is_longer = recording.time_s.last().is_some_and(|last_s| *last_s > end_s);
    bands.extend(is_longer.then(|| band(end_s, f64::NAN)));
    bands
}

/// Returns the layers with the time spans in which the pose of each link was not measured, but found from other
/// markers, interpolated or missing.
fn gaps(recording: &Recording) -> Vec<Layer> {
    const KINDS: [(Fill, &str); 3] = [
        (Fill::Rigid, "other markers"),
        (Fill::Interpolated, "interpolated"),
        (Fill::Missing, "missing"),
    ];
    let (Some(first_s), Some(last_s)) = (recording.time_s.first(), recording.time_s.last()) else {
        return Vec::new();
    };
    // Each bar extends 0.5 above and below its centre, so that the bars of neighbouring links touch.
    let bar = |from_s, to_s, link| [(from_s, link, 0.5), (to_s, link, 0.5)];
    let links = (0..recording.fill.len()).map(|link| link as f64);
    let recorded = links.clone().flat_map(|link| bar(*first_s, *last_s, link));
    let mut layers = vec![Layer::with_errors("", recorded, Look::Spans(looks::BAND))];
    for (nth, (fill, name)) in KINDS.into_iter().enumerate() {
        let mut bars = Vec::new();
        for (fills, link) in recording.fill.iter().zip(links.clone()) {
            let mut i = 0;
            for run in fills.chunk_by(|a, b| a == b) {
                let from_s = recording.time_s[i];
                let to_s = recording.time_s[i + run.len() - 1];
                i += run.len();
                bars.extend(bar(from_s, to_s, link).into_iter().filter(|_| run[0] == fill));
            }
        }
        layers.push(Layer::with_errors(name, bars, looks::gap(nth)));
    }
    layers
}

#[cfg(test)]
mod tests {
    use trilink_tables::{Columns as _, WheelVelocityErrors};

    use super::*;

    #[test]
    fn the_caption_of_kalman_smoothed_velocities_states_their_errors() {
        let errors =
            |m_s: f64| [vec![9.0, m_s, m_s], vec![9.0, m_s, f64::NAN], vec![9.0, m_s, m_s]];
        let caption = |skid_m_s: f64| -> String {
            let of = WheelVelocityErrors {
                roll_m_s: errors(1.5e-3).into(),
                skid_m_s: errors(skid_m_s).into(),
            };
            let time_s = vec![0.0, 1.0, 2.0];
            let recording = Recording { time_s, velocity_errors: Some(of), ..Recording::default() };
            let errors_mm_s = velocity_errors_mm_s(&recording, &(0.5..=2.0));
            let values = context! { smoothing_window => 0, errors_mm_s, unused => true };
            let [_, caption] = texts("velocities", values);
            caption
        };
        assert_eq!(
            caption(8e-4),
            "Velocities are smoothed by the Kalman smoother; RMS of their standard errors in the used cycles: roll 1.5, \
             skid 0.80 mm/s. Shaded: outside the used cycles, and where necessary off the scale."
        );
        assert_eq!(
            caption(f64::NAN),
            "Velocities are smoothed by the Kalman smoother; their standard errors are unknown. Shaded: outside the used \
             cycles, and where necessary off the scale."
        );
    }

    #[test]
    fn times_outside_the_used_cycles_are_shaded() {
        let cycle = |start_s: f64, used| CycleRow { start_s, used, ..CycleRow::blank() };
        let recording = Recording {
            time_s: (0..100).map(f64::from).collect(),
            cycles: vec![
                cycle(10.0, false),
                cycle(20.0, true),
                cycle(30.0, true),
                cycle(40.0, false),
                cycle(50.0, true),
            ],
            ..Recording::default()
        };
        let trial = TrialRow { omega_rad_s: std::f64::consts::TAU / 10.0, ..TrialRow::blank() };
        let bands: Vec<_> = unused_cycles(&trial, &recording)
            .into_iter()
            .map(|layer| [layer.points[0].x, layer.points[1].x])
            .collect();
        assert!(bands[0][0].is_nan() && bands[0][1] == 20.0);
        assert_eq!(bands[1][1].round(), 50.0);
        assert!((bands[1][0] - 40.0).abs() < 1e-9);
        assert!(bands.len() == 3 && bands[2][1].is_nan());
    }
}
