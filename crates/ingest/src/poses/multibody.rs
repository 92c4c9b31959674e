//! Multibody optimisation (Lu and O'Connor 1999): fits the poses of all three links together so that the joints are
//! closed.
//!
//! If the links are fitted separately, marker noise of some tenths of a millimetre leaves the joints slightly open.
//! Here the five coordinates (eq. 1) minimise the sum of squared distances between the fitted and recorded positions of
//! all markers in a frame, with each joint at a single point common to both its links. That sum follows from each
//! link's own fit and the centroid and spread of its markers ([`MarkerMoments`]), so that the markers need not be
//! summed again. The unknowns are the headings of the links instead of the joint angles, which gives the same minimum.

use std::ops::Range;

use nalgebra::{Matrix3, Matrix4, UnitComplex, Vector2, Vector3, Vector4, Vector5};
use trilink_robot::{Robot, rotated};
use trilink_statistics::{NormalEquations, wrap};

use crate::markers::labels::LinkFit;
use crate::markers::rigid::LinkPose;

#[cfg(doc)]
use crate::markers::rigid::MarkerMoments;

/// Maximum number of Gauss-Newton steps: starting from the poses fitted to each link separately, two steps leave only
/// rounding errors.
const MAX_STEPS: usize = 4;
/// Maximum rotation of a link in the Gauss-Newton step after which the iteration ends, rad: the remaining error is the
/// square of the rotation times a lever arm, a thousandth of a millimetre.
const SMALL_RAD: f64 = 3e-3;
/// Number of rows, spread over the trial, from which the joint positions are estimated.
const ROWS: usize = 2000;
/// Number of neighbouring rows that are averaged. Camera noise in the links' headings biases the joint positions by
/// attenuation, in the ratio of the noise variance to the variance of the joint angle (Fuller, *Measurement Error
/// Models*, Wiley 1987, section 1.1). Averaging neighbouring rows reduces the noise and barely changes the angle.
const NEIGHBOURS: usize = 8;
/// Number of parts into which the trial is divided for the jackknife of the joint positions.
pub(crate) const PARTS: usize = 8;
/// Prior standard deviation of a joint position about the position that the robot's h and l give, mm.
const POSITION_MM: f64 = 3.0;
/// Standard deviation, in a frame, of the distance between a joint's positions according to its two links, mm.
const APART_MM: f64 = 0.5;
/// Number of frames over which a slow tilt of the links displaces a joint in one direction.
const CORRELATED_FRAMES: f64 = 360.0;

/// Position of a joint in the frames of its two links, mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointPosition {
    pub in_middle: [f64; 2],
    pub in_outer: [f64; 2],
}

impl JointPosition {
    /// Sets up the equations for the displacements of the joint, in the frames of links a (middle) and b (outer), from
    /// this position, given the poses of both links in runs of neighbouring rows. With the origins `o` and rotations
    /// `R` of the links, the joint's positions `p` satisfy `o_a + R_a p_a = o_b + R_b p_b`. This condition is linear in
    /// both positions and, in the frame of link a, in the terms that differ between rows; it therefore also holds for
    /// the means over a run.
    pub fn equations(
        &self,
        runs: impl Iterator<Item = impl IntoIterator<Item = (LinkPose, LinkPose)>>,
    ) -> NormalEquations<4> {
        let mut equations = NormalEquations::new();
        for run in runs {
            let mut count = 0.0;
            let mut turn = [0.0; 2];
            let mut apart = [0.0; 2];
            let mut squares = [0.0; 2];
            for (a, b) in run {
                let from = a.at(self.in_middle);
                let to = b.at(self.in_outer);
                let (sin, cos) = (b.theta_rad - a.theta_rad).sin_cos();
                let off = rotated(-a.theta_rad, [to[0] - from[0], to[1] - from[1]]);
                count += 1.0;
                for (i, (turned, off)) in [cos, sin].into_iter().zip(off).enumerate() {
                    turn[i] += turned;
                    apart[i] += off;
                    squares[i] += off * off;
                }
            }
            if count > 0.0 {
                let [cos, sin] = turn.map(|sum| sum / count);
                let rows = [Vector4::new(1.0, 0.0, -cos, sin), Vector4::new(0.0, 1.0, -sin, -cos)];
                for (i, row) in rows.iter().enumerate() {
                    equations.add_sums(row, count, apart[i], squares[i]);
                }
            }
        }
        equations
    }

