//! Virtual power of the forces on a chain, and its derivatives with respect to the motion and to the numbers that
//! describe the chain.
//!
//! The virtual power of a chain (Jourdain's principle) is the sum, over its points, of the products of the resistances
//! (of inertia, friction, drag, dampers and springs) and virtual velocities. At a given motion it depends on the
//! velocity v, the acceleration a and the virtual velocity v* of each point; a number that shifts points or turns links
//! changes these alone. Sums over the links beyond each joint therefore give all derivatives of one virtual power at a
//! cost that is proportional to the number of links.

use trilink_robot::{
    Chain, ChainNumber, FreeJoint, Friction, Joint, JointNumber, LinkNumber, MAX_JOINTS, MAX_LINKS,
    Number,
};

use super::links::{Contact, Hinge, Links, Motion, outwards};
use super::plane::{Moving, Vector, inner, moment, normal, scaled, sum};
use super::wave::Wave;

/// Virtual motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Virtual<T> {
    /// Virtual velocities of the reference link along and across itself and its turning rate.
    pub body: [T; 3],
    /// Virtual rates of the joints.
    pub joints: [T; MAX_JOINTS],
    /// The virtual power also contains the sum of `skid[i]` times the actual skid velocity of the wheel of link `i`; its
    /// derivatives are those of skid velocities.
    pub skid: [T; MAX_LINKS],
}

impl<T: Number> Virtual<T> {
    pub(super) fn none() -> Self {
        let zero = T::splat(0.0);
        Self { body: [zero; 3], joints: [zero; MAX_JOINTS], skid: [zero; MAX_LINKS] }
    }
}

/// Derivatives of the virtual power with respect to velocities and accelerations that points have in common.
#[derive(Debug, Clone, Copy)]
struct Sums<T> {
    /// With respect to the virtual velocity, the velocity and the acceleration.
    by_virtual: Vector<T>,
    by_velocity: Vector<T>,
    by_acceleration: Vector<T>,
    /// With respect to the virtual and the actual turning rate, and to the angular acceleration, of all points about the
    /// origin of the reference link.
    by_virtual_turn: T,
    by_turn: T,
    by_turn_acceleration: T,
    /// Half the derivative with respect to the turning rate through centripetal and Coriolis accelerations: the sum of
    /// the moments of `by_acceleration` of each point with its velocity as lever arm.
    by_carried: T,
}

impl<T: Number> Sums<T> {
    fn none() -> Self {
        let zero = T::splat(0.0);
        Self {
            by_virtual: [zero; 2],
            by_velocity: [zero; 2],
            by_acceleration: [zero; 2],
            by_virtual_turn: zero,
            by_turn: zero,
            by_turn_acceleration: zero,
            by_carried: zero,
        }
    }

    /// Adds a point.
    #[inline(always)]
    fn add(&mut self, at: &Moving<T>, point: &Point<T>) {
        let Point { by_virtual, by_velocity, by_acceleration } = *point;
        self.by_virtual = sum(self.by_virtual, by_virtual);
        self.by_velocity = sum(self.by_velocity, by_velocity);
        self.by_acceleration = sum(self.by_acceleration, by_acceleration);
        self.by_virtual_turn += moment(at.at, by_virtual);
        self.by_turn += moment(at.at, by_velocity);
        self.by_turn_acceleration += moment(at.at, by_acceleration);
        self.by_carried += moment(at.rate, by_acceleration);
    }

    #[inline(always)]
    fn add_sums(&mut self, other: &Self) {
        self.by_virtual = sum(self.by_virtual, other.by_virtual);
        self.by_velocity = sum(self.by_velocity, other.by_velocity);
        self.by_acceleration = sum(self.by_acceleration, other.by_acceleration);
        self.by_virtual_turn += other.by_virtual_turn;
        self.by_turn += other.by_turn;
        self.by_turn_acceleration += other.by_turn_acceleration;
        self.by_carried += other.by_carried;
    }

    fn point(&self) -> Point<T> {
        let Self { by_virtual, by_velocity, by_acceleration, .. } = *self;
        Point { by_virtual, by_velocity, by_acceleration }
    }
}

