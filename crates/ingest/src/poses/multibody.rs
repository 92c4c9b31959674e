//! Multibody optimisation (Lu and O'Connor 1999): fits the poses of all links together so that the joints are closed.
//!
//! If the links are fitted separately, marker noise of some tenths of a millimetre leaves the joints slightly open.
//! Here the coordinates (eq. 1) minimise the sum of squared distances between the fitted and recorded positions of
//! all markers in a frame, with each joint at a single point common to both its links. That sum follows from each
//! link's own fit and the centroid and spread of its markers ([`MarkerMoments`]), so that the markers need not be
//! summed again. The unknowns are the headings of the links instead of the joint angles, which gives the same minimum.

use std::ops::Range;

use nalgebra::{Matrix3, Matrix4, UnitComplex, Vector2, Vector3, Vector4};
use trilink_robot::{MAX_JOINTS, MAX_LINKS, rotated};
use trilink_statistics::{NormalEquations, wrap};

use crate::geometry::Geometry;
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

/// Position of a joint in the frames of its two links, mm: the inner link, which is the one towards link 0, and the
/// outer link.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointPosition {
    pub in_inner: [f64; 2],
    pub in_outer: [f64; 2],
}

impl JointPosition {
    /// Sets up the equations for the displacements of the joint, in the frames of links a (inner) and b (outer), from
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
                let from = a.at(self.in_inner);
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

    /// Returns this joint position after a displacement in the inner link's frame (first two components) and in the
    /// outer link's frame (last two), mm.
    pub fn moved(self, by: &Vector4<f64>) -> Self {
        let Self { in_inner: [a, b], in_outer: [c, d] } = self;
        Self { in_inner: [a + by[0], b + by[1]], in_outer: [c + by[2], d + by[3]] }
    }
}

/// The links of a robot with their joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Linkage {
    /// Number of links.
    links: usize,
    /// Numbers of the links from front to rear.
    order: [usize; MAX_LINKS],
    /// Index of link 0 in `order`.
    reference: usize,
    /// Whether each link, by number, has no markers. Its pose then follows from its neighbours' joints.
    is_bare: [bool; MAX_LINKS],
    /// Joints from front to rear.
    joints: [JointPosition; MAX_JOINTS],
    is_of_paper: bool,
}

impl Linkage {
    /// Creates the linkage of a robot; the links without markers are those marked in `is_bare`.
    pub(crate) fn new(geometry: &Geometry, is_bare: impl Fn(usize) -> bool) -> Self {
        let links = geometry.links.len();
        let mut order = [0; MAX_LINKS];
        order[..links].copy_from_slice(&geometry.order);
        let mut joints = [JointPosition::default(); MAX_JOINTS];
        for inner in geometry.links.iter().filter_map(|link| link.inner) {
            joints[inner.joint] = JointPosition {
                in_inner: [1e3 * inner.on_inner_m, 0.0],
                in_outer: [1e3 * inner.on_outer_m, 0.0],
            };
        }
        let reference = geometry.order.iter().position(|link| *link == 0).unwrap_or(0);
        let is_bare = std::array::from_fn(|link| link < links && is_bare(link));
        Self { links, order, reference, is_bare, joints, is_of_paper: geometry.is_of_paper }
    }

    /// Returns the joints from front to rear.
    pub(crate) fn joints(&self) -> &[JointPosition] {
        &self.joints[..self.links - 1]
    }

    /// Returns the numbers of the links from front to rear.
    pub(crate) fn order(&self) -> &[usize] {
        &self.order[..self.links]
    }

    /// Returns the numbers of the two links of a joint: first the one towards link 0.
    pub(crate) fn links_of(&self, joint: usize) -> [usize; 2] {
        let [ahead, behind] = [self.order[joint], self.order[joint + 1]];
        if joint < self.reference { [behind, ahead] } else { [ahead, behind] }
    }

    /// Returns whether the robot is the paper's, whose joints are given by h and l.
    pub(crate) fn is_of_paper(&self) -> bool {
        self.is_of_paper
    }

