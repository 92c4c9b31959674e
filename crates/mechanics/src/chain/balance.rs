//! Equations of motion of a chain of clusters: force balance with its Jacobian, by recursion along the tree of
//! clusters.
//!
//! All vectors are along the axes of the reference link. By d'Alembert's principle, the inertia force of a cluster is
//! `m A + g`, with the acceleration `A` of its origin, the mass `m` of it and of all clusters that hang on it, and `g =
//! carried(moment)` ([`Moving::carried`]). The torque about its origin is
//!
//! ```text
//! M x A + J W' + 2 D W + K + sum over children Q x G
//! ```
//!
//! with the turning rate W, the first moment M, the moment of inertia J, half its rate D and the spin K of
//! [`ClusterNode`], the place Q of a child's joint, and the sum G of `g` over all clusters beyond that joint. In these
//! terms the derivatives with respect to the velocity of the reference link and the turning rates of all clusters are
//! inner products or moments of two vectors; sums over the clusters beyond each joint convert them to joint rates.

use trilink_robot::{Friction, MAX_LINKS, Number, WheelFriction};

use super::cluster::{ClusterNode, Clusters, WheelNode, velocity_of};
use super::plane::{Moving, Vector, inner, moment, normal, rotated, scaled, sum};

/// Joint commands at one time, with the sums over the links of each of `C` clusters, and the wheels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node<T, const C: usize> {
    pub clusters: [ClusterNode<T>; C],
    pub wheels: [WheelNode<T>; MAX_LINKS],
    /// Velocities of the reference link, if constraints and commands alone determine them.
    pub determined: [T; 3],
}

/// Rotations and velocities of the clusters.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Posture<T, const C: usize> {
    /// Angles (rad) and rates (rad/s) of the free joints; the first entry is zero.
    pub phi_rad: [T; C],
    pub joint_rate: [T; C],
    /// Cosine and sine of each cluster's rotation relative to the reference link.
    pub turn: [Vector<T>; C],
    /// Turning rates, rad/s.
    pub rate: [T; C],
    /// Velocities of the clusters' origins, m/s.
    pub velocity: [Vector<T>; C],
    /// Motion of each cluster's joint relative to the origin of its parent.
    pub place: [Moving<T>; C],
}

/// Left-hand side of the equations of motion and its derivatives. Rows and columns are the velocities of the reference
/// link along and across itself, its turning rate, and the rates of the free joints: `D` = 2 + `C`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Balance<T, const C: usize, const D: usize> {
    pub force: [T; D],
    pub mass: [[T; D]; D],
    /// `dforce_dvelocity[i][j]`: derivative of force i with respect to velocity j.
    pub dforce_dvelocity: [[T; D]; D],
    /// `dforce_dphi[c][i]`: derivative of force i with respect to the angle of the free joint of cluster c.
    pub dforce_dphi: [[T; D]; C],
}

/// Equations of motion of a chain of clusters. Its functions are called with `C`, the number of clusters.
#[derive(Debug, Clone)]
pub(crate) struct System {
    pub clusters: Clusters,
    /// Cluster, link and friction coefficients of each wheel from front to rear.
    pub wheels: Vec<(usize, usize, WheelFriction)>,
}

impl System {
    pub(super) fn new(clusters: Clusters) -> Self {
        let wheels = clusters.wheel_friction();
        Self { clusters, wheels }
    }

    #[inline(always)]
    pub(super) fn node<T: Number, const C: usize>(&self, phase_rad: T) -> Node<T, C> {
        let mut node = Node {
            clusters: [ClusterNode::zero(); C],
            wheels: [WheelNode::zero(); MAX_LINKS],
            determined: [T::splat(0.0); 3],
        };
        self.clusters.fill(phase_rad, &mut node.clusters, &mut node.wheels);
        node
    }

    /// Returns the index of the parent of cluster `c`; that of cluster 1 is known to the compiler.
    #[inline(always)]
    pub(super) fn parent(&self, c: usize) -> usize {
        if c < 2 { 0 } else { self.clusters.all[c].parent }
    }

