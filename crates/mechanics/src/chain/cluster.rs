//! Clusters: links between which all joints are driven.
//!
//! Within its own frame, a cluster moves as commanded. All that the equations of motion need to know of it at a phase
//! are a few sums over its links, so that their cost depends on the number of free joints, not on that of links.
//! Cluster 0 contains the reference link, whose frame is that of the cluster; every other cluster hangs on its parent
//! by a free joint, which is the origin of its frame, and has the heading of the link at that joint. Parents precede
//! their children.

use trilink_robot::{
    Chain, FreeJoint, Gait, Joint, JointCommand, Link, MAX_LINKS, Number, WheelFriction,
};

use super::plane::{Heading, Moving, Vector, inner, moment, normal, sum};

/// Link in its cluster.
#[derive(Debug, Clone)]
struct Member {
    /// Index of the link in the chain.
    link: usize,
    /// Driven joint by which the link hangs on an earlier member; `None` for the first.
    hinge: Option<Hinge>,
    /// Place of that joint, or of the free joint at the cluster's origin, along the link, m.
    joint_m: f64,
}

#[derive(Debug, Clone, Copy)]
struct Hinge {
    /// Index of the member on which the link hangs, and the place of the joint along that member, m.
    from: usize,
    from_m: f64,
    /// 1 if the heading increases with the joint's angle (behind the reference link), otherwise -1.
    sign: f64,
    command: JointCommand,
}

#[derive(Debug, Clone)]
pub(super) struct Cluster {
    /// Index of the parent cluster, and of its member on which this cluster hangs; 0 for cluster 0.
    pub parent: usize,
    parent_member: usize,
    /// Place of the free joint along that member, m.
    parent_m: f64,
    /// 1 if the heading increases with the free joint's angle (behind the reference link), otherwise -1.
    pub sign: f64,
    /// Index in the chain, and parameters, of the free joint; those of cluster 0 are unused.
    pub joint: usize,
    pub free: FreeJoint,
    members: Vec<Member>,
    /// Mass of the cluster and of those that hang on it, kg.
    pub mass_beyond_kg: f64,
}

/// Sums over the links of a cluster at one phase, in its frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClusterNode<T> {
    /// First moment of mass about the cluster's origin, with the masses of hanging clusters at their joints, kg m.
    pub moment: Moving<T>,
    /// Moment of inertia about the origin, with the same masses, kg m^2.
    pub inertia: T,
    /// Half the time derivative of the moment of inertia, kg m^2/s.
    pub half_inertia_rate: T,
    /// Rate of change of the angular momentum of the commanded motion, N m.
    pub spin: T,
    /// Place of the cluster's free joint in the parent's frame.
    pub place: Moving<T>,
    /// Heading of the link on which the cluster hangs, in the parent's frame.
    pub heading: Heading<T>,
    /// Torque of the free joint at angle 0 and at rest, N m.
    pub drive: T,
    /// Linear resistance: derivatives of the force (N) and torque about the origin (N m) with respect to the velocity
    /// of the origin (along the cluster's frame) and the turning rate. The upper triangle, row by row.
    pub resistance: [T; 6],
    /// Force and torque due to the commanded motion.
    pub resistance_at_rest: [T; 3],
}

/// Rolling direction of a wheel in its cluster's frame, and its motion there.
#[derive(Debug, Clone, Copy)]
pub(super) struct WheelNode<T> {
    pub direction: Vector<T>,
    pub place: Vector<T>,
    /// Velocity of the wheel in the cluster's frame, m/s.
    pub rate: Vector<T>,
}

impl<T: Number> WheelNode<T> {
    pub(super) fn zero() -> Self {
        let none = [T::splat(0.0); 2];
        Self { direction: none, place: none, rate: none }
    }
}

