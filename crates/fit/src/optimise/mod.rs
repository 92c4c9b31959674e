//! The gait that is best: optimal commands of a model's steady motion.
//!
//! The objectives are products of powers of d, omega and the actuators' work, of which the solver
//! knows the derivatives by every number of the gait. Searches begin at places spread over the
//! ranges and at the present gait. What they end in counts if the motion is stable and is reached
//! from rest.

mod certainty;
mod commands;
mod front;
mod kept;
mod landscape;
mod map;
mod quadratic;
mod search;

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::{
    Attractor, FromRest, MotionStatus, Problem, REFERENCE_ACCURACY, Solver, SteadyMotion,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{ByParameter, Gait, JointCommand, Parameter, SecondHarmonic};

use crate::simulate::Setup;
pub use certainty::Certainty;
use commands::degrees;
pub use commands::{Bounds, Command};
pub use kept::{Kept, TABLES};
use landscape::{ACCURACY, Landscape, Place, ROUGH_ACCURACY};
pub use map::Shown;
use quadratic::Curvature;
use search::{End, search};
pub use trilink_tables::Objective;
use trilink_tables::{Columns, OptimumRow};

/// What is to be found.
#[derive(Debug, Clone)]
pub struct Search {
    /// The robot and its laws, with the present gait and frequency.
    pub problem: Problem,
    pub objective: Objective,
    /// The commands that may vary, one at least.
    pub free: Vec<Command>,
    pub bounds: Bounds,
    /// Places where searches begin, the present gait among them.
    pub starts: usize,
}

/// An optimal gait.
#[derive(Debug, Clone)]
pub struct Optimum {
    pub problem: Problem,
    pub value: f64,
    pub motion: SteadyMotion,
    pub status: MotionStatus,
    pub from_rest: FromRest,
    /// Ends of ranges where it is, and limits that it reaches.
    pub at_bound: Vec<String>,
    /// Searches that ended here.
    pub starts: usize,
    /// Of the cost over what varies, where a search has found it.
    curvature: Option<Curvature>,
}

impl Optimum {
    /// What any objective comes to here.
    pub fn value_of(&self, objective: Objective) -> f64 {
        let motion = &self.motion;
        objective.value(motion.metrics.d_m, motion.metrics.v_m_s, motion.work_j)
    }
}

impl Optimum {
    /// With the motion of a problem, as accurate as it is reported; `None` if there is none.
    fn new(
        problem: Problem,
        objective: Objective,
        at_bound: Vec<String>,
        starts: usize,
    ) -> Option<Self> {
        let mut solver = Solver::default();
        let first = solver.solve(&problem, REFERENCE_ACCURACY);
        let motion = solver.steady_motion(first.clone().ok()?).ok()?;
        let attractor = solver.attractor(&problem, first, REFERENCE_ACCURACY);
        let GaitMetrics { d_m, v_m_s, .. } = motion.metrics;
        Some(Self {
            value: objective.value(d_m, v_m_s, motion.work_j),
            status: motion.status(),
            from_rest: Attractor::from_rest(&attractor),
            at_bound,
            problem,
            motion,
            starts,
            curvature: None,
        })
    }

    /// Whether the robot gets there from rest and stays.
    pub fn counts(&self) -> bool {
        self.status.is_reached_and_stays(self.from_rest)
    }

    /// The same as a line of the table of a campaign's optima; `present` is the campaign's own gait at its best frequency.
    pub fn row(
        &self,
        rank: usize,
        campaign: &str,
        setup: &Setup,
        search: &Search,
        present: Option<&Self>,
    ) -> OptimumRow {
        let numbers =
            self.problem.gait.joints.map(|of| of.map_or([f64::NAN; 3], JointCommand::to_array));
        let seconds = self.problem.gait.joints.map(|of| of.and_then(|of| of.second));
        let Problem { robot, gait, laws, .. } = &self.problem;
        let known = |parameter: Parameter| match laws.know(parameter, gait) {
            true => parameter.of(robot),
            false => f64::NAN,
        };
        OptimumRow {
            campaign: campaign.to_owned(),
            rank: rank as i64,
            model: setup.model,
            parameters: ByParameter::from_fn(known),
            adequate: setup.fit().and_then(|fit| fit.adequate),
            extrapolation: setup.extrapolation(&self.problem),
            objective: search.objective,
            value: self.value,
            omega_rad_s: self.problem.omega_rad_s,
            offset_rad: numbers.map(|of| of[0]),
            amplitude_rad: numbers.map(|of| of[1]),
            phase_rad: numbers.map(|of| of[2]),
            amplitude2_rad: seconds.map(|of| of.map_or(f64::NAN, SecondHarmonic::amplitude_rad)),
            phase2_rad: seconds.map(|of| of.map_or(f64::NAN, SecondHarmonic::phase_rad)),
            metrics: self.motion.metrics,
            work_j: self.motion.work_j,
            power_w: self.power_w(),
            status: self.status,
            from_rest: self.from_rest,
            at_bound: self.at_bound.clone(),
            starts: self.starts as i64,
            present_value: present.map_or(f64::NAN, |of| of.value),
            present_omega_rad_s: present.map_or(f64::NAN, |of| of.problem.omega_rad_s),
            free: search.free.iter().map(Command::to_string).collect(),
            bounds: search.bounds.to_string(),
            ..OptimumRow::blank()
        }
    }

    /// Mean power of the actuators, W.
    pub fn power_w(&self) -> f64 {
        self.motion.work_j * self.problem.omega_rad_s / TAU
    }
}

/// What a search has found.
#[derive(Debug, Clone)]
pub struct Found {
    /// Where searches ended, the best first: those that count before those that do not.
    pub optima: Vec<Optimum>,
    /// Searches that found no motion within the limits that is found from rest, too.
    pub failed: usize,
}

impl Found {
    /// The best gait that counts.
    pub fn best(&self) -> Option<&Optimum> {
        self.optima.first().filter(|best| best.counts())
    }
}

impl Search {
    /// Searches from all starts.
    ///
    /// # Errors
    /// The work was cancelled.
    pub fn run(&self, cancel: &CancelToken) -> Result<Found, Cancelled> {
        let seeds = self.without_seconds(cancel)?;
        let ends: Vec<Option<End>> = (0..self.starts + seeds.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|number| {
                cancel.check()?;
                let mut landscape = self.landscape(ROUGH_ACCURACY);
                let start = match number.checked_sub(self.starts) {
                    Some(seed) => seeds[seed],
                    None if number == 0 => landscape.place_of(&self.problem),
                    None => self.spread(number),
                };
                Ok(climb(&mut landscape, start, None))
            })
            .collect::<Result<_, Cancelled>>()?;
        let all = ends.len();
        let rough = ends.into_iter().flatten().map(|end| (end, 1)).collect();
        let fine: Vec<Option<(End, usize)>> = self
            .distinct(rough, ROUGH_ACCURACY)
            .into_par_iter()
            .with_max_len(1)
            .map(|(end, _, starts)| {
                cancel.check()?;
                let mut landscape = self.landscape(ACCURACY);
                let end = climb(&mut landscape, end.place, Some(end.curvature));
                Ok(end.map(|end| (end, starts)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let fine: Vec<(End, usize)> = fine.into_iter().flatten().collect();
        let failed = all - fine.iter().map(|(_, starts)| starts).sum::<usize>();
        let distinct = self.distinct(fine, ACCURACY).into_par_iter().with_max_len(1);
        let mut optima: Vec<Optimum> = distinct
            .filter_map(|(end, problem, starts)| self.confirm(end, problem, starts))
            .collect();
        optima.sort_by_key(|of| !of.counts());
        Ok(Found { optima, failed })
    }

    /// Of ends with motions of an accuracy, the best first, those that are not the same as one before, and how many
    /// searches ended in each.
    fn distinct(&self, mut ends: Vec<(End, usize)>, accuracy: f64) -> Vec<(End, Problem, usize)> {
        let landscape = self.landscape(accuracy);
        ends.sort_by(|(a, _), (b, _)| a.point.cost.total_cmp(&b.point.cost));
        let mut distinct: Vec<(End, Problem, usize)> = Vec::new();
        for (end, count) in ends {
            let problem = normal(landscape.problem_at(&end.place));
            let known = distinct
                .iter_mut()
                .find(|(known, of, _)| are_same(&landscape, (known, of), (&end, &problem)));
            match known {
                Some((.., starts)) => *starts += count,
                None => distinct.push((end, problem, count)),
            }
        }
        distinct
    }

    /// Where searches with second harmonics begin, too: the best gaits without them, so that none is better than what
    /// is found, and the same with a little of them, since those of a gait that is its own mirror image change
    /// nothing of first order.
    fn without_seconds(&self, cancel: &CancelToken) -> Result<Vec<Place>, Cancelled> {
        const MOST: usize = 3;
        const LITTLE: f64 = 0.04;
        let mut first = self.clone();
        first.free.retain(|of| !of.is_second());
        if first.free.len() == self.free.len() || first.free.is_empty() {
            return Ok(Vec::new());
        }
        let landscape = self.landscape(ACCURACY);
        let seed = |of: &Optimum| {
            let place = landscape.place_of(&of.problem);
            let mut moved = place;
            for (i, command) in self.free.iter().enumerate() {
                moved[i] += if command.is_second() { LITTLE * (1.0 + 0.3 * i as f64) } else { 0.0 };
            }
            [place, self.within_limits(moved)]
        };
        let found = first.run(cancel)?;
        Ok(found.optima.iter().filter(|of| of.counts()).take(MOST).flat_map(seed).collect())
    }

    /// The best of what searches from the present gait end in; what does not vary stays as it is, whatever the
    /// bounds say of it.
    ///
    /// # Errors
    /// The work was cancelled.
    pub fn present(&self, cancel: &CancelToken) -> Result<Option<Optimum>, Cancelled> {
        let bounds = Bounds { angle_rad: f64::INFINITY, rate_rad_s: f64::INFINITY, ..self.bounds };
        let found = Search { bounds, ..self.clone() }.run(cancel)?;
        Ok(found.optima.into_iter().next())
    }

    /// The objective by motions of a relative accuracy.
    fn landscape(&self, accuracy: f64) -> Landscape<'_> {
        let problem = self.problem.clone();
        Landscape::new(problem, self.objective, &self.free, &self.bounds, accuracy)
    }

    /// Where a search begins: places that fill the ranges evenly, however many there are.
    ///
    /// Reference: M. Roberts, *The unreasonable effectiveness of quasirandom sequences* (2018).
    fn spread(&self, number: usize) -> Place {
        let count = self.free.len() as f64;
        // The positive solution of x^(count + 1) = x + 1.
        let ratio = (0..40).fold(2.0_f64, |x, _| (1.0 + x).powf(1.0 / (count + 1.0)));
        let mut place = Place::zeros();
        for (i, command) in self.free.iter().enumerate() {
            let part = (0.5 + number as f64 / ratio.powi(i as i32 + 1)).fract();
            // A phase has a turn to spare on each side.
            place[i] = if command.is_phase() { (1.0 + part) / 3.0 } else { part };
            if command.is_second() {
                place[i] = 0.5 + 0.5 * (part - 0.5);
            }
        }
        self.within_limits(place)
    }

    /// The place moved so that angles and rates are within their limits, as far as what varies can do that.
    fn within_limits(&self, mut place: Place) -> Place {
        const MOST: usize = 8;
        let Bounds { angle_rad, rate_rad_s, .. } = self.bounds;
        let landscape = self.landscape(ACCURACY);
        for _ in 0..MOST {
            let mut problem = landscape.problem_at(&place);
            let omega = problem.omega_rad_s;
            for command in problem.gait.joints.iter_mut().flatten() {
                if let Some(second) = command.second {
                    let rate = command.peak_rate_rad() * omega / rate_rad_s;
                    let part = 1.0 / (command.peak_angle_rad() / angle_rad).max(rate).max(1.0);
                    command.offset_rad *= part;
                    command.amplitude_rad *= part;
                    let amplitude_rad = part * second.amplitude_rad();
                    command.second = Some(SecondHarmonic::new(amplitude_rad, second.phase_rad()));
                    continue;
                }
                let JointCommand { offset_rad, amplitude_rad, .. } = command;
                let largest = (offset_rad.abs() + *amplitude_rad) / angle_rad;
                *amplitude_rad = (*amplitude_rad / largest.max(1.0)).min(rate_rad_s / omega);
                *offset_rad /= largest.max(1.0);
            }
            place = landscape.place_of(&problem);
        }
        place
    }

    /// The motion of an end, as accurate as it is reported; `None` if it is not found again.
    fn confirm(&self, end: End, problem: Problem, starts: usize) -> Option<Optimum> {
        let at_bound = self.landscape(ACCURACY).bounds_met(&end.place, &end.point);
        let optimum = Optimum::new(problem, self.objective, at_bound, starts)?;
        Some(Optimum { curvature: Some(end.curvature), ..optimum })
    }
}

/// Where a search from a place ends: at a motion that is found from rest, too, and is stable if there is such an
/// end.
fn climb(landscape: &mut Landscape, start: Place, curvature: Option<Curvature>) -> Option<End> {
    landscape.forget();
    landscape.only_stable = false;
    let end = search(landscape, start, curvature)?;
    let end = found_again(landscape, end)?;
    if landscape.is_stable() {
        return Some(end);
    }
    landscape.forget();
    landscape.only_stable = true;
    let stable = search(landscape, start, curvature).and_then(|end| found_again(landscape, end));
    Some(stable.filter(|_| landscape.is_stable()).unwrap_or(end))
}

/// Where a search ended, if a solution from rest finds the motion there: a search that goes from one motion to
/// the next may have followed another one, and goes on from the one that is found.
fn found_again(landscape: &mut Landscape, mut end: End) -> Option<End> {
    const MOST: usize = 4;
    for _ in 0..MOST {
        landscape.forget();
        let only_stable = std::mem::replace(&mut landscape.only_stable, false);
        let found = landscape.cost(&end.place)?;
        landscape.only_stable = only_stable;
        if landscape.are_same(found, end.point.cost) {
            return Some(end);
        }
        end = search(landscape, end.place, None)?;
    }
    None
}

/// The whole turns nearest to an angle, rad.
fn whole_turns(angle_rad: f64) -> f64 {
    TAU * (angle_rad / TAU).round()
}

/// The same gait with phases within half a turn of zero.
fn normal(mut problem: Problem) -> Problem {
    for command in problem.gait.joints.iter_mut().flatten() {
        command.phase_rad -= whole_turns(command.phase_rad);
    }
    problem
}

/// Whether two ends are one, or each other's mirror image, as far as the motions tell.
fn are_same(
    landscape: &Landscape,
    (one_end, one): (&End, &Problem),
    (other_end, other): (&End, &Problem),
) -> bool {
    if !landscape.are_same(one_end.point.cost, other_end.point.cost) {
        return false;
    }
    let same = landscape.same_command();
    let near = |a: f64, b: f64| (a - b).abs() < same * (1.0 + a.abs().max(b.abs()));
    let turns = |a: f64, b: f64| {
        let apart = (a - b).rem_euclid(TAU);
        apart.min(TAU - apart) < same * PI
    };
    let is_near = |sign: f64| {
        one.gait.joints.iter().zip(&other.gait.joints).all(|joints| match joints {
            (Some(a), Some(b)) => {
                near(a.offset_rad, sign * b.offset_rad)
                    && near(a.amplitude_rad, b.amplitude_rad)
                    && turns(a.phase_rad, b.phase_rad)
                    && near(a.second().in_phase_rad, sign * b.second().in_phase_rad)
                    && near(a.second().quadrature_rad, sign * b.second().quadrature_rad)
            }
            _ => true,
        })
    };
    near(one.omega_rad_s, other.omega_rad_s) && (is_near(1.0) || is_near(-1.0))
}

/// What of the present gait is not within the bounds, in words; empty if all is.
pub fn outside(gait: &Gait, bounds: &Bounds) -> Vec<String> {
    let mut found = Vec::new();
    for (joint, command) in gait.joints.iter().enumerate() {
        let Some(command) = command else { continue };
        let JointCommand { offset_rad, amplitude_rad, second, .. } = command;
        let largest = match second {
            Some(_) => command.peak_angle_rad(),
            None => offset_rad.abs() + amplitude_rad.abs(),
        };
        let [least, most] = bounds.amplitude_rad;
        if largest > bounds.angle_rad * (1.0 + 1e-9) {
            found.push(format!(
                "joint {} goes to {} degrees, at most {} are allowed",
                joint + 1,
                degrees(largest),
                degrees(bounds.angle_rad)
            ));
        }
        if *amplitude_rad < least * (1.0 - 1e-9) || *amplitude_rad > most * (1.0 + 1e-9) {
            found.push(format!(
                "joint {} has an amplitude of {} degrees, {} to {} are searched",
                joint + 1,
                degrees(*amplitude_rad),
                degrees(least),
                degrees(most)
            ));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use trilink_robot::{Laws, Robot};

    use super::*;

    /// A search over the frequency alone.
    pub(super) fn of_omega(
        problem: Problem,
        objective: Objective,
        omega_rad_s: [f64; 2],
    ) -> Search {
        let bounds = Bounds {
            omega_rad_s,
            amplitude_rad: [0.1, 0.8],
            angle_rad: 1.2,
            rate_rad_s: 10.0,
            power_w: None,
            torque_nm: None,
            least: None,
        };
        Search { problem, objective, free: vec![Command::Omega], bounds, starts: 2 }
    }

    /// Between 0.3523 and 0.3595 rad/s there are three motions: which one a search has followed depends on where
    /// it comes from.
    #[test]
    fn an_end_on_another_branch_is_searched_from_again() {
        let problem = Problem {
            robot: Robot { damping_nm_s_rad: 0.0005, ..Robot::semi_passive() },
            gait: Gait::passive_symmetric(),
            laws: Laws::SKID,
            omega_rad_s: 0.356,
        };
        let search = of_omega(problem.clone(), Objective::Distance, [0.345, 0.365]);
        let mut landscape = search.landscape(ACCURACY);
        let place = landscape.place_of(&problem);
        let cold = landscape.cost(&place).expect("a motion");
        let ends = [0.0, 1.0].map(|from| {
            landscape.forget();
            let along = (0..=20).map(|i| {
                let mut between = place;
                between[0] = from + (place[0] - from) * f64::from(i) / 20.0;
                landscape.evaluate(&between)
            });
            let point = along.last().flatten().expect("a motion");
            End { place, point, curvature: Curvature::identity() }
        });
        let is_other = ends.map(|end| !landscape.are_same(end.point.cost, cold));
        assert!(is_other.contains(&true), "{ends:?} {cold}");
        for (end, is_other) in ends.into_iter().zip(is_other) {
            let found = found_again(&mut landscape, end).expect("an end");
            let mut anew = search.landscape(ACCURACY);
            let cost = anew.cost(&found.place).expect("a motion");
            assert!(anew.are_same(cost, found.point.cost), "{found:?} {cost}");
            let is_same = found.place == place && found.point.cost == end.point.cost;
            assert_eq!(is_same, !is_other, "{found:?}");
        }
    }

    /// The robot comes back to where it was every second cycle only where the motion of one cycle is unstable.
    #[test]
    fn where_a_search_ends_in_an_unstable_motion_the_end_among_stable_ones_counts() {
        const STEP_RAD_S: f64 = 0.02;
        let offset = JointCommand::new(0.8137, 0.2838, 2.662);
        let problem = |omega_rad_s: f64| Problem {
            robot: Robot {
                h_m: 0.1695,
                l_m: 0.1551,
                b_m: 0.02867,
                mass_kg: [2.93, 0.196, 0.2922],
                inertia_kg_m2: [351e-4, 6e-4, 22.9e-4],
                roll_kg_s: [0.0; 3],
                skid_kg_s: [0.0; 3],
                stiffness_nm_rad: 0.4998,
                damping_nm_s_rad: 0.0643,
                rest_angle_rad: -0.1661,
                ..Robot::semi_passive()
            },
            gait: Gait { joints: [Some(offset), None] },
            laws: Laws::NO_SKID,
            omega_rad_s,
        };
        let mut solver = Solver::default();
        let mut at = |omega_rad_s: f64| {
            let metrics = solver.solve(&problem(omega_rad_s), 1e-9).expect("a motion");
            (metrics.v_m_s, solver.status().expect("it is solved for").is_stable())
        };
        let omegas = (0..=125).map(|i| 2.0 + STEP_RAD_S * f64::from(i));
        let all: Vec<(f64, (f64, bool))> = omegas.map(|omega| (omega, at(omega))).collect();
        // A neighbour that is faster and unstable.
        let into_unstable = all.windows(2).find_map(|pair| {
            let is_into =
                |a: &(f64, (f64, bool)), b: &(f64, (f64, bool))| a.1.1 && !b.1.1 && b.1.0 > a.1.0;
            let [a, b] = pair else { return None };
            if is_into(a, b) { Some((a.0, b.0)) } else { is_into(b, a).then_some((b.0, a.0)) }
        });
        let (stable, unstable) = into_unstable.expect("both");
        let away = stable + 3.0 * (stable - unstable);
        let range = [away.min(unstable), away.max(unstable)];
        let search = of_omega(problem(away), Objective::Speed, range);
        let mut landscape = search.landscape(ACCURACY);
        let start = landscape.place_of(&problem(away));
        let is_stable = |place: &Place| {
            let mut anew = search.landscape(ACCURACY);
            anew.cost(place).expect("a motion");
            anew.is_stable()
        };
        let first = super::search(&mut landscape, start, None).expect("an end");
        assert!(!is_stable(&first.place), "{first:?} {stable} {unstable}");
        let end = climb(&mut landscape, start, None).expect("an end");
        assert!(is_stable(&end.place), "{end:?}");
        let omega_rad_s = landscape.problem_at(&end.place).omega_rad_s;
        assert!((omega_rad_s - stable).abs() < STEP_RAD_S, "{omega_rad_s} {stable} {unstable}");
        let found = search.run(&CancelToken::default()).expect("nobody cancels it");
        assert!(found.optima.iter().all(|of| of.status.is_stable()));
    }

    #[test]
    fn a_cancelled_search_ends_at_once() {
        let search = of_omega(
            Problem {
                robot: Robot::kinematic(),
                gait: Gait::symmetric(),
                laws: Laws::SKID_ROLL,
                omega_rad_s: 3.0,
            },
            Objective::Speed,
            [1.0, 8.0],
        );
        // It would take hours.
        let search = Search { starts: 1_000_000, ..search };
        let cancel = CancelToken::default();
        cancel.cancel();
        assert!(search.run(&cancel).is_err() && search.present(&cancel).is_err());
        assert!(search.front(Objective::Distance, &cancel).is_err());
    }
}