    /// Returns a joint's position in the frame of one of its links, given by its index in `order`, mm.
    fn position_on(&self, joint: usize, place: usize) -> [f64; 2] {
        let JointPosition { in_inner, in_outer } = self.joints[joint];
        if (joint < self.reference) == (place > joint) { in_inner } else { in_outer }
    }

    /// Estimates the joint positions from a trial's link poses, starting from this linkage: an error of a millimetre in
    /// h and l would change the fitted joint angles by half a degree. Positions that the trial does not determine, such
    /// as both positions of a joint that does not turn, stay near their starting values. Also returns the estimates
    /// without each of [`PARTS`] parts of the trial, whose differences give the standard errors. Only some rows are
    /// evaluated.
    pub(crate) fn refined(
        &self,
        fits: &[Vec<LinkFit>],
        from: Range<usize>,
    ) -> (Self, [Self; PARTS]) {
        let rows = from.len();
        let stride = (rows / ROWS).max(1);
        let alike = (CORRELATED_FRAMES / stride as f64).max(1.0);
        let joints = self.joints().iter().enumerate().map(|(j, joint)| {
            let [inner, outer] = self.links_of(j).map(|link| &fits[link]);
            let pose = |row: usize| Some((inner[row].pose()?, outer[row].pose()?));
            std::array::from_fn::<_, PARTS, _>(|i| {
                let [begin, end] = [i, i + 1].map(|part| from.start + part * rows / PARTS);
                let firsts = (begin..end).step_by(stride * NEIGHBOURS);
                let run = |first: usize| (first..end.min(first + NEIGHBOURS)).filter_map(pose);
                joint.equations(firsts.map(run))
            })
        });
        let joints: Vec<[NormalEquations<4>; PARTS]> = joints.collect();
        let estimates = std::array::from_fn(|i| self.fitted(&joints, Some(i), alike));
        (self.fitted(&joints, None, alike), estimates)
    }

    /// Solves for the joint positions without the part `left_out` of the trial, or with all parts if it is `None`. A
    /// prior with the given weight keeps the positions near those of this linkage.
    fn fitted(
        &self,
        joints: &[[NormalEquations<4>; PARTS]],
        left_out: Option<usize>,
        weight: f64,
    ) -> Self {
        let mut fitted = *self;
        for (joint, parts) in fitted.joints.iter_mut().zip(joints) {
            let kept = parts.iter().enumerate().filter(|(i, _)| Some(*i) != left_out);
            let mut equations = NormalEquations::sum(kept.map(|(_, part)| part));
            equations.matrix += Matrix4::identity() * (APART_MM / POSITION_MM).powi(2) * weight;
            if let Some((moved, _)) = equations.solve() {
                *joint = joint.moved(&moved);
            }
        }
        fitted
    }

    /// Iterates over the positions of the joints from front to rear, each in the frames of its two links (see
    /// [`Linkage::links_of`]), mm.
    pub(crate) fn ends(&self) -> impl Iterator<Item = [f64; 2]> {
        self.joints().iter().flat_map(|joint| [joint.in_inner, joint.in_outer])
    }