impl Cluster {
    /// Divides a chain into clusters.
    pub(super) fn all(chain: &Chain) -> Vec<Self> {
        let new = |parent, parent_member, parent_m, sign, joint, free, link, joint_m| Self {
            parent,
            parent_member,
            parent_m,
            sign,
            joint,
            free,
            members: vec![Member { link, hinge: None, joint_m }],
            mass_beyond_kg: 0.0,
        };
        let mut clusters = vec![new(0, 0, 0.0, 1.0, 0, FreeJoint::default(), chain.reference, 0.0)];
        let ahead = (0..chain.reference).rev().map(|link| (link, link, -1.0));
        let behind = (chain.reference + 1..chain.links.len()).map(|link| (link, link - 1, 1.0));
        // Cluster and member of the link on which the next one hangs.
        let mut last = (0, 0);
        for (link, joint, sign) in ahead.chain(behind) {
            if link == chain.reference + 1 {
                last = (0, 0);
            }
            let own = &chain.links[link];
            let (from_m, joint_m) = if sign < 0.0 {
                (chain.links[link + 1].front_joint_m, -own.rear_joint_m)
            } else {
                (-chain.links[link - 1].rear_joint_m, own.front_joint_m)
            };
            let (cluster, member) = last;
            match chain.joints[joint] {
                Joint::Driven(command) => {
                    let members = &mut clusters[cluster].members;
                    let hinge = Some(Hinge { from: member, from_m, sign, command });
                    members.push(Member { link, hinge, joint_m });
                    last = (cluster, members.len() - 1);
                }
                Joint::Free(free) => {
                    clusters.push(new(cluster, member, from_m, sign, joint, free, link, joint_m));
                    last = (clusters.len() - 1, 0);
                }
            }
        }
        for c in (0..clusters.len()).rev() {
            let own = clusters[c].members.iter().map(|member| chain.links[member.link].mass_kg);
            let mass_kg = clusters[c].mass_beyond_kg + own.sum::<f64>();
            clusters[c].mass_beyond_kg = mass_kg;
            if c > 0 {
                let parent = clusters[c].parent;
                clusters[parent].mass_beyond_kg += mass_kg;
            }
        }
        clusters
    }

    /// Returns the index of the cluster's first link.
    pub(super) fn root(&self) -> usize {
        self.members[0].link
    }

    /// Calls `visit` for each link of the cluster with its index, its heading and the motion of its origin.
    #[inline(always)]
    fn walk<T: Number>(
        &self,
        phase_rad: T,
        omega_rad_s: f64,
        mut visit: impl FnMut(usize, &Member, &Heading<T>, &Moving<T>),
    ) {
        let mut known = [(Heading::straight(), Moving::zero()); MAX_LINKS];
        for (i, member) in self.members.iter().enumerate() {
            let (heading, joint) = match &member.hinge {
                None => (Heading::straight(), Moving::zero()),
                Some(hinge) => {
                    let (from, origin) = &known[hinge.from];
                    let [angle, rate, acceleration] = waves(&hinge.command, phase_rad, omega_rad_s);
                    let sign = T::splat(hinge.sign);
                    let (sin, cos) = (sign * angle).sin_cos();
                    let heading = Heading {
                        turn: super::plane::rotated(from.turn, [cos, sin]),
                        rate: from.rate + sign * rate,
                        acceleration: from.acceleration + sign * acceleration,
                    };
                    (heading, from.ahead(origin, hinge.from_m))
                }
            };
            let origin = heading.ahead(&joint, -member.joint_m);
            visit(i, member, &heading, &origin);
            known[i] = (heading, origin);
        }
    }
}

/// Returns a command's angle, rate and acceleration at a phase.
#[inline(always)]
fn waves<T: Number>(command: &JointCommand, phase_rad: T, omega_rad_s: f64) -> [T; 3] {
    let omega = T::splat(omega_rad_s);
    let amplitude = T::splat(command.amplitude_rad);
    let (sin, cos) = (phase_rad + T::splat(command.phase_rad)).sin_cos();
    let mut waves = [
        T::splat(command.offset_rad) + amplitude * cos,
        -(amplitude * omega * sin),
        -(amplitude * omega * omega * cos),
    ];
    if let Some(second) = command.second {
        let (sin, cos) = (phase_rad + phase_rad).sin_cos();
        let [in_phase, quadrature] = Gait::second_waves([sin, cos], omega_rad_s);
        let [a, b] = [second.in_phase_rad, second.quadrature_rad].map(T::splat);
        (0..3).for_each(|k| waves[k] += a * in_phase[k] + b * quadrature[k]);
    }
    waves
}

/// Chain divided into clusters.
#[derive(Debug, Clone)]
pub(super) struct Clusters {
    pub chain: Chain,
    pub omega_rad_s: f64,
    pub all: Vec<Cluster>,
    /// Whether the friction of the wheels is part of the clusters' linear resistance.
    pub is_linear: bool,
}

impl Clusters {
    pub(super) fn new(chain: Chain, omega_rad_s: f64, is_linear: bool) -> Self {
        let all = Cluster::all(&chain);
        Self { chain, omega_rad_s, all, is_linear }
    }