/// Derivatives of the virtual power with respect to the virtual velocity (the resistance), the velocity and the
/// acceleration of a point.
#[derive(Debug, Clone, Copy)]
struct Point<T> {
    by_virtual: Vector<T>,
    by_velocity: Vector<T>,
    by_acceleration: Vector<T>,
}

/// Forces that a virtual power contains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Resistance {
    /// Inertia, friction, drag and the constraint forces on the wheels. The torques of springs and dampers and the
    /// prescribed torques enter only [`Power::by_number`].
    All,
    /// Forces that dissipate: friction, drag and dampers. The virtual motion must be the actual one, so that the power is
    /// the dissipated power and its derivatives include the change in the virtual motion.
    Dissipation,
}

/// Motion of a chain at one time, with the contacts of its wheels.
#[derive(Debug, Clone)]
pub(super) struct EvaluatedMotion<'a, T> {
    chain: &'a Chain,
    motion: &'a Motion<T>,
    links: Links<T>,
    contacts: [Option<Contact<T>>; MAX_LINKS],
    /// Lateral forces, by link, that keep the wheels from skidding, N.
    constraint_n: [T; MAX_LINKS],
    /// Angular accelerations of the rotors relative to their links, rad/s^2.
    rotors: [T; MAX_LINKS],
    /// Sine and cosine of the phase.
    turned: [T; 2],
    omega_rad_s: f64,
}

impl<'a, T: Number> EvaluatedMotion<'a, T> {
    /// Evaluates a motion; `constraint_n` are the lateral forces on the wheels, by link, that keep them from skidding.
    #[inline(always)]
    pub(super) fn new<F: Friction>(
        chain: &'a Chain,
        motion: &'a Motion<T>,
        omega_rad_s: f64,
        constraint_n: [T; MAX_LINKS],
    ) -> Self {
        let links = Links::new(chain, motion);
        let mut contacts = [None; MAX_LINKS];
        let mut rotors = [T::splat(0.0); MAX_LINKS];
        let turned = motion.phase_rad.sin_cos().into();
        for (i, link) in chain.links.iter().enumerate() {
            contacts[i] = Contact::of::<F>(chain, &links, i);
            if let Some(rotor) = &link.rotor {
                [_, _, rotors[i]] = Wave::new(&rotor.angle).at(turned, omega_rad_s);
            }
        }
        Self { chain, motion, links, contacts, constraint_n, rotors, turned, omega_rad_s }
    }

    pub(super) fn motion(&self) -> &Motion<T> {
        self.motion
    }

    pub(super) fn contact(&self, link: usize) -> Option<&Contact<T>> {
        self.contacts[link].as_ref()
    }

    /// Returns the angular acceleration of a link, rad/s^2.
    pub(super) fn turning_acceleration(&self, link: usize) -> T {
        self.links.heading[link].acceleration
    }

    /// Returns the skid velocity of a link's wheel, m/s; zero if it has none.
    pub(super) fn skid_m_s(&self, link: usize) -> T {
        self.contacts[link].map_or(T::splat(0.0), |contact| contact.skid_m_s)
    }

    /// Returns the actual motion as a virtual one.
    pub(super) fn as_virtual(&self) -> Virtual<T> {
        let Motion { body, joints, .. } = self.motion;
        Virtual { body: *body, joints: joints.map(|[_, rate, _]| rate), ..Virtual::none() }
    }

    /// Returns the lateral resistance of a wheel, given its friction across its rolling direction.
    #[inline(always)]
    fn lateral_n(&self, link: usize, skid_n: T, resistance: Resistance) -> T {
        match resistance {
            Resistance::All => skid_n - self.constraint_n[link],
            Resistance::Dissipation => skid_n,
        }
    }
}