    /// Returns the distance between the positions of each joint according to its two links, along and across the link
    /// towards link 0, given the links' own poses and the frame number of each row: one value per frame of the grid
    /// (first frame and number of frames), mm; NaN where a link has no pose.
    pub(crate) fn gaps<'f>(
        &'f self,
        fits: &'f [Vec<LinkFit>],
        numbers: &'f [i64],
        [first_frame, frames]: [i64; 2],
    ) -> impl Iterator<Item = Vec<f64>> + 'f {
        let sides = (0..self.links - 1).flat_map(|joint| [(joint, 0), (joint, 1)]);
        sides.map(move |(index, axis)| {
            let joint = self.joints[index];
            let mut gaps_mm = vec![f64::NAN; frames as usize];
            let [inner, outer] = self.links_of(index).map(|link| &fits[link]);
            for ((inner, outer), number) in inner.iter().zip(outer).zip(numbers) {
                let (Some(inner), Some(outer)) = (inner.pose(), outer.pose()) else { continue };
                let [a, b] = [inner.at(joint.in_inner), outer.at(joint.in_outer)];
                let gap = rotated(-inner.theta_rad, [b[0] - a[0], b[1] - a[1]]);
                gaps_mm[(number - first_frame) as usize] = gap[axis];
            }
            gaps_mm
        })
    }

    /// Returns the largest distance between the positions of the same joint in two linkages, mm.
    pub(crate) fn distance_mm(&self, other: &Self) -> f64 {
        let pairs = self.ends().zip(other.ends());
        pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
    }

    /// Fits the poses of the links, which are given by number according to each link's own markers, such that adjacent
    /// links meet at their joints. A link without a pose remains without one and separates the links before it from
    /// those behind it, unless it has no markers and both its neighbours have poses. The residuals become the RMS
    /// distances of the markers from the new poses.
    pub(crate) fn close(&self, poses: &mut [Option<LinkPose>]) {
        let mut start = 0;
        while start < self.links {
            let is_in =
                |place: usize| poses[self.order[place]].is_some() || self.is_bridged(poses, place);
            let end = (start..self.links).find(|place| !is_in(*place)).unwrap_or(self.links);
            if end > start + 1
                && let Some(closed) = self.closed(poses, start..end)
            {
                for place in start..end {
                    let link = self.order[place];
                    poses[link] = Some(self.posed(place, poses[link].as_ref(), &closed));
                }
            }
            start = end + 1;
        }
    }

    /// Returns, for each of the linkages `others`, the changes in the position of link 0's origin, mm, and in the
    /// headings of the links by number, rad, in a frame if that linkage replaced this one, to first order in the joint
    /// positions; `None` if a link that has markers has no pose, or if the poses do not determine the changes.
    pub(crate) fn shifts<const N: usize>(
        &self,
        own: &[Option<LinkPose>],
        others: &[Self; N],
    ) -> Option<[Step; N]> {
        let is_in = |place: usize| own[self.order[place]].is_some() || self.is_bridged(own, place);
        if !(0..self.links).all(is_in) {
            return None;
        }
        let closed = self.closed(own, 0..self.links)?;
        let here = self.step(own, &closed)?;
        let mut shifts = [here; N];
        let mut moved = closed;
        for (shift, other) in shifts.iter_mut().zip(others) {
            other.place(&mut moved);
            let there = other.step(own, &moved)?;
            shift.origin_mm -= there.origin_mm;
            for (turn, there) in shift.turn_rad.iter_mut().zip(there.turn_rad) {
                *turn -= there;
            }
        }
        Some(shifts)
    }

    /// Returns whether a link, given by its index in `order`, has no markers but a neighbour with a pose on either side.
    fn is_bridged(&self, own: &[Option<LinkPose>], place: usize) -> bool {
        self.is_bare[self.order[place]]
            && (1..self.links - 1).contains(&place)
            && [place - 1, place + 1].iter().all(|place| own[self.order[*place]].is_some())
    }

    /// Fits the poses of neighbouring links, given by their indices in `order`; `None` if the poses of their own
    /// markers do not determine them.
    fn closed(&self, own: &[Option<LinkPose>], places: Range<usize>) -> Option<Closed> {
        let root = self.reference.clamp(places.start, places.end - 1);
        let mut closed = Closed {
            places: places.clone(),
            root,
            seen_mm: [Vector2::zeros(); MAX_LINKS],
            origins: [Vector2::zeros(); MAX_LINKS],
            theta_rad: [0.0; MAX_LINKS],
            turns: [UnitComplex::identity(); MAX_LINKS],
        };
        for place in places {
            let pose = own[self.order[place]];
            closed.theta_rad[place] = match pose {
                Some(pose) => pose.theta_rad,
                None => {
                    let [behind, ahead] = self.neighbouring_joints_mm(own, place)?;
                    let local = self.position_on(place - 1, place);
                    let local_behind = self.position_on(place, place);
                    let direction = |a: [f64; 2], b: [f64; 2]| (b[1] - a[1]).atan2(b[0] - a[0]);
                    direction(behind, ahead) - direction(local_behind, local)
                }
            };
            closed.turns[place] = UnitComplex::new(closed.theta_rad[place]);
            if let Some(LinkPose { origin_mm, moments, .. }) = pose {
                closed.seen_mm[place] = Vector2::from(origin_mm)
                    + closed.turns[place] * Vector2::from(moments.centre_mm);
            }
        }
        closed.origins[root] = match own[self.order[root]] {
            Some(pose) => pose.origin_mm.into(),
            None => {
                let [_, ahead] = self.neighbouring_joints_mm(own, root)?;
                let arm = Vector2::from(self.position_on(root - 1, root));
                Vector2::from(ahead) - closed.turns[root] * arm
            }
        };
        self.place(&mut closed);
        for _ in 0..MAX_STEPS {
            // If the markers of every link determine its heading, the matrix is positive definite.
            let step = self.step(own, &closed)?;
            closed.origins[root] -= step.origin_mm;
            for place in closed.places.clone() {
                closed.theta_rad[place] -= step.turn_rad[self.order[place]];
                closed.turns[place] = UnitComplex::new(closed.theta_rad[place]);
            }
            self.place(&mut closed);
            if step.turn_rad.iter().fold(0.0, |max, turn| turn.abs().max(max)) < SMALL_RAD {
                break;
            }
        }
        Some(closed)
    }

    /// Returns the positions of the joints behind and ahead of a link, given by its index in `order`, according to its
    /// two neighbours, mm.
    fn neighbouring_joints_mm(
        &self,
        own: &[Option<LinkPose>],
        place: usize,
    ) -> Option<[[f64; 2]; 2]> {
        let behind = own[self.order[place + 1]]?.at(self.position_on(place, place + 1));
        let ahead = own[self.order[place - 1]]?.at(self.position_on(place - 1, place - 1));
        Some([behind, ahead])
    }

    /// Sets the positions of the links' origins, given that of the root and the headings.
    fn place(&self, closed: &mut Closed) {
        for place in closed.outwards() {
            let (inner, to_joint, to_origin) = self.arms(closed, place);
            closed.origins[place] = closed.origins[inner]
                + closed.turns[inner] * to_joint
                + closed.turns[place] * to_origin;
        }
    }

    /// Returns, for a link other than the root, the index in `order` of the next link towards the root, and the
    /// vectors from that link's origin to the joint between them, in that link's frame, and from the joint to the
    /// link's own origin, in its own frame.
    fn arms(&self, closed: &Closed, place: usize) -> (usize, Vector2<f64>, Vector2<f64>) {
        let (inner, joint) =
            if place < closed.root { (place + 1, place) } else { (place - 1, place - 1) };
        let [to_joint, to_origin] = [inner, place].map(|place| self.position_on(joint, place));
        (inner, to_joint.into(), -Vector2::from(to_origin))
    }

    /// Computes the Gauss-Newton step, to be subtracted from the position of the root's origin and from the headings of
    /// the links; `None` if the poses do not determine it. The heading of the outermost link affects only that link's
    /// markers and is therefore eliminated first, then that of the next one.
    fn step(&self, own: &[Option<LinkPose>], at: &Closed) -> Option<Step> {
        let root = at.root;
        let mut forms = [Form::default(); MAX_LINKS];
        let mut eliminated = [(Vector3::zeros(), 0.0); MAX_LINKS];
        if let Some(pose) = &own[self.order[root]] {
            forms[root].add_markers(pose, at, root);
        }
        for place in (at.places.start..root).chain((root + 1..at.places.end).rev()) {
            let (inner, to_joint, to_origin) = self.arms(at, place);
            let inner_arm = at.turns[inner] * to_joint;
            let p = perpendicular(inner_arm);
            let pose = &own[self.order[place]];
            let is_outermost = place == at.places.start || place + 1 == at.places.end;
            let (coupling, own_step, stiffness) = match pose {
                Some(LinkPose { theta_rad, moments, .. }) if is_outermost => {
                    let Form { normal, gradient } = &mut forms[inner];
                    let markers = moments.markers;
                    let turning = moments.turning_mm2;
                    let own_arm = at.turns[place] * (to_origin + Vector2::from(moments.centre_mm));
                    let off = at.origins[inner] + inner_arm + own_arm - at.seen_mm[place];
                    let slope = turning * (at.theta_rad[place] - theta_rad).sin();
                    // Derivative of `off` with respect to the heading of this link; `p` is that of the inner link.
                    let b = perpendicular(own_arm);
                    add_point(normal, gradient, markers, off, p);
                    let stiffness = markers * (b.x * b.x + b.y * b.y) + turning;
                    let coupling =
                        Vector3::new(b.x, b.y, p.x * b.x + p.y * b.y) * (markers / stiffness);
                    let own_step = (markers * (b.x * off.x + b.y * off.y) + slope) / stiffness;
                    (coupling, own_step, stiffness)
                }
                _ => {
                    if let Some(pose) = pose {
                        forms[place].add_markers(pose, at, place);
                    }
                    // Substitutes the link's position by that of the inner link and both headings.
                    let Form { normal, gradient } = forms[place].symmetric();
                    let b = perpendicular(at.turns[place] * to_origin);
                    let of_inner = Matrix3::new(1.0, 0.0, p.x, 0.0, 1.0, p.y, 0.0, 0.0, 0.0);
                    let of_own = Vector3::new(b.x, b.y, 1.0);
                    let pull = normal * of_own;
                    let stiffness = of_own.dot(&pull);
                    if stiffness <= 0.0 {
                        return None;
                    }
                    forms[inner].normal += of_inner.transpose() * normal * of_inner;
                    forms[inner].gradient += of_inner.transpose() * gradient;
                    let coupling = of_inner.transpose() * pull / stiffness;
                    (coupling, of_own.dot(&gradient) / stiffness, stiffness)
                }
            };
            let Form { normal, gradient } = &mut forms[inner];
            *normal -= coupling * coupling.transpose() * stiffness;
            *gradient -= coupling * (own_step * stiffness);
            eliminated[place] = (coupling, own_step);
        }
        // Cholesky reads the lower triangle only.
        let solution = forms[root].normal.cholesky()?.solve(&forms[root].gradient);
        let mut steps = [Vector3::zeros(); MAX_LINKS];
        steps[root] = solution;
        for place in at.outwards() {
            let (inner, to_joint, to_origin) = self.arms(at, place);
            let (coupling, own_step) = eliminated[place];
            let turn = own_step - coupling.dot(&steps[inner]);
            let p = perpendicular(at.turns[inner] * to_joint) * steps[inner].z;
            let moved = steps[inner].xy() + p + perpendicular(at.turns[place] * to_origin) * turn;
            steps[place] = Vector3::new(moved.x, moved.y, turn);
        }
        let mut turn_rad = [0.0; MAX_LINKS];
        for place in at.places.clone() {
            turn_rad[self.order[place]] = steps[place].z;
        }
        Some(Step { origin_mm: solution.xy(), turn_rad })
    }

    /// Returns the pose of a link, given by its index in `order`, according to `closed`, in which adjacent links meet at
    /// their joints, given the pose from the link's own markers if it has any.
    fn posed(&self, place: usize, own: Option<&LinkPose>, closed: &Closed) -> LinkPose {
        let theta_rad = wrap(closed.theta_rad[place]);
        let origin_mm = closed.origins[place];
        let Some(own) = own else {
            let origin_mm = origin_mm.into();
            return LinkPose { origin_mm, theta_rad, residual_mm: f64::NAN, ..LinkPose::default() };
        };
        let moments = &own.moments;
        let centre = closed.turns[place] * Vector2::from(moments.centre_mm);
        let off = origin_mm + centre - closed.seen_mm[place];
        let half_turn = (0.5 * (closed.theta_rad[place] - own.theta_rad)).sin();
        let turning = 4.0 * moments.turning_mm2 * half_turn * half_turn;
        let squares = own.residual_mm.powi(2) + off.x * off.x + off.y * off.y;
        let residual_mm = (squares + turning / moments.markers).sqrt();
        LinkPose { origin_mm: origin_mm.into(), theta_rad, residual_mm, ..*own }
    }
}

