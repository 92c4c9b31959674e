//! Derivatives of a chain's steady motion with respect to the numbers that describe it, by the adjoint method.
//!
//! The metrics are integrals over the cycle, or angles at turning points. The adjoint solution of each
//! ([`PeriodicOrbit::solve_adjoint`]) weights the equations of motion at every stage; these are balances of forces, so
//! that their weighted sum is a virtual power, whose derivatives with respect to all numbers follow together
//! ([`Power`](super::power::Power)).

use std::f64::consts::TAU;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    ChainError, ChainNumber, CommandNumber, Friction, Joint, Lanes, LinkNumber, MAX_JOINTS,
    MAX_LINKS, Number, Pose,
};

use super::balance::{Node, Posture, WheelState};
use super::constraint::{Equation, product, turned};
use super::determined::{is_unbounded, velocities_and_factors};
use super::links::Motion;
use super::model::{Model, Wheels};
use super::plane::normal;
use super::power::{EvaluatedMotion, Power, Resistance, Virtual, needs_evaluate};
use super::wave::Wave;
use super::{ChainProblem, in_link_order};
use crate::Result;
use crate::cycle::Cycle;
use crate::element::{Element, Stages};
use crate::extreme::{Extremes, TurningPoint};
use crate::orbit::{Adjoint, OfElements, PeriodicOrbit, sum_of_lanes};
use crate::path::Leg;
use crate::radau::{RADAU, STAGES};
use crate::reduced::Reduced;

/// Derivatives that are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slopes {
    /// Those of the metrics.
    Metrics,
    /// Those of the metrics and of the work of the actuators over a cycle, which equals the loss.
    All,
}

/// Maximum number of quantities whose derivatives are computed together, if there are few and if there are more.
const FEW: usize = 5;
const MORE: usize = 7;

/// Output of a solution whose derivatives are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Output {
    /// Skid ratio of a wheel, given its index from front to rear and that of its link.
    Sigma {
        wheel: usize,
        link: usize,
    },
    Distance,
    /// Displacement under a change that breaks the half-period symmetry: the second half of the motion changes like the
    /// mirror image of the first with the opposite sign, and the displacement because the heading at half the period
    /// does.
    OddDistance,
    /// Rotation per cycle.
    Turn,
    /// Half the range of the angle of a free joint, given its index among the free joints.
    Range(usize),
    /// Energy dissipated over a cycle.
    Loss,
}

impl Output {
    /// Returns whether the quantity changes its sign under the half-period symmetry.
    fn is_odd(self) -> bool {
        matches!(self, Self::OddDistance | Self::Turn)
    }
}

/// Number with respect to which derivatives are computed.
struct Wanted {
    number: ChainNumber,
    /// Derivative of the number's command with respect to it, if it is one of a command.
    wave: Option<Wave>,
    /// Link of a wheel and its number, if the number is one of the friction of a wheel.
    friction: Option<(usize, LinkNumber)>,
    /// Whether the motion can depend on the number.
    is_used: bool,
}

impl Wanted {
    fn new(problem: &ChainProblem, number: ChainNumber) -> Result<Self> {
        let chain = &problem.chain;
        if chain.number(number).is_none() {
            return Err(ChainError::NoNumber(number.key()).into());
        }
        let wave = match number {
            ChainNumber::Command(joint, number) => {
                Some(Wave::slope(chain.joints[joint].command(), number))
            }
            ChainNumber::Rotor(link, number) => {
                chain.links[link].rotor.map(|rotor| Wave::slope(&rotor.angle, number))
            }
            ChainNumber::Link(..) | ChainNumber::Joint(..) => None,
        };
        let (friction, is_used) = match number {
            ChainNumber::Link(link, number) => {
                let friction = number.is_of_friction().then_some((link, number));
                (friction, number.is_used(problem.laws))
            }
            _ => (None, true),
        };
        Ok(Self { number, wave, friction, is_used })
    }
}