/// Returns whether the derivative with respect to a number needs [`Power::evaluate`]; for others
/// [`Power::set_velocities`] suffices.
pub(super) fn needs_evaluate(chain: &Chain, number: ChainNumber) -> bool {
    use LinkNumber::{Com, FrontJoint, RearJoint, WheelPlace};
    match number {
        ChainNumber::Link(_, number) => {
            matches!(number, Com | FrontJoint | RearJoint | WheelPlace)
        }
        ChainNumber::Command(joint, _) => matches!(chain.joints[joint], Joint::Driven(_)),
        ChainNumber::Rotor(..) | ChainNumber::Joint(..) => false,
    }
}

/// Virtual power and its derivatives. One value serves many evaluations, because it is large.
#[derive(Debug, Clone)]
pub(super) struct Power<T> {
    virtual_motion: Virtual<T>,
    resistance: Resistance,
    /// Virtual turning rates of the links, and virtual velocities of their origins.
    rate: [T; MAX_LINKS],
    velocity: [Vector<T>; MAX_LINKS],
    /// Derivatives with respect to the motion of the links' centres of mass and of their wheels.
    com: [Point<T>; MAX_LINKS],
    wheel: [Point<T>; MAX_LINKS],
    /// Sums over each link and all links beyond it, away from the reference link.
    beyond: [Sums<T>; MAX_LINKS],
    /// Derivatives with respect to the angles, rates and accelerations of the driven joints.
    by_driven: [[T; 3]; MAX_JOINTS],
}

impl<T: Number> Power<T> {
    pub(super) fn new() -> Self {
        let zero = T::splat(0.0);
        let none = Sums::none().point();
        Self {
            virtual_motion: Virtual::none(),
            resistance: Resistance::All,
            rate: [zero; MAX_LINKS],
            velocity: [[zero; 2]; MAX_LINKS],
            com: [none; MAX_LINKS],
            wheel: [none; MAX_LINKS],
            beyond: [Sums::none(); MAX_LINKS],
            by_driven: [[zero; 3]; MAX_JOINTS],
        }
    }

    /// Evaluates the virtual velocities of a virtual motion; all sums remain those of an earlier one. This suffices for
    /// [`Power::by_number`] unless the number [`needs_evaluate`].
    pub(super) fn set_velocities(
        &mut self,
        at: &EvaluatedMotion<T>,
        virtual_motion: &Virtual<T>,
        resistance: Resistance,
    ) {
        let EvaluatedMotion { chain, links, .. } = at;
        self.virtual_motion = *virtual_motion;
        self.resistance = resistance;
        self.rate[chain.reference] = virtual_motion.body[2];
        self.velocity[chain.reference] = [virtual_motion.body[0], virtual_motion.body[1]];
        for i in outwards(chain) {
            let hinge = Hinge::of(chain, i);
            self.rate[i] =
                self.rate[hinge.inner] + T::splat(hinge.sign) * virtual_motion.joints[hinge.joint];
            let across = self.rate[i] * T::splat(-hinge.own_m);
            let at_hinge = self.at_hinge(links, &hinge);
            self.velocity[i] = sum(at_hinge, scaled(across, normal(links.unit[i].at)));
        }
    }

