//! Chains whose wheels cannot skid: equations of motion in minimal states.
//!
//! The constraint of each wheel is a row of `W w = -b` for the velocities `w` (of the reference link and the free
//! joints), where `b` is the skid velocity due to the commanded motion. Constant rows `E`, which span the null space of
//! `W` at the mean shape, complete it to the square matrix `A`: with `E w = s`, the speeds `s` along the null space
//! determine all velocities. The equations of motion contain no constraint forces after projection on the columns of
//! `A^-1` that belong to `s`. Derivatives follow from those of `A w = (-b, s)`.

use nalgebra::DMatrix;
use trilink_robot::{MAX_LINKS, Number, Pose};

use super::balance::{Balance, DRY_WHEELS, Node, Posture, System, WheelState};
use super::cluster::Clusters;
use super::forces::ChainSample;
use super::plane::{Moving, Vector, inner, normal, rotated, scaled, sum};
use super::{ChainProblem, OfChain};
use crate::reduced::{MAX_TRACKED, Reduced, Residual};

/// Maximum number of directions in which a chain can move without skidding, at given rates of its driven joints.
pub(super) const MAX_SPEEDS: usize = 3;

/// Equations of motion with wheels that cannot skid. The states are [`MAX_SPEEDS`] speeds along the null space of the
/// constraints, of which those that do not exist decay to zero, and the angles of the free joints: `N` = 2 + `C` states
/// for `C` clusters.
#[derive(Debug, Clone)]
pub(super) struct NoSkid<const N: usize, const C: usize> {
    problem: ChainProblem,
    system: System<C, DRY_WHEELS>,
    /// Rows `E` of the speeds.
    speeds: Vec<[f64; N]>,
}

/// Velocities without skid at one time.
struct Solved<T, const N: usize, const C: usize> {
    matrix: Triangular<T, N>,
    velocity: [T; N],
    acceleration: [T; N],
    posture: Posture<T, C>,
    wheels: [WheelState<T>; DRY_WHEELS],
}

/// Square matrix, the product of a unit lower triangular matrix and one whose rows are orthogonal.
struct Triangular<T, const N: usize> {
    lower: [[T; N]; N],
    rows: [[T; N]; N],
    /// Reciprocals of the squared lengths of the rows.
    per_square: [T; N],
}

impl<T: Number, const N: usize> Triangular<T, N> {
    /// Factors a matrix by the modified Gram-Schmidt method.
    #[inline(always)]
    fn new(mut rows: [[T; N]; N]) -> Self {
        let zero = T::splat(0.0);
        let mut lower = [[zero; N]; N];
        let mut per_square = [zero; N];
        for i in 0..N {
            for j in 0..i {
                let share = product(&rows[i], &rows[j]) * per_square[j];
                lower[i][j] = share;
                (0..N).for_each(|k| rows[i][k] = rows[i][k] - share * rows[j][k]);
            }
            per_square[i] = T::splat(1.0) / product(&rows[i], &rows[i]);
        }
        Self { lower, rows, per_square }
    }

    #[inline(always)]
    fn solve(&self, mut right: [T; N]) -> [T; N] {
        let mut solution = [T::splat(0.0); N];
        for i in 0..N {
            (0..i).for_each(|j| right[i] = right[i] - self.lower[i][j] * right[j]);
            let share = right[i] * self.per_square[i];
            (0..N).for_each(|k| solution[k] += share * self.rows[i][k]);
        }
        solution
    }

    #[inline(always)]
    fn solve_transposed(&self, right: &[T; N]) -> [T; N] {
        let mut solution: [T; N] =
            std::array::from_fn(|i| product(&self.rows[i], right) * self.per_square[i]);
        for i in (0..N).rev() {
            let known = solution[i];
            (0..i).for_each(|j| solution[j] = solution[j] - self.lower[i][j] * known);
        }
        solution
    }
}

#[inline(always)]
fn product<T: Number, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    (0..N).fold(T::splat(0.0), |sum, i| sum + a[i] * b[i])
}

