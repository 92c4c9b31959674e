//! Multibody optimisation (Lu and O'Connor 1999): the poses of all three links at once, with the
//! joints closed.
//!
//! Each link's own fit leaves its joints a little apart: noise of some tenths of a millimetre.
//! Here the five coordinates (eq. 1) are those that bring all markers of a frame nearest to
//! where the cameras saw them, in the sense of least squares, with every joint at one point of
//! both its links. A link's own fit, and the centroid and spread of its markers, determine the sum
//! over the markers ([`MarkerMoments`]), which is not taken again. Instead of the joint angles the links'
//! headings are the unknowns, which gives the same minimum.

use std::ops::Range;

use nalgebra::{Matrix3, Matrix4, UnitComplex, Vector2, Vector3, Vector4, Vector5};
use trilink_robot::{Robot, rotated};
use trilink_statistics::{NormalEquations, wrap};

use crate::markers::labels::LinkFit;
use crate::markers::rigid::LinkPose;

#[cfg(doc)]
use crate::markers::rigid::MarkerMoments;

/// Steps of Gauss-Newton: from the links' own fits, two reach rounding.
const STEPS: usize = 4;
/// A step that turns no link by more than this, rad, is the last: what remains is its square times
/// an arm, a thousandth of a millimetre.
const SMALL_RAD: f64 = 3e-3;
/// Rows that the joints' positions are taken from, spread over the trial.
const ROWS: usize = 2000;
/// Neighbouring rows that are taken together. The cameras' noise in the links' headings pulls the joints'
/// positions towards no difference, by its variance over that of the joint's angle: attenuation (Fuller,
/// *Measurement Error Models*, Wiley 1987, section 1.1). In a mean over neighbours there is that much less
/// noise, and the angle is as good as the same.
const NEIGHBOURS: usize = 8;
/// Parts of the trial that the joints' positions are looked for without.
pub(crate) const PARTS: usize = 8;
/// How far a joint may well be from where the robot's h and l put it, and how far the links of a
/// frame leave it apart, mm.
const POSITION_MM: f64 = 3.0;
const APART_MM: f64 = 0.5;
/// Frames over which a slow tilt of the links leaves it apart in the same direction.
const ALIKE_FRAMES: f64 = 360.0;

/// Where a joint is in its two links' own frames, mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointPosition {
    pub in_middle: [f64; 2],
    pub in_outer: [f64; 2],
}

