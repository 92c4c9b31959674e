//! Motion of the single links of a chain, and the contact of their wheels.

use trilink_robot::{Chain, Friction, MAX_JOINTS, MAX_LINKS, Number};

use super::plane::{Heading, Moving, Vector, inner, normal, rotated};

/// Motion of a chain at one time.
#[derive(Debug, Clone)]
pub(super) struct Motion<T> {
    pub phase_rad: T,
    /// Velocities of the reference link along and across itself (m/s) and its turning rate (rad/s), and their time
    /// derivatives.
    pub body: [T; 3],
    pub dbody: [T; 3],
    /// Angle, rate and acceleration of each joint from front to rear (rad, rad/s, rad/s^2), followed by zeros.
    pub joints: [[T; 3]; MAX_JOINTS],
}

/// Joint by which a link hangs on its neighbour on the side of the reference link.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hinge {
    /// Index of the neighbour.
    pub inner: usize,
    /// Index of the joint.
    pub joint: usize,
    /// 1 if the link's heading increases with the joint's angle (behind the reference link), otherwise -1.
    pub sign: f64,
    /// Place of the joint along the neighbour, m.
    pub from_m: f64,
    /// Place of the joint along the link itself, m.
    pub own_m: f64,
}

impl Hinge {
    /// Returns the hinge of a link that is not the reference link.
    #[inline(always)]
    pub(super) fn of(chain: &Chain, link: usize) -> Self {
        let own = &chain.links[link];
        if link < chain.reference {
            let from_m = chain.links[link + 1].front_joint_m;
            Self { inner: link + 1, joint: link, sign: -1.0, from_m, own_m: -own.rear_joint_m }
        } else {
            let from_m = -chain.links[link - 1].rear_joint_m;
            Self { inner: link - 1, joint: link - 1, sign: 1.0, from_m, own_m: own.front_joint_m }
        }
    }
}

/// Returns the indices of all links except the reference link, each after its neighbour nearer to that link; those ahead
/// come first.
pub(super) fn outwards(chain: &Chain) -> impl DoubleEndedIterator<Item = usize> + use<> {
    (0..chain.reference).rev().chain(chain.reference + 1..chain.links.len())
}

/// Motion of the links along the axes of the reference link.
#[derive(Debug, Clone)]
pub(super) struct Links<T> {
    /// Headings relative to that of the reference link, with absolute rates and accelerations.
    pub heading: [Heading<T>; MAX_LINKS],
    /// [`Heading::unit`].
    pub unit: [Moving<T>; MAX_LINKS],
    /// Places of the links' origins relative to that of the reference link, with absolute velocities and accelerations.
    pub origin: [Moving<T>; MAX_LINKS],
}

impl<T: Number> Links<T> {
    pub(super) fn new(chain: &Chain, motion: &Motion<T>) -> Self {
        let [u, v, r] = motion.body;
        let [du, dv, dr] = motion.dbody;
        let heading = Heading { rate: r, acceleration: dr, ..Heading::straight() };
        let at_reference =
            Moving { at: [T::splat(0.0); 2], rate: [u, v], acceleration: [du - r * v, dv + r * u] };
        let mut links = Self {
            heading: [heading; MAX_LINKS],
            unit: [heading.unit(); MAX_LINKS],
            origin: [at_reference; MAX_LINKS],
        };
        for i in outwards(chain) {
            let hinge = Hinge::of(chain, i);
            let [angle, rate, acceleration] =
                motion.joints[hinge.joint].map(|value| T::splat(hinge.sign) * value);
            let from = &links.heading[hinge.inner];
            let (sin, cos) = angle.sin_cos();
            let own = Heading {
                turn: rotated(from.turn, [cos, sin]),
                rate: from.rate + rate,
                acceleration: from.acceleration + acceleration,
            };
            links.heading[i] = own;
            links.unit[i] = own.unit();
            links.origin[i] = links.hinge(&hinge).ahead(-hinge.own_m, &links.unit[i]);
        }
        links
    }

    /// Returns the motion of a hinge.
    #[inline(always)]
    pub(super) fn hinge(&self, hinge: &Hinge) -> Moving<T> {
        self.origin[hinge.inner].ahead(hinge.from_m, &self.unit[hinge.inner])
    }

    /// Returns the motion of a point of a link, given its place along the link, m.
    #[inline(always)]
    pub(super) fn point(&self, link: usize, place_m: f64) -> Moving<T> {
        self.origin[link].ahead(place_m, &self.unit[link])
    }
}

/// Wheel of a link and the resistances to its motion, with their derivatives with respect to the velocities.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact<T> {
    /// Rolling direction.
    pub direction: Vector<T>,
    pub point: Moving<T>,
    pub roll_m_s: T,
    pub skid_m_s: T,
    /// Resistance to rolling, N, with the sign of the velocity, and its derivative with respect to the velocity, kg/s.
    pub roll: [T; 2],
    /// The same for skidding.
    pub skid: [T; 2],
}

impl<T: Number> Contact<T> {
    /// Returns the contact of a link's wheel; `None` if it has none.
    #[inline(always)]
    pub(super) fn of<F: Friction>(chain: &Chain, links: &Links<T>, link: usize) -> Option<Self> {
        let wheel = chain.links[link].wheel.as_ref()?;
        let ahead = links.heading[link].turn;
        let direction = match wheel.steer_rad {
            0.0 => ahead,
            steer_rad => {
                let (sin, cos) = steer_rad.sin_cos();
                rotated(ahead, [T::splat(cos), T::splat(sin)])
            }
        };
        let point = links.point(link, wheel.place_m);
        let roll_m_s = inner(direction, point.rate);
        let skid_m_s = inner(normal(direction), point.rate);
        let roll = F::roll(&wheel.friction, roll_m_s);
        let skid = F::skid(&wheel.friction, skid_m_s);
        Some(Self { direction, point, roll_m_s, skid_m_s, roll, skid })
    }
}