impl<const N: usize, const C: usize> NoSkid<N, C> {
    /// Creates the equations; `None` if there are more than [`MAX_SPEEDS`] speeds.
    pub(super) fn new(problem: ChainProblem) -> Option<Self> {
        const { assert!(N == C + 2) };
        let clusters = Clusters::new(problem.chain.clone(), problem.omega_rad_s, false);
        let system = System::new(clusters);
        let speeds = speeds_at_mean_shape::<N, C>(&problem);
        (speeds.len() <= MAX_SPEEDS).then_some(Self { problem, system, speeds })
    }

    /// Number of wheels and thus of constraints.
    fn constraints(&self) -> usize {
        self.system.wheels.len()
    }

    #[inline(always)]
    fn angles<T: Number>(y: &[T; N]) -> [T; C] {
        std::array::from_fn(|c| if c == 0 { T::splat(0.0) } else { y[MAX_SPEEDS + c - 1] })
    }

    #[inline(always)]
    fn posture<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        phi_rad: [T; C],
        velocity: &[T; N],
    ) -> Posture<T, C> {
        let rates = std::array::from_fn(|c| if c == 0 { T::splat(0.0) } else { velocity[2 + c] });
        self.system.posture(&node.clusters, [velocity[0], velocity[1], velocity[2]], phi_rad, rates)
    }

    #[inline(always)]
    fn wheels<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        posture: &Posture<T, C>,
    ) -> [WheelState<T>; DRY_WHEELS] {
        let none = [T::splat(0.0); 2];
        let zero = T::splat(0.0);
        let mut wheels =
            [WheelState { direction: none, place: none, roll_m_s: zero, skid_m_s: zero };
                DRY_WHEELS];
        for (i, (cluster, _)) in self.system.wheels.iter().enumerate() {
            wheels[i] = self.system.wheel(posture, &node.wheels[i], *cluster);
        }
        wheels
    }

    /// Returns the factored matrix `A` and the skid velocities `b` due to the commanded motion.
    #[inline(always)]
    fn constrain<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        phi_rad: [T; C],
    ) -> (Triangular<T, N>, [T; N]) {
        let zero = T::splat(0.0);
        let still = self.posture(node, phi_rad, &[zero; N]);
        let wheels = self.wheels(node, &still);
        let mut rows = [[zero; N]; N];
        let mut skid_m_s = [zero; N];
        for (i, (cluster, _)) in self.system.wheels.iter().enumerate() {
            rows[i] = self.system.skid_row(&still, &wheels[i], *cluster);
            skid_m_s[i] = wheels[i].skid_m_s;
        }
        for (row, speed) in rows[self.constraints()..].iter_mut().zip(&self.speeds) {
            *row = speed.map(T::splat);
        }
        (Triangular::new(rows), skid_m_s)
    }

    /// Returns the right-hand side with the given negated values for the wheels and values for the speeds.
    #[inline(always)]
    fn right<T: Number>(&self, wheels: &[T; N], speeds: &[T]) -> [T; N] {
        std::array::from_fn(|i| match i.checked_sub(self.constraints()) {
            None => -wheels[i],
            Some(speed) => speeds[speed],
        })
    }

    #[inline(always)]
    fn solve<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        y: &[T; N],
        dy: &[T; N],
    ) -> Solved<T, N, C> {
        let phi_rad = Self::angles(y);
        let (matrix, skid_m_s) = self.constrain(node, phi_rad);
        let velocity = matrix.solve(self.right(&skid_m_s, y));
        let posture = self.posture(node, phi_rad, &velocity);
        let wheels = self.wheels(node, &posture);
        let (origins, turning) = self.steady_accelerations(node, &posture);
        let mut skid_m_s2 = [T::splat(0.0); N];
        for (i, (c, _)) in self.system.wheels.iter().enumerate() {
            let moving = self.moving(node, &posture, i);
            let point = sum(origins[*c], moving.carried(posture.rate[*c], turning[*c]));
            let link_rate = posture.rate[*c] + node.wheels[i].turning;
            skid_m_s2[i] =
                inner(normal(wheels[i].direction), point) - link_rate * wheels[i].roll_m_s;
        }
        let acceleration = matrix.solve(self.right(&skid_m_s2, dy));
        Solved { matrix, velocity, acceleration, posture, wheels }
    }

    /// Returns the motion of a wheel relative to its cluster's origin, along the axes of the reference link.
    #[inline(always)]
    fn moving<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        posture: &Posture<T, C>,
        wheel: usize,
    ) -> Moving<T> {
        let own = &node.wheels[wheel];
        let turn = posture.turn[self.system.wheels[wheel].0];
        Moving {
            at: rotated(turn, own.place),
            rate: rotated(turn, own.rate),
            acceleration: rotated(turn, own.acceleration),
        }
    }

    /// Returns the accelerations of the clusters' origins and their angular accelerations while the velocities of the
    /// reference link and of the free joints are constant.
    #[inline(always)]
    fn steady_accelerations<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        posture: &Posture<T, C>,
    ) -> ([Vector<T>; C], [T; C]) {
        let [u, v] = posture.velocity[0];
        let r = posture.rate[0];
        let mut origins = [[-(r * v), r * u]; C];
        let mut turning = [T::splat(0.0); C];
        for c in 1..C {
            let p = self.system.clusters.all[c].parent;
            turning[c] = turning[p] + node.clusters[c].heading.acceleration;
            let hung = posture.place[c].carried(posture.rate[p], turning[p]);
            origins[c] = sum(origins[p], hung);
        }
        (origins, turning)
    }

    /// Returns, for changes `velocity` in the velocities, the changes in the velocities of the clusters' origins and in
    /// their turning rates.
    #[inline(always)]
    fn change<T: Number>(
        &self,
        posture: &Posture<T, C>,
        velocity: &[T; N],
    ) -> ([Vector<T>; C], [T; C]) {
        let mut origins = [[velocity[0], velocity[1]]; C];
        let mut rates = [velocity[2]; C];
        for c in 1..C {
            let cluster = &self.system.clusters.all[c];
            let p = cluster.parent;
            rates[c] = rates[p] + T::splat(cluster.sign) * velocity[2 + c];
            origins[c] = sum(origins[p], scaled(rates[p], normal(posture.place[c].at)));
        }
        (origins, rates)
    }

    /// Returns the changes in the skid accelerations of the wheels for changes in the velocities.
    #[inline(always)]
    fn skid_acceleration_change<T: Number>(
        &self,
        node: &Node<T, C, DRY_WHEELS>,
        solved: &Solved<T, N, C>,
        balance: &Balance<T, C, N>,
        velocity: &[T; N],
    ) -> [T; N] {
        let Solved { posture, wheels, .. } = solved;
        let [u, v] = posture.velocity[0];
        let r = posture.rate[0];
        let (origins, rates) = self.change(posture, velocity);
        let [du, dv, dr] = [velocity[0], velocity[1], velocity[2]];
        let mut accelerations = [[-(dr * v + r * dv), dr * u + r * du]; C];
        for c in 1..C {
            let p = self.system.clusters.all[c].parent;
            let hung = scaled(rates[p], balance.dacceleration_drate[c]);
            accelerations[c] = sum(accelerations[p], hung);
        }
        let mut changes = [T::splat(0.0); N];
        for (i, (c, _)) in self.system.wheels.iter().enumerate() {
            let c = *c;
            let moving = self.moving(node, posture, i);
            let WheelState { direction, roll_m_s, place, .. } = wheels[i];
            let point =
                sum(accelerations[c], scaled(rates[c], moving.dcarried_drate(posture.rate[c])));
            let link_rate = posture.rate[c] + node.wheels[i].turning;
            let roll = inner(direction, sum(origins[c], scaled(rates[c], normal(place))));
            changes[i] = inner(normal(direction), point) - rates[c] * roll_m_s - link_rate * roll;
        }
        changes
    }
}