/// Sum of the squared marker residuals of a link, and of those links that are connected to the root through it, as a
/// quadratic form in the position of the link's origin and in its heading. The matrix is in the lower triangle.
#[derive(Debug, Clone, Copy, Default)]
struct Form {
    normal: Matrix3<f64>,
    gradient: Vector3<f64>,
}

impl Form {
    /// Adds the residuals of a link's own markers.
    fn add_markers(&mut self, pose: &LinkPose, at: &Closed, place: usize) {
        let LinkPose { theta_rad, moments, .. } = pose;
        let turning = moments.turning_mm2;
        let arm = at.turns[place] * Vector2::from(moments.centre_mm);
        let off = at.origins[place] + arm - at.seen_mm[place];
        let Self { normal, gradient } = self;
        add_point(normal, gradient, moments.markers, off, perpendicular(arm));
        normal[(2, 2)] += turning;
        gradient[2] += turning * (at.theta_rad[place] - theta_rad).sin();
    }

    fn symmetric(mut self) -> Self {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            self.normal[(i, j)] = self.normal[(j, i)];
        }
        self
    }
}

/// Adds to the normal equations for a position and a heading the squared distance `off` of a point, with a weight, given
/// the derivative `p` of the point with respect to the heading.
fn add_point(
    normal: &mut Matrix3<f64>,
    gradient: &mut Vector3<f64>,
    weight: f64,
    off: Vector2<f64>,
    p: Vector2<f64>,
) {
    let turn = p.x * off.x + p.y * off.y;
    normal[(0, 0)] += weight;
    normal[(1, 1)] += weight;
    normal[(2, 0)] += weight * p.x;
    normal[(2, 1)] += weight * p.y;
    normal[(2, 2)] += weight * (p.x * p.x + p.y * p.y);
    *gradient += Vector3::new(off.x, off.y, turn) * weight;
}