    /// Returns this joint position after a displacement in the middle link's frame (first two components) and in the
    /// outer link's frame (last two), mm.
    pub fn moved(self, by: &Vector4<f64>) -> Self {
        let Self { in_middle: [a, b], in_outer: [c, d] } = self;
        Self { in_middle: [a + by[0], b + by[1]], in_outer: [c + by[2], d + by[3]] }
    }
}

/// The three links with their two joints, between links 0 and 1 and between links 0 and 2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Linkage {
    pub joints: [JointPosition; 2],
}

impl Linkage {
    /// Creates the linkage from a robot's lengths h and l.
    pub(crate) fn from_robot(robot: &Robot) -> Self {
        let joint = |joint: usize, sign: f64| JointPosition {
            in_middle: [sign * 1e3 * robot.h_m[joint], 0.0],
            in_outer: [-sign * 1e3 * robot.l_m[joint], 0.0],
        };
        Self { joints: [joint(0, 1.0), joint(1, -1.0)] }
    }

    /// Estimates the joint positions from a trial's link poses, starting from this linkage: an error of a millimetre in
    /// h and l would change the fitted joint angles by half a degree. Positions that the trial does not determine, such
    /// as both positions of a joint that does not turn, stay near their starting values. Also returns the estimates
    /// without each of [`PARTS`] parts of the trial, whose differences give the standard errors. Only some rows are
    /// evaluated.
    pub(crate) fn refined(
        &self,
        fits: &[Vec<LinkFit>; 3],
        from: Range<usize>,
    ) -> (Self, [Self; PARTS]) {
        let rows = from.len();
        let stride = (rows / ROWS).max(1);
        let alike = (CORRELATED_FRAMES / stride as f64).max(1.0);
        let parts = [0, 1].map(|side| {
            let [middle, outer] = [&fits[0], &fits[1 + side]];
            let pose = |row: usize| Some((middle[row].pose()?, outer[row].pose()?));
            std::array::from_fn::<_, PARTS, _>(|i| {
                let [begin, end] = [i, i + 1].map(|part| from.start + part * rows / PARTS);
                let firsts = (begin..end).step_by(stride * NEIGHBOURS);
                let run = |first: usize| (first..end.min(first + NEIGHBOURS)).filter_map(pose);
                self.joints[side].equations(firsts.map(run))
            })
        });
        let estimates = std::array::from_fn(|i| self.fitted(&parts, Some(i), alike));
        (self.fitted(&parts, None, alike), estimates)
    }

    /// Solves for the joint positions without the part `left_out` of the trial, or with all parts if it is `None`. A
    /// prior with the given weight keeps the positions near those of this linkage.
    fn fitted(
        &self,
        parts: &[[NormalEquations<4>; PARTS]; 2],
        left_out: Option<usize>,
        weight: f64,
    ) -> Self {
        let joints = [0, 1].map(|side| {
            let kept = parts[side].iter().enumerate().filter(|(i, _)| Some(*i) != left_out);
            let mut equations = NormalEquations::sum(kept.map(|(_, part)| part));
            equations.matrix += Matrix4::identity() * (APART_MM / POSITION_MM).powi(2) * weight;
            let joint = self.joints[side];
            equations.solve().map_or(joint, |(moved, _)| joint.moved(&moved))
        });
        Self { joints }
    }

    /// Returns the positions of joint 1 in the frames of links 0 and 1 and of joint 2 in the frames of links 0 and 2,
    /// mm.
    pub(crate) fn ends(&self) -> [[f64; 2]; 4] {
        let [front, rear] = self.joints;
        [front.in_middle, front.in_outer, rear.in_middle, rear.in_outer]
    }