    /// Returns the clusters between the reference link and cluster `c`, from `c` towards the reference link: the index
    /// of each one's parent, then its own.
    #[inline(always)]
    fn path(&self, c: usize) -> impl Iterator<Item = [usize; 2]> {
        let parent = |c: usize| (c > 0).then(|| [self.parent(c), c]);
        std::iter::successors(parent(c), move |[above, _]| parent(*above))
    }

    /// Returns whether cluster `c` is cluster `b` or hangs on it.
    #[inline(always)]
    pub(super) fn is_beyond(&self, b: usize, c: usize) -> bool {
        self.path(c).any(|[_, own]| own == b)
    }

    #[inline(always)]
    pub(super) fn posture<T: Number, const C: usize>(
        &self,
        nodes: &[ClusterNode<T>; C],
        [u, v, r]: [T; 3],
        phi_rad: [T; C],
        joint_rate: [T; C],
    ) -> Posture<T, C> {
        let [zero, one] = [0.0, 1.0].map(T::splat);
        let mut posture = Posture {
            phi_rad,
            joint_rate,
            turn: [[one, zero]; C],
            rate: [r; C],
            velocity: [[u, v]; C],
            place: [Moving::zero(); C],
        };
        for c in 1..C {
            let cluster = &self.clusters.all[c];
            let node = &nodes[c];
            let sign = T::splat(cluster.sign);
            let (sin, cos) = (sign * phi_rad[c]).sin_cos();
            let p = self.parent(c);
            posture.turn[c] = rotated(node.heading.turn, [cos, sin]);
            posture.place[c] = node.place;
            if p > 0 {
                posture.turn[c] = rotated(posture.turn[p], posture.turn[c]);
                posture.place[c] = node.place.rotated(posture.turn[p]);
            }
            posture.rate[c] = posture.rate[p] + node.heading.rate + sign * joint_rate[c];
            posture.velocity[c] =
                velocity_of(posture.velocity[p], posture.rate[p], &posture.place[c]);
        }
        posture
    }

    /// Returns the rolling direction of a wheel and its place relative to its cluster's origin, along the axes of the
    /// reference link, and its roll and skid velocities.
    #[inline(always)]
    pub(super) fn wheel<T: Number, const C: usize>(
        &self,
        posture: &Posture<T, C>,
        wheel: &WheelNode<T>,
        cluster: usize,
    ) -> WheelState<T> {
        let WheelNode { mut direction, mut place, mut rate } = *wheel;
        if cluster > 0 {
            let turn = posture.turn[cluster];
            [direction, place, rate] = [direction, place, rate].map(|vector| rotated(turn, vector));
        }
        let moving = Moving { at: place, rate, acceleration: [T::splat(0.0); 2] };
        let velocity = velocity_of(posture.velocity[cluster], posture.rate[cluster], &moving);
        WheelState {
            direction,
            place,
            roll_m_s: inner(direction, velocity),
            skid_m_s: inner(normal(direction), velocity),
        }
    }

