//! The statements of the paper's section II about single shapes of the robot.

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};
use serde::Deserialize;

use crate::robot::{Robot, Trig, det_wb, mass_matrix, skid_rows};

/// A statement that can be checked by arithmetic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mechanics {
    /// Largest difference of eq. 1 from the wheels' velocities, m/s.
    Eq1,
    /// Rank of the constraints of the kinematic robot.
    Constraints,
    /// Unactuated degrees of freedom of the semi-passive robot less its constraints.
    FreeDirections,
    /// `det W_b` of eq. 1 over eq. 4.
    Eq4,
    /// Largest `det W_b` on both kinds of singular states, m.
    SingularStates,
    /// Largest part of the constraints that no body velocity meets where eq. 5 holds.
    Eq5,
    /// The same on `phi1 = phi2` where eq. 6 holds.
    Eq6,
    /// `det A` over `det(W_b)^2`, kinematic robot.
    DetAKinematic,
    /// Least `det A` over the largest, semi-passive robot.
    DetASemiPassive,
}

/// Shapes to look at, degrees: no two angles alike.
const SHAPES_DEG: [[f64; 2]; 6] =
    [[20.0, -35.0], [-50.0, 10.0], [61.0, 40.0], [-15.0, -70.0], [5.0, 30.0], [75.0, -44.0]];

impl Mechanics {
    pub fn value(self) -> f64 {
        let (robot, passive) = (Robot::kinematic(), Robot::semi_passive());
        match self {
            Self::Eq1 => shapes().map(|phi| eq1_difference(&robot, phi)).fold(0.0, f64::max),
            Self::Constraints => {
                let rank = |phi| rank(&DMatrix::from_fn(3, 5, |i, j| rows(&robot, phi)[i][j]));
                shapes().map(rank).fold(f64::INFINITY, f64::min)
            }
            Self::FreeDirections => {
                let rank = |phi| rank(&DMatrix::from_fn(3, 4, |i, j| rows(&passive, phi)[i][j]));
                4.0 - shapes().map(rank).fold(f64::INFINITY, f64::min)
            }
            Self::Eq4 => {
                farthest_from(1.0, shapes().map(|phi| det_eq1(&robot, phi) / eq4(&robot, phi)))
            }
            Self::SingularStates => singular_shapes(&robot)
                .chain(alike_shapes())
                .map(|phi| det_wb(&robot, &Trig::new(phi)).abs())
                .fold(0.0, f64::max),
            Self::Eq5 => singular_shapes(&robot)
                .map(|phi| unmet(&robot, phi, [phi[0].sin(), -phi[1].sin()]))
                .fold(0.0, f64::max),
            Self::Eq6 => {
                alike_shapes().map(|phi| unmet(&robot, phi, [1.0, -1.0])).fold(0.0, f64::max)
            }
            Self::DetAKinematic => farthest_from(
                -1.0,
                shapes().map(|phi| {
                    det_a::<3, 6>(&robot, phi) / det_wb(&robot, &Trig::new(phi)).powi(2)
                }),
            ),
            Self::DetASemiPassive => {
                let grid = || (-9..=9).map(|k| f64::from(10 * k).to_radians());
                let all = grid().flat_map(|phi1| grid().map(move |phi2| [phi1, phi2]));
                let (low, high) = all
                    .map(|phi| det_a::<4, 7>(&passive, phi))
                    .fold((f64::INFINITY, 0.0_f64), |(low, high), det| {
                        (low.min(det), high.max(det.abs()))
                    });
                low / high
            }
        }
    }
}

fn shapes() -> impl Iterator<Item = [f64; 2]> {
    SHAPES_DEG.into_iter().map(|phi| phi.map(f64::to_radians))
}

fn rows(robot: &Robot, phi_rad: [f64; 2]) -> [[f64; 5]; 3] {
    skid_rows(robot, &Trig::new(phi_rad))
}

fn farthest_from(value: f64, numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.max_by(|a, b| (a - value).abs().total_cmp(&(b - value).abs())).unwrap_or(f64::NAN)
}

fn rank(matrix: &DMatrix<f64>) -> f64 {
    matrix.rank(1e-9) as f64
}