    /// Evaluates the virtual power in a virtual motion. [`Power::resistances`] do not depend on that motion.
    pub(super) fn evaluate(
        &mut self,
        at: &EvaluatedMotion<T>,
        virtual_motion: &Virtual<T>,
        resistance: Resistance,
    ) {
        self.set_velocities(at, virtual_motion, resistance);
        let EvaluatedMotion { chain, links, .. } = at;
        let none = Sums::none().point();
        let has_inertia = resistance == Resistance::All;
        for (i, link) in chain.links.iter().enumerate() {
            let com = links.point(i, link.com_m);
            let velocity = self.velocity_of(links, i, link.com_m);
            let mut own = none;
            if has_inertia {
                let mass = T::splat(link.mass_kg);
                own.by_virtual = scaled(mass, com.acceleration);
                own.by_acceleration = scaled(mass, velocity);
            }
            let unit = links.unit[i].at;
            for (coefficient, direction) in
                [(link.drag.along_kg_s, unit), (link.drag.across_kg_s, normal(unit))]
            {
                if coefficient != 0.0 {
                    let coefficient = T::splat(coefficient);
                    let force = coefficient * inner(direction, com.rate);
                    let slope = coefficient * inner(direction, velocity);
                    own.by_virtual = sum(own.by_virtual, scaled(force, direction));
                    own.by_velocity = sum(own.by_velocity, scaled(slope, direction));
                }
            }
            let mut sums = Sums::none();
            sums.add(&com, &own);
            self.com[i] = own;
            if has_inertia {
                let rotor = T::splat(link.rotor.map_or(0.0, |rotor| rotor.inertia_kg_m2));
                let inertia = T::splat(link.inertia_kg_m2) + rotor;
                sums.by_virtual_turn +=
                    inertia * links.heading[i].acceleration + rotor * at.rotors[i];
                sums.by_turn_acceleration += inertia * self.rate[i];
            }
            if link.drag.turning_nm_s_rad != 0.0 {
                let coefficient = T::splat(link.drag.turning_nm_s_rad);
                sums.by_virtual_turn += coefficient * links.heading[i].rate;
                sums.by_turn += coefficient * self.rate[i];
            }
            if let (Some(contact), Some(wheel)) = (&at.contacts[i], &link.wheel) {
                let Contact { direction, roll, skid, .. } = *contact;
                let lateral = at.lateral_n(i, skid[0], resistance);
                let velocity = self.velocity_of(links, i, wheel.place_m);
                let axle = normal(direction);
                let [by_roll, by_skid] = [
                    roll[1] * inner(direction, velocity),
                    skid[1] * inner(axle, velocity) + virtual_motion.skid[i],
                ];
                let own = Point {
                    by_virtual: sum(scaled(roll[0], direction), scaled(lateral, axle)),
                    by_velocity: sum(scaled(by_roll, direction), scaled(by_skid, axle)),
                    ..none
                };
                sums.add(&contact.point, &own);
                self.wheel[i] = own;
            }
            self.beyond[i] = sums;
        }
        for i in outwards(chain).rev() {
            let inner = Hinge::of(chain, i).inner;
            let own = self.beyond[i];
            self.beyond[inner].add_sums(&own);
        }
    }

    /// Evaluates the derivatives with respect to the commands of the driven joints after [`Power::evaluate`], for
    /// [`Power::by_number`].
    pub(super) fn evaluate_commands(&mut self, at: &EvaluatedMotion<T>) {
        for (i, joint) in at.chain.joints.iter().enumerate() {
            if let Joint::Driven(_) = joint {
                self.by_driven[i] = self.by_joint(at, i);
            }
        }
    }

    /// Returns the virtual velocity of a point of a link.
    #[inline(always)]
    fn velocity_of(&self, links: &Links<T>, link: usize, place_m: f64) -> Vector<T> {
        let across = self.rate[link] * T::splat(place_m);
        sum(self.velocity[link], scaled(across, normal(links.unit[link].at)))
    }

    #[inline(always)]
    fn at_hinge(&self, links: &Links<T>, hinge: &Hinge) -> Vector<T> {
        self.velocity_of(links, hinge.inner, hinge.from_m)
    }

    /// Returns the derivatives with respect to the velocities of the reference link, without the effect of these
    /// velocities on accelerations: exact for [`Resistance::Dissipation`].
    pub(super) fn by_body(&self, at: &EvaluatedMotion<T>) -> [T; 3] {
        let sums = &self.beyond[at.chain.reference];
        let [mut x, mut y] = sums.by_velocity;
        let mut turn = sums.by_turn;
        if self.resistance == Resistance::Dissipation {
            [x, y] = sum([x, y], sums.by_virtual);
            turn += sums.by_virtual_turn;
        }
        [x, y, turn]
    }