    /// Returns the wheels with their friction coefficients, unless it is part of the clusters' linear resistance.
    #[inline(always)]
    fn rubbing<'a, T: Number, const C: usize>(
        &'a self,
        node: &'a Node<T, C>,
        posture: &'a Posture<T, C>,
    ) -> impl Iterator<Item = (usize, WheelState<T>, &'a WheelFriction)> {
        let wheels = if self.clusters.is_linear { &[][..] } else { &self.wheels };
        node.wheels.iter().zip(wheels).map(|(wheel, (cluster, _, friction))| {
            (*cluster, self.wheel(posture, wheel, *cluster), friction)
        })
    }

    /// Returns the power dissipated by the wheels, by drag and by the dampers of the free joints, W.
    #[inline(always)]
    pub(super) fn loss_w<T: Number, F: Friction, const C: usize>(
        &self,
        node: &Node<T, C>,
        posture: &Posture<T, C>,
    ) -> T {
        let mut loss = T::splat(0.0);
        for c in 0..C {
            let rate = posture.joint_rate[c];
            loss += node.clusters[c].loss_w(posture.turn[c], posture.velocity[c], posture.rate[c])
                + T::splat(self.clusters.all[c].free.damping_nm_s_rad) * rate * rate;
        }
        for (_, WheelState { roll_m_s, skid_m_s, .. }, friction) in self.rubbing(node, posture) {
            loss += F::roll(friction, roll_m_s)[0] * roll_m_s
                + F::skid(friction, skid_m_s)[0] * skid_m_s;
        }
        loss
    }

    /// Evaluates the left-hand side of the equations of motion at a posture with the time derivatives `acceleration` of
    /// the velocities, and its derivatives if `SLOPES`.
    #[inline(always)]
    pub(super) fn balance<
        T: Number,
        F: Friction,
        const C: usize,
        const D: usize,
        const SLOPES: bool,
    >(
        &self,
        node: &Node<T, C>,
        posture: &Posture<T, C>,
        acceleration: &[T; D],
    ) -> Balance<T, C, D> {
        let zero = T::splat(0.0);
        let [u, v] = posture.velocity[0];
        let r = posture.rate[0];
        let mut balance = Balance {
            force: [zero; D],
            mass: [[zero; D]; D],
            dforce_dvelocity: [[zero; D]; D],
            dforce_dphi: [[zero; D]; C],
        };
        // Accelerations of the clusters' origins, and their derivatives, relative to the parent, with respect to the
        // parent's turning rate.
        let mut origins = [[acceleration[0] - r * v, acceleration[1] + r * u]; C];
        let mut dhung = [[zero; 2]; C];
        let Balance { force, mass, dforce_dvelocity: slopes, dforce_dphi } = &mut balance;
        let total = T::splat(self.clusters.all[0].mass_beyond_kg);
        mass[0][0] = total;
        mass[1][1] = total;
        let mut resistance = [[zero; 3]; C];
        let mut dresistance = [[[zero; 3]; 3]; C];
        for c in 0..C {
            let turn = (c > 0).then_some(posture.turn[c]);
            (resistance[c], dresistance[c]) =
                node.clusters[c].resist(turn, posture.velocity[c], posture.rate[c]);
        }
        for (cluster, state, friction) in self.rubbing(node, posture) {
            let WheelState { direction, place, roll_m_s, skid_m_s } = state;
            let force = &mut resistance[cluster];
            let slopes = &mut dresistance[cluster];
            let mut add = |direction: Vector<T>, [resistance, slope]: [T; 2]| {
                let row = [direction[0], direction[1], moment(place, direction)];
                for i in 0..3 {
                    force[i] += resistance * row[i];
                    (0..3).for_each(|j| slopes[i][j] += slope * row[i] * row[j]);
                }
            };
            add(direction, F::roll(friction, roll_m_s));
            add(normal(direction), F::skid(friction, skid_m_s));
        }
        let mut turning = [acceleration[2]; C];
        let mut moments = [[zero; 2]; C];
        // Forces of each cluster, and then of all clusters beyond its joint.
        let mut beyond = [[zero; 2]; C];
        for c in 0..C {
            let own = &node.clusters[c];
            let rate = posture.rate[c];
            if c > 0 {
                let cluster = &self.clusters.all[c];
                let p = self.parent(c);
                let place = &posture.place[c];
                turning[c] = turning[p]
                    + own.heading.acceleration
                    + T::splat(cluster.sign) * acceleration[2 + c];
                let hung = place.carried(posture.rate[p], turning[p]);
                origins[c] = sum(origins[p], hung);
                dhung[c] = place.dcarried_drate(posture.rate[p]);
            }
            let first = if c == 0 { own.moment } else { own.moment.rotated(posture.turn[c]) };
            let carried = first.carried(rate, turning[c]);
            moments[c] = first.at;
            beyond[c] = sum(carried, [resistance[c][0], resistance[c][1]]);
            let row = 2 + c;
            let two = T::splat(2.0);
            force[row] = moment(first.at, origins[c])
                + own.inertia * turning[c]
                + two * own.half_inertia_rate * rate
                + own.spin
                + resistance[c][2];
            if !SLOPES {
                continue;
            }
            let dcarried = first.dcarried_drate(rate);
            mass[row][row] = own.inertia;
            slopes[row][row] += two * own.half_inertia_rate;
            let [x, y] = normal(first.at);
            (mass[0][row], mass[row][0]) = (x, x);
            (mass[1][row], mass[row][1]) = (y, y);
            slopes[0][row] += dcarried[0];
            slopes[1][row] += dcarried[1];
            for [above, hung] in self.path(c) {
                let place = posture.place[hung].at;
                let coupling = inner(place, first.at);
                (mass[2 + above][row], mass[row][2 + above]) = (coupling, coupling);
                slopes[2 + above][row] += moment(place, dcarried);
                slopes[row][2 + above] += moment(first.at, dhung[hung]);
            }
            self.spread(c, posture, &dresistance[c], slopes);
        }
        for c in (1..C).rev() {
            let p = self.parent(c);
            force[2 + p] += moment(posture.place[c].at, beyond[c]);
            beyond[p] = sum(beyond[p], beyond[c]);
        }
        let [fx, fy] = sum(scaled(total, origins[0]), beyond[0]);
        (force[0], force[1]) = (fx, fy);

        // Rotation of all clusters beyond a joint.
        for b in if SLOPES { 1..C } else { 1..1 } {
            let column = &mut dforce_dphi[b];
            let [x, y] = normal(beyond[b]);
            (column[0], column[1]) = (x, y);
            for [above, hung] in self.path(b) {
                column[2 + above] = inner(posture.place[hung].at, beyond[b]);
            }
            let [vx, vy] = posture.velocity[b];
            for c in b..C {
                if !self.is_beyond(b, c) {
                    continue;
                }
                column[2 + c] += -inner(moments[c], origins[b]);
                let change = dresistance[c].map(|row| row[0] * vy - row[1] * vx);
                self.spread_force(c, posture, &change, column);
            }
        }
        self.by_joints::<T, C, D, SLOPES>(&mut balance);
        let Balance { force, mass, dforce_dvelocity: slopes, dforce_dphi } = &mut balance;
        // The rotation of the reference link accelerates all masses alike.
        for i in if SLOPES { 0..D } else { 0..0 } {
            let [along, across] = [mass[i][0], mass[i][1]];
            slopes[i][0] += across * r;
            slopes[i][1] += -(along * r);
            slopes[i][2] += across * u - along * v;
        }
        for c in 1..C {
            let free = &self.clusters.all[c].free;
            let [stiffness, damping] = [free.stiffness_nm_rad, free.damping_nm_s_rad].map(T::splat);
            let row = 2 + c;
            force[row] += stiffness * posture.phi_rad[c] + damping * posture.joint_rate[c]
                - node.clusters[c].drive;
            slopes[row][row] += damping;
            dforce_dphi[c][row] += stiffness;
        }
        balance
    }

    /// Adds a force and torque on a cluster, about its origin, to the forces conjugate to the velocities of the
    /// reference link and to the turning rates of the clusters.
    #[inline(always)]
    fn spread_force<T: Number, const C: usize, const D: usize>(
        &self,
        c: usize,
        posture: &Posture<T, C>,
        &[x, y, torque]: &[T; 3],
        force: &mut [T; D],
    ) {
        force[0] += x;
        force[1] += y;
        force[2 + c] += torque;
        for [above, hung] in self.path(c) {
            force[2 + above] += moment(posture.place[hung].at, [x, y]);
        }
    }

    /// Adds the derivatives of a force and torque on a cluster with respect to the velocity of its origin and its
    /// turning rate to those with respect to the velocities of the reference link and the turning rates.
    #[inline(always)]
    fn spread<T: Number, const C: usize, const D: usize>(
        &self,
        c: usize,
        posture: &Posture<T, C>,
        slopes: &[[T; 3]; 3],
        matrix: &mut [[T; D]; D],
    ) {
        // The slopes are symmetric.
        let [by_x, by_y, by_rate] = slopes;
        let mut add = |column: usize, &[x, y, torque]: &[T; 3]| {
            matrix[0][column] += x;
            matrix[1][column] += y;
            matrix[2 + c][column] += torque;
            for [above, hung] in self.path(c) {
                matrix[2 + above][column] += moment(posture.place[hung].at, [x, y]);
            }
        };
        add(0, by_x);
        add(1, by_y);
        add(2 + c, by_rate);
        for [above, hung] in self.path(c) {
            let [x, y] = normal(posture.place[hung].at);
            add(2 + above, &std::array::from_fn(|i| x * by_x[i] + y * by_y[i]));
        }
    }

    /// Converts forces and derivatives from the turning rates of the clusters to the turning rate of the reference link
    /// and the rates of the free joints.
    #[inline(always)]
    fn by_joints<T: Number, const C: usize, const D: usize, const SLOPES: bool>(
        &self,
        balance: &mut Balance<T, C, D>,
    ) {
        let Balance { force, mass, dforce_dvelocity: slopes, dforce_dphi } = balance;
        for c in (1..C).rev() {
            let [own, above] = [2 + c, 2 + self.parent(c)];
            let sign = T::splat(self.clusters.all[c].sign);
            self.fold(c, force);
            if !SLOPES {
                continue;
            }
            dforce_dphi.iter_mut().for_each(|column| self.fold(c, column));
            for matrix in [&mut *mass, &mut *slopes] {
                matrix.iter_mut().for_each(|row| self.fold(c, row));
                for j in 0..D {
                    let value = matrix[own][j];
                    matrix[above][j] += value;
                    matrix[own][j] = sign * value;
                }
            }
        }
        for c in 1..C {
            let sign = T::splat(self.clusters.all[c].sign);
            dforce_dphi[c].iter_mut().for_each(|force| *force = sign * *force);
        }
    }

    /// Converts the entry of a row from the turning rate of cluster `c` to the rate of its free joint, after those of
    /// all clusters that hang on it.
    #[inline(always)]
    fn fold<T: Number, const D: usize>(&self, c: usize, row: &mut [T; D]) {
        let value = row[2 + c];
        row[2 + self.parent(c)] += value;
        row[2 + c] = T::splat(self.clusters.all[c].sign) * value;
    }

    /// Returns, for a wheel, the row whose product with the velocities is its skid velocity (without that of the
    /// commanded motion).
    #[inline(always)]
    pub(super) fn skid_row<T: Number, const C: usize, const D: usize>(
        &self,
        posture: &Posture<T, C>,
        state: &WheelState<T>,
        cluster: usize,
    ) -> [T; D] {
        self.velocity_row(posture, state, cluster, normal(state.direction))
    }

    /// Returns, for a wheel, the row whose product with the velocities is the wheel's velocity along an axis (without that
    /// of the commanded motion).
    #[inline(always)]
    pub(super) fn velocity_row<T: Number, const C: usize, const D: usize>(
        &self,
        posture: &Posture<T, C>,
        state: &WheelState<T>,
        cluster: usize,
        axis: Vector<T>,
    ) -> [T; D] {
        let [x, y] = axis;
        let mut row = [T::splat(0.0); D];
        self.spread_force(cluster, posture, &[x, y, moment(state.place, axis)], &mut row);
        (1..C).rev().for_each(|c| self.fold(c, &mut row));
        row
    }
}

/// Wheel along the axes of the reference link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WheelState<T> {
    /// Rolling direction.
    pub direction: Vector<T>,
    /// Place relative to the origin of the wheel's cluster, m.
    pub place: Vector<T>,
    pub roll_m_s: T,
    pub skid_m_s: T,
}