/// `W` as eq. 1 prints it.
fn printed_w(robot: &Robot, theta: f64, [phi1, phi2]: [f64; 2]) -> SMatrix<f64, 3, 5> {
    let (h, l) = (robot.h_m, robot.l_m);
    SMatrix::from([
        [-theta.sin(), (phi1 - theta).sin(), -(phi2 + theta).sin()],
        [theta.cos(), (phi1 - theta).cos(), (phi2 + theta).cos()],
        [0.0, l + h * phi1.cos(), -l - h * phi2.cos()],
        [0.0, -l, 0.0],
        [0.0, 0.0, -l],
    ])
}

/// Places of the wheels for coordinates `(x, y, theta, phi1, phi2)`, m.
fn wheels(robot: &Robot, q: [f64; 5]) -> [[f64; 2]; 3] {
    let (h, l) = (robot.h_m, robot.l_m);
    let [x, y, theta, phi1, phi2] = q;
    let along = |[x, y]: [f64; 2], angle: f64, length: f64| {
        [x + length * angle.cos(), y + length * angle.sin()]
    };
    let middle = [x, y];
    let front = along(along(middle, theta, h), theta - phi1, l);
    let rear = along(along(middle, theta, -h), theta + phi2, -l);
    [middle, front, rear]
}

/// Largest difference of `W q'` from the velocities of the wheels across their links, by central
/// differences of their places, for unit rates of each coordinate.
fn eq1_difference(robot: &Robot, phi: [f64; 2]) -> f64 {
    const STEP: f64 = 1e-5;
    let theta = 0.4;
    let q = [0.3, -0.2, theta, phi[0], phi[1]];
    let w = printed_w(robot, theta, phi);
    let links = [theta, theta - phi[0], theta + phi[1]];
    let mut worst = 0.0_f64;
    for j in 0..5 {
        let at = |step: f64| {
            let mut moved = q;
            moved[j] += step;
            wheels(robot, moved)
        };
        let (low, high) = (at(-STEP), at(STEP));
        for i in 0..3 {
            let [vx, vy] = [0, 1].map(|k| (high[i][k] - low[i][k]) / (2.0 * STEP));
            let across = -links[i].sin() * vx + links[i].cos() * vy;
            worst = worst.max((across - w[(i, j)]).abs());
        }
    }
    worst
}

fn det_eq1(robot: &Robot, phi: [f64; 2]) -> f64 {
    let w = printed_w(robot, 0.4, phi);
    Matrix3::from_fn(|i, j| w[(i, j)]).determinant()
}

fn eq4(robot: &Robot, [phi1, phi2]: [f64; 2]) -> f64 {
    robot.h_m * (phi2 - phi1).sin() + robot.l_m * (phi2.sin() - phi1.sin())
}

/// Shapes on `phi1 = phi2`.
fn alike_shapes() -> impl Iterator<Item = [f64; 2]> {
    (-12..=12).map(|k| [f64::from(5 * k).to_radians(); 2])
}

/// Shapes with `h cos((phi2 - phi1) / 2) = -l cos((phi1 + phi2) / 2)`, the other factor of eq. 4.
fn singular_shapes(robot: &Robot) -> impl Iterator<Item = [f64; 2]> {
    let ratio = robot.l_m / robot.h_m;
    (-8..=8).map(move |k| {
        let middle = f64::from(10 * k).to_radians();
        let half = (-ratio * middle.cos()).acos();
        [middle - half, middle + half]
    })
}

/// Part of `W_s q_s'` that no body velocity meets at a singular shape.
fn unmet(robot: &Robot, phi: [f64; 2], rates: [f64; 2]) -> f64 {
    let rows = rows(robot, phi);
    let body = Matrix3::from_fn(|i, j| rows[i][j]);
    let driven = Vector3::from_fn(|i, _| rows[i][3] * rates[0] + rows[i][4] * rates[1]);
    let decomposed = body.svd(true, true);
    match decomposed.solve(&driven, 1e-9) {
        Ok(met) => (body * met - driven).norm() / driven.norm(),
        Err(_) => f64::NAN,
    }
}

/// Determinant of eq. 10's matrix `[[M_pp, -W_p^T], [W_p, 0]]` with `P` passive coordinates.
fn det_a<const P: usize, const N: usize>(robot: &Robot, phi: [f64; 2]) -> f64 {
    let trig = Trig::new(phi);
    let (mass, rows) = (mass_matrix(robot, &trig), skid_rows(robot, &trig));
    let entry = |i: usize, j: usize| match (i < P, j < P) {
        (true, true) => mass[i][j],
        (true, false) => -rows[j - P][i],
        (false, true) => rows[i - P][j],
        (false, false) => 0.0,
    };
    DMatrix::from_fn(N, N, entry).determinant()
}