    /// Returns the derivatives with respect to the angle, the rate and the acceleration of a joint. They include the damper
    /// of a free joint only for [`Resistance::Dissipation`], and never its spring or its prescribed torque.
    #[inline(always)]
    pub(super) fn by_joint(&self, motion: &EvaluatedMotion<T>, joint: usize) -> [T; 3] {
        let EvaluatedMotion { chain, links, .. } = motion;
        let outer = if joint < chain.reference { joint } else { joint + 1 };
        let hinge = Hinge::of(chain, outer);
        let sums = &self.beyond[outer];
        let Moving { at, rate, acceleration } = links.hinge(&hinge);
        let two = T::splat(2.0);
        let by_angle = moment(self.at_hinge(links, &hinge), sums.by_virtual)
            + moment(rate, sums.by_velocity)
            + moment(acceleration, sums.by_acceleration);
        let by_acceleration = sums.by_turn_acceleration - moment(at, sums.by_acceleration);
        let carried = sums.by_carried - moment(rate, sums.by_acceleration);
        let mut by_rate = sums.by_turn - moment(at, sums.by_velocity) + two * carried;
        if self.resistance == Resistance::Dissipation {
            by_rate += sums.by_virtual_turn - moment(at, sums.by_virtual);
        }
        let sign = T::splat(hinge.sign);
        let mut by_rate = sign * by_rate;
        if let (Resistance::Dissipation, Joint::Free(free)) =
            (self.resistance, &chain.joints[joint])
        {
            by_rate += two * T::splat(free.damping_nm_s_rad) * self.virtual_motion.joints[joint];
        }
        [-(sign * by_angle), by_rate, sign * by_acceleration]
    }

    /// Returns the derivative with respect to the place of points along a link, per metre ahead.
    #[inline(always)]
    fn by_place(&self, links: &Links<T>, link: usize, points: &Point<T>) -> T {
        let Moving { at, rate, acceleration } = &links.unit[link];
        self.rate[link] * inner(normal(*at), points.by_virtual)
            + inner(*rate, points.by_velocity)
            + inner(*acceleration, points.by_acceleration)
    }

    /// Returns the derivative with respect to a number of the chain, in SI units; zero for the friction coefficients of
    /// wheels, which change no velocity. `wave` is the derivative of the number's
    /// command with respect to it ([`Wave::slope`]), if it is one of a command.
    #[inline(always)]
    pub(super) fn by_number(
        &self,
        at: &EvaluatedMotion<T>,
        number: ChainNumber,
        wave: Option<&Wave>,
    ) -> T {
        let zero = T::splat(0.0);
        let EvaluatedMotion { chain, links, motion, rotors, .. } = at;
        let has_inertia = self.resistance == Resistance::All;
        let slope = |wave: &Wave| wave.at(at.turned, at.omega_rad_s);
        match number {
            ChainNumber::Link(link, number) => match number {
                LinkNumber::Mass if has_inertia => {
                    let com_m = chain.links[link].com_m;
                    let velocity = self.velocity_of(links, link, com_m);
                    inner(links.point(link, com_m).acceleration, velocity)
                }
                LinkNumber::Inertia if has_inertia => {
                    links.heading[link].acceleration * self.rate[link]
                }
                LinkNumber::RotorInertia if has_inertia => {
                    (links.heading[link].acceleration + rotors[link]) * self.rate[link]
                }
                LinkNumber::Mass | LinkNumber::Inertia | LinkNumber::RotorInertia => zero,
                _ => self.by_link(at, link, number),
            },
            ChainNumber::Rotor(link, _) => match (&chain.links[link].rotor, wave) {
                (Some(rotor), Some(wave)) if has_inertia => {
                    T::splat(rotor.inertia_kg_m2) * self.rate[link] * slope(wave)[2]
                }
                _ => zero,
            },
            ChainNumber::Joint(joint, number) => {
                let Joint::Free(free) = &chain.joints[joint] else { return zero };
                let virtual_rate = self.virtual_motion.joints[joint];
                let [angle, rate, _] = motion.joints[joint];
                let torque = &free.torque;
                let turned = motion.phase_rad + T::splat(torque.phase_rad);
                match number {
                    JointNumber::Damping => rate * virtual_rate,
                    _ if !has_inertia => zero,
                    JointNumber::Stiffness => {
                        let [target, ..] = slope(&Wave::new(&free.target));
                        (angle - target) * virtual_rate
                    }
                    JointNumber::TorqueMean => -virtual_rate,
                    JointNumber::TorqueAmplitude => -(virtual_rate * turned.sin_cos().1),
                    JointNumber::TorquePhase => {
                        T::splat(torque.amplitude_nm) * virtual_rate * turned.sin_cos().0
                    }
                }
            }
            ChainNumber::Command(joint, _) => match (&chain.joints[joint], wave) {
                (_, None) => zero,
                (Joint::Driven(_), Some(wave)) => {
                    let [angle, rate, acceleration] = slope(wave);
                    let by = &self.by_driven[joint];
                    by[0] * angle + by[1] * rate + by[2] * acceleration
                }
                (Joint::Free(FreeJoint { stiffness_nm_rad, .. }), Some(wave)) if has_inertia => {
                    -(T::splat(*stiffness_nm_rad)
                        * self.virtual_motion.joints[joint]
                        * slope(wave)[0])
                }
                (Joint::Free(_), _) => zero,
            },
        }
    }