/// Returns the derivatives of the metrics of the solution `orbit` and, if wanted, of the work (J) with respect to numbers
/// of the chain, in SI units and in their order. They are NaN if the motion has no neighbouring ones
/// ([`Differentiation::persists`]), and 0 if the laws do not use the number.
///
/// # Errors
/// Returns an error if the chain does not have one of the numbers, or if the linearisation of the motion is singular.
pub(super) fn slopes<const N: usize, const C: usize, const D: usize, F: Friction>(
    model: &Model<N, C, D, F>,
    orbit: &mut PeriodicOrbit<N, Model<N, C, D, F>>,
    numbers: &[ChainNumber],
    wanted_slopes: Slopes,
) -> Result<Vec<(GaitMetrics, f64)>> {
    let problem = &model.problem;
    let wanted: Vec<Wanted> =
        numbers.iter().map(|number| Wanted::new(problem, *number)).collect::<Result<_>>()?;
    let cycle = orbit.measure(model);
    orbit.linearise(model)?;
    let is_half = orbit.mesh.is_half;
    let has_odd = is_half && numbers.iter().any(|number| number.is_odd());
    let wheels = model.system.wheels.iter().enumerate();
    let skids = wheels.filter(|_| model.skids());
    let mut quantities: Vec<Output> =
        skids.map(|(wheel, (_, link, _))| Output::Sigma { wheel, link: *link }).collect();
    quantities.push(Output::Distance);
    quantities.extend((0..C - 1).map(Output::Range));
    if wanted_slopes == Slopes::All {
        quantities.push(Output::Loss);
    }
    if has_odd {
        quantities.push(Output::OddDistance);
    }
    if has_odd || !is_half {
        quantities.push(Output::Turn);
    }
    let differentiation = Differentiation::new(model, orbit, &cycle, &wanted);
    let sums = match quantities.len() {
        0..=FEW => differentiation.of_all::<FEW>(&quantities, orbit)?,
        _ => differentiation.of_all::<MORE>(&quantities, orbit)?,
    };
    let persists = differentiation.persists();
    let slope = |i: usize, wanted: &Wanted| {
        let is_odd = is_half && wanted.number.is_odd();
        let of = |quantity: Output| {
            let at = quantities.iter().position(|one| *one == quantity);
            let is_zero = !wanted.is_used || is_half && quantity.is_odd() != is_odd;
            match at.filter(|_| !is_zero) {
                Some(_) if !persists[i] => f64::NAN,
                Some(at) => sums[at * numbers.len() + i],
                None => 0.0,
            }
        };
        slopes_of(model, wanted.number, is_odd, of)
    };
    Ok(std::iter::zip(0.., &wanted).map(|(i, wanted)| slope(i, wanted)).collect())
}

/// Returns the derivatives of the metrics and of the work with respect to a number, given those of the quantities.
fn slopes_of<const N: usize, const C: usize, const D: usize, F: Friction>(
    model: &Model<N, C, D, F>,
    number: ChainNumber,
    is_odd: bool,
    of: impl Fn(Output) -> f64,
) -> (GaitMetrics, f64) {
    let ChainProblem { chain, omega_rad_s, .. } = &model.problem;
    let d_m = of(if is_odd { Output::OddDistance } else { Output::Distance });
    let mut sigma = [f64::NAN; MAX_LINKS];
    for (wheel, (_, link, _)) in model.system.wheels.iter().enumerate() {
        sigma[wheel] = of(Output::Sigma { wheel, link: *link });
    }
    let sigma = in_link_order(model, &sigma);
    let mut alpha_rad = [f64::NAN; MAX_JOINTS];
    alpha_rad[..chain.joints.len()].fill(0.0);
    for c in 1..C {
        alpha_rad[model.system.clusters.all[c].joint] = of(Output::Range(c - 1));
    }
    if let ChainNumber::Command(joint, number) = number
        && let Joint::Driven(command) = &chain.joints[joint]
    {
        let index = CommandNumber::ALL.iter().position(|one| *one == number).unwrap_or(0);
        alpha_rad[joint] = command.half_range_slopes()[index];
    }
    let v_m_s = d_m * omega_rad_s / TAU;
    let metrics = GaitMetrics { d_m, v_m_s, sigma, alpha_rad, dtheta_rad: of(Output::Turn) };
    (metrics, of(Output::Loss))
}