    /// Returns the distance between the positions of each joint according to its two links, along and across the middle
    /// link, given the links' own poses and the frame number of each row: one value per frame of the grid (first frame
    /// and number of frames), mm; NaN where a link has no pose.
    pub(crate) fn gaps<'f>(
        &'f self,
        fits: &'f [Vec<LinkFit>; 3],
        numbers: &'f [i64],
        [first_frame, frames]: [i64; 2],
    ) -> impl Iterator<Item = Vec<f64>> + 'f {
        let sides = [0, 1].into_iter().flat_map(|side| [(side, 0), (side, 1)]);
        sides.map(move |(side, axis)| {
            let joint = self.joints[side];
            let mut gaps_mm = vec![f64::NAN; frames as usize];
            let links = fits[0].iter().zip(&fits[1 + side]);
            for ((middle, outer), number) in links.zip(numbers) {
                let (Some(middle), Some(outer)) = (middle.pose(), outer.pose()) else { continue };
                let [a, b] = [middle.at(joint.in_middle), outer.at(joint.in_outer)];
                let gap = rotated(-middle.theta_rad, [b[0] - a[0], b[1] - a[1]]);
                gaps_mm[(number - first_frame) as usize] = gap[axis];
            }
            gaps_mm
        })
    }

    /// Returns the largest distance between the positions of the same joint in two linkages, mm.
    pub(crate) fn distance_mm(&self, other: &Self) -> f64 {
        let pairs = self.ends().into_iter().zip(other.ends());
        pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
    }

    /// Fits the poses of links 0, 1, 2 such that adjacent links meet at their joints, given the pose from each link's
    /// own markers. A link without a pose remains without one. The residuals become the RMS distances of the markers
    /// from the new poses.
    pub(crate) fn close(&self, own: [Option<LinkPose>; 3]) -> [Option<LinkPose>; 3] {
        let Some(closed) = self.closed(&own) else { return own };
        [0, 1, 2].map(|link| Some(self.posed(link, &own[link]?, &closed)))
    }

    /// Returns, for each of the linkages `others`, the changes in the position of link 0's axle, mm, and in the
    /// headings of links 0, 1, 2, rad, in a frame if that linkage replaced this one, to first order in the joint
    /// positions; `None` if link 0 or both side links have no pose, or if the poses do not determine the changes.
    pub(crate) fn shifts<const N: usize>(
        &self,
        own: &[Option<LinkPose>; 3],
        others: &[Self; N],
    ) -> Option<[Vector5<f64>; N]> {
        let closed = self.closed(own)?;
        let here = self.step(own, &closed)?;
        let mut shifts = [here; N];
        for (shift, other) in shifts.iter_mut().zip(others) {
            *shift -= other.step(own, &closed)?;
        }
        Some(shifts)
    }

    fn closed(&self, own: &[Option<LinkPose>; 3]) -> Option<Closed> {
        // Without the middle link or without both side links, no joint is determined from both sides.
        let middle = own[0].filter(|_| own[1].is_some() || own[2].is_some())?;
        let [x, y] = middle.origin_mm;
        let [front, rear] = [own[1], own[2]].map(|pose| pose.map_or(0.0, |pose| pose.theta_rad));
        let q = Vector5::new(x, y, middle.theta_rad, front, rear);
        let turns = turns(&q);
        let seen_mm = [0, 1, 2].map(|link| {
            own[link].map_or(Vector2::zeros(), |LinkPose { origin_mm, moments, .. }| {
                Vector2::from(origin_mm) + turns[link] * Vector2::from(moments.centre_mm)
            })
        });
        let mut closed = Closed { seen_mm, q, turns };
        for _ in 0..MAX_STEPS {
            // If the markers of every link determine its heading, the matrix is positive definite.
            let step = self.step(own, &closed)?;
            closed.q -= step;
            closed.turns = self::turns(&closed.q);
            if step.fixed_rows::<3>(2).amax() < SMALL_RAD {
                break;
            }
        }
        Some(closed)
    }

    /// Returns the vectors from link 0's axle to a side link's joint, in link 0's frame, and from that joint to the
    /// side link's axle, in the side link's frame.
    fn arms(&self, link: usize) -> (Vector2<f64>, Vector2<f64>) {
        match link.checked_sub(1).map(|side| self.joints[side]) {
            None => (Vector2::zeros(), Vector2::zeros()),
            Some(joint) => (joint.in_middle.into(), -Vector2::from(joint.in_outer)),
        }
    }

    /// Computes the Gauss-Newton step, to be subtracted from the position of link 0's axle and the headings of links 0,
    /// 1, 2; `None` if the poses do not determine it. The heading of a side link affects only that link's markers and
    /// is therefore eliminated first.
    fn step(&self, own: &[Option<LinkPose>; 3], at: &Closed) -> Option<Vector5<f64>> {
        let Closed { seen_mm, q, turns } = at;
        let mut normal = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        let mut sides = [(Vector3::zeros(), 0.0); 3];
        for (link, pose) in own.iter().enumerate() {
            let Some(LinkPose { theta_rad, moments, .. }) = pose else { continue };
            let markers = moments.markers;
            let turning = moments.turning_mm2;
            let (to_joint, to_axle) = self.arms(link);
            let own_arm = turns[link] * (to_axle + Vector2::from(moments.centre_mm));
            let middle_arm = turns[0] * to_joint;
            let off = q.xy() + middle_arm + own_arm - seen_mm[link];
            let slope = turning * (q[2 + link] - theta_rad).sin();
            // Derivatives of `off` with respect to the headings of link 0 and of this link.
            let b = perpendicular(own_arm);
            let p = if link == 0 { b } else { perpendicular(middle_arm) };
            let turn = p.x * off.x + p.y * off.y;
            normal[(0, 0)] += markers;
            normal[(1, 1)] += markers;
            normal[(2, 0)] += markers * p.x;
            normal[(2, 1)] += markers * p.y;
            normal[(2, 2)] += markers * (p.x * p.x + p.y * p.y);
            gradient += Vector3::new(off.x, off.y, turn) * markers;
            if link == 0 {
                normal[(2, 2)] += turning;
                gradient[2] += slope;
                continue;
            }
            let stiffness = markers * (b.x * b.x + b.y * b.y) + turning;
            let coupling = Vector3::new(b.x, b.y, p.x * b.x + p.y * b.y) * (markers / stiffness);
            let own_step = (markers * (b.x * off.x + b.y * off.y) + slope) / stiffness;
            normal -= coupling * coupling.transpose() * stiffness;
            gradient -= coupling * (own_step * stiffness);
            sides[link] = (coupling, own_step);
        }
        // Cholesky reads the lower triangle only.
        let step = normal.cholesky()?.solve(&gradient);
        let [front, rear] = [1, 2].map(|link| sides[link].1 - sides[link].0.dot(&step));
        Some(Vector5::new(step[0], step[1], step[2], front, rear))
    }

    /// Returns the pose of a link according to `closed`, in which adjacent links meet at their joints, given the pose
    /// from the link's own markers.
    fn posed(&self, link: usize, own: &LinkPose, closed: &Closed) -> LinkPose {
        let Closed { seen_mm, q, turns } = closed;
        let (to_joint, to_axle) = self.arms(link);
        let origin_mm = q.xy() + turns[0] * to_joint + turns[link] * to_axle;
        let moments = &own.moments;
        let off = origin_mm + turns[link] * Vector2::from(moments.centre_mm) - seen_mm[link];
        let half_turn = (0.5 * (q[2 + link] - own.theta_rad)).sin();
        let turning = 4.0 * moments.turning_mm2 * half_turn * half_turn;
        let squares = own.residual_mm.powi(2) + off.x * off.x + off.y * off.y;
        let residual_mm = (squares + turning / moments.markers).sqrt();
        let theta_rad = wrap(q[2 + link]);
        LinkPose { origin_mm: origin_mm.into(), theta_rad, residual_mm, ..*own }
    }
}