/// Returns rows that span the null space of the constraints at the mean shape, in which all commands are at their
/// offsets. If the chain is straight there, the first row is the velocity along it.
fn speeds_at_mean_shape<const N: usize, const C: usize>(problem: &ChainProblem) -> Vec<[f64; N]> {
    let mean = problem.chain.at_mean_shape();
    let length_m = mean.skid_length_m;
    let angles = mean.clone();
    let system: System<C, DRY_WHEELS> =
        System::new(Clusters::new(mean, problem.omega_rad_s, false));
    let node: Node<f64, C, DRY_WHEELS> = system.node(0.0);
    let mut phi_rad = [0.0; C];
    for c in 1..C {
        phi_rad[c] = angles.rest_angle_rad(system.clusters.all[c].joint);
    }
    let posture = system.posture(&node.clusters, [0.0; 3], phi_rad, [0.0; C]);
    let constraints = system.wheels.len();
    let mut matrix = DMatrix::<f64>::zeros(N + constraints + 1, N);
    for (i, (cluster, _)) in system.wheels.iter().enumerate() {
        let wheel = system.wheel(&posture, &node.wheels[i], *cluster);
        let row: [f64; N] = system.skid_row(&posture, &wheel, *cluster);
        for (k, entry) in row.into_iter().enumerate() {
            matrix[(i, k)] = if k < 2 { entry } else { entry / length_m };
        }
    }
    const STRAIGHT: f64 = 1e-12;
    let is_straight = (0..constraints).all(|i| matrix[(i, 0)].abs() < STRAIGHT);
    let mut rows = Vec::new();
    if is_straight {
        matrix[(constraints, 0)] = 1.0;
        rows.push(std::array::from_fn(|k| if k == 0 { 1.0 } else { 0.0 }));
    }
    let Some(decomposed) = matrix.try_svd(false, true, f64::EPSILON, 1000) else { return rows };
    let Some(directions) = decomposed.v_t else { return rows };
    let mut order: Vec<usize> = (0..N).collect();
    let values = &decomposed.singular_values;
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let wanted = N.saturating_sub(constraints + rows.len());
    for k in order.into_iter().take(wanted) {
        rows.push(std::array::from_fn(|i| directions[(k, i)] * if i < 2 { 1.0 } else { length_m }));
    }
    rows
}