    /// Returns the sums of all clusters, of which there must be `C`, at a phase.
    #[inline(always)]
    pub(super) fn nodes<T: Number, const C: usize>(&self, phase_rad: T) -> [ClusterNode<T>; C] {
        let zero = T::splat(0.0);
        let empty = ClusterNode {
            moment: Moving::zero(),
            inertia: zero,
            half_inertia_rate: zero,
            spin: zero,
            place: Moving::zero(),
            heading: Heading::straight(),
            drive: zero,
            resistance: [zero; 6],
            resistance_at_rest: [zero; 3],
        };
        let mut nodes = [empty; C];
        for (c, cluster) in self.all.iter().enumerate() {
            let mut own = nodes[c];
            cluster.walk(phase_rad, self.omega_rad_s, |i, member, heading, origin| {
                let link = &self.chain.links[member.link];
                let centre = heading.ahead(origin, link.com_m);
                let rotor_kg_m2 = link.rotor.map_or(0.0, |rotor| rotor.inertia_kg_m2);
                let inertia = T::splat(link.inertia_kg_m2 + rotor_kg_m2);
                own.add_mass(link.mass_kg, &centre);
                own.inertia += inertia;
                own.spin += inertia * heading.acceleration;
                if let Some(rotor) = &link.rotor {
                    let [_, _, acceleration] = waves(&rotor.angle, phase_rad, self.omega_rad_s);
                    own.spin += T::splat(rotor.inertia_kg_m2) * acceleration;
                }
                own.add_drag(link, heading, &centre);
                if self.is_linear
                    && let Some(wheel) = link.wheel
                {
                    let at = heading.ahead(origin, wheel.place_m);
                    let direction = steered(heading, wheel.steer_rad);
                    let WheelFriction { roll_kg_s, skid_kg_s, .. } = wheel.friction;
                    own.add_resistance(roll_kg_s, direction, &at);
                    own.add_resistance(skid_kg_s, normal(direction), &at);
                }
                let hanging = self.all.iter().enumerate().skip(1);
                for (child, hanging) in
                    hanging.filter(|(_, one)| one.parent == c && one.parent_member == i)
                {
                    let place = heading.ahead(origin, hanging.parent_m);
                    own.add_mass(hanging.mass_beyond_kg, &place);
                    nodes[child].place = place;
                    nodes[child].heading = *heading;
                }
            });
            let FreeJoint { stiffness_nm_rad, target, torque, .. } = &cluster.free;
            if c > 0 {
                let [angle, ..] = waves(target, phase_rad, self.omega_rad_s);
                let (_, cos) = (phase_rad + T::splat(torque.phase_rad)).sin_cos();
                own.drive = T::splat(*stiffness_nm_rad) * angle
                    + T::splat(torque.mean_nm)
                    + T::splat(torque.amplitude_nm) * cos;
            }
            nodes[c] = own;
        }
        nodes
    }

    /// Returns the wheels, from front to rear, in the frames of their clusters at a phase, followed by zeros.
    #[inline(always)]
    pub(super) fn wheels<T: Number>(&self, phase_rad: T) -> [WheelNode<T>; MAX_LINKS] {
        let mut wheels = [WheelNode::zero(); MAX_LINKS];
        for cluster in &self.all {
            cluster.walk(phase_rad, self.omega_rad_s, |_, member, heading, origin| {
                if let Some(wheel) = self.chain.links[member.link].wheel {
                    let Moving { at, rate, .. } = heading.ahead(origin, wheel.place_m);
                    wheels[self.wheel_of(member.link)] =
                        WheelNode { direction: steered(heading, wheel.steer_rad), place: at, rate };
                }
            });
        }
        wheels
    }

    /// Returns the index of a link's wheel among the wheels from front to rear.
    fn wheel_of(&self, link: usize) -> usize {
        self.chain.links[..link].iter().filter(|link| link.wheel.is_some()).count()
    }

    /// Returns the index of the link of a wheel, given its index among the wheels from front to rear.
    pub(super) fn link_of_wheel(&self, wheel: usize) -> usize {
        let links = self.chain.links.iter().enumerate();
        let mut wheeled = links.filter(|(_, link)| link.wheel.is_some()).map(|(link, _)| link);
        wheeled.nth(wheel).unwrap_or(0)
    }