/// Solution whose derivatives are computed.
struct Differentiation<'a, const N: usize, const C: usize, const D: usize, F: Friction> {
    model: &'a Model<N, C, D, F>,
    wanted: &'a [Wanted],
    /// Whether one of the wanted numbers is not of friction.
    needs_power: bool,
    /// Whether one of the wanted numbers needs [`Power::evaluate`].
    needs_evaluate: bool,
    /// Derivatives of d with respect to the pose (x, y, theta) at the end of the time span of the mesh, and those for a
    /// change that has opposite effects in the two halves of the period.
    dd_dend: [[f64; 3]; 2],
    end: Pose,
    /// Twice the derivative of each skid ratio, by wheel, with respect to the mean squared skid velocity.
    dsigma_dskid: [f64; MAX_LINKS],
}

impl<'a, const N: usize, const C: usize, const D: usize, F: Friction>
    Differentiation<'a, N, C, D, F>
{
    fn new(
        model: &'a Model<N, C, D, F>,
        orbit: &PeriodicOrbit<N, Model<N, C, D, F>>,
        cycle: &Cycle,
        wanted: &'a [Wanted],
    ) -> Self {
        let Pose { x_m: x, y_m: y, theta_rad } = cycle.end;
        // Pose at the end of the period, after a half and its mirror image.
        let whole = cycle.end * cycle.end.mirrored();
        let (sin, cos) = theta_rad.sin_cos();
        let turned = whole.x_m * (cos * y - sin * x) + whole.y_m * (cos * x + sin * y);
        let halves = |sign: f64| {
            let [sin, cos] = [sign * sin, sign * cos];
            [
                whole.x_m * (1.0 + cos) + whole.y_m * sin,
                whole.x_m * sin + whole.y_m * (1.0 - cos),
                turned,
            ]
        };
        let even = if orbit.mesh.is_half { halves(1.0) } else { [x, y, 0.0] };
        // The gradient of a zero distance is undefined and taken as zero.
        let per_m = if cycle.d_m > 0.0 { 1.0 / cycle.d_m } else { 0.0 };
        let scale_squared = model.skid_scale_m_s().powi(2);
        Self {
            model,
            wanted,
            needs_power: wanted.iter().any(|one| one.is_used && one.friction.is_none()),
            needs_evaluate: wanted
                .iter()
                .any(|one| needs_evaluate(&model.problem.chain, one.number)),
            dd_dend: [even, halves(-1.0)].map(|slopes| slopes.map(|slope| slope * per_m)),
            end: cycle.end,
            dsigma_dskid: cycle.sigma.map(|sigma| match sigma {
                0.0 => 0.0,
                sigma => 1.0 / (scale_squared * sigma),
            }),
        }
    }

    /// Returns the derivatives of quantities with respect to all wanted numbers, quantity by quantity; those of `B`
    /// quantities are computed together.
    fn of_all<const B: usize>(
        &self,
        quantities: &[Output],
        orbit: &mut PeriodicOrbit<N, Model<N, C, D, F>>,
    ) -> Result<Vec<f64>> {
        const { assert!(B <= MORE) };
        let mut adjoint = Adjoint::<N, B>::default();
        let mut sums = Vec::with_capacity(quantities.len() * self.wanted.len());
        for quantities in quantities.chunks(B) {
            sums.extend(self.of(quantities, orbit, &mut adjoint)?);
        }
        Ok(sums)
    }

    /// Returns the derivatives of at most `B` quantities.
    fn of<const B: usize>(
        &self,
        quantities: &[Output],
        orbit: &mut PeriodicOrbit<N, Model<N, C, D, F>>,
        adjoint: &mut Adjoint<N, B>,
    ) -> Result<Vec<f64>> {
        let count = self.wanted.len();
        adjoint.clear(orbit.mesh.packs());
        let mut at_turns = vec![0.0; quantities.len() * count];
        for (q, quantity) in quantities.iter().enumerate() {
            adjoint.is_odd[q] = orbit.mesh.is_half && quantity.is_odd();
            if let Output::Range(joint) = quantity {
                let own = &mut at_turns[q * count..][..count];
                adjoint.starts[q] = self.range(*joint, orbit, own)?;
            }
        }
        let mesh = &orbit.mesh;
        let mut power = Power::new();
        let spans = mesh.spans() as f64;
        for (pack, leg) in orbit.path.legs.iter().enumerate() {
            let starts = mesh.starts(pack);
            let element = mesh.pack(pack, &starts);
            let phases_rad = mesh.phases_rad(pack);
            let weights = mesh.weights(pack);
            for (q, quantity) in quantities.iter().enumerate() {
                let own = &mut adjoint.weights[pack * B + q];
                match quantity {
                    Output::Distance => self.path(self.dd_dend[0], leg, weights[1], own),
                    Output::OddDistance => self.path(self.dd_dend[1], leg, weights[1], own),
                    Output::Turn => {
                        for (own, weight) in own.iter_mut().zip(RADAU.integrate[STAGES - 1]) {
                            own[2] = Lanes::splat(spans * weight) * weights[1];
                        }
                    }
                    Output::Range(_) => {}
                    Output::Sigma { wheel, .. } => {
                        for j in 0..STAGES {
                            let factor = RADAU.integrate[STAGES - 1][j] * self.dsigma_dskid[*wheel];
                            let factor = Lanes::splat(factor) * weights[0];
                            own[j] =
                                self.by_skid(*wheel, &element.nodes[j], &leg.states[j], factor);
                        }
                    }
                    Output::Loss => {
                        for j in 0..STAGES {
                            let motion = self.motion(&element, &phases_rad, j);
                            let at = self.evaluated(&motion, [Lanes::default(); MAX_LINKS]);
                            let direct = self.direct(*quantity, &at, j, weights, spans);
                            own[j] = self.by_state(&mut power, &at, &direct);
                        }
                    }
                }
            }
        }
        orbit.solve_adjoint(adjoint)?;

        let mesh = &orbit.mesh;
        let mut sums = vec![Lanes::default(); quantities.len() * count];
        for pack in 0..mesh.packs() {
            let starts = mesh.starts(pack);
            let element = mesh.pack(pack, &starts);
            let phases_rad = mesh.phases_rad(pack);
            let weights = mesh.weights(pack);
            for j in 0..STAGES {
                let weighted = Weighted::new(self.model, &element, j);
                let factors = adjoint.factors::<Model<N, C, D, F>>(pack, j);
                let rows = |q: usize| std::array::from_fn(|i| -factors[i][q]);
                let powers: [_; B] = std::array::from_fn(|q| FrictionPower {
                    velocities: weighted.velocities(self.model, &rows(q)),
                    actual: match quantities.get(q) {
                        Some(Output::Loss) => self.loss_weight(j, weights[1], spans),
                        _ => Lanes::default(),
                    },
                });
                let posture = &orbit.path.legs[pack].states[j];
                let powers = &powers[..quantities.len()];
                self.add_friction(&element.nodes[j], posture, powers, &mut sums);
                if !self.needs_power {
                    continue;
                }
                let motion = self.motion(&element, &phases_rad, j);
                let at = self.evaluated(&motion, weighted.constraint_n);
                for (q, quantity) in quantities.iter().enumerate() {
                    let own = &mut sums[q * count..][..count];
                    let rows = rows(q);
                    let mut virtual_motion = weighted.virtual_motion(self.model, &rows);
                    if let Output::Sigma { .. } | Output::Loss = quantity {
                        let direct = self.direct(*quantity, &at, j, weights, spans);
                        match direct.resistance {
                            Resistance::All => {
                                for (own, direct) in
                                    virtual_motion.skid.iter_mut().zip(direct.virtual_motion.skid)
                                {
                                    *own += direct;
                                }
                            }
                            Resistance::Dissipation => self.add(&mut power, &at, &direct, own),
                        }
                    }
                    if let Wheels::Determined(determined) = &self.model.wheels {
                        let body = [rows[0], rows[1], rows[2]];
                        let (point_count, points) =
                            determined.points(&self.model.system, phases_rad[j]);
                        for (weight, phase_rad) in &points[..point_count] {
                            self.add_determined(&mut power, *phase_rad, (&body, *weight), own);
                        }
                    } else {
                        self.add(&mut power, &at, &WeightedPower::all(virtual_motion), own);
                    }
                }
            }
        }
        let sums = sums.into_iter().map(sum_of_lanes);
        Ok(sums.zip(at_turns).map(|(sum, at_turns)| sum + at_turns).collect())
    }

    /// Returns the motion at stage `j` of an element.
    #[inline(always)]
    fn motion<T: Number>(
        &self,
        element: &Element<N, Model<N, C, D, F>, T>,
        phases_rad: &[T; STAGES],
        j: usize,
    ) -> Motion<T> {
        self.model.motion(phases_rad[j], &element.stages[j], &element.rate(j))
    }

    #[inline(always)]
    fn evaluated<'m, T: Number>(
        &self,
        motion: &'m Motion<T>,
        constraint_n: [T; MAX_LINKS],
    ) -> EvaluatedMotion<'m, T>
    where
        'a: 'm,
    {
        let ChainProblem { chain, omega_rad_s, .. } = &self.model.problem;
        EvaluatedMotion::new::<F>(chain, motion, *omega_rad_s, constraint_n)
    }

    /// Returns the power whose derivatives are those of a quantity's direct dependence on the motion at stage `j`, given
    /// [`Mesh::weights`](crate::mesh::Mesh::weights).
    fn direct(
        &self,
        quantity: Output,
        at: &EvaluatedMotion<Lanes>,
        j: usize,
        [part, duration_s]: [Lanes; 2],
        spans: f64,
    ) -> WeightedPower<Lanes> {
        let weight = RADAU.integrate[STAGES - 1][j];
        match quantity {
            Output::Sigma { wheel, link } => {
                let mut virtual_motion = Virtual::none();
                virtual_motion.skid[link] =
                    Lanes::splat(weight * self.dsigma_dskid[wheel]) * part * at.skid_m_s(link);
                WeightedPower::all(virtual_motion)
            }
            _ => WeightedPower {
                virtual_motion: at.as_virtual(),
                resistance: Resistance::Dissipation,
                weight: self.loss_weight(j, duration_s, spans),
            },
        }
    }

    /// Returns the weight of the dissipated power at stage `j` in the loss over a cycle.
    fn loss_weight(&self, j: usize, duration_s: Lanes, spans: f64) -> Lanes {
        Lanes::splat(spans * RADAU.integrate[STAGES - 1][j]) * duration_s
    }

    /// Returns the derivatives, with respect to the states, of half the square of a wheel's skid velocity, times a factor.
    fn by_skid(
        &self,
        wheel: usize,
        node: &Node<Lanes, C>,
        posture: &Posture<Lanes, C>,
        factor: Lanes,
    ) -> [Lanes; N] {
        let system = &self.model.system;
        let (cluster, ..) = system.wheels[wheel];
        let state = system.wheel(posture, &node.wheels[wheel], cluster);
        let row: [Lanes; D] = system.skid_row(posture, &state, cluster);
        let factor = factor * state.skid_m_s;
        let mut by = [Lanes::default(); N];
        (0..D).for_each(|i| by[i] = factor * row[i]);
        for b in (1..C).filter(|b| system.is_beyond(*b, cluster)) {
            by[D + b - 1] = factor * turned(system, b, state.direction, posture.velocity[b]);
        }
        by
    }

    /// Returns the derivatives of a virtual power with respect to the states.
    fn by_state<T: Number>(
        &self,
        power: &mut Power<T>,
        at: &EvaluatedMotion<T>,
        direct: &WeightedPower<T>,
    ) -> [T; N] {
        power.evaluate(at, &direct.virtual_motion, direct.resistance);
        let mut by = [T::splat(0.0); N];
        by[..3].copy_from_slice(&power.by_body(at));
        for c in 1..C {
            [by[D + c - 1], by[2 + c], _] =
                power.by_joint(at, self.model.system.clusters.all[c].joint);
        }
        by.map(|slope| direct.weight * slope)
    }

    /// Adds the derivatives of virtual powers of friction with respect to the wanted numbers of friction, power by power.
    fn add_friction<T: Number>(
        &self,
        node: &Node<T, C>,
        posture: &Posture<T, C>,
        powers: &[FrictionPower<T, D>],
        sums: &mut [T],
    ) {
        let system = &self.model.system;
        for ((cluster, link, friction), wheel) in system.wheels.iter().zip(&node.wheels) {
            let of_wheel = |one: &Wanted| one.friction.filter(|(of, _)| one.is_used && of == link);
            if self.wanted.iter().all(|one| of_wheel(one).is_none()) {
                continue;
            }
            let state = system.wheel(posture, wheel, *cluster);
            let WheelState { direction, roll_m_s, skid_m_s, .. } = state;
            let axes = [direction, normal(direction)];
            let rows: [[T; D]; 2] =
                axes.map(|axis| system.velocity_row(posture, &state, *cluster, axis));
            let mut virtual_m_s = [[T::splat(0.0); 2]; MORE];
            for (own, FrictionPower { velocities, actual }) in virtual_m_s.iter_mut().zip(powers) {
                *own = [(rows[0], roll_m_s), (rows[1], skid_m_s)]
                    .map(|(row, velocity)| product(&row, velocities) + *actual * velocity);
            }
            for (i, one) in self.wanted.iter().enumerate() {
                let Some((_, number)) = of_wheel(one) else { continue };
                let [roll, skid] = F::slopes(friction, number, roll_m_s, skid_m_s);
                let own = sums[i..].iter_mut().step_by(self.wanted.len());
                for (sum, [rolling, across]) in own.zip(virtual_m_s) {
                    *sum += roll * rolling + skid * across;
                }
            }
        }
    }

    /// Adds the derivatives of a virtual power with respect to the wanted numbers that are not of friction.
    #[inline(never)]
    fn add<T: Number>(
        &self,
        power: &mut Power<T>,
        at: &EvaluatedMotion<T>,
        direct: &WeightedPower<T>,
        sums: &mut [T],
    ) {
        if self.needs_evaluate {
            power.evaluate(at, &direct.virtual_motion, direct.resistance);
            power.evaluate_commands(at);
        } else {
            power.set_velocities(at, &direct.virtual_motion, direct.resistance);
        }
        for (sum, one) in sums.iter_mut().zip(self.wanted) {
            if one.is_used && one.friction.is_none() {
                *sum += direct.weight * power.by_number(at, one.number, one.wave.as_ref());
            }
        }
    }

    /// Subtracts from the sum of each wanted number `weight` times a derivative with respect to that number: of the scalar
    /// product of `factors` and the velocities that constraints and commands determine at a phase.
    fn add_determined<T: Number>(
        &self,
        power: &mut Power<T>,
        phase_rad: T,
        (factors, weight): (&[T; 3], f64),
        sums: &mut [T],
    ) {
        let zero = T::splat(0.0);
        let Self { model, .. } = self;
        let (body, factors) = velocities_and_factors(&model.system, phase_rad, factors);
        let mut virtual_motion = Virtual::none();
        for ((_, link, _), factor) in model.system.wheels.iter().zip(factors) {
            virtual_motion.skid[*link] = T::splat(weight) * factor;
        }
        let state = std::array::from_fn(|i| if i < 3 { body[i] } else { zero });
        let motion = model.motion(phase_rad, &state, &[zero; N]);
        let at = self.evaluated(&motion, [zero; MAX_LINKS]);
        self.add(power, &at, &WeightedPower::all(virtual_motion), sums);
    }

    /// Returns, for each wanted number, whether the velocities that constraints and commands determine are bounded also
    /// for neighbouring values of it.
    fn persists(&self) -> Vec<bool> {
        let Wheels::Determined(determined) = &self.model.wheels else {
            return vec![true; self.wanted.len()];
        };
        let length_m = self.model.problem.chain.skid_length_m;
        // Largest of the derivatives of the three velocities with respect to each number.
        let sizes_at = |phase_rad: f64| {
            let mut sizes = vec![0.0_f64; self.wanted.len()];
            for body in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, length_m]] {
                let mut slopes = vec![0.0; self.wanted.len()];
                self.add_determined(&mut Power::new(), phase_rad, (&body, 1.0), &mut slopes);
                for (size, slope) in sizes.iter_mut().zip(slopes) {
                    // `max` would ignore NaN.
                    *size = if slope.abs() <= *size { *size } else { slope.abs() };
                }
            }
            sizes
        };
        let mut persists = vec![true; self.wanted.len()];
        for crossing in determined.crossings() {
            let [far, near] = crossing.approach_rad().map(sizes_at);
            for (persists, sizes) in persists.iter_mut().zip(far.into_iter().zip(near)) {
                *persists &= !is_unbounded(sizes.into());
            }
        }
        persists
    }

    /// Sets `weights` to the derivatives of the displacement d with respect to the states at the stages of a path segment,
    /// given its derivatives with respect to the end pose.
    fn path(
        &self,
        dd_dend: [f64; 3],
        leg: &Leg<N, Model<N, C, D, F>>,
        duration_s: Lanes,
        weights: &mut Stages<N, Lanes>,
    ) {
        let [dd_dx, dd_dy, dd_dtheta] = dd_dend.map(Lanes::splat);
        // Effect of a rotation on the remaining path.
        let [end_of_span_x, end_of_span_y] = [self.end.x_m, self.end.y_m].map(Lanes::splat);
        let [end_x, end_y] = leg.ends;
        let later = dd_dtheta + dd_dy * (end_of_span_x - end_x) - dd_dx * (end_of_span_y - end_y);
        for j in 0..STAGES {
            let weight = Lanes::splat(RADAU.integrate[STAGES - 1][j]) * duration_s;
            let (sin, cos) = leg.directions[j];
            let [u, v, _] = Model::<N, C, D, F>::body(&leg.states[j]);
            let dd_dforward = dd_dx * cos + dd_dy * sin;
            let dd_dsideways = dd_dy * cos - dd_dx * sin;
            weights[j][0] = weight * dd_dforward;
            weights[j][1] = weight * dd_dsideways;
            weights[j][2] += weight * later;
            let turned = weight * (u * dd_dsideways - v * dd_dforward);
            for l in 0..STAGES {
                weights[l][2] += turned * Lanes::splat(RADAU.integrate[j][l]) * duration_s;
            }
        }
    }

    /// Returns the derivatives of half the range of a free joint's angle with respect to the states at the starts of the
    /// elements that contain its turning points, and adds those with respect to the wanted numbers with these states held
    /// fixed. A shift of a turning point in time has no effect on the angle.
    fn range(
        &self,
        joint: usize,
        orbit: &mut PeriodicOrbit<N, Model<N, C, D, F>>,
        sums: &mut [f64],
    ) -> Result<OfElements<N>> {
        let Extremes { highest, lowest } = orbit.extremes[joint];
        // With half-period symmetry, the opposite extreme follows half a period later.
        let parts = if orbit.mesh.is_half { [1.0, 0.0] } else { [0.5, -0.5] };
        let mut starts = [None; 2];
        for ((extreme, part), start) in [highest, lowest].iter().zip(parts).zip(&mut starts) {
            if part != 0.0 {
                let weight = part * extreme.sign;
                let by_start = self.turning_angle(joint, extreme, weight, orbit, sums)?;
                *start = Some((extreme.element, by_start));
            }
        }
        Ok(starts)
    }

    /// Returns the derivatives of `weight` times a free joint's angle at a turning point with respect to the state at the
    /// start of its element, and adds those with respect to the wanted numbers.
    fn turning_angle(
        &self,
        joint: usize,
        extreme: &TurningPoint<N>,
        weight: f64,
        orbit: &mut PeriodicOrbit<N, Model<N, C, D, F>>,
        sums: &mut [f64],
    ) -> Result<[f64; N]> {
        let error = orbit.not_converged();
        let PeriodicOrbit { mesh, workspace, .. } = orbit;
        let found = extreme.shorter_element(self.model, mesh, workspace);
        let (nodes, stages) = found.ok_or(error)?;
        let start = mesh.states.start_of(extreme.element);
        let duration_s = extreme.fraction * mesh.duration_s(extreme.element);
        let element = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
        let phases_rad =
            RADAU.nodes.map(|node| mesh.phase_rad(extreme.element, extreme.fraction * node));
        workspace.linearise(0, self.model, &element, true);
        let angle = D + joint;
        let by_start = workspace.end_transfer::<N, Model<N, C, D, F>>(0, duration_s)[angle];
        let mut end = [0.0; N];
        end[angle] = weight;
        let mut rows = vec![[0.0; 1]; D * STAGES];
        workspace.adjoint_factors::<N, Model<N, C, D, F>, 1>(0, duration_s, &[end], &mut rows);
        let mut power = Power::new();
        for j in 0..STAGES {
            let weighted = Weighted::new(self.model, &element, j);
            let rows = std::array::from_fn(|i| -rows[j * D + i][0]);
            let velocities = weighted.velocities(self.model, &rows);
            let posture = self.model.kinematics(&nodes[j], &stages[j]);
            let power_of_friction = FrictionPower { velocities, actual: 0.0 };
            self.add_friction(&nodes[j], &posture, &[power_of_friction], sums);
            if self.needs_power {
                let motion = self.motion(&element, &phases_rad, j);
                let at = self.evaluated(&motion, weighted.constraint_n);
                let virtual_motion = weighted.virtual_motion(self.model, &rows);
                self.add(&mut power, &at, &WeightedPower::all(virtual_motion), sums);
            }
        }
        Ok(by_start.map(|slope| weight * slope))
    }
}