    /// Returns the derivative with respect to a number of a link that can also affect the dissipated power.
    #[inline(always)]
    fn by_link(&self, at: &EvaluatedMotion<T>, link: usize, number: LinkNumber) -> T {
        let zero = T::splat(0.0);
        let EvaluatedMotion { chain, links, contacts, .. } = at;
        let own = &chain.links[link];
        let com = |direction: Vector<T>| {
            let velocity = self.velocity_of(links, link, own.com_m);
            inner(direction, links.point(link, own.com_m).rate) * inner(direction, velocity)
        };
        let beyond = |outer: usize| self.by_place(links, link, &self.beyond[outer].point());
        let last = chain.links.len() - 1;
        match number {
            LinkNumber::FrontJoint if link > chain.reference => -beyond(link),
            LinkNumber::FrontJoint if link > 0 => beyond(link - 1),
            LinkNumber::RearJoint if link < chain.reference => beyond(link),
            LinkNumber::RearJoint if link < last => -beyond(link + 1),
            // The ends of the chain have no joint.
            LinkNumber::FrontJoint | LinkNumber::RearJoint => zero,
            LinkNumber::Com => self.by_place(links, link, &self.com[link]),
            LinkNumber::WheelPlace => self.by_place(links, link, &self.wheel[link]),
            LinkNumber::DragAlong => com(links.unit[link].at),
            LinkNumber::DragAcross => com(normal(links.unit[link].at)),
            LinkNumber::DragTurning => links.heading[link].rate * self.rate[link],
            LinkNumber::WheelSteer => {
                let (Some(contact), Some(wheel)) = (&contacts[link], &own.wheel) else {
                    return zero;
                };
                let velocity = self.velocity_of(links, link, wheel.place_m);
                let Contact { direction, roll_m_s, skid_m_s, roll, skid, .. } = *contact;
                let [rolling, across] =
                    [direction, normal(direction)].map(|axis| inner(axis, velocity));
                let by_roll = roll[1] * rolling;
                let by_skid = skid[1] * across + self.virtual_motion.skid[link];
                let lateral = at.lateral_n(link, skid[0], self.resistance);
                by_roll * skid_m_s - by_skid * roll_m_s + roll[0] * across - lateral * rolling
            }
            _ => zero,
        }
    }

    /// Returns the generalised forces conjugate to the velocities of the reference link (N, N, N m) and to the rates of the
    /// joints from front to rear (N m), without joint springs, dampers and prescribed torques.
    pub(super) fn resistances(&self, at: &EvaluatedMotion<T>) -> ([T; 3], [T; MAX_JOINTS]) {
        let EvaluatedMotion { chain, links, .. } = at;
        let of = |sums: &Sums<T>, at: Vector<T>| sums.by_virtual_turn - moment(at, sums.by_virtual);
        let whole = &self.beyond[chain.reference];
        let [x, y] = whole.by_virtual;
        let mut joints = [T::splat(0.0); MAX_JOINTS];
        for outer in outwards(chain) {
            let hinge = Hinge::of(chain, outer);
            let torque = of(&self.beyond[outer], links.hinge(&hinge).at);
            joints[hinge.joint] = T::splat(hinge.sign) * torque;
        }
        ([x, y, whole.by_virtual_turn], joints)
    }
}
