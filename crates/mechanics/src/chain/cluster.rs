//! Clusters: links between which all joints are driven.
//!
//! Within its own frame, a cluster moves as commanded. All that the equations of motion need to know of it at a phase
//! are a few sums over its links, so that their cost depends on the number of free joints, not on that of links.
//! Cluster 0 contains the reference link, whose frame is that of the cluster; every other cluster hangs on its parent
//! by a free joint, which is the origin of its frame, and has the heading of the link at that joint. Parents precede
//! their children.

use trilink_robot::{Chain, Drag, FreeJoint, Joint, MAX_LINKS, Number, Wheel, WheelFriction};

use super::plane::{Heading, Moving, Vector, inner, moment, normal, rotated, scaled, sum};
use super::wave::{Wave, prescribed};

/// Link in its cluster.
#[derive(Debug, Clone)]
struct Member {
    /// Index of the link in the chain.
    link: usize,
    /// Driven joint by which the link hangs on an earlier member; `None` for the first.
    hinge: Option<Hinge>,
    /// Place of that joint, or of the free joint at the cluster's origin, along the link, m.
    joint_m: f64,
    com_m: f64,
    mass_kg: f64,
    /// Moment of inertia, with that of the rotor, kg m^2.
    inertia_kg_m2: f64,
    /// Moment of inertia of the rotor, kg m^2, and its angle.
    rotor: Option<(f64, Wave)>,
    drag: Drag,
    /// Wheel, with its index among the wheels from front to rear.
    wheel: Option<(usize, Wheel)>,
    /// Clusters that hang on the link, and the places of their free joints along it, m.
    hanging: Vec<(usize, f64)>,
}

impl Member {
    fn new(chain: &Chain, link: usize, hinge: Option<Hinge>, joint_m: f64) -> Self {
        let own = &chain.links[link];
        let before = chain.links[..link].iter().filter(|link| link.wheel.is_some()).count();
        Self {
            link,
            hinge,
            joint_m,
            com_m: own.com_m,
            mass_kg: own.mass_kg,
            inertia_kg_m2: own.inertia_kg_m2 + own.rotor.map_or(0.0, |rotor| rotor.inertia_kg_m2),
            rotor: own.rotor.map(|rotor| (rotor.inertia_kg_m2, Wave::new(&rotor.angle))),
            drag: own.drag,
            wheel: own.wheel.map(|wheel| (before, wheel)),
            hanging: Vec::new(),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Hinge {
    /// Whether the link hangs on the first member of the cluster instead of the one before it.
    is_on_first: bool,
    /// Place of the joint along the member on which the link hangs, m.
    from_m: f64,
    /// 1 if the heading increases with the joint's angle (behind the reference link), otherwise -1.
    sign: f64,
    wave: Wave,
}

#[derive(Debug, Clone)]
pub(super) struct Cluster {
    /// Index of the parent cluster, on which this cluster hangs; 0 for cluster 0.
    pub parent: usize,
    /// 1 if the heading increases with the free joint's angle (behind the reference link), otherwise -1.
    pub sign: f64,
    /// Index in the chain, and parameters, of the free joint; those of cluster 0 are unused.
    pub joint: usize,
    pub free: FreeJoint,
    /// Angle at which the spring of the free joint is relaxed.
    target: Wave,
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
    /// Force and torque due to the commanded motion, and its power, W.
    pub resistance_at_rest: [T; 3],
    pub loss_at_rest: T,
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

    /// Returns a wheel on a link, given the motion of the link's origin and [`Heading::unit`].
    #[inline(always)]
    fn new(wheel: &Wheel, origin: &Moving<T>, unit: &Moving<T>) -> Self {
        let direction = match wheel.steer_rad {
            0.0 => unit.at,
            steer_rad => {
                let (sin, cos) = steer_rad.sin_cos();
                rotated(unit.at, [T::splat(cos), T::splat(sin)])
            }
        };
        let Moving { at: place, rate, .. } = origin.ahead(wheel.place_m, unit);
        Self { direction, place, rate }
    }
}

impl Cluster {
    /// Divides a chain into clusters.
    pub(super) fn all(chain: &Chain) -> Vec<Self> {
        let new = |parent, sign, joint, free: FreeJoint, link, joint_m| Self {
            parent,
            sign,
            joint,
            target: Wave::new(&free.target),
            free,
            members: vec![Member::new(chain, link, None, joint_m)],
            mass_beyond_kg: 0.0,
        };
        let mut clusters = vec![new(0, 1.0, 0, FreeJoint::default(), chain.reference, 0.0)];
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
                    let wave = Wave::new(&command);
                    let hinge = Some(Hinge { is_on_first: member == 0, from_m, sign, wave });
                    members.push(Member::new(chain, link, hinge, joint_m));
                    last = (cluster, members.len() - 1);
                }
                Joint::Free(free) => {
                    let hanging = clusters.len();
                    clusters[cluster].members[member].hanging.push((hanging, from_m));
                    clusters.push(new(cluster, sign, joint, free, link, joint_m));
                    last = (hanging, 0);
                }
            }
        }
        for c in (0..clusters.len()).rev() {
            let own = clusters[c].members.iter().map(|member| member.mass_kg);
            let mass_kg = clusters[c].mass_beyond_kg + own.sum::<f64>();
            clusters[c].mass_beyond_kg = mass_kg;
            if c > 0 {
                let parent = clusters[c].parent;
                clusters[parent].mass_beyond_kg += mass_kg;
            }
        }
        clusters
    }