/// Virtual power of the friction of the wheels.
struct FrictionPower<T, const D: usize> {
    /// Virtual velocities of the reference link and of the free joints.
    velocities: [T; D],
    /// Multiple of the actual velocities that is added to them.
    actual: T,
}

/// Virtual power, times a weight.
struct WeightedPower<T> {
    virtual_motion: Virtual<T>,
    resistance: Resistance,
    weight: T,
}

impl<T: Number> WeightedPower<T> {
    /// Returns the power of all resistances in a virtual motion.
    fn all(virtual_motion: Virtual<T>) -> Self {
        Self { virtual_motion, resistance: Resistance::All, weight: T::splat(1.0) }
    }
}

/// Equations of motion at a stage as virtual powers.
struct Weighted<T, const D: usize> {
    /// Directions in which wheels that cannot skid allow the chain to move.
    null: [[T; D]; D],
    /// Forces, by link, that keep the wheels from skidding, N.
    constraint_n: [T; MAX_LINKS],
}

impl<T: Number, const D: usize> Weighted<T, D> {
    fn new<const N: usize, const C: usize, F: Friction>(
        model: &Model<N, C, D, F>,
        element: &Element<N, Model<N, C, D, F>, T>,
        j: usize,
    ) -> Self {
        let zero = T::splat(0.0);
        let mut weighted = Self { null: [[zero; D]; D], constraint_n: [zero; MAX_LINKS] };
        let Some(constraints) = model.constraints() else { return weighted };
        let node: &Node<T, C> = &element.nodes[j];
        let posture = model.kinematics(node, &element.stages[j]);
        let rate = element.rate(j);
        let acceleration: [T; D] = std::array::from_fn(|i| rate[i]);
        let force = model.system.balance::<T, F, C, D, false>(node, &posture, &acceleration).force;
        let (null, forces) = constraints.directions(&model.system, node, &posture, &force);
        weighted.null = null;
        for ((_, link, _), force) in model.system.wheels.iter().zip(forces) {
            weighted.constraint_n[*link] = force;
        }
        weighted
    }

