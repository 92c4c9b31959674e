//! Places of joints and wheels on the links of a robot, and the velocities that follow from them.
//!
//! Links bear the numbers of [`Chain::numbering`]: link 0 is the reference link, and the others follow from front to
//! rear. Joints are counted from front to rear, starting from 0.

use trilink_robot::{Chain, MAX_JOINTS, MAX_LINKS, Number, Robot};

/// Maximum number of velocities: along and across link 0, its turning rate, and the joint rates.
pub(crate) const MAX_VELOCITIES: usize = 3 + MAX_JOINTS;

/// Factors of the velocities along and across link 0, of its turning rate and of the joint rates.
pub(crate) type Row = [f64; MAX_VELOCITIES];

/// Geometry of a robot whose links form a chain.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Geometry {
    /// Links by number.
    pub links: Vec<LinkGeometry>,
    /// Numbers of the links from front to rear.
    pub order: Vec<usize>,
    /// Length that normalises skid velocities (eq. 20 of the paper), m.
    pub skid_length_m: f64,
    /// Whether the robot is the paper's, which is described by h, l and b.
    pub is_of_paper: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LinkGeometry {
    /// Connection to the next link towards link 0; `None` for link 0.
    pub inner: Option<Connection>,
    pub wheel: Option<WheelPlace>,
}

/// Joint by which a link is connected to the next link towards link 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Connection {
    /// Number of the next link towards link 0.
    pub link: usize,
    pub joint: usize,
    /// Sign of the joint angle in this link's heading: -1 ahead of link 0, 1 behind it.
    pub sign: f64,
    /// Place of the joint on the next link towards link 0, m ahead of its origin.
    pub on_inner_m: f64,
    /// Place of the joint on this link, m ahead of its origin.
    pub on_outer_m: f64,
}

/// Place of a wheel on its link, m ahead of its origin, and angle of its rolling direction relative to the link, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WheelPlace {
    pub place_m: f64,
    pub steer_rad: f64,
}

impl Geometry {
    pub(crate) fn new(chain: &Chain) -> Self {
        let Chain { links, reference, skid_length_m, .. } = chain;
        let numbering = chain.numbering();
        let mut order = vec![0; links.len()];
        for (number, place) in numbering.iter().enumerate() {
            order[*place] = number;
        }
        let link = |place: &usize| {
            let place = *place;
            let inner = if place < *reference {
                Some(Connection {
                    link: order[place + 1],
                    joint: place,
                    sign: -1.0,
                    on_inner_m: links[place + 1].front_joint_m,
                    on_outer_m: -links[place].rear_joint_m,
                })
            } else if place > *reference {
                Some(Connection {
                    link: order[place - 1],
                    joint: place - 1,
                    sign: 1.0,
                    on_inner_m: -links[place - 1].rear_joint_m,
                    on_outer_m: links[place].front_joint_m,
                })
            } else {
                None
            };
            let wheel = links[place]
                .wheel
                .map(|wheel| WheelPlace { place_m: wheel.place_m, steer_rad: wheel.steer_rad });
            LinkGeometry { inner, wheel }
        };
        let links = numbering.iter().map(link).collect();
        Self { links, order, skid_length_m: *skid_length_m, is_of_paper: false }
    }

    /// Creates the geometry of the paper's robot.
    pub(crate) fn of_robot(robot: &Robot) -> Self {
        let geometry = Self::new(&robot.chain(&trilink_robot::Gait::symmetric()));
        Self { is_of_paper: true, ..geometry }
    }

    pub(crate) fn joints(&self) -> usize {
        self.links.len() - 1
    }

    /// Iterates over the connections of a link to link 0, beginning with the link's own, each with the number of its
    /// outer link.
    pub(crate) fn path(&self, link: usize) -> impl Iterator<Item = (usize, &Connection)> {
        let connected =
            move |link: usize| self.links[link].inner.as_ref().map(|inner| (link, inner));
        std::iter::successors(connected(link), move |(_, inner)| connected(inner.link))
    }

    /// Iterates over the numbers of the links such that each follows the next link towards link 0.
    fn outwards(&self) -> impl Iterator<Item = usize> {
        let reference = self.order.iter().position(|link| *link == 0).unwrap_or(0);
        let ahead = self.order[..reference].iter().rev();
        std::iter::once(0).chain(ahead.chain(&self.order[reference + 1..]).copied())
    }
}

/// Rows of the velocities of a point along and across its link, with their derivatives with respect to the joint
/// angles.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Velocity {
    pub along: Row,
    pub across: Row,
    pub dphi: [[Row; 2]; MAX_JOINTS],
}

impl Velocity {
    /// Returns the rows with respect to axes turned by an angle, given its sine and cosine.
    fn turned(&self, (sin, cos): (f64, f64)) -> Self {
        let turn = |[along, across]: [&Row; 2]| -> [Row; 2] {
            [
                std::array::from_fn(|i| cos * along[i] + sin * across[i]),
                std::array::from_fn(|i| cos * across[i] - sin * along[i]),
            ]
        };
        let [along, across] = turn([&self.along, &self.across]);
        Self {
            along,
            across,
            dphi: self.dphi.each_ref().map(|[along, across]| turn([along, across])),
        }
    }