    /// Calls `visit` for each link of the cluster with its heading, [`Heading::unit`] and the motion of its origin, given
    /// the sine and cosine of the phase.
    #[inline(always)]
    fn walk<T: Number>(
        &self,
        phase: [T; 2],
        omega_rad_s: f64,
        mut visit: impl FnMut(&Member, &Heading<T>, &Moving<T>, &Moving<T>),
    ) {
        let mut first = (Heading::straight(), Moving::zero(), Moving::zero());
        let mut last = first;
        for member in &self.members {
            let (mut heading, mut joint) = (first.0, first.2);
            if let Some(hinge) = &member.hinge {
                let (from, unit, origin) = if hinge.is_on_first { &first } else { &last };
                let [angle, rate, acceleration] = hinge.wave.at(phase, omega_rad_s);
                let sign = T::splat(hinge.sign);
                let (sin, cos) = (sign * angle).sin_cos();
                heading = Heading {
                    turn: rotated(from.turn, [cos, sin]),
                    rate: from.rate + sign * rate,
                    acceleration: from.acceleration + sign * acceleration,
                };
                joint = origin.ahead(hinge.from_m, unit);
            }
            let unit = heading.unit();
            last = (heading, unit, joint.ahead(-member.joint_m, &unit));
            visit(member, &last.0, &last.1, &last.2);
            if member.hinge.is_none() {
                first = last;
            }
        }
    }
}

/// Chain divided into clusters.
#[derive(Debug, Clone)]
pub(super) struct Clusters {
    pub omega_rad_s: f64,
    pub all: Vec<Cluster>,
    /// Whether the friction of the wheels is part of the clusters' linear resistance.
    pub is_linear: bool,
}

impl Clusters {
    pub(super) fn new(chain: &Chain, omega_rad_s: f64, is_linear: bool) -> Self {
        Self { omega_rad_s, all: Cluster::all(chain), is_linear }
    }

    /// Adds the sums of all clusters, of which there must be `C`, at a phase to `nodes`, which must be zero, and sets
    /// `wheels` to the wheels, from front to rear, in the frames of their clusters.
    #[inline(always)]
    pub(super) fn fill<T: Number, const C: usize>(
        &self,
        phase_rad: T,
        nodes: &mut [ClusterNode<T>; C],
        wheels: &mut [WheelNode<T>; MAX_LINKS],
    ) {
        let (sin, cos) = phase_rad.sin_cos();
        for c in 0..C {
            let cluster = &self.all[c];
            let (known, hung) = nodes.split_at_mut(c + 1);
            let own = &mut known[c];
            cluster.walk([sin, cos], self.omega_rad_s, |member, heading, unit, origin| {
                let centre = origin.ahead(member.com_m, unit);
                let inertia = T::splat(member.inertia_kg_m2);
                own.add_mass(member.mass_kg, &centre);
                own.inertia += inertia;
                own.spin += inertia * heading.acceleration;
                if let Some((inertia_kg_m2, wave)) = &member.rotor {
                    let [_, _, acceleration] = wave.at([sin, cos], self.omega_rad_s);
                    own.spin += T::splat(*inertia_kg_m2) * acceleration;
                }
                own.add_drag(&member.drag, heading, &centre);
                if let Some((index, wheel)) = &member.wheel {
                    let node = WheelNode::new(wheel, origin, unit);
                    wheels[*index] = node;
                    if self.is_linear {
                        let WheelFriction { roll_kg_s, skid_kg_s, .. } = wheel.friction;
                        own.add_resistance(roll_kg_s, node.direction, &node);
                        own.add_resistance(skid_kg_s, normal(node.direction), &node);
                    }
                }
                for (child, from_m) in &member.hanging {
                    let place = origin.ahead(*from_m, unit);
                    own.add_mass(self.all[*child].mass_beyond_kg, &place);
                    let hung = &mut hung[child - c - 1];
                    hung.place = place;
                    hung.heading = *heading;
                }
            });
            if c > 0 {
                let FreeJoint { stiffness_nm_rad, torque, .. } = &cluster.free;
                let [angle, ..] = cluster.target.at([sin, cos], self.omega_rad_s);
                own.drive = T::splat(*stiffness_nm_rad) * angle + prescribed(torque, phase_rad);
            }
        }
    }