/// Positions of the links in a frame, such that adjacent links meet at their joints.
struct Closed {
    /// Centroids of the links' markers according to the poses fitted to each link separately, mm.
    seen_mm: [Vector2<f64>; 3],
    /// Position of link 0's axle, mm, and headings of links 0, 1, 2, rad.
    q: Vector5<f64>,
    turns: [UnitComplex<f64>; 3],
}

/// Returns the rotations of links 0, 1, 2 by their headings.
fn turns(q: &Vector5<f64>) -> [UnitComplex<f64>; 3] {
    [2, 3, 4].map(|heading| UnitComplex::new(q[heading]))
}

/// Returns the derivative of a rotated lever arm with respect to the rotation angle: the arm turned by 90 degrees.
fn perpendicular(arm: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-arm.y, arm.x)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_tables::config::Config;

    use super::*;
    use crate::markers::labels::Outlier;
    use crate::markers::rigid;

    type Pairs = Vec<([f64; 2], [f64; 2])>;

    /// Returns the positions of the links for the coordinates `q` (position of link 0's axle, mm, and headings, rad),
    /// for tests in which the residuals do not matter.
    fn closed(q: &Vector5<f64>) -> Closed {
        Closed { seen_mm: [Vector2::zeros(); 3], q: *q, turns: turns(q) }
    }

    /// Returns local positions and noisy recorded positions of the default layout's markers in one frame.
    fn pairs(q: &Vector5<f64>, noise_mm: f64) -> [Pairs; 3] {
        let linkage = Linkage::from_robot(&Robot::kinematic());
        let config = Config::default();
        let mut k = 0.0_f64;
        [0, 1, 2].map(|link| {
            let own = LinkPose {
                origin_mm: [0.0; 2],
                theta_rad: 0.0,
                residual_mm: 0.0,
                moments: rigid::MarkerMoments { markers: 1.0, ..Default::default() },
            };
            let pose = linkage.posed(link, &own, &closed(q));
            let mut pair = |p: &[f64; 3]| {
                k += 1.0;
                let [x, y] = pose.at([p[0], p[1]]);
                let noise = [(12.9 * k).sin(), (78.2 * k).cos()].map(|x| noise_mm * x);
                ([p[0], p[1]], [x + noise[0], y + noise[1]])
            };
            config.markers.links()[link].values().map(&mut pair).collect()
        })
    }

    fn own(pairs: &[Pairs; 3]) -> [Option<LinkPose>; 3] {
        pairs.each_ref().map(|pairs| rigid::fit(pairs.iter().copied()))
    }

    /// Returns the sum of the squared distances between the recorded positions of all markers and their positions on
    /// the links at `q`, computed marker by marker.
    fn squares(pairs: &[Pairs; 3], q: &Vector5<f64>) -> f64 {
        let linkage = Linkage::from_robot(&Robot::kinematic());
        let own = own(pairs);
        let mut sums = [0.0; 3];
        for (link, sum) in sums.iter_mut().enumerate() {
            let pose = linkage.posed(link, &own[link].unwrap(), &closed(q));
            let squares = pairs[link].iter().map(|(local, seen)| {
                let at = pose.at(*local);
                (at[0] - seen[0]).powi(2) + (at[1] - seen[1]).powi(2)
            });
            *sum = squares.sum();
        }
        sums.iter().sum()
    }

    const Q: [f64; 5] = [812.0, -340.0, 3.0, 2.4, 3.5];

    #[test]
    fn without_noise_the_poses_stay_as_they_are() {
        let own = own(&pairs(&Vector5::from(Q), 0.0));
        let closed = Linkage::from_robot(&Robot::kinematic()).close(own);
        for (own, closed) in own.into_iter().flatten().zip(closed.into_iter().flatten()) {
            assert!((own.theta_rad - closed.theta_rad).abs() < 1e-12);
            assert!((own.origin_mm[0] - closed.origin_mm[0]).abs() < 1e-9);
            assert!(closed.residual_mm < 1e-6);
        }
    }

    #[test]
    fn noisy_poses_become_the_least_squares_of_all_markers_with_closed_joints() {
        let pairs = pairs(&Vector5::from(Q), 1.0);
        let linkage = Linkage::from_robot(&Robot::kinematic());
        let closed = linkage.close(own(&pairs)).map(Option::unwrap);
        let [x, y] = closed[0].origin_mm;
        let theta = closed.map(|pose| pose.theta_rad);
        let q = Vector5::new(x, y, theta[0], theta[1], theta[2]);
        let minimum = squares(&pairs, &q);
        for i in 0..5 {
            for step in [-1e-4, 1e-4] {
                let mut other = q;
                other[i] += step;
                assert!(squares(&pairs, &other) > minimum, "{i}");
            }
        }
        let counts = [4.0, 3.0, 3.0];
        let by_residuals: f64 =
            closed.iter().zip(counts).map(|(pose, n)| n * pose.residual_mm.powi(2)).sum();
        assert!((by_residuals / minimum - 1.0).abs() < 1e-9);
        // The joints are closed: joint 1 is l behind link 1's axle and h ahead of link 0's.
        let robot = Robot::kinematic();
        let h_mm = 1e3 * robot.h_m[0];
        let l_mm = 1e3 * robot.l_m[0];
        let [front, rear] = [closed[0].at([h_mm, 0.0]), closed[0].at([-h_mm, 0.0])];
        let [of_front, of_rear] = [closed[1].at([-l_mm, 0.0]), closed[2].at([l_mm, 0.0])];
        for (a, b) in [(front, of_front), (rear, of_rear)] {
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
        }
    }

    #[test]
    fn wrong_joint_positions_are_corrected_from_the_poses() {
        let right = Linkage::from_robot(&Robot::kinematic());
        let mut fits = [const { Vec::new() }; 3];
        for i in 0..2000 {
            let phase = 0.1 * i as f64;
            let turn = [0.5 * phase.cos(), 0.5 * phase.sin()];
            let q = Vector5::new(3.0 * phase, 5.0, 1.0, 1.0 - turn[0], 1.0 + turn[1]);
            for (fits, pose) in fits.iter_mut().zip(own(&pairs(&q, 0.0))) {
                fits.extend(pose.map(|pose| LinkFit::new(0b111, Some(pose), Outlier::None)));
            }
        }
        let mut robot = Robot::kinematic();
        robot.h_m = robot.h_m.map(|h_m| h_m + 0.002);
        robot.l_m = robot.l_m.map(|l_m| l_m - 0.001);
        let wrong = Linkage::from_robot(&robot);
        assert!((wrong.distance_mm(&right) - 2.0).abs() < 1e-9);
        assert!(wrong.refined(&fits, 0..2000).0.distance_mm(&right) < 0.3);
        // A joint that does not turn determines only the sum of the two positions.
        let still = fits.map(|fits| vec![fits[0]; 200]);
        let (refined, _) = wrong.refined(&still, 0..200);
        let [middle, front] = [0, 1].map(|link| still[link][0].pose().unwrap());
        let positions = refined.joints[0];
        let a = middle.at(positions.in_middle);
        let b = front.at(positions.in_outer);
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.1);
        assert!(refined.distance_mm(&wrong) < 2.0);
    }

    #[test]
    fn noise_does_not_bias_the_joints_of_links_that_turn_little() {
        let right = Linkage::from_robot(&Robot::kinematic());
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        let mut fits = [const { Vec::new() }; 3];
        for i in 0..6000 {
            let phase = 0.05 * i as f64;
            let turn = [0.2 * phase.cos(), 0.2 * phase.sin()];
            let q = Vector5::new(3.0 * phase, 5.0, 0.01 * phase, 0.5 - turn[0], 0.5 + turn[1]);
            for (fits, pairs) in fits.iter_mut().zip(pairs(&q, 0.0)) {
                let seen = pairs.iter().map(|(p, [x, y])| (*p, [x + noise(), y + noise()]));
                let pose = rigid::fit(seen.collect::<Vec<_>>().into_iter());
                fits.extend(pose.map(|pose| LinkFit::new(0b111, Some(pose), Outlier::None)));
            }
        }
        let distance_mm = right.refined(&fits, 0..6000).0.distance_mm(&right);
        assert!(distance_mm < 0.4, "{distance_mm}");
    }

    #[test]
    fn shifts_are_the_changes_of_the_poses_with_other_joints() {
        let own = own(&pairs(&Vector5::from(Q), 0.2));
        let here = Linkage::from_robot(&Robot::kinematic());
        let mut there = here;
        there.joints[0] = there.joints[0].moved(&Vector4::new(0.1, -0.2, 0.05, 0.1));
        let [shift] = here.shifts(&own, &[there]).unwrap();
        let poses = [here, there].map(|linkage| linkage.close(own).map(Option::unwrap));
        let [a, b] = poses.map(|[middle, front, rear]| {
            let [x, y] = middle.origin_mm;
            let theta = [middle, front, rear].map(|pose| pose.theta_rad);
            Vector5::new(x, y, theta[0], theta[1], theta[2])
        });
        let error = (b - a - shift).abs();
        assert!(shift.norm() > 0.05 && error.amax() < 1e-3 * shift.norm(), "{shift} {error}");
        assert_eq!(here.shifts(&[None, own[1], own[2]], &[there]), None);
    }

    #[test]
    fn an_occluded_link_has_no_pose_and_the_others_close_their_joint() {
        let pairs = pairs(&Vector5::from(Q), 1.0);
        let linkage = Linkage::from_robot(&Robot::kinematic());
        let all = own(&pairs);
        let closed = linkage.close([all[0], all[1], None]);
        assert_eq!(closed[2], None);
        let [middle, front] = [closed[0].unwrap(), closed[1].unwrap()];
        let joint = linkage.joints[0];
        let a = middle.at(joint.in_middle);
        let b = front.at(joint.in_outer);
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
        assert_eq!(linkage.close([None, all[1], all[2]]), [None, all[1], all[2]]);
        assert_eq!(linkage.close([all[0], None, None]), [all[0], None, None]);
    }
}