impl JointPosition {
    /// Equations of how far the joint is from here in either frame, given poses of both links in runs of
    /// neighbouring rows: `o_a + R_a p_a = o_b + R_b p_b` is linear in the two positions and, seen from link a,
    /// in what differs between rows, so that it holds for the means over a run.
    pub fn equations(
        &self,
        runs: impl Iterator<Item = impl IntoIterator<Item = (LinkPose, LinkPose)>>,
    ) -> NormalEquations<4> {
        let mut equations = NormalEquations::new();
        for run in runs {
            let mut count = 0.0;
            let (mut turn, mut apart, mut squares) = ([0.0; 2], [0.0; 2], [0.0; 2]);
            for (a, b) in run {
                let (from, to) = (a.at(self.in_middle), b.at(self.in_outer));
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

    pub fn moved(self, by: &Vector4<f64>) -> Self {
        let Self { in_middle: [a, b], in_outer: [c, d] } = self;
        Self { in_middle: [a + by[0], b + by[1]], in_outer: [c + by[2], d + by[3]] }
    }
}

/// The three links with their joints, of links 0 and 1 and of links 0 and 2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Linkage {
    pub joints: [JointPosition; 2],
}

impl Linkage {
    /// With the h and l of a robot.
    pub(crate) fn of(robot: &Robot) -> Self {
        let joint = |sign: f64| JointPosition {
            in_middle: [sign * 1e3 * robot.h_m, 0.0],
            in_outer: [-sign * 1e3 * robot.l_m, 0.0],
        };
        Self { joints: [joint(1.0), joint(-1.0)] }
    }

    /// With the joints where a trial's own poses have them, starting from these: h and l that are a
    /// millimetre wrong would bend the poses by half a degree. What the trial does not determine,
    /// such as both positions of a joint that does not turn, stays near where it was. Then the same
    /// without each of [`PARTS`] parts of the trial, whose differences tell how well the joints
    /// are known. It is looked at in some rows.
    pub(crate) fn refined(
        &self,
        fits: &[Vec<LinkFit>; 3],
        from: Range<usize>,
    ) -> (Self, [Self; PARTS]) {
        let rows = from.len();
        let stride = (rows / ROWS).max(1);
        let alike = (ALIKE_FRAMES / stride as f64).max(1.0);
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
        let without = |left_out: Option<usize>| {
            let joint = |side: usize| {
                let kept = parts[side].iter().enumerate().filter(|(i, _)| Some(*i) != left_out);
                let mut equations = NormalEquations::sum(kept.map(|(_, part)| part));
                equations.matrix += Matrix4::identity() * (APART_MM / POSITION_MM).powi(2) * alike;
                let joint = self.joints[side];
                equations.solve().map_or(joint, |(moved, _)| joint.moved(&moved))
            };
            Self { joints: [joint(0), joint(1)] }
        };
        (without(None), std::array::from_fn(|i| without(Some(i))))
    }

    /// Where joint 1 is in links 0 and 1, and joint 2 in links 0 and 2, mm.
    pub(crate) fn ends(&self) -> [[f64; 2]; 4] {
        let [front, rear] = self.joints;
        [front.in_middle, front.in_outer, rear.in_middle, rear.in_outer]
    }

    /// How far a joint of a link is from where another linkage has it, at most, mm.
    pub(crate) fn distance_mm(&self, other: &Self) -> f64 {
        let pairs = self.ends().into_iter().zip(other.ends());
        pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
    }

    /// The poses of links 0, 1, 2 with their joints closed, given the pose that each link's own
    /// markers give; a link without one stays without. Residuals are the markers' RMS
    /// distances from the new poses.
    pub(crate) fn close(&self, own: [Option<LinkPose>; 3]) -> [Option<LinkPose>; 3] {
        let Some(closed) = self.closed(&own) else { return own };
        let posed = |link: usize| Some(self.posed(link, &own[link]?, &closed));
        [0, 1, 2].map(posed)
    }

    /// By how much the links of a frame would be elsewhere with the joints of other linkages: link
    /// 0's axle, mm, and the headings of links 0, 1, 2, rad. To first order, as far as joints
    /// differ from trial to trial.
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
        // Without the middle link, or with it alone, no joint is known from both sides.
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
        for _ in 0..STEPS {
            // Markers that give every link a heading give a positive definite matrix.
            let step = self.step(own, &closed)?;
            closed.q -= step;
            closed.turns = self::turns(&closed.q);
            if step.fixed_rows::<3>(2).amax() < SMALL_RAD {
                break;
            }
        }
        Some(closed)
    }

    /// From link 0's axle to the joint of a link, in link 0's frame, and from there to the
    /// link's axle, in its own.
    fn arms(&self, link: usize) -> (Vector2<f64>, Vector2<f64>) {
        match link.checked_sub(1).map(|side| self.joints[side]) {
            None => (Vector2::zeros(), Vector2::zeros()),
            Some(joint) => (joint.in_middle.into(), -Vector2::from(joint.in_outer)),
        }
    }

    /// The Gauss-Newton step, to be subtracted: link 0's axle and the headings of links 0, 1, 2.
    /// A side link's heading acts on its own markers only, and is eliminated first.
    fn step(&self, own: &[Option<LinkPose>; 3], at: &Closed) -> Option<Vector5<f64>> {
        let Closed { seen_mm, q, turns } = at;
        let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        let mut sides = [(Vector3::zeros(), 0.0); 3];
        for (link, pose) in own.iter().enumerate() {
            let Some(LinkPose { theta_rad, moments, .. }) = pose else { continue };
            let (markers, turning) = (moments.markers, moments.turning_mm2);
            let (to_joint, to_axle) = self.arms(link);
            let own_arm = turns[link] * (to_axle + Vector2::from(moments.centre_mm));
            let middle_arm = turns[0] * to_joint;
            let off = q.xy() + middle_arm + own_arm - seen_mm[link];
            let slope = turning * (q[2 + link] - theta_rad).sin();
            // Derivatives of `off` with respect to the headings of link 0 and of the link itself.
            let across = |arm: Vector2<f64>| Vector2::new(-arm.y, arm.x);
            let (p, b) = (across(if link == 0 { own_arm } else { middle_arm }), across(own_arm));
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
        let heading = |link: usize| sides[link].1 - sides[link].0.dot(&step);
        Some(Vector5::new(step[0], step[1], step[2], heading(1), heading(2)))
    }

    /// A link's pose in the linkage, given its own.
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
        let (origin_mm, theta_rad) = (origin_mm.into(), wrap(q[2 + link]));
        LinkPose { origin_mm, theta_rad, residual_mm, ..*own }
    }
}

/// The links of a frame with their joints closed.
struct Closed {
    /// Where each link's own pose has its markers' centroid.
    seen_mm: [Vector2<f64>; 3],
    /// Link 0's axle, mm, and the headings of links 0, 1, 2, rad.
    q: Vector5<f64>,
    turns: [UnitComplex<f64>; 3],
}

/// By the headings of links 0, 1, 2.
fn turns(q: &Vector5<f64>) -> [UnitComplex<f64>; 3] {
    [2, 3, 4].map(|heading| UnitComplex::new(q[heading]))
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

    /// Links at `q` whose markers' residuals do not matter.
    fn closed(q: &Vector5<f64>) -> Closed {
        Closed { seen_mm: [Vector2::zeros(); 3], q: *q, turns: turns(q) }
    }

    /// Places and noisy positions of the default layout's markers in one frame.
    fn pairs(q: &Vector5<f64>, noise_mm: f64) -> [Pairs; 3] {
        let linkage = Linkage::of(&Robot::kinematic());
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
            let place = |p: &[f64; 3]| {
                k += 1.0;
                let [x, y] = pose.at([p[0], p[1]]);
                let noise = [(12.9 * k).sin(), (78.2 * k).cos()].map(|x| noise_mm * x);
                ([p[0], p[1]], [x + noise[0], y + noise[1]])
            };
            config.markers.links()[link].values().map(place).collect()
        })
    }

    fn own(pairs: &[Pairs; 3]) -> [Option<LinkPose>; 3] {
        pairs.each_ref().map(|pairs| rigid::fit(pairs.iter().copied()))
    }

    /// The sum of squared distances of all markers, by its definition.
    fn squares(pairs: &[Pairs; 3], q: &Vector5<f64>) -> f64 {
        let linkage = Linkage::of(&Robot::kinematic());
        let own = own(pairs);
        let of_link = |link: usize| -> f64 {
            let pose = linkage.posed(link, &own[link].unwrap(), &closed(q));
            let square = |(place, seen): &([f64; 2], [f64; 2])| {
                let at = pose.at(*place);
                (at[0] - seen[0]).powi(2) + (at[1] - seen[1]).powi(2)
            };
            pairs[link].iter().map(square).sum()
        };
        (0..3).map(of_link).sum()
    }

    const Q: [f64; 5] = [812.0, -340.0, 3.0, 2.4, 3.5];

    #[test]
    fn without_noise_the_poses_stay_as_they_are() {
        let own = own(&pairs(&Vector5::from(Q), 0.0));
        let closed = Linkage::of(&Robot::kinematic()).close(own);
        for (own, closed) in own.into_iter().flatten().zip(closed.into_iter().flatten()) {
            assert!((own.theta_rad - closed.theta_rad).abs() < 1e-12);
            assert!((own.origin_mm[0] - closed.origin_mm[0]).abs() < 1e-9);
            assert!(closed.residual_mm < 1e-6);
        }
    }

    #[test]
    fn noisy_poses_become_the_least_squares_of_all_markers_with_closed_joints() {
        let pairs = pairs(&Vector5::from(Q), 1.0);
        let linkage = Linkage::of(&Robot::kinematic());
        let closed = linkage.close(own(&pairs)).map(Option::unwrap);
        let [[x, y], theta] =
            [closed[0].origin_mm, closed.map(|pose| pose.theta_rad)[..2].try_into().unwrap()];
        let q = Vector5::new(x, y, theta[0], theta[1], closed[2].theta_rad);
        let least = squares(&pairs, &q);
        for i in 0..5 {
            for step in [-1e-4, 1e-4] {
                let mut other = q;
                other[i] += step;
                assert!(squares(&pairs, &other) > least, "{i}");
            }
        }
        let counts = [4.0, 3.0, 3.0];
        let by_residuals: f64 =
            closed.iter().zip(counts).map(|(pose, n)| n * pose.residual_mm.powi(2)).sum();
        assert!((by_residuals / least - 1.0).abs() < 1e-9);
        // The joints are closed: link 1's is l behind its axle, link 0's h before its own.
        let robot = Robot::kinematic();
        let (h_mm, l_mm) = (1e3 * robot.h_m, 1e3 * robot.l_m);
        let [front, rear] = [closed[0].at([h_mm, 0.0]), closed[0].at([-h_mm, 0.0])];
        let [of_front, of_rear] = [closed[1].at([-l_mm, 0.0]), closed[2].at([l_mm, 0.0])];
        for (a, b) in [(front, of_front), (rear, of_rear)] {
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
        }
    }

    #[test]
    fn positions_of_joints_that_are_wrong_are_found_from_the_poses() {
        let right = Linkage::of(&Robot::kinematic());
        let fit = |pose: LinkPose| LinkFit::new(0b111, Some(pose), Outlier::None);
        let mut fits = [const { Vec::new() }; 3];
        for i in 0..2000 {
            let phase = 0.1 * i as f64;
            let turn = [0.5 * phase.cos(), 0.5 * phase.sin()];
            let q = Vector5::new(3.0 * phase, 5.0, 1.0, 1.0 - turn[0], 1.0 + turn[1]);
            for (fits, pose) in fits.iter_mut().zip(own(&pairs(&q, 0.0))) {
                fits.extend(pose.map(fit));
            }
        }
        let mut robot = Robot::kinematic();
        robot.h_m += 0.002;
        robot.l_m -= 0.001;
        let wrong = Linkage::of(&robot);
        assert!((wrong.distance_mm(&right) - 2.0).abs() < 1e-9);
        assert!(wrong.refined(&fits, 0..2000).0.distance_mm(&right) < 0.3);
        // From a joint that does not turn only their sum is known.
        let still = fits.map(|fits| vec![fits[0]; 200]);
        let (refined, _) = wrong.refined(&still, 0..200);
        let [middle, front] = [0, 1].map(|link| still[link][0].pose().unwrap());
        let positions = refined.joints[0];
        let (a, b) = (middle.at(positions.in_middle), front.at(positions.in_outer));
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.1);
        assert!(refined.distance_mm(&wrong) < 2.0);
    }

    #[test]
    fn noise_does_not_pull_the_joints_of_links_that_turn_a_little() {
        let right = Linkage::of(&Robot::kinematic());
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
    fn shifts_are_what_closing_other_joints_makes_of_the_poses() {
        let own = own(&pairs(&Vector5::from(Q), 0.2));
        let here = Linkage::of(&Robot::kinematic());
        let mut there = here;
        there.joints[0] = there.joints[0].moved(&Vector4::new(0.1, -0.2, 0.05, 0.1));
        let [shift] = here.shifts(&own, &[there]).unwrap();
        let poses = [here, there].map(|linkage| linkage.close(own).map(Option::unwrap));
        let [a, b] = poses.map(|[middle, front, rear]| {
            let ([x, y], theta) = (middle.origin_mm, [middle, front, rear].map(|of| of.theta_rad));
            Vector5::new(x, y, theta[0], theta[1], theta[2])
        });
        let error = (b - a - shift).abs();
        assert!(shift.norm() > 0.05 && error.amax() < 1e-3 * shift.norm(), "{shift} {error}");
        assert_eq!(here.shifts(&[None, own[1], own[2]], &[there]), None);
    }

    #[test]
    fn a_link_that_was_not_seen_stays_so_and_the_others_close_their_joint() {
        let pairs = pairs(&Vector5::from(Q), 1.0);
        let linkage = Linkage::of(&Robot::kinematic());
        let all = own(&pairs);
        let closed = linkage.close([all[0], all[1], None]);
        assert_eq!(closed[2], None);
        let [middle, front] = [closed[0].unwrap(), closed[1].unwrap()];
        let joint = linkage.joints[0];
        let (a, b) = (middle.at(joint.in_middle), front.at(joint.in_outer));
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
        assert_eq!(linkage.close([None, all[1], all[2]]), [None, all[1], all[2]]);
        assert_eq!(linkage.close([all[0], None, None]), [all[0], None, None]);
    }
}