impl<const N: usize, const C: usize> OfChain<N, C> for NoSkid<N, C> {
    fn problem(&self) -> &ChainProblem {
        &self.problem
    }

    fn clusters(&self) -> &Clusters {
        &self.system.clusters
    }

    fn accelerations(
        &self,
        node: &Self::Node<f64>,
        y: &[f64; N],
        dy: &[f64; N],
    ) -> ([f64; 3], [f64; C]) {
        let rates = self.solve(node, y, dy).acceleration;
        let joints = std::array::from_fn(|c| if c == 0 { 0.0 } else { rates[2 + c] });
        ([rates[0], rates[1], rates[2]], joints)
    }
}

impl<const N: usize, const C: usize> Reduced<N> for NoSkid<N, C> {
    const ANGLES: usize = C - 1;
    const INTEGRATED: bool = false;
    const SKIDS: bool = false;
    const IS_LINEAR: bool = false;
    const TRACKED: usize = 2 * C + 1;

    type Node<T: Number> = Node<T, C, DRY_WHEELS>;
    super::of_chain!();

    fn with_transition_scaled(&self, factor: f64) -> Option<Self> {
        let is_dry = self.problem.laws.are_dry();
        is_dry.then(|| Self::new(self.problem.with_transition_scaled(factor))).flatten()
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        let problem = self.problem.with_friction_scaled(factor);
        Self::new(problem).unwrap_or_else(|| self.clone())
    }

    #[inline(always)]
    fn node<T: Number>(&self, phase_rad: T) -> Self::Node<T> {
        self.system.node(phase_rad)
    }