    /// Returns the virtual motion whose power is the sum of the residuals times the given factors.
    fn virtual_motion<const N: usize, const C: usize, F: Friction>(
        &self,
        model: &Model<N, C, D, F>,
        factors: &[T; D],
    ) -> Virtual<T> {
        let mut virtual_motion = Virtual::none();
        let velocities = self.velocities(model, factors);
        virtual_motion.body.copy_from_slice(&velocities[..3]);
        for c in 1..C {
            virtual_motion.joints[model.system.clusters.all[c].joint] = velocities[2 + c];
        }
        for (row, factor) in factors.iter().enumerate() {
            if let Some(Equation::Constraint(wheel)) =
                model.constraints().map(|constraints| constraints.equation(row))
            {
                let (_, link, _) = model.system.wheels[wheel];
                virtual_motion.skid[link] = *factor;
            }
        }
        virtual_motion
    }

    /// Returns the virtual velocities of the reference link and of the free joints.
    #[inline(always)]
    fn velocities<const N: usize, const C: usize, F: Friction>(
        &self,
        model: &Model<N, C, D, F>,
        factors: &[T; D],
    ) -> [T; D] {
        let mut velocities = [T::splat(0.0); D];
        match &model.wheels {
            Wheels::Skid => velocities = *factors,
            Wheels::Roll(constraints) => {
                for (row, factor) in factors.iter().enumerate() {
                    if let Equation::Motion(direction) = constraints.equation(row) {
                        let null = &self.null[direction];
                        (0..D).for_each(|i| velocities[i] += *factor * null[i]);
                    }
                }
            }
            Wheels::Determined(_) => {}
        }
        velocities
    }
}