/// Change in the position of the root's origin, mm, and in the headings of the links by number, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    pub origin_mm: Vector2<f64>,
    pub turn_rad: [f64; MAX_LINKS],
}

/// Positions of neighbouring links in a frame, such that adjacent links meet at their joints. The links are given by
/// their indices from front to rear.
struct Closed {
    places: Range<usize>,
    /// Link whose position is an unknown of the fit: link 0, or the one closest to it.
    root: usize,
    /// Centroids of the links' markers according to the poses fitted to each link separately, mm.
    seen_mm: [Vector2<f64>; MAX_LINKS],
    origins: [Vector2<f64>; MAX_LINKS],
    theta_rad: [f64; MAX_LINKS],
    turns: [UnitComplex<f64>; MAX_LINKS],
}

impl Closed {
    /// Iterates over the links other than the root such that each follows the next link towards the root.
    fn outwards(&self) -> impl Iterator<Item = usize> + use<> {
        let Self { places, root, .. } = self;
        (places.start..*root).rev().chain(root + 1..places.end)
    }
}

/// Returns the derivative of a rotated lever arm with respect to the rotation angle: the arm turned by 90 degrees.
fn perpendicular(arm: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-arm.y, arm.x)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector5;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_robot::Robot;
    use trilink_tables::config::Config;

    use super::*;
    use crate::markers::labels::Outlier;
    use crate::markers::rigid;

    type Pairs = Vec<([f64; 2], [f64; 2])>;

    fn linkage(robot: &Robot) -> Linkage {
        Linkage::new(&Geometry::of_robot(robot), |_| false)
    }

    /// Returns the pose of a link of a linkage for the coordinates `q` (position of link 0's axle, mm, and headings,
    /// rad), for tests in which the centroids do not matter.
    fn posed(linkage: &Linkage, link: usize, own: &LinkPose, q: &Vector5<f64>) -> LinkPose {
        let theta_rad =
            std::array::from_fn(|place| q.get(2 + linkage.order[place]).copied().unwrap_or(0.0));
        let mut closed = Closed {
            places: 0..3,
            root: 1,
            seen_mm: [Vector2::zeros(); MAX_LINKS],
            origins: [q.xy(); MAX_LINKS],
            theta_rad,
            turns: theta_rad.map(UnitComplex::new),
        };
        linkage.place(&mut closed);
        linkage.posed([1, 0, 2][link], Some(own), &closed)
    }

    fn close(linkage: &Linkage, mut own: [Option<LinkPose>; 3]) -> [Option<LinkPose>; 3] {
        linkage.close(&mut own);
        own
    }

    /// Returns local positions and noisy recorded positions of the default layout's markers in one frame.
    fn pairs(q: &Vector5<f64>, noise_mm: f64) -> [Pairs; 3] {
        let linkage = self::linkage(&Robot::kinematic());
        let config = Config::default();
        let mut k = 0.0_f64;
        [0, 1, 2].map(|link| {
            let own = LinkPose {
                origin_mm: [0.0; 2],
                theta_rad: 0.0,
                residual_mm: 0.0,
                moments: rigid::MarkerMoments { markers: 1.0, ..Default::default() },
            };
            let pose = posed(&linkage, link, &own, q);
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
        let linkage = self::linkage(&Robot::kinematic());
        let own = own(pairs);
        let mut sums = [0.0; 3];
        for (link, sum) in sums.iter_mut().enumerate() {
            let pose = posed(&linkage, link, &own[link].unwrap(), q);
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
        let closed = close(&linkage(&Robot::kinematic()), own);
        for (own, closed) in own.into_iter().flatten().zip(closed.into_iter().flatten()) {
            assert!((own.theta_rad - closed.theta_rad).abs() < 1e-12);
            assert!((own.origin_mm[0] - closed.origin_mm[0]).abs() < 1e-9);
            assert!(closed.residual_mm < 1e-6);
        }
    }

    #[test]
    fn noisy_poses_become_the_least_squares_of_all_markers_with_closed_joints() {
        let pairs = pairs(&Vector5::from(Q), 1.0);
        let linkage = self::linkage(&Robot::kinematic());
        let closed = close(&linkage, own(&pairs)).map(Option::unwrap);
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
        let right = linkage(&Robot::kinematic());
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
        let wrong = linkage(&robot);
        assert!((wrong.distance_mm(&right) - 2.0).abs() < 1e-9);
        assert!(wrong.refined(&fits, 0..2000).0.distance_mm(&right) < 0.3);
        // A joint that does not turn determines only the sum of the two positions.
        let still = fits.map(|fits: Vec<LinkFit>| vec![fits[0]; 200]);
        let (refined, _) = wrong.refined(&still, 0..200);
        let [middle, front] = [0, 1].map(|link| still[link][0].pose().unwrap());
        let positions = refined.joints[0];
        let a = middle.at(positions.in_inner);
        let b = front.at(positions.in_outer);
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.1);
        assert!(refined.distance_mm(&wrong) < 2.0);
    }

    #[test]
    fn noise_does_not_bias_the_joints_of_links_that_turn_little() {
        let right = linkage(&Robot::kinematic());
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
        let here = linkage(&Robot::kinematic());
        let mut there = here;
        there.joints[0] = there.joints[0].moved(&Vector4::new(0.1, -0.2, 0.05, 0.1));
        let [shift] = here.shifts(&own, &[there]).unwrap();
        let poses = [here, there].map(|linkage| close(&linkage, own).map(Option::unwrap));
        let [a, b] = poses.map(|[middle, front, rear]| {
            let [x, y] = middle.origin_mm;
            let theta = [middle, front, rear].map(|pose| pose.theta_rad);
            Vector5::new(x, y, theta[0], theta[1], theta[2])
        });
        let [x, y] = shift.origin_mm.into();
        let shift = Vector5::new(x, y, shift.turn_rad[0], shift.turn_rad[1], shift.turn_rad[2]);
        let error = (b - a - shift).abs();
        assert!(shift.norm() > 0.05 && error.amax() < 1e-3 * shift.norm(), "{shift} {error}");
        assert_eq!(here.shifts(&[None, own[1], own[2]], &[there]), None);
    }

    #[test]
    fn an_occluded_link_has_no_pose_and_the_others_close_their_joint() {
        let pairs = pairs(&Vector5::from(Q), 1.0);
        let linkage = self::linkage(&Robot::kinematic());
        let all = own(&pairs);
        let closed = close(&linkage, [all[0], all[1], None]);
        assert_eq!(closed[2], None);
        let [middle, front] = [closed[0].unwrap(), closed[1].unwrap()];
        let joint = linkage.joints[0];
        let a = middle.at(joint.in_inner);
        let b = front.at(joint.in_outer);
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
        assert_eq!(close(&linkage, [None, all[1], all[2]]), [None, all[1], all[2]]);
        assert_eq!(close(&linkage, [all[0], None, None]), [all[0], None, None]);
    }
}