    #[inline(always)]
    fn residual<T: Number>(&self, node: &Self::Node<T>, y: &[T; N], dy: &[T; N]) -> Residual<N, T> {
        let zero = T::splat(0.0);
        let one = T::splat(1.0);
        let mut residual = Residual {
            value: [zero; N],
            state_jacobian: [[zero; N]; N],
            rate_jacobian: [[zero; N]; N],
        };
        let solved = self.solve(node, y, dy);
        let Solved { matrix, velocity, acceleration, posture, wheels } = &solved;
        let balance = self.system.balance::<T, N>(node, posture, acceleration);
        // Constraint forces, then the forces along the null space.
        let supplied = matrix.solve_transposed(&balance.force);
        let constraints = self.constraints();
        let count = N - constraints;
        let unit =
            |i: usize| -> [T; N] { std::array::from_fn(|k| if k == i { one } else { zero }) };
        let mut null = [[zero; N]; MAX_SPEEDS];
        for k in 0..count {
            null[k] = matrix.solve(unit(constraints + k));
            residual.value[k] = supplied[constraints + k];
        }
        let along = |force: &[T; N], k: usize| product(&null[k], force);
        // Change in the forces for changes in the velocities and their time derivatives.
        let force_change = |velocity: &[T; N], acceleration: &[T; N]| -> [T; N] {
            std::array::from_fn(|i| {
                product(&balance.dforce_dvelocity[i], velocity)
                    + product(&balance.mass[i], acceleration)
            })
        };
        let acceleration_change =
            |skid: &[T; N]| matrix.solve(self.right(skid, &[zero; MAX_SPEEDS]));
        for k in 0..count {
            let skid = self.skid_acceleration_change(node, &solved, &balance, &null[k]);
            let change = force_change(&null[k], &acceleration_change(&skid));
            let by_rate = force_change(&[zero; N], &null[k]);
            for m in 0..count {
                residual.state_jacobian[m][k] = along(&change, m);
                residual.rate_jacobian[m][k] = along(&by_rate, m);
            }
        }
        for k in count..MAX_SPEEDS {
            let omega = T::splat(self.problem.omega_rad_s);
            residual.value[k] = dy[k] + omega * y[k];
            residual.state_jacobian[k][k] = omega;
            residual.rate_jacobian[k][k] = one;
        }
        let mut virtual_velocities = [[[zero; 2]; C]; MAX_SPEEDS];
        for m in 0..count {
            virtual_velocities[m] = self.change(posture, &null[m]).0;
        }
        for b in 1..C {
            let sign = T::splat(self.system.clusters.all[b].sign);
            let mut skid = [zero; N];
            let mut turned = [zero; N];
            let mut virtual_skid = [zero; MAX_SPEEDS];
            for (i, (c, _)) in self.system.wheels.iter().enumerate() {
                if !self.system.is_beyond(b, *c) {
                    continue;
                }
                let direction = wheels[i].direction;
                let link_rate = posture.rate[*c] + node.wheels[i].turning;
                skid[i] = -(sign * inner(direction, posture.velocity[b]));
                turned[i] = -(sign
                    * (inner(direction, balance.acceleration[b])
                        + link_rate * inner(normal(direction), posture.velocity[b])));
                for m in 0..count {
                    virtual_skid[m] +=
                        -(sign * supplied[i] * inner(direction, virtual_velocities[m][b]));
                }
            }
            let velocity_change = matrix.solve(self.right(&skid, &[zero; MAX_SPEEDS]));
            let with_velocity =
                self.skid_acceleration_change(node, &solved, &balance, &velocity_change);
            let skid_change: [T; N] = std::array::from_fn(|i| turned[i] + with_velocity[i]);
            let mut change = force_change(&velocity_change, &acceleration_change(&skid_change));
            (0..N).for_each(|i| change[i] += balance.dforce_dphi[b][i]);
            let column = MAX_SPEEDS + b - 1;
            for m in 0..count {
                residual.state_jacobian[m][column] = along(&change, m) - virtual_skid[m];
            }
            for c in 1..C {
                residual.state_jacobian[MAX_SPEEDS + c - 1][column] = -velocity_change[2 + c];
            }
            residual.value[column] = dy[column] - velocity[2 + b];
            residual.rate_jacobian[column][column] = one;
            for k in 0..count {
                residual.state_jacobian[column][k] = -null[k][2 + b];
            }
        }
        residual
    }

    #[inline(always)]
    fn kinematics<T: Number>(&self, node: &Self::Node<T>, y: &[T; N]) -> Posture<T, C> {
        let phi_rad = Self::angles(y);
        let (matrix, skid_m_s) = self.constrain(node, phi_rad);
        let velocity = matrix.solve(self.right(&skid_m_s, y));
        self.posture(node, phi_rad, &velocity)
    }

    fn half_period_signs(&self) -> Option<[f64; N]> {
        let signs = std::array::from_fn(|i| if i == 0 { 1.0 } else { -1.0 });
        self.problem.chain.is_mirrored().then_some(signs)
    }

    fn at_rest(&self) -> [f64; N] {
        let angles = self.rest_angles();
        std::array::from_fn(|i| if i < MAX_SPEEDS { 0.0 } else { angles[i - MAX_SPEEDS] })
    }
}