    /// Returns the rows for a point that lies farther ahead on the link, whose turning rate is `turning`.
    fn ahead(mut self, ahead_m: f64, turning: &Row) -> Self {
        for (across, turning) in self.across.iter_mut().zip(turning) {
            *across += ahead_m * turning;
        }
        self
    }
}

/// Computes the rows of all wheels for successive shapes of a robot.
pub(crate) struct WheelRows<'g> {
    geometry: &'g Geometry,
    origins: [Velocity; MAX_LINKS],
    turning: [Row; MAX_LINKS],
}

impl<'g> WheelRows<'g> {
    pub(crate) fn new(geometry: &'g Geometry) -> Self {
        let mut turning = [Row::default(); MAX_LINKS];
        for link in 0..geometry.links.len() {
            turning[link][2] = 1.0;
            geometry.path(link).for_each(|(_, inner)| turning[link][3 + inner.joint] = inner.sign);
        }
        let mut origins = [Velocity::default(); MAX_LINKS];
        origins[0].along[0] = 1.0;
        origins[0].across[1] = 1.0;
        Self { geometry, origins, turning }
    }

    /// Sets the joint angles, rad.
    pub(crate) fn set_shape(&mut self, phi_rad: impl Fn(usize) -> f64) {
        let joints = self.geometry.joints();
        let mut trig = [(0.0, 1.0); MAX_JOINTS + 1];
        for joint in (0..joints).step_by(2) {
            let second = if joint + 1 < joints { phi_rad(joint + 1) } else { 0.0 };
            let both = f64::both_sin_cos([phi_rad(joint), second]);
            trig[joint..joint + 2].copy_from_slice(&both);
        }
        for link in self.geometry.outwards() {
            let Some(inner) = &self.geometry.links[link].inner else { continue };
            let (sin, cos) = trig[inner.joint];
            let at_joint =
                self.origins[inner.link].ahead(inner.on_inner_m, &self.turning[inner.link]);
            let mut turned = at_joint.turned((inner.sign * sin, cos));
            let Velocity { along, across, dphi } = &mut turned;
            dphi[inner.joint] = [across.map(|x| inner.sign * x), along.map(|x| -inner.sign * x)];
            self.origins[link] = turned.ahead(-inner.on_outer_m, &self.turning[link]);
        }
    }

    /// Returns the rows of the roll velocity (along) and of the skid velocity (across) of a link's wheel; `None` if the
    /// link has none.
    pub(crate) fn wheel(&self, link: usize) -> Option<Velocity> {
        let WheelPlace { place_m, steer_rad } = self.geometry.links[link].wheel?;
        let wheel = self.origins[link].ahead(place_m, &self.turning[link]);
        Some(if steer_rad == 0.0 { wheel } else { wheel.turned(steer_rad.sin_cos()) })
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Gait;

    use super::*;

    #[test]
    fn rows_of_the_papers_robot_are_those_of_equation_1() {
        let mut robot = Robot::kinematic();
        robot.h_m = [0.15, 0.13];
        robot.l_m = [0.11, 0.12];
        let geometry = Geometry::new(&robot.chain(&Gait::symmetric()));
        assert_eq!(geometry.order, [1, 0, 2]);
        let mut rows = WheelRows::new(&geometry);
        for phi_rad in [[0.3, -0.7], [-1.2, 0.4], [0.0, 0.0]] {
            rows.set_shape(|joint| phi_rad[joint]);
            let [(s1, c1), (s2, c2)] = f64::both_sin_cos(phi_rad);
            let ([h1, h2], [l1, l2]) = (robot.h_m, robot.l_m);
            let roll = [
                [1.0, 0.0, 0.0, 0.0, 0.0],
                [c1, -s1, -h1 * s1, 0.0, 0.0],
                [c2, s2, -h2 * s2, 0.0, 0.0],
            ];
            let skid = [
                [0.0, 1.0, 0.0, 0.0, 0.0],
                [s1, c1, l1 + h1 * c1, -l1, 0.0],
                [-s2, c2, -l2 - h2 * c2, 0.0, -l2],
            ];
            // Derivatives of the rows of wheels 1 and 2 with respect to the angle of the wheel's own joint.
            let droll = [[-s1, -c1, -h1 * c1, 0.0, 0.0], [-s2, c2, -h2 * c2, 0.0, 0.0]];
            let dskid = [[c1, -s1, -h1 * s1, 0.0, 0.0], [-c2, -s2, h2 * s2, 0.0, 0.0]];
            for link in 0..3 {
                let Velocity { along, across, dphi } = rows.wheel(link).unwrap();
                assert_eq!((&along[..5], &across[..5]), (&roll[link][..], &skid[link][..]));
                if let Some(joint) = link.checked_sub(1) {
                    let [dalong, dacross] = dphi[joint];
                    assert_eq!(
                        (&dalong[..5], &dacross[..5]),
                        (&droll[joint][..], &dskid[joint][..])
                    );
                    assert_eq!(dphi[1 - joint], [Row::default(); 2]);
                }
            }
        }
    }
}