    /// Returns, for each wheel from front to rear, the indices of its cluster and of its link, and its friction
    /// coefficients.
    pub(super) fn wheel_friction(&self) -> Vec<(usize, usize, WheelFriction)> {
        let mut wheels = Vec::with_capacity(MAX_LINKS);
        for (c, cluster) in self.all.iter().enumerate() {
            let wheeled = cluster.members.iter().filter_map(|member| Some((member, member.wheel?)));
            wheels.extend(wheeled.map(|(member, (_, wheel))| (c, member.link, wheel.friction)));
        }
        wheels.sort_by_key(|(_, link, _)| *link);
        wheels
    }
}

impl<T: Number> ClusterNode<T> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
        let zero = T::splat(0.0);
        Self {
            moment: Moving::zero(),
            inertia: zero,
            half_inertia_rate: zero,
            spin: zero,
            place: Moving::zero(),
            heading: Heading::straight(),
            drive: zero,
            resistance: [zero; 6],
            resistance_at_rest: [zero; 3],
            loss_at_rest: zero,
        }
    }

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
    fn add_resistance(&mut self, coefficient_kg_s: f64, direction: Vector<T>, at: &WheelNode<T>) {
        if coefficient_kg_s == 0.0 {
            return;
        }
        let coefficient = T::splat(coefficient_kg_s);
        let [x, y] = direction;
        let row = [x, y, moment(at.place, direction)];
        self.add_row(coefficient, row, inner(direction, at.rate));
    }

    #[inline(always)]
    fn add_row(&mut self, coefficient: T, row: [T; 3], speed: T) {
        self.loss_at_rest += coefficient * speed * speed;
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
    fn add_drag(&mut self, drag: &Drag, heading: &Heading<T>, centre: &Moving<T>) {
        let Moving { at, rate, .. } = *centre;
        let centre = WheelNode { direction: heading.turn, place: at, rate };
        self.add_resistance(drag.along_kg_s, heading.turn, &centre);
        self.add_resistance(drag.across_kg_s, normal(heading.turn), &centre);
        if drag.turning_nm_s_rad != 0.0 {
            let [zero, one] = [0.0, 1.0].map(T::splat);
            self.add_row(T::splat(drag.turning_nm_s_rad), [zero, zero, one], heading.rate);
        }
    }

    /// Returns the power dissipated by the linear resistance, W, given the velocity of the origin along the axes of a
    /// frame in which the cluster is turned by the given angle, and the turning rate.
    #[inline(always)]
    pub(super) fn loss_w(&self, [cos, sin]: Vector<T>, velocity: Vector<T>, rate: T) -> T {
        let [xx, xy, xt, yy, yt, tt] = self.resistance;
        let [fx, fy, torque] = self.resistance_at_rest;
        let [x, y] = rotated([cos, -sin], velocity);
        let along = xx * x + xy * y + xt * rate + fx + fx;
        let across = xy * x + yy * y + yt * rate + fy + fy;
        let turning = xt * x + yt * y + tt * rate + torque + torque;
        along * x + across * y + turning * rate + self.loss_at_rest
    }

    /// Returns the resisting force (along the axes of a frame in which the cluster is turned by the given angle, or of its
    /// own if that is `None`) and torque about the origin, with their derivatives with respect to the velocity of the
    /// origin and the turning rate.
    #[inline(always)]
    pub(super) fn resist(
        &self,
        turn: Option<Vector<T>>,
        velocity: Vector<T>,
        rate: T,
    ) -> ([T; 3], [[T; 3]; 3]) {
        let [mut xx, mut xy, mut xt, mut yy, mut yt, tt] = self.resistance;
        let [mut fx, mut fy, torque] = self.resistance_at_rest;
        if let Some([cos, sin]) = turn {
            let [cos2, sin2, both] = [cos * cos, sin * sin, cos * sin];
            let twice = (both + both) * xy;
            [xx, xy, yy] = [
                cos2 * xx + sin2 * yy - twice,
                both * (xx - yy) + (cos2 - sin2) * xy,
                sin2 * xx + cos2 * yy + twice,
            ];
            [xt, yt] = rotated([cos, sin], [xt, yt]);
            [fx, fy] = rotated([cos, sin], [fx, fy]);
        }
        let slopes = [[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]];
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
    sum(sum(origin, scaled(rate, normal(point.at))), point.rate)
}