    /// Returns, for each wheel from front to rear, the index of its cluster and its friction coefficients.
    pub(super) fn wheel_friction(&self) -> Vec<(usize, WheelFriction)> {
        let cluster_of = |link: usize| {
            let holds = |cluster: &Cluster| cluster.members.iter().any(|one| one.link == link);
            self.all.iter().position(holds).unwrap_or(0)
        };
        let wheels = self.chain.links.iter().enumerate();
        wheels.filter_map(|(link, one)| Some((cluster_of(link), one.wheel?.friction))).collect()
    }
}

/// Returns the rolling direction of a wheel that is steered by an angle relative to its link.
#[inline(always)]
fn steered<T: Number>(heading: &Heading<T>, steer_rad: f64) -> Vector<T> {
    let (sin, cos) = steer_rad.sin_cos();
    super::plane::rotated(heading.turn, [T::splat(cos), T::splat(sin)])
}

impl<T: Number> ClusterNode<T> {
    #[inline(always)]
    fn add_mass(&mut self, mass_kg: f64, at: &Moving<T>) {
        let mass = T::splat(mass_kg);
        self.moment.add(mass_kg, at);
        self.inertia += mass * inner(at.at, at.at);
        self.half_inertia_rate += mass * inner(at.at, at.rate);
        self.spin += mass * moment(at.at, at.acceleration);
    }

    /// Adds a viscous resistance along a direction at a point.
    #[inline(always)]
    fn add_resistance(&mut self, coefficient_kg_s: f64, direction: Vector<T>, at: &Moving<T>) {
        if coefficient_kg_s == 0.0 {
            return;
        }
        let coefficient = T::splat(coefficient_kg_s);
        let [x, y] = direction;
        let row = [x, y, moment(at.at, direction)];
        self.add_row(coefficient, row, inner(direction, at.rate));
    }

    #[inline(always)]
    fn add_row(&mut self, coefficient: T, row: [T; 3], speed: T) {
        let mut entry = 0;
        for i in 0..3 {
            let force = coefficient * row[i];
            self.resistance_at_rest[i] += force * speed;
            for of_column in &row[i..] {
                self.resistance[entry] += force * *of_column;
                entry += 1;
            }
        }
    }

    #[inline(always)]
    fn add_drag(&mut self, link: &Link, heading: &Heading<T>, centre: &Moving<T>) {
        let drag = &link.drag;
        self.add_resistance(drag.along_kg_s, heading.turn, centre);
        self.add_resistance(drag.across_kg_s, normal(heading.turn), centre);
        if drag.turning_nm_s_rad != 0.0 {
            let [zero, one] = [0.0, 1.0].map(T::splat);
            self.add_row(T::splat(drag.turning_nm_s_rad), [zero, zero, one], heading.rate);
        }
    }

    /// Returns the resisting force (along the axes of a frame in which the cluster is turned by the given angle) and
    /// torque about the origin, with their derivatives with respect to the velocity of the origin and the turning rate.
    #[inline(always)]
    pub(super) fn resist(
        &self,
        [cos, sin]: Vector<T>,
        velocity: Vector<T>,
        rate: T,
    ) -> ([T; 3], [[T; 3]; 3]) {
        let [xx, xy, xt, yy, yt, tt] = self.resistance;
        let [fx, fy, torque] = self.resistance_at_rest;
        let across = cos * sin * (xx - yy);
        let [cos2, sin2] = [cos * cos, sin * sin];
        let twice = (cos * sin + cos * sin) * xy;
        let slopes_xx = cos2 * xx + sin2 * yy - twice;
        let slopes_yy = sin2 * xx + cos2 * yy + twice;
        let slopes_xy = across + (cos2 - sin2) * xy;
        let [slopes_xt, slopes_yt] = super::plane::rotated([cos, sin], [xt, yt]);
        let slopes = [
            [slopes_xx, slopes_xy, slopes_xt],
            [slopes_xy, slopes_yy, slopes_yt],
            [slopes_xt, slopes_yt, tt],
        ];
        let [fx, fy] = super::plane::rotated([cos, sin], [fx, fy]);
        let at_rest = [fx, fy, torque];
        let moved = [velocity[0], velocity[1], rate];
        let mut force = at_rest;
        for i in 0..3 {
            (0..3).for_each(|j| force[i] += slopes[i][j] * moved[j]);
        }
        (force, slopes)
    }
}

/// Returns the velocity of a point in a turning frame whose origin moves.
#[inline(always)]
pub(super) fn velocity_of<T: Number>(origin: Vector<T>, rate: T, point: &Moving<T>) -> Vector<T> {
    sum(sum(origin, super::plane::scaled(rate, normal(point.at))), point.rate)
}
